"""The motions of the library, ranked by what they would tell about which member of a class is right."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.gap.interactions.experiment import Experiment
from physreal_core.gap.interactions.interaction import Interaction
from physreal_core.gap.next_motion.hold import Hold
from physreal_core.gap.next_motion.information import entropy, expected_information, separations
from physreal_core.gap.next_motion.library import HandMotion, motions_for
from physreal_core.gap.next_motion.members import Member
from physreal_core.gap.next_motion.planned import planned_experiment
from physreal_core.gap.next_motion.prediction import Prediction
from physreal_core.gap.noise.model import ModelError
from physreal_core.gap.report import ProposedMotion, Separation

WHOLE = 3
"""Motions whose information is computed in full; the others keep their first estimate."""

CERTAIN = 0.99
"""Share of the entropy from which on a motion tells all. Of such motions, those come first that part the closest pair most."""


@dataclass(frozen=True)
class _Scored:
    """A motion with what it tells so far.

    Args:
        motion, path: of the library, displacement in the world [m].
        recording: number of the interaction whose hold it has.
        prediction: of the members.
        gram: products of their predictions.
        information: [nat].
        entropy: the most that there is to know [nat].
        rough: whether that is a first estimate.
    """

    motion: HandMotion
    path: Float[Array, "frames 3"]
    recording: int
    prediction: Prediction
    gram: Float[Array, "members members"]
    information: float
    entropy: float
    rough: bool = True

    @property
    def worth(self) -> tuple[float, float]:
        """The larger, the better: information, and where it is all that there is, the least separation of two members."""
        apart = separations(self.gram)[np.triu_indices(len(self.gram), 1)]
        return min(self.information, CERTAIN * self.entropy), float(apart.min())


def next_motions(
    experiments: Sequence[Interaction],
    members: Sequence[Member],
    error: ModelError,
    temperature: float,
    progress: Callable[[str], None] = lambda message: None,
) -> tuple[ProposedMotion, ...]:
    """The motions that a person could film next, the most informative first.

    Every motion is rolled out under every member, which gives a first estimate of its information. The motions with the
    largest estimates are computed in full, until the second best of them is ahead of all others or `WHOLE` are done.

    Args:
        experiments: interactions with the object so far. A motion has the hold of the first that allows it.
        members: answers that are to be told apart, the most probable first.
        error: size and smoothness of the model's own error.
        temperature: by which the search divides gains in evidence.
        progress: called with a line of text.

    Returns:
        Those computed in full first. None where there are less than two members, or where no hand holds the object.
    """
    if len(members) < 2:
        return ()
    begun, chances = time.perf_counter(), np.array([member.probability for member in members])
    waiting = list(_estimated(experiments, members, error, temperature, chances))
    done: list[_Scored] = []
    while waiting and not _settled(done, waiting):
        best = max(waiting, key=lambda scored: scored.worth)
        waiting.remove(best)
        gram = best.prediction.gram(temperature)
        done.append(replace(best, gram=gram, information=expected_information(chances, gram), rough=False))
    ranked = [*_sorted(done), *_sorted(waiting)]
    if ranked:
        progress(f"next motion: {len(ranked)} motions of the hand in {time.perf_counter() - begun:.0f} s")
    return tuple(_proposed(scored, members, experiments[scored.recording]) for scored in ranked)


def sentence_of(motions: Sequence[ProposedMotion]) -> str:
    """The best motion in words, with its information, and the second best; "" without any."""
    if not motions:
        return ""
    best, *others = motions
    said = f"{_held(best)} ({best.information:.2f} of at most {best.entropy:.2f} nat about which answer is right)"
    return said + "".join(f"; or: {_held(other)} ({other.information:.2f} nat)" for other in others[:1])


def _held(motion: ProposedMotion) -> str:
    return motion.words if motion.recording == 0 else f"{motion.words}, held as in recording {motion.recording + 1}"


def _estimated(
    experiments: Sequence[Interaction],
    members: Sequence[Member],
    error: ModelError,
    temperature: float,
    chances: Float[Array, " members"],
) -> Iterator[_Scored]:
    """All motions that some hold allows and all members can be simulated along, with first estimates."""
    known: set[str] = set()
    for number, experiment in enumerate(experiments):
        hold = Hold.of(experiment.setting) if isinstance(experiment, Experiment) else None
        for motion in motions_for(hold) if hold else ():
            if motion.name in known:
                continue
            known.add(motion.name)
            path = motion.path(hold, experiment.setting.fps)
            prediction = Prediction(planned_experiment(experiment, path), members, error)
            if not prediction.fails:
                gram = prediction.rough_gram(temperature)
                yield _Scored(
                    motion, path, number, prediction, gram, expected_information(chances, gram), entropy(chances)
                )


def _settled(done: Sequence[_Scored], waiting: Sequence[_Scored]) -> bool:
    """Whether the best two are known, or enough has been computed."""
    if len(done) < 2:
        return False
    second = sorted((scored.worth for scored in done), reverse=True)[1]
    return len(done) >= WHOLE or max(scored.worth for scored in waiting) < second


def _sorted(scored: Sequence[_Scored]) -> list[_Scored]:
    return sorted(scored, key=lambda one: one.worth, reverse=True)


def _proposed(scored: _Scored, members: Sequence[Member], experiment: Interaction) -> ProposedMotion:
    apart = separations(scored.gram)
    pairs = tuple(
        Separation(members[i].names, members[j].names, float(apart[i, j]))
        for i, j in combinations(range(len(members)), 2)
    )
    return ProposedMotion(
        scored.motion.name,
        scored.motion.words,
        scored.information,
        scored.entropy,
        scored.rough,
        pairs,
        scored.recording,
        experiment.setting.fps,
        tuple(tuple(round(float(x), 6) for x in place) for place in scored.path),
    )
