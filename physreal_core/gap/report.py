"""What the search for a missing effect returns: verdict, candidates, the gap before and after; plain records for gap.json."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any, Literal

from torch import Tensor

Kind = Literal["none", "effect", "effects", "class", "unknown"]


@dataclass(frozen=True)
class FittedEffect:
    """One effect with its coefficients as fitted on the training frames of all interactions.

    Args:
        name: in the registry.
        values, intervals, units: per coefficient; intervals hold 90 % of the posterior.
    """

    name: str
    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    units: dict[str, str]


@dataclass(frozen=True)
class Candidate:
    """One answer that was considered: no effect (empty), one effect or two.

    Args:
        effects: fitted.
        screened: gain in log evidence that the linear score test promised; None for an answer it does not rank.
        gain: log evidence above the baseline's, on the training frames of all interactions [nat]; None if it was not fitted.
        held_out: gain in the log likelihood of the held-out frames [nat].
        probability: among all answers.
        fields: the baseline's fields (as of `Model.fields`) refitted beside the effects.
        excess: what it leaves of the disagreement beyond noise and numerics on the training frames [nat].
        telling: per interaction, the share of what the effects do in the others that a fit to it alone would predict.
    """

    effects: tuple[FittedEffect, ...]
    screened: float | None
    gain: float | None = None
    held_out: float | None = None
    probability: float = 0.0
    fields: dict[str, Tensor] = field(default_factory=dict, repr=False)
    excess: float | None = None
    telling: tuple[float, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(effect.name for effect in self.effects)


@dataclass(frozen=True)
class Verdict:
    """What is missing.

    Args:
        kind: `none`; `effect` or `effects` (two at once); `class`: the data cannot tell the members apart; `unknown`: there is
            a gap and nothing in the library closes it.
        names: of the best answer; for a class its best member.
        members: answers of the reported class, the best first, at most three; each is a tuple of names.
        probability: that one of the members is right.
        sentence: for a person.
        next_motion: the action that would tell the members apart, or show what this motion cannot; "" if nothing is open.
    """

    kind: Kind
    names: tuple[str, ...]
    members: tuple[tuple[str, ...], ...]
    probability: float
    sentence: str
    next_motion: str = ""


@dataclass(frozen=True)
class Disagreement:
    """How far a model is from the measurement in one interval of frames of one interaction.

    Args:
        interaction: number of the interaction, 0 for the sequence itself.
        interval: `train` or `held_out`.
        metres: mean distance over the valid entries [m].
        rms: root mean square distance [m].
        noise_units: root of the mean squared residual in units of sensor noise.
        floor: what sensor noise alone would give as `rms` [m].
    """

    interaction: int
    interval: Literal["train", "held_out"]
    metres: float
    rms: float
    noise_units: float
    floor: float


@dataclass(frozen=True)
class GapReport:
    """The result of `find_gap`.

    Args:
        verdict: the answer.
        candidates: all that were considered, the most probable first.
        test: of any disagreement beyond noise and numerics: `statistic`, `degrees`, `p_value`, `excess_rms` [m].
        where: records of the maps, phases and the sentence, one per interaction.
        baseline: disagreement of the refitted baseline.
        fields: the refitted baseline's fields, as of `Model.fields`.
        information: expected whitened change per effect beyond baseline and numerics, one row per interaction.
        numerical_floor: root mean square change of the baseline by its own discretisation [m], per interaction.
        settings: that the search ran with.
        lead: for an unknown effect, the disagreement as a force field and a formula (`unknown.Lead`); None otherwise.
    """

    verdict: Verdict
    candidates: tuple[Candidate, ...]
    test: dict[str, float]
    where: tuple[dict[str, Any], ...]
    baseline: tuple[Disagreement, ...]
    fields: dict[str, Tensor] = field(repr=False)
    information: tuple[dict[str, float], ...] = ()
    numerical_floor: tuple[float, ...] = ()
    settings: dict[str, Any] = field(default_factory=dict)
    lead: dict[str, Any] | None = None

    @property
    def best(self) -> Candidate:
        """The candidate that the verdict names."""
        return next(c for c in self.candidates if c.names == self.verdict.names)

    def as_record(self) -> dict[str, Any]:
        """JSON-able; tensors are left out, the models beside gap.json hold them."""
        return _plain(self)


@dataclass(frozen=True)
class Added:
    """The result of `add_effect`: the named effect in the model, and what it did to frames and interactions it never saw.

    Args:
        adopted: whether the held-out gap shrank; otherwise the model stays as it was.
        effects: as they go into the model, refitted; empty if not adopted.
        fields: the model's fields beside them.
        before, after: disagreement of the baseline and of the model with the effect. Both fitted on the training frames of
            one interaction alone, `fitted_on`; every other one is held out as a whole.
        runner_up: the same of the next best answer, whose names are `runner_up_names`.
        fitted_on: number of the interaction.
        numerical_floor: root mean square change of the simulation by its own discretisation [m], per interaction.
        closed: 1 - after / before of the held-out mean square gap above the sensor's floor; negative where it grew.
    """

    adopted: bool
    effects: tuple[FittedEffect, ...]
    fields: dict[str, Tensor] = field(repr=False)
    before: tuple[Disagreement, ...] = ()
    after: tuple[Disagreement, ...] = ()
    runner_up: tuple[Disagreement, ...] = ()
    runner_up_names: tuple[str, ...] = ()
    fitted_on: int = 0
    numerical_floor: tuple[float, ...] = ()
    closed: float = 0.0

    def as_record(self) -> dict[str, Any]:
        """JSON-able; tensors are left out."""
        return _plain(self)


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        entries = {entry.name: getattr(value, entry.name) for entry in dataclasses.fields(value)}
        return {name: _plain(entry) for name, entry in entries.items() if name != "fields"}
    if isinstance(value, dict):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    return value
