"""A cable held at both ends by robots, as a rod: recordings of its markers, where it starts, and how the hands hold it.

Recordings: `cable_mocap/cable1.npz`, `markers` [6, 500, 13, 3] m at 100 Hz, published with DEFORM (arXiv 2406.05931). The first two and the last
two markers are at the hands and lead the rod; the nine between are predicted.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from scipy.interpolate import CubicSpline

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.errors import InputError
from physreal_core.simulation import Grip, Parameters, SimulationConfig, Simulator, rod_body, untwisted_directors

FPS, MARKERS, PREDICTED = 100.0, 13, slice(2, 11)
LED = (0, 1, 11, 12)
RADIUS, DENSITY, POISSON = 0.005, 1300.0, 0.45
"""Of the section [m], which is not given, and of a cable with a sheath of PVC [kg/m3]; masses scale out of the motion."""
STRETCHING = 2.5e6
"""Young's modulus of stretching [Pa]: less than a cable's, for longer steps; its own weight stretches it by 0.4 %."""
HOLD, HOLD_DAMPING, REACH = 1e3, 1.0, 0.01
"""Bonds of a led vertex to four points around its marker: force at unit strain [N], dashpot [N s/m], distance of the points [m]."""
TWIST_LAG = 0.005
"""Retardation time of twisting [s]: a twist dies away within a fifth of a second, far faster than the cable swings."""
START_FRAMES = 6
"""Frames from which the velocities at the start are taken: the slope there of a parabola."""
TERMS = ("drag", "bending", "twisting", "rest_curvature", "retardation", "initial_director")
_POINTS = REACH * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)


def recordings(folder: Path) -> Float[Array, "recordings frames 13 3"]:
    """Markers [m] of all recordings in the folder of real ones.

    Raises:
        InputError: they are not there.
    """
    file = Path(folder) / "cable_mocap" / "cable1.npz"
    if not file.is_file():
        raise InputError(
            "no such recording",
            where=str(file),
            expected="cable_mocap/cable1.npz with `markers` [6, 500, 13, 3]",
            remedy="set PHYSREAL_REAL_DATA to the folder of real recordings, or skip this benchmark",
        )
    return np.load(file)["markers"].astype(np.float64)


@dataclass(frozen=True)
class Cable:
    """What is measured of the cable once, on the recording that is fitted.

    Attributes:
        gaps: lengths between markers along it [m], shape [12].
        hands: mean directions of the cable at the first and the last marker, unit vectors, shape [2, 3].
        parts: segments between two markers; the gaps at the hands, of 2 cm, are one segment.
    """

    gaps: Float[Array, 12]
    hands: Float[Array, "2 3"]
    parts: int = 2

    @classmethod
    def measured(cls, markers: Float[Array, "frames 13 3"], parts: int = 2) -> Cable:
        """From a recording: the mean over frames of arcs and of directions."""
        arcs = np.mean([_arcs(frame) for frame in markers[::10]], axis=0)
        hands = [_unit(markers[:, b] - markers[:, a]).mean(0) for a, b in ((0, 1), (11, 12))]
        return cls(arcs, _unit(np.stack(hands)), parts)

    @cached_property
    def counts(self) -> Array:
        """Segments of each gap."""
        return np.array([1] + [self.parts] * 10 + [1])

    @cached_property
    def at(self) -> Array:
        """Vertex of each marker."""
        return np.concatenate([[0], np.cumsum(self.counts)])

    @cached_property
    def place(self) -> Float[Array, " vertices"]:
        """Of each vertex along the cable, counted in markers."""
        return np.concatenate([[0.0], np.cumsum(np.repeat(1.0 / self.counts, self.counts))])

    @property
    def length(self) -> float:
        """From the first marker to the last [m]."""
        return float(self.gaps.sum())


@dataclass(frozen=True)
class Model:
    """What is fitted, each a tensor.

    Attributes:
        stiffness: E I / (rho A) [m4/s2].
        twisting: G J over that of a homogeneous round rod of the same E I.
        drag: linear, per mass [1/s].
        quadratic_drag: per mass [1/m].
        lag: retardation time of bending [s].
        curvature: without stress by the two directors, at the markers [1/m], shape [13, 2].
        roll: angle by which the first hand is turned about the cable against the last one [rad].
    """

    stiffness: Tensor
    twisting: Tensor
    drag: Tensor
    quadratic_drag: Tensor
    lag: Tensor
    curvature: Float[Tensor, "13 2"]
    roll: Tensor


class HeldCable:
    """A recording that is predicted from the motion of its led markers and from where it starts.

    Args:
        cable: as measured.
        markers: of the recording [m].
        frames: how many from the first on.
    """

    def __init__(self, cable: Cable, markers: Float[Array, "frames 13 3"], frames: int) -> None:
        self.cable, self.frames = cable, frames
        self.measured = torch.as_tensor(markers[:frames])
        start = _resampled(markers[0], cable.counts)
        rest = np.repeat(cable.gaps / cable.counts, cable.counts)
        self._body = rod_body(start, RADIUS, DENSITY, rest, directors=self._from_last_hand(start))
        velocity = np.polynomial.polynomial.polyfit(
            np.arange(START_FRAMES) / FPS, markers[:START_FRAMES].reshape(START_FRAMES, -1), 2
        )[1]
        self._velocity = torch.as_tensor(CubicSpline(np.arange(MARKERS), velocity.reshape(MARKERS, 3))(cable.place))
        bound = np.repeat(cable.at[list(LED)], len(_POINTS))
        grip = Grip(bound, np.arange(len(bound)), np.ones(len(bound)), np.full(len(bound), REACH))
        config = SimulationConfig(fps=FPS, courant=0.7, dtype="float64", ground_height=None, terms=TERMS)
        self._simulator = Simulator(self._body, config, grip)
        path = markers[: frames + 1, LED, None] + _POINTS
        self._points = torch.as_tensor(path.reshape(len(path), -1, 3))

    def predict(self, model: Model) -> Float[Tensor, "frames 13 3"]:
        """Markers [m] of all frames; differentiable by the model."""
        return self._simulator.rollout(self._parameters(model), self._points, frames=self.frames).x[:, self.cable.at]

    def errors(self, model: Model) -> Float[Tensor, "frames 13"]:
        """Distances of the markers [m] in all frames but the first, which is given; those at PREDICTED are predicted."""
        return (self.predict(model) - self.measured)[1:].norm(dim=-1)

    def _parameters(self, model: Model) -> Parameters:
        number = lambda value: torch.tensor(value, dtype=torch.float64)
        mass = torch.as_tensor(self._body.mass)
        ratio = model.stiffness * DENSITY * 4.0 / RADIUS**2 / STRETCHING
        along = np.stack([np.interp(self.cable.place, np.arange(MARKERS), row) for row in np.eye(MARKERS)], 1)
        lag = torch.stack([model.lag, number(TWIST_LAG)])
        return Parameters(
            number(STRETCHING),
            number(POISSON),
            grip_stiffness=number(HOLD),
            grip_damping=number(HOLD_DAMPING),
            initial_velocity=self._velocity,
            linear_drag=model.drag * mass,
            quadratic_drag=model.quadratic_drag * mass,
            bending_ratio=ratio,
            twisting_ratio=ratio * model.twisting,
            rest_curvature=torch.as_tensor(along) @ model.curvature,
            retardation_time=lag,
            initial_director=self._directors(model.roll),
        )

    # --- how the hands hold it ----------------------------------------------------------------------------------

    def _from_last_hand(self, start: Float[Array, "vertices 3"]) -> Float[Array, "vertices 3"]:
        """Directors without twist from that of the last hand on."""
        back = untwisted_directors(start[::-1].copy(), first=_held(self.cable.hands[1], start[-1] - start[-2]))
        return np.concatenate([back[:-1][::-1], back[:1]])  # a segment's first vertex is the other one in reverse

    def _directors(self, roll: Tensor) -> Float[Tensor, "vertices 3"]:
        """Directors at the start: each hand holds its own, and the angle between them is even along the cable."""
        rod = self._body.elements
        way = np.diff(rod.start, axis=0)
        length = np.linalg.norm(way, axis=1)
        tangents = way / length[:, None]
        tangents = np.append(tangents, tangents[-1:], axis=0)
        first = _held(self.cable.hands[0], tangents[0])
        own = rod.directors[0]
        angle = float(np.arctan2(np.cross(own, first) @ tangents[0], own @ first)) + roll
        middle = np.cumsum(length) - length / 2.0
        share = np.append((middle[-1] - middle) / (middle[-1] - middle[0]), 0.0)
        turn = angle * torch.as_tensor(share)
        d, across = torch.as_tensor(rod.directors), torch.as_tensor(np.cross(tangents, rod.directors))
        return turn.cos()[:, None] * d + turn.sin()[:, None] * across


def _held(reference: Float[Array, 3], tangent: Float[Array, 3]) -> Float[Array, 3]:
    """A hand's director where the cable leaves it along a tangent: the y axis across the mean direction, led by the shortest turn."""
    tangent = _unit(tangent)
    director = _unit(np.array([0.0, 1.0, 0.0]) - reference[1] * reference)
    return director - director @ tangent / (1.0 + reference @ tangent) * (reference + tangent)


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _spline(markers: Float[Array, "13 3"]) -> tuple[Array, CubicSpline]:
    """The curve through markers by the sum of their distances."""
    knots = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(markers, axis=0), axis=1))])
    return knots, CubicSpline(knots, markers)


def _fine(markers: Float[Array, "13 3"], steps: int = 100) -> tuple[Array, Array]:
    """Arc lengths [12, steps + 1] from each marker on and the parameters of the curve there."""
    knots, curve = _spline(markers)
    u = np.linspace(knots[:-1], knots[1:], steps + 1, axis=1)
    arcs = np.cumsum(np.linalg.norm(np.diff(curve(u), axis=1), axis=-1), axis=1)
    return np.concatenate([np.zeros((len(u), 1)), arcs], axis=1), u


def _arcs(markers: Float[Array, "13 3"]) -> Float[Array, 12]:
    return _fine(markers)[0][:, -1]


def _resampled(markers: Float[Array, "13 3"], counts: Array) -> Float[Array, "vertices 3"]:
    """Vertices on the curve that share every gap evenly."""
    curve = _spline(markers)[1]
    at = [
        np.interp(np.linspace(0.0, arc[-1], count + 1)[:-1], arc, u)
        for arc, u, count in zip(*_fine(markers), counts, strict=True)
    ]
    return np.concatenate([curve(np.concatenate(at)), markers[-1:]])
