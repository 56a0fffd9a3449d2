"""The ground is higher or lower than assumed, or slopes."""

from dataclasses import replace

import numpy as np
import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import changed, field, vector
from physreal_core.effects.shape import middle, underside
from physreal_core.simulation import States

REACH = 0.01
"""Height of the starts above and below where the ground is thought to be [m]."""
LEVEL = 0.1
"""Spacings by which the body's underside has to leave the ground, somewhere below the body, for a start from there."""


class GroundPlane(Effect):
    """The plane z = ground + height + slope_x (x - c_x) + slope_y (y - c_y), c the body's middle at frame 0.

    The simulator's plane is level, so the rollout runs in the plane's own frame: body, hand and gravity are moved and
    turned into it, and `observe` brings its points back. It has to act after effects that place something in the world.
    """

    name = "ground_plane"
    family = "contact"
    words = "The ground is higher or lower than assumed, or slopes."
    formula = (
        "x' = R (x - p), F(0) = R, g' = R g, with R n = e_z; n and p the plane's normal and its point below the body"
    )
    shows = "only while it touches the ground: it lies too high or too low, slides downhill"
    distinguished_by = "letting it lie, then pushing it to either side (tilted gravity acts in the air, too)"
    terms = ("initial_position", "gravity")
    volume_terms = ("initial_deformation",)
    coefficients = (
        Coefficient("height", "m", "below the body's middle", 0.0, -0.1, 0.1, 0.01),
        Coefficient("slope_x", "1", "rise along x", 0.0, -0.5, 0.5, 0.1),
        Coefficient("slope_y", "1", "rise along y", 0.0, -0.5, 0.5, 0.1),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        place = field(inputs, "initial_position", setting)
        turn, world, own = _frames(values, setting, place)

        def moved(points: Tensor) -> Tensor:
            return (points.to(place) - world) @ turn.T + own

        present = {name: getattr(inputs.parameters, name) for name in ("force", "initial_velocity")}
        vectors = {name: value @ turn.T for name, value in present.items() if value is not None}
        if setting.body.elements is None:
            vectors["initial_deformation"] = turn @ field(inputs, "initial_deformation", setting)
        gravity = turn @ field(inputs, "gravity", setting)
        given = changed(inputs, initial_position=moved(place), gravity=gravity, **vectors)
        if inputs.parameters.obstacle is not None:
            centre, half, rest = inputs.parameters.obstacle.split([3, 3, 2])
            given = changed(given, obstacle=torch.cat([moved(centre), turn @ half, rest]))
        return replace(given, controllers=moved(inputs.controllers).to(inputs.controllers))

    def observe(self, points: Float[Tensor, "frames points 3"], values: Values, setting: Setting) -> Tensor:
        turn, world, own = _frames(values, setting, points)
        return (points - own) @ turn + world

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """Only where there is a ground, and no clamp that would not turn along: as it is, and so much higher or lower that a body
        which a wrong material holds above it would touch it."""
        here = setting.ground_height is not None and not setting.clamps
        return ({}, {"height": REACH}, {"height": -REACH}) if here else ()

    def large_starts(self, setting: Setting) -> tuple[dict[str, float], ...]:
        """The ground as the body lies on it at frame 0, where that is not as assumed."""
        if not self.starts(setting) or (plane := underside(setting.body)) is None:
            return ()
        level, slope_x, slope_y = plane
        height = level - setting.ground_height
        rise = abs(height) + np.abs([slope_x, slope_y]) @ np.ptp(setting.body.x0[:, :2], axis=0) / 2
        return (
            ({"height": height, "slope_x": slope_x, "slope_y": slope_y},) if rise > LEVEL * setting.body.spacing else ()
        )


def _frames(values: Values, setting: Setting, like: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Rotation of the world into the plane's frame, and the plane's point below the body in either [m]."""
    height, slope_x, slope_y = vector(values, "height", "slope_x", "slope_y", like=like)
    x, y, _ = middle(setting.body)
    own = like.new_tensor([x, y, setting.ground_height or 0.0])
    zero = torch.zeros_like(height)
    return _levelling(slope_x, slope_y), own + torch.stack([zero, zero, height]), own


def _levelling(slope_x: Tensor, slope_y: Tensor) -> Float[Tensor, "3 3"]:
    """The shortest rotation that takes the normal of a plane with these slopes to e_z."""
    n = torch.stack([-slope_x, -slope_y, torch.ones_like(slope_x)])
    nx, ny, nz = n / n.norm()
    # R = 1 + [w] + [w]^2 / (1 + c), w = n x e_z = (ny, -nx, 0), c = nz
    k = 1 / (1 + nz)
    rows = [1 - nx * nx * k, -nx * ny * k, -nx, -nx * ny * k, 1 - ny * ny * k, -ny, nx, ny, nz]
    return torch.stack(rows).reshape(3, 3)
