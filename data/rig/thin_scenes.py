"""A rope and a cloth, each filmed in two motions: what a simulator of rods and shells is to recover and to predict.

The hand holds an end or an edge level and only moves: what is not held sticks out from it and droops, as far as it is stiff.
"""

from collections.abc import Callable

from data.rig.rig_scene import Look, Material, Motion, RigScene, View, mitten
from data.rig.rope import Rope
from data.rig.shapes import Block
from data.rig.thin import Cloth

AGAINST_CHATTER = 2e-5  # [s]; damps a swing of 5 Hz by 0.03 % of critical

ROPE = Rope(
    start=(-0.20, 0.0, 0.005),
    end=(0.20, 0.0, 0.005),
    spacing=0.005,
    thickness=0.010,
    stretching_stiffness=500.0,
    bending_stiffness=6e-4,
    twisting_stiffness=4e-4,
    mass_per_length=0.064,
    damping=AGAINST_CHATTER,
)
"""A soft kernmantle rope (data/rig/README.md says where the numbers come from)."""

CLOTH = Cloth(
    centre=(0.0, 0.0, 0.00035),
    size=(0.26, 0.20),
    spacing=0.008,
    thickness=0.0007,
    membrane_stiffness=1000.0,
    bending_stiffness=6.4e-5,
    poissons_ratio=0.3,
    areal_density=0.324,
    damping=4e-3,  # an eighth of it the step's own; with less, small differences grow while the cloth flaps
    turn=1.5707963267948966,
    equilateral=True,
)
"""Denim (data/rig/README.md says where the numbers come from). Its long edges run along y, away from the camera."""

PLATE_RATIO = -1 / 3
"""Poisson's ratio of bending: equal hinges on equilateral triangles are the isotropic plate with this one.

A hinge between two triangles of height H turns by (3 m.B.m - t.B.t) H / 3 where the curvature is B, the edge runs along t and m is across
it. Summed over the three directions of edges, the squares are 9 (tr B^2 (1 - nu) + nu (tr B)^2) with nu = -1/3.
"""

MEASURED = {
    Rope: {"stretching_stiffness": 1.0, "bending_stiffness": 0.997, "twisting_stiffness": 1.0},
    Cloth: {"membrane_stiffness": 1.002, "bending_stiffness": 0.997},
}
"""Stiffness that elements of these spacings have, over the one that MuJoCo was given (`thin_convergence`)."""


def _rope(name: str, motion: Motion) -> RigScene:
    """The rope, held at its +x end, before a camera that looks along y."""
    return RigScene(
        name=name,
        description="a rope",
        body=ROPE,
        hand=mitten((0.185, 0.0, -0.010), (0.7, 0.3, 0.65)),
        grasp=Block((0.158, -0.02, -1.0), (0.21, 0.02, 1.0)),  # what lies in the mitten
        motion=motion,
        material=Material(density=ROPE.density, friction_coefficient=0.4),
        view=View(eye=(0.0, -0.96, 0.47), target=(0.02, 0.0, 0.185)),
        look=Look(body="rope"),
    )


def rope_lift() -> RigScene:
    """An end is lifted until the rope hangs free, and moved aside: it swings."""
    return _rope("rope_lift", Motion(((0.1, 0.95, (-0.02, 0.0, 0.36)), (1.0, 1.3, (0.0, 0.06, 0.0)))))


def rope_swing() -> RigScene:
    """The same rope is lifted faster and swung to and fro along itself and across."""
    return _rope(
        "rope_swing",
        Motion(
            (
                (0.1, 0.7, (-0.04, 0.0, 0.36)),
                (0.7, 0.95, (-0.09, 0.0, 0.0)),
                (0.95, 1.25, (0.12, 0.05, 0.0)),
                (1.3, 1.6, (-0.06, -0.05, 0.0)),
            )
        ),
    )


def _cloth(name: str, motion: Motion, aside: float = 0.0) -> RigScene:
    """The cloth, held in the middle of its far edge, or so far aside [m]."""
    return RigScene(
        name=name,
        description="a cloth",
        body=CLOTH,
        hand=mitten((aside, 0.118, -0.010), (0.45, 0.6, 0.65), across=0.03),
        grasp=Block(
            (aside - 0.03, 0.072, -1.0), (aside + 0.03, 0.14, 1.0)
        ),  # what lies under the thumb, and on to the edge
        motion=motion,
        material=Material(density=CLOTH.density, friction_coefficient=0.4),
        view=View(eye=(0.22, -0.80, 0.52), target=(0.0, 0.02, 0.107), focal=500.0),
        look=Look(body="print"),
    )


def cloth_lift() -> RigScene:
    """An edge is lifted until the cloth hangs free, and moved across its surface: it swings and bends."""
    return _cloth("cloth_lift", Motion(((0.1, 1.0, (0.0, -0.04, 0.25)), (1.05, 1.4, (0.01, 0.05, 0.0)))))


def cloth_swing() -> RigScene:
    """The same cloth is lifted faster and swung to and fro across its surface and along it."""
    return _cloth(
        "cloth_swing",
        Motion(
            (
                (0.1, 0.85, (0.0, -0.06, 0.23)),
                (0.9, 1.25, (0.0, 0.06, 0.0)),
                (1.25, 1.6, (0.01, -0.05, 0.01)),
                (1.65, 1.95, (0.0, 0.04, 0.0)),
            )
        ),
    )


CORNER = 0.075  # [m] aside of the edge's middle; the hold ends with the cloth


def corner_lift() -> RigScene:
    """A corner is lifted until the cloth hangs free, and moved aside: it swings."""
    return _cloth("corner_lift", Motion(((0.1, 1.0, (0.0, -0.04, 0.27)), (1.05, 1.4, (-0.05, 0.02, 0.0)))), CORNER)


def corner_swing() -> RigScene:
    """The same corner is lifted faster, and swung to and fro."""
    return _cloth(
        "corner_swing",
        Motion(
            (
                (0.1, 0.85, (-0.02, -0.05, 0.25)),
                (0.9, 1.25, (0.06, 0.03, 0.0)),
                (1.25, 1.6, (-0.05, -0.04, 0.01)),
                (1.65, 1.95, (0.03, 0.03, 0.0)),
            )
        ),
        CORNER,
    )


THIN_SCENES: dict[str, Callable[[], RigScene]] = {
    make.__name__: make for make in (rope_lift, rope_swing, cloth_lift, cloth_swing, corner_lift, corner_swing)
}
"""Scenes of thin bodies by name."""
