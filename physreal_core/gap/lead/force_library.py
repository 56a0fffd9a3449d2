"""Terms of a formula for an unknown force per mass: of position, velocity, strain, and attraction to a place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from physreal_core.array_types import Array, Bool, Float

_AXES = "xyz"


@dataclass(frozen=True)
class RegionMotion:
    """The motion of regions of the body.

    Args:
        position: of their centres [m], shape [T, R, 3].
        velocity: of their centres [m/s], shape [T, R, 3].
        swelling: relative change of their volume, shape [T, R].
    """

    position: Float[Array, "T R 3"]
    velocity: Float[Array, "T R 3"]
    swelling: Float[Array, "T R"]


@dataclass(frozen=True)
class Term:
    """One term. Its coefficient times its field is a force per mass [m/s2].

    Args:
        formula: of the field, as "-|v| v".
        unit: of the coefficient.
        words: a physical meaning of the term.
        place: centre of an attraction [m], else None.
    """

    formula: str
    unit: str
    words: str
    place: tuple[float, float, float] | None = None

    def named(self) -> str:
        """The formula with its place put in."""
        if self.place is None:
            return self.formula
        return self.formula.replace("p", "(" + ", ".join(f"{value:.3f}" for value in self.place) + ")")


ATTRACTION = Term(
    "(p - x) / |p - x|^3", "m3/s2", "attraction to, or repulsion from, a place (magnet, charge, a hidden mass)"
)


def region_motion(
    simulated: Float[Array, "T J 3"],
    measured: Float[Array, "T J 3"],
    valid: Bool[Array, "T J"],
    weights: Float[Array, "J R"],
    fps: float,
    *,
    smoothing: float = 0.2,
) -> RegionMotion:
    """Motion of regions as measured: the simulated motion plus each region's mean departure, smoothed in time.

    Args:
        simulated, measured: tracks [m].
        valid: entries with a measurement.
        weights: share of each region in every track.
        fps: frames per second.
        smoothing: window of a cubic fit [s] (Savitzky and Golay 1964).
    """
    departure = np.where(valid[..., None], measured - simulated, 0.0)
    mass = valid.astype(float) @ weights
    mean = np.einsum("jr,tjc->trc", weights, departure) / np.maximum(mass, 1e-12)[..., None]
    window = min(max(5, 2 * round(0.5 * smoothing * fps) + 1), (len(valid) - 1) // 2 * 2 + 1)
    filled = np.stack([_filled(mean[:, r], mass[:, r] > 0.1) for r in range(weights.shape[1])], 1)
    total = np.maximum(weights.sum(0), 1e-12)
    position = np.einsum("jr,tjc->trc", weights / total, simulated) + savgol_filter(filled, window, 3, axis=0)
    velocity = np.gradient(position, 1.0 / fps, axis=0)
    return RegionMotion(position, velocity, _swelling(simulated, weights))


def _filled(path: Float[Array, "T 3"], known: Bool[Array, " T"]) -> Float[Array, "T 3"]:
    """A path with its holes filled: linear in time between readings, constant beyond them, zero without any."""
    frames = np.arange(len(path))
    if not known.any():
        return np.zeros_like(path)
    return np.stack([np.interp(frames, frames[known], path[known, axis]) for axis in range(3)], -1)


SMALLEST = 1e-6
"""Extent of a region below which it has none [m]."""


def _swelling(simulated: Float[Array, "T J 3"], weights: Float[Array, "J R"]) -> Float[Array, "T R"]:
    """det F - 1 of the affine motion that fits each region's tracks best.

    A ridge keeps a flat region isochoric, and one of a single point, which has no extent at all.
    """
    shares = weights / np.maximum(weights.sum(0), 1e-12)
    centred = simulated[:, :, None] - np.einsum("jr,tjc->trc", shares, simulated)[:, None]
    start = centred[0]
    moment = np.einsum("jr,jra,jrb->rab", shares, start, start)
    ridge = (1e-3 * np.trace(moment, axis1=1, axis2=2) + SMALLEST**2)[:, None, None] * np.eye(3)
    mixed = np.einsum("jr,tjra,jrb->trab", shares, centred, start) + ridge
    return np.linalg.det(mixed @ np.linalg.inv(moment + ridge)) - 1.0


def library(motion: RegionMotion, origin: Float[Array, " 3"]) -> tuple[list[Term], Float[Array, "C T R 3"]]:
    """All terms but attractions, and their fields [m/s2 per unit of the coefficient].

    Args:
        motion: of the regions.
        origin: of the positions in the terms [m]; the same for all interactions.
    """
    v, r = motion.velocity, motion.position - origin
    inside = motion.position - motion.position.mean(1, keepdims=True)
    speed = np.linalg.norm(v, axis=-1, keepdims=True)
    unit = np.eye(3)
    entries = [
        (Term("-v", "1/s", "drag in proportion to speed, or damping"), -v),
        (Term("-|v| v", "1/m", "drag in proportion to the square of speed"), -speed * v),
        (Term("x - centre", "1/s2", "the body swells or shrinks"), inside),
        (
            Term("swelling (x - centre)", "1/s2", "the body is stiffer or softer in volume"),
            motion.swelling[..., None] * inside,
        ),
    ]
    for i, axis in enumerate(_AXES):
        entries.append((Term(f"e{axis}", "m/s2", f"a steady force along {axis}"), np.broadcast_to(unit[i], v.shape)))
        turned = np.cross(unit[i], v)
        entries.append(
            (Term(f"e{axis} × v", "1/s", f"a force across the motion, about {axis} (a turning frame)"), turned)
        )
        for j, along in enumerate(_AXES):
            words = f"a force along {axis} that grows with {along}"
            entries.append((Term(f"{along} e{axis}", "1/s2", words), r[..., j : j + 1] * unit[i]))
    terms, fields = zip(*entries, strict=True)
    return list(terms), np.stack(fields)


def attraction(motion: RegionMotion, place: Float[Array, " 3"]) -> tuple[Term, Float[Array, "T R 3"]]:
    """Inverse-square attraction to a place [m], softened at a centimetre, where a region is no longer a point."""
    way = place - motion.position
    distance = np.sqrt((way**2).sum(-1, keepdims=True) + 0.01**2)
    term = Term(ATTRACTION.formula, ATTRACTION.unit, ATTRACTION.words, tuple(float(p) for p in place))
    return term, way / distance**3


def places_around(
    positions: Float[Array, "n 3"], count: int = 5
) -> tuple[Float[Array, "places 3"], Float[Array, " 3"]]:
    """A grid in and around where a body has been: places and spacing [m].

    The body's box is widened by half its greatest extent on each side.
    """
    margin = 0.5 * np.ptp(positions, axis=0).max()
    low, high = positions.min(0) - margin, positions.max(0) + margin
    axes = [np.linspace(low[i], high[i], count) for i in range(3)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3), (high - low) / (count - 1)
