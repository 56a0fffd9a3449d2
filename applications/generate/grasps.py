"""Where a hand can take the body, and how well: each place is tried, by lifting the twin there."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace

import numpy as np

from applications.twin import Twin
from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError, SimulationError
from physreal_core.geometry import farthest_points
from physreal_core.playing import Session
from stages._evaluation import scattered

LIFT, RISING, HOLDING = 0.12, 0.8, 0.4
"""Height [m] and times [s] of the trial."""

OFF = 0.01
"""A particle this high above where it lay is off the table [m]."""

_SAMPLES = 2000


@dataclass(frozen=True)
class Hand:
    """Two fingers that press from both sides.

    Attributes:
        squeeze: force of each finger [N].
        friction: coefficient between finger and body.
    """

    squeeze: float = 10.0
    friction: float = 0.6

    @property
    def strength(self) -> float:
        """Largest pull before the body slips out [N]: Coulomb's law at both fingers."""
        return 2.0 * self.friction * self.squeeze


@dataclass(frozen=True)
class Grasp:
    """A place that was tried.

    Attributes:
        place: on the surface, where the body lies at rest [m].
        peak: largest pull while it was lifted [N].
        lifted: share of the mass that is off the table at the end.
        margin: share of the hand's strength that is left at the peak; below zero the body slips out.
    """

    place: tuple[float, float, float]
    peak: float
    lifted: float
    margin: float

    @property
    def holds(self) -> bool:
        """Whether the body does not slip out."""
        return self.margin > 0.0

    def record(self) -> dict:
        """As JSON has it."""
        return {**asdict(self), "holds": self.holds}


def candidates(twin: Twin, surface: Float[Array, "V 3"], count: int, seed: int) -> Float[Array, "count 3"]:
    """Places far from each other on the upper half of the surface, which a hand reaches from above.

    Args:
        twin: whose.
        surface: vertices of its mesh at rest [m].
        count: of the places.
        seed: of the sampling.
    """
    points, _ = scattered(replace(twin.mesh, vertices=surface), _SAMPLES, seed)
    upper = points[points[:, 2] >= np.median(points[:, 2])]
    return upper[farthest_points(upper, count, start=int(np.argmax(upper[:, 2])))]


def tried(session: Session, place: Float[Array, " 3"], hand: Hand) -> Grasp | None:
    """Lift the body by a place, in a session that rests; the session goes on from there. None where the simulation breaks off."""
    x0, mass = session.state.x.cpu().double().numpy(), session.masses
    rising, holding = round(RISING * session.fps), round(HOLDING * session.fps)
    handle, peak = session.take(place), 0.0
    try:
        for frame in range(rising + holding):
            session.move(handle, place + [0.0, 0.0, LIFT * min(1.0, (frame + 1) / rising)])
            session.step()
            peak = max(peak, float(np.linalg.norm(session.pull(handle).force)))
    except SimulationError:
        return None
    off = session.state.x.cpu().double().numpy()[:, 2] - x0[:, 2] > OFF
    return Grasp(tuple(place.tolist()), peak, float(mass[off].sum() / mass.sum()), 1.0 - peak / hand.strength)


def ranked(grasps: Iterable[Grasp | None]) -> list[Grasp]:
    """What was tried: grasps that hold before those that do not, then by what they lift, then by their margin.

    Raises:
        InputError: none of them could be simulated, or none holds.
    """
    known = sorted(
        (grasp for grasp in grasps if grasp is not None),
        key=lambda g: (g.holds, round(g.lifted, 1), g.margin),
        reverse=True,
    )
    if not known or not known[0].holds:
        least = min((grasp.peak for grasp in known), default=float("nan"))
        raise InputError(
            f"no grasp holds; the least pull is {least:.2g} N",
            where="physreal generate",
            expected="a hand that can lift the body",
            remedy="raise --squeeze",
        )
    return known
