"""A lead on an unknown effect: the disagreement as a force field and as a short formula. It is no verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from physreal_core.gap.lead.departure import Departure, ForceField, force_field
from physreal_core.gap.lead.force_library import Term
from physreal_core.gap.lead.formula import FormulaSearch


@dataclass(frozen=True)
class FittedTerm:
    """A term of the formula.

    Args:
        term: the term.
        coefficient, deviation: its coefficient and standard deviation.
        explained: share of the training disagreement that the formula up to this term explains.
    """

    term: Term
    coefficient: float
    deviation: float
    explained: float


@dataclass(frozen=True)
class Lead:
    """What an unknown effect looks like.

    Args:
        terms: of the formula, in the order in which they were taken.
        explained, explained_held_out: share of the disagreement beyond noise that the formula explains.
        fields: force field of each interaction.
        sentence: for a person.
    """

    terms: tuple[FittedTerm, ...]
    explained: float
    explained_held_out: float
    fields: tuple[ForceField, ...]
    sentence: str

    @property
    def formula(self) -> str:
        """The force per mass, with numbers."""
        parts = [f"{fitted.coefficient:+.3g} {fitted.term.unit} · {fitted.term.named()}" for fitted in self.terms]
        return "f/m = " + (" ".join(parts) if parts else "0")

    def as_record(self) -> dict[str, Any]:
        """The lead as plain values, ready for JSON."""
        fields = [{key: np.asarray(value).tolist() for key, value in asdict(field).items()} for field in self.fields]
        return asdict(self) | {"fields": fields, "formula": self.formula}


def find_lead(departures: Sequence[Departure], *, most: int = 3, worth: float = 0.03, stretch: float = 0.2) -> Lead:
    """Find a force field and a short formula for the disagreement of some interactions with one object.

    Args:
        departures: of the interactions.
        most: largest number of terms.
        worth: share of the held-out disagreement that a term must explain (of the training disagreement where nothing
            is held out).
        stretch: time over which the force field is constant [s].

    Raises:
        InputError: scikit-learn is not installed, or there is no interaction.
    """
    search = FormulaSearch.over(departures)
    terms = search.pursue(most, worth)
    values, covariance = search.fit(terms)
    shares = [search.share(terms[: count + 1]) for count in range(len(terms))]
    fitted = tuple(
        FittedTerm(term, float(value), float(np.sqrt(variance)), share)
        for term, value, variance, share in zip(terms, values, np.diag(covariance), shares, strict=True)
    )
    explained = shares[-1] if shares else 0.0
    held_out = search.share(terms, held_out=True)
    fields = tuple(force_field(departure, stretch) for departure in departures)
    return Lead(fitted, explained, held_out, fields, _sentence(fitted, explained, held_out, fields))


def _sentence(terms: tuple[FittedTerm, ...], explained: float, held_out: float, fields: tuple[ForceField, ...]) -> str:
    if not terms:
        # the mean over the body: neighbouring regions may push against one another without moving much
        size = max(float(np.sqrt((field.acceleration.mean(1) ** 2).sum(-1).mean())) for field in fields)
        return f"As a force on the body it would be about {size:.2g} N per kg, with no short formula of position, velocity and strain."
    words = " and ".join(fitted.term.words for fitted in terms)
    formula = " ".join(f"{fitted.coefficient:+.3g} {fitted.term.named()}" for fitted in terms)
    shares = f"which explains {explained:.0%} of the gap, {held_out:.0%} on held-out frames"
    if held_out < 0.5:
        return f"No short formula explains it well; as a force, nearest comes {words}: f/m = {formula}, {shares}."
    return f"As a force it looks like {words}: f/m = {formula}, {shares}."
