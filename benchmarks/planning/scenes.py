"""What is planned for: a body of the rig, its fitted model, and goals that the rig's own hand has reached on a way that no plan is told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from data.rig.driven import Driven
from data.rig.mesh import TetMesh
from data.rig.rig_scene import Motion, RigScene, plush_lift
from data.rig.thin_scenes import cloth_lift, rope_lift
from physreal_core.array_types import Array, Float, Int

FRAMES, REST = 45, 10
"""Of a plan and of a hidden way, the last of them with the hand at rest."""

SETTLED = 5
"""Last frames over which places are averaged."""


@dataclass(frozen=True)
class Setting:
    """A body and what is wanted of it.

    Args:
        scene: of the rig.
        goals: hidden ways of the hand by name.
        lower, upper: how far the hand may go from where it begins [m].
    """

    scene: Callable[[], RigScene]
    goals: dict[str, Motion]
    lower: tuple[float, float, float]
    upper: tuple[float, float, float]

    def way(self, goal: str, seed: int) -> Motion:
        """The hidden way to a goal: the one that stands in `goals` for seed 0, and one like it for every other.

        It is turned about the vertical by up to 30 degrees, and 0.7 to 1.3 times as far along the table and up, within the hand's bounds.
        """
        known, random = self.goals[goal], np.random.default_rng(seed)
        if seed == 0:
            return known
        while True:
            angle, along, up = np.radians(random.uniform(-30, 30)), random.uniform(0.7, 1.3), random.uniform(0.7, 1.3)
            drawn = _turned(known, angle, along, up)
            places = drawn.displacement(np.linspace(0, FRAMES / self.scene().fps, 10 * FRAMES))
            if (places >= self.lower).all() and (places <= self.upper).all():
                return drawn


def _turned(way: Motion, angle: float, along: float, up: float) -> Motion:
    cos, sin = along * np.cos(angle), along * np.sin(angle)
    matrix = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, up]])
    return Motion(tuple((begin, end, tuple(map(float, matrix @ stroke))) for begin, end, stroke in way.strokes))


SPEED = 0.6
"""Largest of the hand [m/s]."""

SETTINGS = {
    "plush": Setting(
        plush_lift,
        {
            "held up": Motion(((0.0, 0.7, (-0.03, 0.02, 0.10)), (0.5, 1.1, (0.0, 0.06, 0.0)))),
            "laid aside": Motion(
                ((0.0, 0.4, (-0.02, 0.0, 0.05)), (0.2, 0.85, (-0.02, 0.11, 0.0)), (0.75, 1.1, (0.0, 0.0, -0.045)))
            ),
        },
        (-0.12, -0.15, -0.005),
        (0.12, 0.15, 0.15),
    ),
    "rope": Setting(
        rope_lift,
        {
            "laid along a curve": Motion(
                ((0.0, 0.4, (-0.02, 0.0, 0.03)), (0.15, 0.85, (-0.10, 0.13, 0.0)), (0.8, 1.1, (0.0, 0.0, -0.028)))
            ),
        },
        (-0.25, -0.2, -0.002),
        (0.1, 0.2, 0.2),
    ),
    "cloth": Setting(
        cloth_lift,
        {
            "folded": Motion(
                ((0.0, 0.5, (0.0, -0.05, 0.08)), (0.3, 0.95, (0.0, -0.11, 0.0)), (0.85, 1.15, (0.0, 0.0, -0.06)))
            )
        },
        (-0.1, -0.24, -0.002),
        (0.1, 0.05, 0.2),
    ),
}


@dataclass(frozen=True)
class Reached:
    """Where the body begins, and where the rig's hidden way has brought it.

    Attributes:
        start, end: nodes of the rig's mesh [m]; the end is the mean over the last frames.
        surface: nodes that lie on its surface; all of a thin body.
        faces: triangles of the surface; none of a rope.
    """

    start: Float[Array, "nodes 3"]
    end: Float[Array, "nodes 3"]
    surface: Int[Array, " shown"]
    faces: Int[Array, "faces 3"]


def reached(setting: Setting, way: Motion, driven: Driven, kept: Path) -> Reached:
    """Where a hidden way leads, which is read from `kept` where it has been found before."""
    if not kept.is_file():
        driven.begin_anew()
        start = driven.nodes
        times = np.arange(1, FRAMES + 2) / setting.scene().fps
        seen = driven.advance(way.displacement(times))
        kept.parent.mkdir(parents=True, exist_ok=True)
        draft = kept.with_suffix(".partial.npz")  # a killed run leaves no half of a goal
        np.savez(draft, start=start, end=seen[-SETTLED:].mean(0))
        draft.rename(kept)
    mesh = driven.world.mesh
    if isinstance(mesh, TetMesh):
        faces = mesh.faces
    else:
        faces = mesh.elements if mesh.elements.shape[1] == 3 else np.zeros((0, 3), int)
    with np.load(kept) as file:
        start, end = file["start"], file["end"]
    return Reached(start, end, np.unique(faces) if len(faces) else np.arange(len(start)), faces)


def small_view(scene: RigScene) -> RigScene:
    """The scene seen in half as many pixels a side: enough for a mask."""
    view = scene.view
    return replace(scene, view=replace(view, width=view.width // 2, height=view.height // 2, focal=view.focal / 2))
