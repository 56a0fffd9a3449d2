"""A sparse formula for an unknown force, by orthogonal matching pursuit (Pati et al. 1993) on the tracks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize

from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError
from physreal_core.gap.lead.departure import Departure, explained_share
from physreal_core.gap.lead.force_library import RegionMotion, Term, attraction, library, places_around


class FormulaSearch:
    """Terms of a formula as whitened columns of all interactions, and fits of some of them.

    `over` fills in the library.

    Args:
        departures: of the interactions.
        motions: of their regions.
        grid: spacing of the places of attraction [m], shape [3].
    """

    def __init__(
        self, departures: Sequence[Departure], motions: Sequence[RegionMotion], grid: Float[Array, " 3"]
    ) -> None:
        self._departures, self._motions, self._grid = departures, motions, grid
        displacements = [departure.displacement for departure in departures]
        self._targets = {held_out: self._stacked(displacements, held_out) for held_out in (False, True)}
        self._columns: dict[Term, dict[bool, Array]] = {}

    @classmethod
    def over(cls, departures: Sequence[Departure]) -> FormulaSearch:
        """A search over the library's terms, and attractions to places in and around the body.

        Raises:
            InputError: there is no interaction.
        """
        if not departures:
            raise InputError("no interaction", expected="at least one")
        motions = [departure.motion() for departure in departures]
        everywhere = np.concatenate([motion.position.reshape(-1, 3) for motion in motions])
        origin = everywhere.mean(0)
        places, grid = places_around(everywhere)
        search = cls(departures, motions, grid)
        search._add(library(motions[0], origin)[0], [library(motion, origin)[1] for motion in motions])
        search._add([attraction(motions[0], place)[0] for place in places], search._attractions(places))
        return search

    def pursue(self, most: int, worth: float) -> list[Term]:
        """The best formula.

        A place costs three numbers, so a formula with one must be plainly better than one without.

        Args:
            most: largest number of terms.
            worth: share of the disagreement that a term must explain.
        """
        without = self._pursue([term for term in self._columns if term.place is None], most, worth)
        places = self._pruned(self._with_exact_places(self._pursue(list(self._columns), most, worth)), worth)
        return places if self._judged(places) > self._judged(without) + worth else without

    def fit(self, terms: Sequence[Term], *, held_out: bool = False) -> tuple[Float[Array, " C"], Float[Array, "C C"]]:
        """Coefficients of some terms on the training entries, and their covariance."""
        columns = self._among(terms, held_out)
        inverse = np.linalg.pinv(columns.T @ columns)
        return inverse @ (columns.T @ self._targets[held_out][:, 0]), inverse

    def share(self, terms: Sequence[Term], *, held_out: bool = False) -> float:
        """Share of the squared departure beyond noise that these terms explain, as fitted to the training entries."""
        target = self._targets[held_out][:, 0]
        if not terms or not len(target):
            return 0.0
        return explained_share(target, target - self._among(terms, held_out) @ self.fit(terms)[0])

    # --- steps of the pursuit -----------------------------------------------------------------------------------

    def _pursue(self, names: list[Term], most: int, worth: float) -> list[Term]:
        """Matching pursuit over these terms, up to the last one that explains enough."""
        columns = self._among(names, held_out=False)
        columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
        path = _matching_pursuit(columns, self._targets[False][:, 0], most)
        chosen: list[Term] = []
        for coefficients in path.T:
            used = [names[i] for i in np.flatnonzero(coefficients)]
            found = chosen + [term for term in used if term not in chosen]
            if self._judged(found) < self._judged(chosen) + worth:
                break
            chosen = found
        return chosen

    def _pruned(self, terms: list[Term], worth: float) -> list[Term]:
        """The terms without those that only made up for a place that was not exact yet."""
        for term in reversed(terms):
            rest = [other for other in terms if other is not term]
            if rest and self._judged(rest) > self._judged(terms) - worth:
                terms = rest
        return terms

    def _judged(self, terms: Sequence[Term]) -> float:
        """Explained share of the held-out entries, or of the training entries where nothing is held out."""
        return self.share(terms, held_out=len(self._targets[True]) > 0)

    def _with_exact_places(self, terms: list[Term]) -> list[Term]:
        """The terms with each attraction moved off the grid, to where it explains most of the training entries."""
        for number, term in enumerate(terms):
            if term.place is not None:
                rest = terms[:number] + terms[number + 1 :]
                found = minimize(
                    lambda place, rest=rest: -self.share([*rest, self._attraction(place)]),
                    np.array(term.place),
                    method="Nelder-Mead",
                    options={
                        "maxfev": 120,
                        "initial_simplex": term.place + 0.5 * np.vstack([np.zeros(3), np.diag(self._grid)]),
                    },
                )
                terms = [*terms[:number], self._attraction(found.x), *terms[number + 1 :]]
        return terms

    # --- columns ------------------------------------------------------------------------------------------------

    def _attraction(self, place: Array) -> Term:
        term = attraction(self._motions[0], place)[0]
        if term not in self._columns:
            self._add([term], self._attractions(place[None]))
        return term

    def _attractions(self, places: Float[Array, "places 3"]) -> list[Float[Array, "places T R 3"]]:
        return [np.stack([attraction(motion, place)[1] for place in places]) for motion in self._motions]

    def _add(self, terms: Sequence[Term], fields: Sequence[Float[Array, "C T R 3"]]) -> None:
        pairs = zip(self._departures, fields, strict=True)
        moved = [departure.responses.displacement(field) for departure, field in pairs]
        stacked = {held_out: self._stacked(moved, held_out) for held_out in (False, True)}
        for number, term in enumerate(terms):
            self._columns[term] = {held_out: stacked[held_out][:, number : number + 1] for held_out in (False, True)}

    def _stacked(self, fields: Sequence[Float[Array, "C T J 3"]], held_out: bool) -> Float[Array, "entries C"]:
        pairs = zip(self._departures, fields, strict=True)
        return np.concatenate([(own.held_out if held_out else own.train)(field) for own, field in pairs])

    def _among(self, terms: Sequence[Term], held_out: bool) -> Float[Array, "entries C"]:
        none = np.zeros((len(self._targets[held_out]), 0))
        return np.concatenate([none, *(self._columns[term][held_out] for term in terms)], 1)


def _matching_pursuit(columns: Float[Array, "n C"], target: Float[Array, " n"], most: int) -> Float[Array, "C most"]:
    """Coefficients with one, two, ... terms, by scikit-learn."""
    try:
        from sklearn.linear_model import orthogonal_mp_gram
    except ImportError as error:
        raise InputError(
            "scikit-learn is not installed",
            where="gap.lead",
            expected="its sparse regression, to find a formula",
            remedy="pip install 'physreal[gap]'",
        ) from error
    gram, along = columns.T @ columns, columns.T @ target
    path = orthogonal_mp_gram(gram, along, n_nonzero_coefs=most, return_path=True)
    return path.reshape(len(gram), -1)
