"""A hidden wall, ceiling or ramp."""

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.effects.contact.obstacle import FORMULA, STIFFNESS, Obstacle
from physreal_core.effects.contact.places import MOST, passed_by, reach
from physreal_core.effects.effect import Coefficient, Setting, Values
from physreal_core.effects.fields import vector
from physreal_core.effects.shape import middle
from physreal_core.effects.turns import direction
from physreal_core.simulation import States

FLAT = 50.0
"""Radius of the ball that stands for a plane [m]: within a body of 0.3 m it bends by 0.2 mm."""
EXCURSION = 0.01  # [m] beyond the place of frame 0, for a direction to be worth a start
DIRECTIONS = (*((float(azimuth), 0.0) for azimuth in np.arange(8) * np.pi / 4), (0.0, np.pi / 2))
"""Azimuth and elevation [rad] in which walls are looked for."""
WAYS = MOST // 2  # directions, of two walls each


class ObstaclePlane(Obstacle):
    """Everything beyond a distance from the body's middle at frame 0, in one direction, is solid."""

    name = "obstacle_plane"
    words = "A hidden wall is in the way."
    formula = FORMULA + " of a half space"
    shows = "in all of the body that should pass the wall, from that frame on"
    distinguished_by = "moving along the wall, then towards it"
    coefficients = (
        STIFFNESS,
        Coefficient("azimuth", "rad", "direction towards the wall, from x to y", 0.0, -7.0, 7.0, 0.3, "shape"),
        Coefficient("elevation", "rad", "of that direction above the horizontal", 0.0, -2.0, 2.0, 0.3, "shape"),
        Coefficient("distance", "m", "from the body's middle at frame 0", 0.1, 0.0, 10.0, 0.02, "shape"),
    )

    def capsule(self, values: Values, setting: Setting, like: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        azimuth, elevation, distance = vector(values, "azimuth", "elevation", "distance", like=like)
        centre = torch.from_numpy(middle(setting.body)).to(like) + (distance + FLAT) * direction(azimuth, elevation)
        return centre, torch.zeros_like(centre), torch.full_like(distance, FLAT)

    def touching(
        self, place: Float[Array, "3"], towards: Float[Array, "3"], setting: Setting
    ) -> list[dict[str, float]]:
        """The wall that faces the place."""
        elevation = float(np.arcsin(np.clip(towards[2], -1.0, 1.0)))
        distance = float((place - middle(setting.body)) @ towards)
        azimuth = float(np.arctan2(towards[1], towards[0]))
        return [{"azimuth": azimuth, "elevation": elevation, "distance": distance}] if distance > 0.0 else []

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """Walls in the directions in which the body goes farthest beyond frame 0: half the way, and where its matter comes into
        them by one spacing."""
        if motion is None:
            return ()
        x = passed_by(motion)
        reaches = [_reaches(x, *way, setting) for way in DIRECTIONS]
        ways = sorted(zip(reaches, DIRECTIONS, strict=True), key=lambda way: way[0][0] - way[0].max())
        return tuple(
            {"azimuth": azimuth, "elevation": elevation, "distance": distance}
            for reached, (azimuth, elevation) in ways[:WAYS]
            if (farthest := float(reached.max())) - reached[0] > EXCURSION
            for distance in (0.5 * (float(reached[0]) + farthest), farthest + reach(setting) - setting.body.spacing)
        )

    def blocking_starts(
        self, setting: Setting, seen: Float[Array, "points 3"], expected: Float[Array, "points 3"]
    ) -> tuple[dict[str, float], ...]:
        """Walls as far as the points were seen to go, in the directions in which the baseline has them a spacing further."""
        both = np.stack([seen, expected])
        ways = [(*_reaches(both, *way, setting).tolist(), *way) for way in DIRECTIONS]
        return tuple(
            {"stiffness": STIFFNESS.scale, "azimuth": azimuth, "elevation": elevation, "distance": seen_to}
            for seen_to, expected_to, azimuth, elevation in ways
            if seen_to > 0.0 and expected_to - seen_to > setting.body.spacing
        )


def _reaches(
    x: Float[Array, "frames points 3"], azimuth: float, elevation: float, setting: Setting
) -> Float[Array, " frames"]:
    """How far points reach in a direction in each frame, from the body's middle at frame 0 [m]."""
    towards = direction(torch.tensor(azimuth), torch.tensor(elevation)).double().numpy()
    return ((x - middle(setting.body)) @ towards).max(1)
