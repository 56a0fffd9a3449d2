"""Named effects as a model file holds them: JSON-able records, checked against the registry."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

from physreal_core.effects import EFFECTS, Effect
from physreal_core.errors import InputError

Record = dict[str, Any]
"""`name`, `values`, and where known `intervals` (of 90 %), `units`, `probability`: of the effect, per coefficient."""


def effect_record(
    name: str,
    values: Mapping[str, float],
    *,
    intervals: Mapping[str, tuple[float, float]] | None = None,
    probability: float | None = None,
) -> Record:
    """The record of one effect; its units come from the registry. Raises InputError as `registered` does."""
    record: Record = {"name": name, "values": {key: float(value) for key, value in values.items()}}
    if intervals:
        record["intervals"] = {key: [float(low), float(high)] for key, (low, high) in intervals.items()}
    record["units"] = registered([record])[0].units
    if probability is not None:
        record["probability"] = float(probability)
    return record


def registered(records: Iterable[Record], where: str = "Model.effects") -> tuple[Effect, ...]:
    """The effects that records name, in their order.

    Raises:
        InputError: for a name that is not in the registry or stands twice, and for coefficients that are not the effect's own or
            lie outside their bounds.
    """
    found: dict[str, Effect] = {}
    for record in records:
        name = record.get("name")
        if name not in EFFECTS:
            raise InputError(f"effect {name!r}", where=where, expected=f"one of {', '.join(sorted(EFFECTS))}")
        if name in found:
            raise InputError(f"effect {name!r} twice", where=where, expected="every effect once")
        found[name] = EFFECTS[name]
        _check_values(EFFECTS[name], record.get("values", {}), f"{where}, {name}")
    return tuple(found.values())


def _check_values(effect: Effect, values: Mapping[str, float], where: str) -> None:
    own = {coefficient.name: coefficient for coefficient in effect.coefficients}
    if set(values) != set(own):
        raise InputError(f"coefficients {sorted(values)}", where=where, expected=f"{sorted(own)}")
    for name, value in values.items():
        lower, upper = own[name].lower, own[name].upper
        slack = 1e-9 * (upper - lower)  # a fit that ends on a bound may miss it by its rounding
        if not (math.isfinite(value) and lower - slack <= value <= upper + slack):
            expected = f"a number in [{lower:g}, {upper:g}] {own[name].unit}"
            raise InputError(f"{name} = {value:g}", where=where, expected=expected)
