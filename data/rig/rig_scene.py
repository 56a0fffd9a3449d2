"""What the rig films: a soft object, how a hand moves it, its physics, the camera. Plain data, seeded, no simulator."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from data.rig.shapes import Block, Capsule, RoundedShape, Solid
from data.rig.thin_body import ThinBody
from physreal_core.array_types import Array, Float


@dataclass(frozen=True)
class Material:
    """Homogeneous elastic solid: Young's modulus [Pa], Poisson's ratio, density [kg/m^3], stiffness damping [s]."""

    youngs_modulus: float = 6e4
    poissons_ratio: float = 0.3
    density: float = 300.0
    damping: float = 0.004
    friction_coefficient: float = 0.5


@dataclass(frozen=True)
class SoftPart:
    """A part of a solid body that is softer than the rest: what lies at x < `border` [m] at rest has the `share` of its Young's modulus."""

    share: float
    border: float

    def left(self, places: Float[Array, "P 3"]) -> Float[Array, " P"]:
        """Share of the modulus at places [m]."""
        return np.where(places[:, 0] < self.border, self.share, 1.0)


@dataclass(frozen=True)
class Motion:
    """The hand's path: smooth strokes, each `(start [s], end [s], displacement [m])`, that add up."""

    strokes: tuple[tuple[float, float, tuple[float, float, float]], ...]

    def displacement(self, time: float | Float[Array, "..."]) -> Float[Array, "... 3"]:
        """Hand displacement since time 0 [m]; each stroke follows 3s^2 - 2s^3."""
        total = np.zeros((*np.shape(time), 3))
        for start, end, vector in self.strokes:
            s = np.clip((np.asarray(time) - start) / (end - start), 0.0, 1.0)
            total += (s * s * (3 - 2 * s))[..., None] * np.asarray(vector)
        return total

    @property
    def onset(self) -> float:
        """When the hand first moves [s]."""
        return min(start for start, _, _ in self.strokes)


@dataclass(frozen=True)
class View:
    """A pinhole camera at `eye` [m] looking at `target` [m]; focal length in pixels, OpenCV axes."""

    eye: tuple[float, float, float] = (0.0, -0.66, 0.40)
    target: tuple[float, float, float] = (-0.005, 0.0, 0.08)
    focal: float = 520.0
    width: int = 320
    height: int = 240

    def intrinsics(self) -> Float[Array, "3 3"]:
        """K with pixel centres at integers."""
        cx, cy = (self.width - 1) / 2, (self.height - 1) / 2
        return np.array([[self.focal, 0, cx], [0, self.focal, cy], [0, 0, 1.0]])

    def pose(self) -> Float[Array, "4 4"]:
        """T_world_camera."""
        forward = np.subtract(self.target, self.eye)
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        pose = np.eye(4)
        pose[:3] = np.stack([right, np.cross(forward, right), forward, np.asarray(self.eye)], axis=1)
        return pose


@dataclass(frozen=True)
class Noise:
    """Sensor noise: colour [grey levels of 255], depth sigma = base + slope z^2 [m], chance of a depth hole."""

    colour: float = 2.0
    depth_base: float = 0.0005
    depth_slope: float = 0.0015
    depth_hole: float = 0.01
    grazing_angle: float = 78.0  # degrees between surface normal and ray, beyond which the sensor reads nothing


@dataclass(frozen=True)
class Look:
    """How things are painted, lit and exposed.

    Attributes:
        body, hand, table: names in `texture.PAINTS`.
        seed: of the patterns.
        lamp: direction towards the lamp, of any length.
        ambient, diffuse: light from all sides, and the lamp's where it shines straight down on a surface.
        shade: share of the lamp's light that reaches a place in shadow.
        shutter: share of the time between two frames in which light is gathered; 0 shows an instant.
    """

    body: str = "plush"
    hand: str = "mitten"
    table: str = "wood"
    seed: int = 0
    lamp: tuple[float, float, float] = (-0.35, -0.45, 0.82)
    ambient: float = 0.42
    diffuse: float = 0.72
    shade: float = 0.3
    shutter: float = 0.0


@dataclass(frozen=True)
class FurtherHand:
    """A hand beside the first: its shape at time 0, its path, and how near [m] the nodes are that it holds.

    With `grip_reach` None it holds nothing and passes through whatever is in its way.
    """

    shape: RoundedShape
    motion: Motion
    grip_reach: float | None = None

    @property
    def reach(self) -> float:
        """Distance from its surface below which nodes are held [m]; no distance is below that of an idle hand."""
        return -np.inf if self.grip_reach is None else self.grip_reach


@dataclass(frozen=True)
class RigScene:
    """One capture: `body` and `hand` at time 0 in the world frame, what the hand does, and how it is filmed.

    The hand holds the nodes in `grasp`, or where that is None those within `grip_reach` [m] of its surface when it takes them. It holds
    all the time, or from and to the times `holds` [s]. Hands are meshed with `hand_spacing` [m].

    With a `soft_part`, `material` is that of the rest.

    With `push_friction`, Coulomb's of its surface on the body, the hand holds nothing: it pushes by contact, as a stick does.
    """

    name: str
    description: str
    body: Solid | ThinBody
    hand: RoundedShape
    motion: Motion
    material: Material = Material()
    view: View = View()
    noise: Noise = Noise()
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    fps: float = 30.0
    frames: int = 60
    observed: int = 42
    mesh_spacing: float = 0.009
    grip_reach: float = 0.004
    grasp: Block | None = None
    hints: dict[str, dict] = field(default_factory=dict)
    look: Look = Look()
    others: tuple[FurtherHand, ...] = ()
    hand_spacing: float = 0.009
    holds: tuple[float, float] | None = None
    push_friction: float | None = None
    soft_part: SoftPart | None = None

    @property
    def on_the_way(self) -> Float[Array, "3"]:
        """How far the hand has moved when it takes the body [m]."""
        return np.zeros(3) if self.holds is None else self.motion.displacement(self.holds[0])


def plush_body() -> RoundedShape:
    """A stuffed animal lying on its back: 0.24 x 0.16 x 0.06 m, head at +x, resting on z = 0."""
    sides = (-1.0, 1.0)
    torso = [Capsule((-0.035, 0, 0.030), (0.03, 0, 0.030), 0.030), Capsule((0.03, 0, 0.029), (0.075, 0, 0.029), 0.026)]
    head = [Capsule((0.076, 0, 0.029), (0.080, 0, 0.029), 0.029)]
    ears = [Capsule((0.090, 0.020 * s, 0.03), (0.100, 0.036 * s, 0.03), 0.012) for s in sides]
    arms = [Capsule((0.020, 0.018 * s, 0.024), (0.034, 0.060 * s, 0.019), 0.019) for s in sides]
    legs = [Capsule((-0.042, 0.016 * s, 0.026), (-0.106, 0.042 * s, 0.022), 0.022) for s in sides]
    return RoundedShape(tuple(torso + head + ears + arms + legs))


_THUMB = 0.013  # radius of a mitten's thumb [m]


def mitten(grasp: tuple[float, float, float], towards: tuple[float, float, float], across: float = 0.0) -> RoundedShape:
    """A hand in a mitten around the point `grasp` [m]: palm above, fingers and thumb down its two sides, forearm
    leaving along `towards`. About 0.08 m wide. The thumb's end may lie across, along x, on so much of an edge to both sides [m]."""
    g = np.asarray(grasp, float)
    arm = np.asarray(towards, float) / np.linalg.norm(towards)

    def at(*offset: float) -> tuple[float, ...]:
        return tuple(map(float, g + offset))

    wrist = g + [0, 0, 0.040] + 0.045 * arm
    return RoundedShape(
        (
            Capsule(at(-0.012, 0.010, 0.034), at(0.012, -0.010, 0.034), 0.018),
            Capsule(at(-0.010, 0.012, 0.034), at(-0.012, 0.033, 0.008), 0.014),
            Capsule(at(0.012, 0.012, 0.034), at(0.010, 0.033, 0.008), 0.014),
            Capsule(at(0.004, -0.014, 0.034), at(0.000, -0.033, 0.010), _THUMB),
            *(
                [Capsule(at(-ball, -0.033, 0.010), at(ball, -0.033, 0.010), _THUMB)]
                if (ball := across - _THUMB) > 0
                else []
            ),
            Capsule(at(0.0, 0.0, 0.036), tuple(map(float, wrist)), 0.021),
            Capsule(tuple(map(float, wrist)), tuple(map(float, wrist + 0.5 * arm)), 0.023),
        ),
        blend=0.012,
    )


def bare_hand(
    grasp: tuple[float, float, float],
    towards: tuple[float, float, float],
    *,
    facing: tuple[float, float, float] = (0.0, -0.66, 0.4),
    left: bool = False,
) -> RoundedShape:
    """A hand with four fingers and a thumb, life-size, which finders of hands know.

    Args:
        grasp: where the fingertips are [m].
        towards: direction in which the forearm leaves.
        facing: direction in which the back of the hand looks, as nearly as the forearm lets it.
        left: a left hand; the thumb is then on the other side.
    """
    fingers = -np.asarray(towards, float) / np.linalg.norm(towards)
    back = np.asarray(facing, float) - np.dot(facing, fingers) * fingers
    back /= np.linalg.norm(back)
    side = np.cross(fingers, back) * (-1 if left else 1)

    def at(along: float, across: float, above: float) -> tuple[float, ...]:
        return tuple(map(float, np.asarray(grasp) + along * fingers + across * side + above * back))

    shapes = []
    for across, knuckle, radius in _FINGERS:
        joints = [
            at(-0.145, 0.55 * across, 0.004),
            at(knuckle, across, 0.008),
            at(knuckle + 0.040, 1.05 * across, 0.011),
        ]
        joints += [at(knuckle + 0.062, 0.95 * across, 0.005), at(knuckle + 0.072, 0.8 * across, -0.004)]
        radii = 0.0125, radius, 0.9 * radius, 0.82 * radius
        shapes += [Capsule(*ends, r) for ends, r in zip(pairwise(joints), radii, strict=True)]
    thumb = [at(-0.13, -0.018, 0.0), at(-0.095, -0.045, -0.012), at(-0.05, -0.052, -0.016), at(-0.015, -0.036, -0.012)]
    shapes += [Capsule(*ends, r) for ends, r in zip(pairwise(thumb), (0.015, 0.0125, 0.0105), strict=True)]
    shapes += [Capsule(at(-0.14, across, 0.0), at(-0.6, across, 0.0), 0.023) for across in (-0.011, 0.011)]
    return RoundedShape(tuple(shapes), blend=0.005)


_FINGERS = ((-0.038, -0.062, 0.010), (-0.014, -0.056, 0.0105), (0.0115, -0.058, 0.010), (0.0345, -0.066, 0.0085))
"""Of each finger: its place across the hand, that of its knuckle along the hand from the fingertips, its radius [m]."""


def plush_lift() -> RigScene:
    """The head is lifted 0.11 m, moved sideways and held: legs leave the ground last, swing and settle."""
    grasp = (0.080, 0.0, 0.030)
    return RigScene(
        name="plush_lift",
        description="a stuffed animal",
        body=plush_body(),
        hand=mitten(grasp, (0.55, 0.45, 0.75)),
        motion=Motion(((0.1, 0.95, (-0.02, 0.0, 0.11)), (1.0, 1.3, (0.0, 0.03, 0.0)))),
    )


def plush_push() -> RigScene:
    """The same animal held at its hips: pressed down and pushed over the table, then raised, the head dragging."""
    grasp = (-0.045, 0.0, 0.030)
    return RigScene(
        name="plush_push",
        description="a stuffed animal",
        body=plush_body(),
        hand=mitten(grasp, (-0.45, 0.45, 0.8)),
        motion=Motion(
            (
                (0.1, 0.4, (0.0, 0.0, -0.006)),
                (0.25, 0.8, (0.04, 0.05, 0.0)),
                (0.8, 1.35, (-0.05, -0.07, 0.036)),
            )
        ),
        view=View(target=(0.01, 0.0, 0.04)),
    )


SOFT_LEGS = SoftPart(share=0.25, border=0.0)
"""Of `toy_lift` and `toy_swing`: the rear half with the legs is four times as soft as the front half with the head."""


def toy_lift() -> RigScene:
    """The same animal with a stiff and a soft part, held at its chest and lifted, moved sideways and held: legs and head hang from it."""
    grasp = (0.030, 0.0, 0.030)
    return RigScene(
        name="toy_lift",
        description="a stuffed animal",
        body=plush_body(),
        hand=mitten(grasp, (0.35, 0.5, 0.8)),
        motion=Motion(
            ((0.1, 0.8, (0.0, 0.0, 0.12)), (0.85, 1.15, (0.0, 0.04, -0.02)), (1.2, 1.5, (0.03, -0.04, 0.02)))
        ),
        soft_part=SOFT_LEGS,
    )


def toy_swing() -> RigScene:
    """The same toy held at its head: lifted, and swung to and fro."""
    grasp = (0.080, 0.0, 0.030)
    return RigScene(
        name="toy_swing",
        description="a stuffed animal",
        body=plush_body(),
        hand=mitten(grasp, (0.55, 0.45, 0.75)),
        motion=Motion(
            (
                (0.1, 0.7, (-0.02, 0.0, 0.13)),
                (0.7, 1.0, (0.0, 0.05, 0.0)),
                (1.0, 1.35, (0.0, -0.07, 0.0)),
                (1.35, 1.7, (0.0, 0.03, 0.0)),
            )
        ),
        soft_part=SOFT_LEGS,
    )


def plush_take() -> RigScene:
    """The same animal: a hand comes down to its head, takes it, lifts it, lets it fall from some centimetres and goes away."""
    return RigScene(
        name="plush_take",
        description="a stuffed animal",
        body=plush_body(),
        hand=mitten((0.130, 0.0, 0.120), (0.55, 0.45, 0.75)),
        motion=Motion(
            (
                (0.0, 0.3, (-0.05, 0.0, -0.09)),
                (0.4, 0.8, (-0.01, 0.0, 0.07)),
                (0.8, 1.0, (0.0, 0.02, 0.0)),
                (1.15, 1.5, (0.06, 0.0, 0.07)),
            )
        ),
        holds=(0.35, 1.1),
    )


STICK = 0.012  # radius of the stick that pushes [m]


def stick(tip: tuple[float, float, float], towards: tuple[float, float, float], length: float = 0.3) -> RoundedShape:
    """A stick with round ends: the ball at its lower end around `tip` [m], the rest leaving along `towards`."""
    way = np.asarray(towards, float) / np.linalg.norm(towards)
    return RoundedShape((Capsule(tip, tuple(map(float, tip + length * way)), STICK),))


def plush_poke() -> RigScene:
    """The same animal: a stick comes to the side of its head, pushes it over the table, which turns and bends it, lets go, and pushes on."""
    return RigScene(
        name="plush_poke",
        description="a stuffed animal",
        body=plush_body(),
        hand=stick((0.072, 0.062, 0.030), (0.35, 0.55, 0.75)),
        motion=Motion(
            (
                (0.1, 0.9, (-0.035, -0.075, 0.0)),
                (0.95, 1.15, (0.0, 0.02, 0.0)),
                (1.2, 1.8, (0.02, -0.065, 0.0)),
            )
        ),
        view=View(target=(0.0, 0.0, 0.03)),
        push_friction=0.3,
    )


def plush_shove() -> RigScene:
    """The same animal, pushed by the same stick at its hips from the same side, with the head left behind."""
    return RigScene(
        name="plush_shove",
        description="a stuffed animal",
        body=plush_body(),
        hand=stick((-0.045, 0.068, 0.030), (-0.35, 0.55, 0.75)),
        motion=Motion(((0.1, 0.8, (0.015, -0.07, 0.0)), (1.0, 1.6, (0.0, -0.05, 0.0)))),
        view=View(target=(0.0, 0.0, 0.03)),
        push_friction=0.3,
    )


SCENES = {
    "plush_lift": plush_lift,
    "plush_push": plush_push,
    "toy_lift": toy_lift,
    "toy_swing": toy_swing,
    "plush_take": plush_take,
    "plush_poke": plush_poke,
    "plush_shove": plush_shove,
}
