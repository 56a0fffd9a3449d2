"""Results of the search for a missing effect: verdict, candidates, the gap before and after. They become gap.json."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any, Literal

from torch import Tensor

Kind = Literal["none", "effect", "effects", "class", "unknown", "not_searched"]


@dataclass(frozen=True)
class FittedEffect:
    """One effect with its coefficients, fitted to the training frames of all interactions.

    Args:
        name: in the registry.
        values, intervals, units: per coefficient; an interval covers 90 % of the posterior.
    """

    name: str
    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    units: dict[str, str]


@dataclass(frozen=True)
class Candidate:
    """One answer that was considered: no effect (empty), one effect or two.

    Args:
        effects: as fitted, or where the score test has its optimum.
        screened: gain in log evidence that the score test predicted [nat]; None for an answer that it does not rank.
        gain: gain in log evidence over the baseline, on the training frames of all interactions [nat]; None if not
            fitted.
        held_out: gain in log likelihood on the held-out frames [nat].
        probability: among all answers that were fitted.
        fields: the baseline's fields, as of `Model.fields`, refitted beside the effects.
        left: size of the smooth error that it leaves on the training frames [m], as of `ModelError.rms`.
        telling: per interaction, the share of what the effects do in the others that a fit to it alone would predict.
        elastic_law: beside the effects; None for the given model's own.
    """

    effects: tuple[FittedEffect, ...]
    screened: float | None
    gain: float | None = None
    held_out: float | None = None
    probability: float = 0.0
    fields: dict[str, Tensor] = field(default_factory=dict, repr=False)
    left: float | None = None
    telling: tuple[float, ...] = ()
    elastic_law: str | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(effect.name for effect in self.effects)


@dataclass(frozen=True)
class Verdict:
    """What is missing.

    Args:
        kind: `none`; `effect`; `effects` for two at once; `class` for several answers that the data cannot tell apart;
            `unknown` for a disagreement that nothing in the library explains; `not_searched` where nothing was asked.
        names: effects of the best answer; for a class, of its best member.
        members: answers of the class, the best first, at most three. Each is a tuple of names.
        probability: that one of the members is correct; None where nothing was asked.
        sentence: for a person.
        next_motion: the motion to film next, which would tell the members apart, and the second best; "" if nothing is
            open. Without a hand that holds the body, what shows each of the effects.
    """

    kind: Kind
    names: tuple[str, ...]
    members: tuple[tuple[str, ...], ...]
    probability: float | None
    sentence: str
    next_motion: str = ""


@dataclass(frozen=True)
class Disagreement:
    """The distance of a model from the measurement, in one interval of frames of one interaction.

    Args:
        interaction: number of the interaction, 0 for the sequence itself.
        interval: `train` or `held_out`.
        metres: mean distance over the valid entries [m].
        rms: root mean square distance [m].
        noise_units: root mean square distance in units of sensor noise.
        floor: noise floor [m]: the root mean square distance that sensor noise alone would give.
    """

    interaction: int
    interval: Literal["train", "held_out"]
    metres: float
    rms: float
    noise_units: float
    floor: float


@dataclass(frozen=True)
class Separation:
    """How far a motion parts two answers.

    Args:
        one, other: names of their effects.
        nats: expected gain in log evidence of the right one over the other, at the search's temperature [nat].
    """

    one: tuple[str, ...]
    other: tuple[str, ...]
    nats: float


@dataclass(frozen=True)
class ProposedMotion:
    """A motion of the hand that a person could film next.

    Args:
        name: in the library of motions.
        words: what to do.
        information: expected information about which answer of the class is right [nat].
        entropy: the most that there is to know: the entropy of the answers' probabilities [nat].
        rough: whether `information` is a first estimate, which leaves out numerical error and what the answers could
            imitate by other numbers.
        separations: of every pair of answers.
        recording: number of the interaction as in which the hand holds the object.
        fps: frames per second of the path.
        path: displacement of the hand since frame 0 in the world's frame, T triples [m].
    """

    name: str
    words: str
    information: float
    entropy: float
    rough: bool
    separations: tuple[Separation, ...]
    recording: int
    fps: float
    path: tuple[tuple[float, ...], ...] = field(repr=False)


@dataclass(frozen=True)
class GapReport:
    """The result of `find_gap`.

    Args:
        verdict: the answer.
        candidates: all that were considered, the most probable first.
        test: the global test for a disagreement beyond noise and numerical error: `statistic`, `degrees`, `p_value`;
            with `threshold`, the gain that is reached by chance [nat], and `explained`, the share that the best answer
            explains.
        where: one record per interaction, as of `Where.as_record`.
        baseline: disagreement of the refitted baseline.
        fields: of the refitted baseline, as of `Model.fields`.
        information: per interaction and effect, the whitened change by the effect at its scale that the baseline cannot
            imitate.
        numerical_floor: root mean square of the baseline's numerical error [m], per interaction.
        settings: candidates and seed of the search, and effects that were left out with the reason.
        lead: for an unknown effect, the record of a `Lead`: the disagreement as a force field and a formula. Else None.
        next_motions: motions that would tell the members of the verdict apart, the most informative first; empty where
            there are less than two.
        elastic_law: of the refitted baseline; None for the given model's own.
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
    next_motions: tuple[ProposedMotion, ...] = ()
    elastic_law: str | None = None

    @property
    def best(self) -> Candidate:
        """The candidate that the verdict names first."""
        return next(c for c in self.candidates if c.names == self.verdict.names)

    def as_record(self) -> dict[str, Any]:
        """The report as plain values, ready for JSON. Tensors are left out; gap.safetensors has them."""
        return _plain(self)


@dataclass(frozen=True)
class Added:
    """The result of `add_effect`: the effect in the model, and the gap before and after.

    Args:
        adopted: whether the gap shrank on held-out frames. If not, the model stays as it was.
        effects: as they go into the model; empty if not adopted.
        fields: of the model beside them.
        before, after: disagreement of the baseline and of the model with the effect. Both are fitted to the training
            frames of one interaction, `fitted_on`; every other interaction is held out as a whole.
        runner_up: disagreement of the next best answer, whose effects are `runner_up_names`.
        fitted_on: number of the interaction.
        numerical_floor: as of `GapReport`.
        closed: 1 - after / before of the held-out mean square distance beyond the noise floor; negative where it grew, not
            a number where one of the two models cannot be simulated through all frames.
        elastic_law: of that model; None for the given model's own.
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
    elastic_law: str | None = None

    def as_record(self) -> dict[str, Any]:
        """The result as plain values, ready for JSON, without tensors."""
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
