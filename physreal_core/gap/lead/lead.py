"""A disagreement that nothing in the library of effects explains, as a force field, and a sparse formula for it: a lead for a
person, not a verdict.

The force is first found without a formula, per region of the body and stretch of time, then as few terms of position,
velocity and strain by orthogonal matching pursuit (Pati et al. 1993) on what they do to the tracks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

from physreal_core.array_types import Array, Bool, Float
from physreal_core.errors import InputError
from physreal_core.gap.lead.force_library import RegionMotion, Term, attraction, library, places_around, region_motion
from physreal_core.gap.lead.responses import Responses

Whiten = Callable[[Float[Array, "C T J 3"]], Float[Array, "entries C"]]


@dataclass(frozen=True)
class Scene:
    """One interaction.

    Args:
        simulated, measured: tracks [m], shape [T, J, 3].
        valid: [T, J].
        fps: frames per second.
        responses: of the tracks to forces on the regions.
        weights: share of each region in every track, shape [J, R].
        train, held_out: fields [m] over all frames to whitened entries of the training and the held-out frames.
    """

    simulated: Float[Array, "T J 3"]
    measured: Float[Array, "T J 3"]
    valid: Bool[Array, "T J"]
    fps: float
    responses: Responses
    weights: Float[Array, "J R"]
    train: Whiten
    held_out: Whiten

    @property
    def departure(self) -> Float[Array, "1 T J 3"]:
        """Measured - simulated [m], zero where nothing was measured."""
        return np.where(self.valid[..., None], self.measured - self.simulated, 0.0)[None]

    def motion(self) -> RegionMotion:
        """Of the regions, as measured."""
        return region_motion(self.simulated, self.measured, self.valid, self.weights, self.fps)


@dataclass(frozen=True)
class FittedTerm:
    """A term with its coefficient and standard deviation, and the share of the training gap that the formula explains with it
    in place and all before it."""

    term: Term
    coefficient: float
    deviation: float
    explained: float


@dataclass(frozen=True)
class ForceField:
    """Force per mass [m/s2] without a formula, per stretch of time and region; its place, velocity and strain.

    Args:
        frames: middle of each stretch, shape [K].
        acceleration, deviation: [m/s2], shape [K, R, 3].
        position: [m], velocity: [m/s], shape [K, R, 3]; swelling: [1], shape [K, R].
        explained: share of the training gap that it explains.
    """

    frames: Float[Array, " K"]
    acceleration: Float[Array, "K R 3"]
    deviation: Float[Array, "K R 3"]
    position: Float[Array, "K R 3"]
    velocity: Float[Array, "K R 3"]
    swelling: Float[Array, "K R"]
    explained: float


@dataclass(frozen=True)
class Lead:
    """What an unknown effect looks like.

    Args:
        terms: of the formula, in the order in which they were taken.
        explained, explained_held_out: share of the gap, beyond noise, that the formula takes out.
        fields: per interaction.
        sentence: for a person.
    """

    terms: tuple[FittedTerm, ...]
    explained: float
    explained_held_out: float
    fields: tuple[ForceField, ...]
    sentence: str

    @property
    def formula(self) -> str:
        """Force per mass, with numbers."""
        parts = [f"{fitted.coefficient:+.3g} {fitted.term.unit} · {fitted.term.named()}" for fitted in self.terms]
        return "f/m = " + (" ".join(parts) if parts else "0")

    def as_record(self) -> dict[str, Any]:
        """JSON-able."""
        fields = [{key: np.asarray(value).tolist() for key, value in asdict(field).items()} for field in self.fields]
        return asdict(self) | {"fields": fields, "formula": self.formula}


def find_lead(scenes: Sequence[Scene], *, most: int = 3, worth: float = 0.03, stretch: float = 0.2) -> Lead:
    """The disagreement of some interactions with one object as a force field and as a sparse formula.

    Args:
        scenes: the interactions.
        most: terms at most.
        worth: share of the held-out gap (of the training gap where nothing is held out) that a term must explain to be kept.
        stretch: [s]; the field is constant over such stretches of time.

    Raises:
        InputError: scikit-learn is not installed, or there is no scene.
    """
    if not scenes:
        raise InputError("no interaction", expected="at least one")
    search = _Search(scenes)
    terms = search.pursue(most, worth)
    values, covariance = search.fit(terms)
    shares = [search.share(terms[: count + 1]) for count in range(len(terms))]
    fitted = tuple(
        FittedTerm(term, float(value), float(np.sqrt(variance)), share)
        for term, value, variance, share in zip(terms, values, np.diag(covariance), shares, strict=True)
    )
    explained = shares[-1] if shares else 0.0
    held_out = search.share(terms, held_out=True)
    fields = tuple(force_field(scene, stretch) for scene in scenes)
    return Lead(fitted, explained, held_out, fields, _sentence(fitted, explained, held_out, fields))


def force_field(scene: Scene, stretch: float = 0.2) -> ForceField:
    """The force per mass that would close the gap of one interaction: least squares with a Gaussian prior whose width the data
    choose (evidence maximisation, MacKay 1992)."""
    frames, regions = len(scene.simulated), scene.weights.shape[1]
    length = max(1, round(stretch * scene.fps))
    starts = np.arange(0, frames, length)
    among = (np.arange(frames)[None] >= starts[:, None]) & (np.arange(frames)[None] < starts[:, None] + length)
    pushes = np.einsum("kt,rs,ac->kratsc", among.astype(float), np.eye(regions), np.eye(3))
    columns = scene.train(scene.responses.displacement(pushes.reshape(-1, frames, regions, 3)))
    target = scene.train(scene.departure)[:, 0]
    mean, deviation = _ridge(columns, target)
    motion, middle = scene.motion(), (starts + np.minimum(starts + length, frames) - 1) / 2.0
    shape, at = (len(starts), regions, 3), middle.astype(int)
    return ForceField(
        middle, mean.reshape(shape), deviation.reshape(shape),
        motion.position[at], motion.velocity[at], motion.swelling[at],
        _share(target, target - columns @ mean),
    )  # fmt: skip


def _ridge(columns: Float[Array, "n C"], target: Float[Array, " n"]) -> tuple[Float[Array, " C"], Float[Array, " C"]]:
    """Posterior mean and standard deviation of coefficients of mean zero and one common variance. The noise has a variance of
    one or, as far as the responses are no exact model, more."""
    values, vectors = np.linalg.eigh(columns.T @ columns)
    values = np.maximum(values, 0.0)
    along = vectors.T @ (columns.T @ target)

    def noise(ratio: float) -> float:
        return max(1.0, float(target @ target - (ratio * along**2 / (1.0 + ratio * values)).sum()) / len(target))

    def unlikely(ratio: float) -> float:
        left = float(target @ target - (ratio * along**2 / (1.0 + ratio * values)).sum())
        return len(target) * np.log(noise(ratio)) + left / noise(ratio) + float(np.log1p(ratio * values).sum())

    ratio = min(np.logspace(-8, 4, 61), key=unlikely)
    covariance = vectors / (values + 1.0 / ratio)
    return covariance @ along, np.sqrt(noise(ratio) * (covariance * vectors).sum(1))


class _Search:
    """The library's terms as whitened columns of all interactions, and fits of some of them."""

    def __init__(self, scenes: Sequence[Scene]) -> None:
        self._scenes, self._motions = scenes, [scene.motion() for scene in scenes]
        everywhere = np.concatenate([motion.position.reshape(-1, 3) for motion in self._motions])
        self._origin = everywhere.mean(0)
        self._targets = {held: self._stacked([s.departure for s in scenes], held) for held in (False, True)}
        self._columns: dict[Term, dict[bool, Array]] = {}
        terms, _ = library(self._motions[0], self._origin)
        self._add(terms, [library(motion, self._origin)[1] for motion in self._motions])
        places, self._grid = places_around(everywhere)
        self._add([attraction(self._motions[0], place)[0] for place in places], self._attractions(places))

    def pursue(self, most: int, worth: float) -> list[Term]:
        """The best formula; a place is worth its three numbers only if the formula is plainly better than one without."""
        without = self._pursue([term for term in self._columns if term.place is None], most, worth)
        places = self._pruned(self._with_exact_places(self._pursue(list(self._columns), most, worth)), worth)
        return places if self._judged(places) > self._judged(without) + worth else without

    def _pruned(self, terms: list[Term], worth: float) -> list[Term]:
        """Without terms that stood in for a place that was not exact yet."""
        for term in reversed(terms):
            rest = [other for other in terms if other is not term]
            if rest and self._judged(rest) > self._judged(terms) - worth:
                terms = rest
        return terms

    def _pursue(self, names: list[Term], most: int, worth: float) -> list[Term]:
        """Orthogonal matching pursuit over these terms, up to the last one that explains enough."""
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

    def _judged(self, terms: Sequence[Term]) -> float:
        """Share explained of the held-out entries; of the training ones where nothing is held out."""
        return self.share(terms, held_out=len(self._targets[True]) > 0)

    def _with_exact_places(self, terms: list[Term]) -> list[Term]:
        """Each attraction moved from its place on the grid to where it explains most of the training entries."""
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

    def fit(self, terms: Sequence[Term], *, held_out: bool = False) -> tuple[Float[Array, " C"], Float[Array, "C C"]]:
        """Coefficients on the training entries, and their covariance."""
        columns = self._among(terms, held_out)
        inverse = np.linalg.pinv(columns.T @ columns)
        return inverse @ (columns.T @ self._targets[held_out][:, 0]), inverse

    def share(self, terms: Sequence[Term], *, held_out: bool = False) -> float:
        """Share of the squared departure, beyond noise, that these terms explain with coefficients from the training entries."""
        target = self._targets[held_out][:, 0]
        if not terms or not len(target):
            return 0.0
        return _share(target, target - self._among(terms, held_out) @ self.fit(terms)[0])

    def _attraction(self, place: Array) -> Term:
        term = attraction(self._motions[0], place)[0]
        if term not in self._columns:
            self._add([term], self._attractions(place[None]))
        return term

    def _attractions(self, places: Float[Array, "places 3"]) -> list[Float[Array, "places T R 3"]]:
        return [np.stack([attraction(motion, place)[1] for place in places]) for motion in self._motions]

    def _add(self, terms: Sequence[Term], fields: Sequence[Float[Array, "C T R 3"]]) -> None:
        moved = [scene.responses.displacement(field) for scene, field in zip(self._scenes, fields, strict=True)]
        stacked = {held: self._stacked(moved, held) for held in (False, True)}
        for number, term in enumerate(terms):
            self._columns[term] = {held: stacked[held][:, number : number + 1] for held in (False, True)}

    def _stacked(self, fields: Sequence[Float[Array, "C T J 3"]], held_out: bool) -> Float[Array, "entries C"]:
        pairs = zip(self._scenes, fields, strict=True)
        return np.concatenate([(scene.held_out if held_out else scene.train)(field) for scene, field in pairs])

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
            where="gap.unknown",
            expected="its sparse regression, to find a formula",
            remedy="pip install 'physreal[gap]'",
        ) from error
    gram, along = columns.T @ columns, columns.T @ target
    path = orthogonal_mp_gram(gram, along, n_nonzero_coefs=most, return_path=True)
    return path.reshape(len(gram), -1)


def _share(target: Float[Array, " n"], left: Float[Array, " n"]) -> float:
    """Share of the square of `target` beyond its noise (of variance one) that is not in `left`."""
    total = float(target @ target)
    excess = total - len(target)
    return float(np.clip((total - float(left @ left)) / excess, 0.0, 1.0)) if excess > 0 else 0.0


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
