"""The specimen of the hidden-effect captures: a foam bar so soft and slender that it sags by centimetres when one end is held.

At this stiffness independent simulators agree to a millimetre (`data/rig/README.md`), so that an effect of a few shows. Its
section is square: what coarse elements add to the stiffness of bending is then the same upwards and sideways, and a modulus
takes it up. The hand holds the +x end: all of it to lift, so that the bar is a cantilever; the upper half to press, so that
the lower half gives.
"""

from collections.abc import Callable

import numpy as np

from data.rig.hidden.effect import NOTHING, Hidden
from data.rig.rig_scene import Material, Motion, RigScene, View, mitten
from data.rig.shapes import Block
from data.rig.simulate import simulate
from data.rig.trajectory import Trajectory

LENGTH, WIDTH, HEIGHT = 0.24, 0.044, 0.044  # [m]
HELD = 0.045  # length of the end that the hand holds [m]
SPACING = 0.011  # of the finite elements [m]
_SETTLE = 0.1  # [s]; the bar lies flat, so there is little to settle


def specimen(motion: str, seed: int) -> RigScene:
    """The bar and one of the `MOTIONS`; material, sizes and directions of the motion follow from the seed.

    Captures of one seed show the same object.
    """
    material = np.random.default_rng([seed, 0])
    path = np.random.default_rng([seed, 1 + list(MOTIONS).index(motion)])
    half = LENGTH / 2
    return RigScene(
        name=motion,
        description="a foam bar",
        body=Block((-half, -WIDTH / 2, 0.0), (half, WIDTH / 2, HEIGHT)),
        hand=mitten((half - HELD / 2, 0.0, 0.7 * HEIGHT), (0.75, 0.3, 0.6)),
        grasp=Block((half - HELD, -1.0, HELD_ABOVE[motion]), (1.0, 1.0, 1.0)),
        motion=MOTIONS[motion](path),
        material=Material(
            youngs_modulus=float(np.exp(material.uniform(np.log(1.2e5), np.log(2.4e5)))),
            poissons_ratio=0.3,
            density=float(material.uniform(450, 750)),
            damping=2e-5,  # takes the chatter out of contacts; off the first swings it takes less than a hundredth
            friction_coefficient=float(material.uniform(0.35, 0.6)),
        ),
        view=View(eye=(-0.05, -0.75, 0.45), target=(0.0, 0.0, 0.09), focal=420.0),
        mesh_spacing=SPACING,
    )


def lift_swing(random: np.random.Generator) -> Motion:
    """Lifts its end, stops, jerks it sideways and holds still: the far end swings down, then across.

    By centimetres: in larger swings the phases of two simulators part.
    """
    height, side = random.uniform(0.1, 0.13), random.choice([-1, 1])
    across, along = side * random.uniform(0.022, 0.032), random.uniform(-0.015, 0.015)
    return Motion(((0.1, 0.8, (0.0, 0.0, height)), (1.0, 1.25, (along, across, 0.0))))


def press_drag(random: np.random.Generator) -> Motion:
    """Presses its end into the table and lets go, then sweeps the bar sideways over the table and stops: the free end lags by
    friction, and where friction holds it, it stays bent."""
    depth, angle = random.uniform(0.004, 0.005), random.choice([-1, 1]) * random.uniform(0.9, 1.3)
    way = random.uniform(0.13, 0.16) * np.array([np.cos(angle), np.sin(angle), 0.0])
    return Motion(
        (
            (0.1, 0.3, (0.0, 0.0, -depth)),
            (0.45, 0.55, (0.0, 0.0, depth)),
            (0.6, 0.7, (0.0, 0.0, random.uniform(0.006, 0.012))),
            (0.75, 1.3, tuple(map(float, way))),
        )
    )


MOTIONS: dict[str, Callable[[np.random.Generator], Motion]] = {"lift_swing": lift_swing, "press_drag": press_drag}
HELD_ABOVE = {"lift_swing": -1.0, "press_drag": HEIGHT / 2}  # the hand holds what of its end lies above this height [m]


def run(scene: RigScene, hidden: Hidden = NOTHING) -> Trajectory:
    """The truth of a bar's scene: undamped and symplectic unless the effect takes an implicit step."""
    implicit = hidden.implicit_step()
    return simulate(
        scene,
        timestep=explicit_step(scene) / hidden.hardening() ** 0.5 if implicit is None else implicit,
        integrator="Euler" if implicit is None else "discrete",
        settle=_SETTLE,
        calm=_SETTLE / 5,
        hidden=hidden,
        punctual=True,
    )


def explicit_step(scene: RigScene) -> float:
    """A stable step [s]: 0.42 of the time that a pressure wave takes through an element.

    The limit itself is near 0.55, that of a corner tetrahedron's height of 1 / sqrt 3 edges.
    """
    E, nu = scene.material.youngs_modulus, scene.material.poissons_ratio
    speed = np.sqrt(E * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) / scene.material.density)
    return 0.42 * scene.mesh_spacing / speed
