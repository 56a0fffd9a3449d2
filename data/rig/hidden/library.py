"""All hidden effects by name, with the directions and places that a seed draws for them.

An amplitude is the one number of an effect that its strength sets (`strengths.py`); its unit is given at each maker.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from data.rig.bodies import Body
from data.rig.hidden.around import Gravity, LinearDrag, QuadraticDrag, SurfaceDrag, Wind
from data.rig.hidden.contact import (
    GroundAdhesion,
    GroundPlane,
    ObstaclePlane,
    ObstaclePost,
    ObstacleSphere,
    RateFriction,
    StickSlip,
)
from data.rig.hidden.effect import Hidden
from data.rig.hidden.grip import GripCompliance, GripLag, GripOffset, GripSlip
from data.rig.hidden.mass import DensityGradient, Payload
from data.rig.hidden.material import (
    Fibres,
    KelvinVoigt,
    MaxwellCreep,
    PlasticYield,
    RestShape,
    SoftSpot,
    StrainStiffening,
)
from data.rig.hidden.measurement import CameraDrift, DepthBias, FrameRate
from data.rig.hidden.outside import Breathing, Charge, GradientField, Gyration, Magnet, Tether, Turntable
from data.rig.hidden.relaxation import HystereticDamping, StandardLinearSolid
from data.rig.rig_scene import RigScene
from data.rig.specimen import run
from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError

OUTSIDE = "outside:"  # begins the names of effects that the search does not know
_CLEAR = 0.004  # [m] between an obstacle and the body as it lies at frame 0
_TRIES = 8


@dataclass(frozen=True)
class Swing:
    """Where the free part goes when nothing is in its way, [T, F, 3] m; and the side, 1 or -1, to which it goes furthest."""

    places: Float[Array, "T F 3"]
    side: float

    @property
    def everywhere(self) -> Float[Array, "P 3"]:
        return self.places.reshape(-1, 3)

    def is_clear(self, distance: Float[Array, " F"]) -> bool:
        """Whether an obstacle with these distances from the free part at frame 0 [m] leaves it alone there."""
        return bool(distance.min() > _CLEAR)


@dataclass(frozen=True)
class Staging:
    """What a maker may look at to place an effect.

    Args:
        body: the object.
        swung: a scene of it that is seen, in which its free part goes sideways: obstacles stand in its way there.
    """

    body: Body
    swung: RigScene

    @cached_property
    def swing(self) -> Swing:
        """With the elements of the capture: a coarser body swings by millimetres less or more, as much as it should enter an obstacle."""
        scene = self.swung
        motion = run(scene)
        free = motion.mesh.vertices[:, 0] < scene.grasp.lower[0] - scene.mesh_spacing
        places = motion.vertices[:, free]
        away = (places - places[0]).mean(axis=1)[:, 1]
        return Swing(places, float(np.sign(away[np.abs(away).argmax()])))


Maker = Callable[[float, Staging, np.random.Generator], Hidden]
"""From an amplitude, the object and a generator for directions and places to the effect."""


def maker(name: str) -> Maker:
    """The effect called `name`.

    Raises:
        InputError: there is none.
    """
    if name not in LIBRARY:
        raise InputError(f"no hidden effect named {name!r}", where="rig", expected=f"one of {sorted(LIBRARY)}")
    return LIBRARY[name]


def _alone(effect: Callable[[float], Hidden]) -> Maker:
    """An effect that is its amplitude and nothing else."""
    return lambda amplitude, staging, random: effect(amplitude)


def _signed(effect: Callable[[float], Hidden]) -> Maker:
    """The same, of either sign."""
    return lambda amplitude, staging, random: effect(random.choice([-1, 1]) * amplitude)


def _level(random: np.random.Generator) -> Float[Array, "2"]:
    """A horizontal direction."""
    angle = random.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _direction(random: np.random.Generator) -> Float[Array, "3"]:
    vector = random.normal(size=3)
    return vector / np.linalg.norm(vector)


def _wind(amplitude: float, staging: Staging, random: np.random.Generator) -> Wind:
    """m/s^2."""
    return Wind(*(amplitude * _level(random)), 0.0)


def _gravity(amplitude: float, staging: Staging, random: np.random.Generator) -> Gravity:
    """rad, of the tilt; the size is off by a third of that share."""
    return Gravity(*(amplitude * _level(random)), 0.3 * random.choice([-1, 1]) * amplitude)


def _standard_linear_solid(amplitude: float, staging: Staging, random: np.random.Generator) -> StandardLinearSolid:
    """Share of the modulus; the time is about that of a swing, or some of it."""
    return StandardLinearSolid(amplitude, float(np.exp(random.uniform(np.log(0.03), np.log(0.3)))))


def _fibres(amplitude: float, staging: Staging, random: np.random.Generator) -> Fibres:
    """Modulus over Young's. Oblique to the body, so that bending twists it; along it they would only raise the modulus."""
    return Fibres(amplitude, random.choice([-1, 1]) * random.uniform(0.4, 0.8), random.uniform(-0.2, 0.2))


def _soft_spot(amplitude: float, staging: Staging, random: np.random.Generator) -> SoftSpot:
    """Share of the modulus lost; between the middle and the hand, where bending is largest."""
    place = staging.body.place(random, (0.6, 0.9), 0.3 * staging.body.thickness)
    return SoftSpot(min(amplitude, 0.95), *map(float, place), radius=staging.body.spot)


def _rest_shape(amplitude: float, staging: Staging, random: np.random.Generator) -> RestShape:
    """Curvature, 1/m, in one direction; and some stretch."""
    sideways, upwards = amplitude * _level(random)
    return RestShape(0.005 * random.choice([-1, 1]) * amplitude, sideways, upwards)


def _payload(amplitude: float, staging: Staging, random: np.random.Generator) -> Payload:
    """Mass over the body's; in the free part near one side, so that the body twists (in its middle it would pass for a lower
    modulus)."""
    depth = min(0.008, 0.3 * staging.body.thickness)
    places = [staging.body.place(random, (0.1, 0.6), depth) for _ in range(5)]
    x, y, z = max(places, key=lambda place: abs(place[1]))
    return Payload(amplitude, float(x), float(y), float(z), radius=0.02)


def _density_gradient(amplitude: float, staging: Staging, random: np.random.Generator) -> DensityGradient:
    """1/m, along the body; half as much across it."""
    along, across = random.choice([-1, 1]) * amplitude, random.uniform(-0.5, 0.5) * amplitude
    return DensityGradient(along, across, 0.0)


def _adhesion(amplitude: float, staging: Staging, random: np.random.Generator) -> GroundAdhesion:
    """Pa."""
    return GroundAdhesion(amplitude, random.uniform(0.003, 0.006))


def _stick_slip(amplitude: float, staging: Staging, random: np.random.Generator) -> StickSlip:
    """Excess of the static coefficient; it fades at about the speed of the drag, or else too early to show."""
    return StickSlip(amplitude, random.uniform(0.1, 0.25))


def _ground_plane(amplitude: float, staging: Staging, random: np.random.Generator) -> GroundPlane:
    """Slope; as high as it takes for all of the body to be above z = 0."""
    slope_x, slope_y = amplitude * _level(random)
    half = np.maximum(staging.body.upper, -staging.body.lower)
    return GroundPlane(float(abs(slope_x) * half[0] + abs(slope_y) * half[1]), slope_x, slope_y)


def _entered(
    places: Float[Array, "P A"], beside: Float[Array, " A"], radius: float, side: float, depth: float
) -> Array:
    """The centre [m] of a ball (A = 3) or post (A = 2) that `places` enter by `depth` [m] and no more: `beside`, moved to
    the side."""
    inner, outer = 0.0, 0.5
    for _ in range(40):
        centre = beside + side * np.eye(len(beside))[1] * (inner + outer) / 2
        entered = radius - np.linalg.norm(places - centre, axis=1).min()
        inner, outer = ((inner + outer) / 2, outer) if entered > depth else (inner, (inner + outer) / 2)
    return centre


def _obstacle_plane(amplitude: float, staging: Staging, random: np.random.Generator) -> ObstaclePlane:
    """m, by which the free end would enter the wall; oblique, so that the hand passes it."""
    swing, middle = staging.swing, staging.body.shape.middle()
    for _ in range(_TRIES):
        angle = random.uniform(0.3, 0.8)
        towards = np.array([-np.sin(angle), swing.side * np.cos(angle), 0.0])
        reach = float(((swing.everywhere - middle) @ towards).max()) - amplitude
        if swing.is_clear(reach - (swing.places[0] - middle) @ towards):
            break
    return ObstaclePlane(float(np.arctan2(towards[1], towards[0])), 0.0, reach)


def _obstacle_sphere(amplitude: float, staging: Staging, random: np.random.Generator) -> ObstacleSphere:
    """m, by which the free end would enter the ball."""
    swing, body = staging.swing, staging.body
    for _ in range(_TRIES):
        x = body.lower[0] + random.uniform(0.1, 0.3) * body.length
        end, radius = np.abs(swing.places[0, :, 0] - x).argmin(), random.uniform(0.025, 0.035)
        beside = swing.places[(swing.side * swing.places[:, end, 1]).argmax(), end].copy()
        beside[2] = max(beside[2], 0.6 * radius)  # on the table, not in it
        centre = _entered(swing.everywhere, beside, radius, swing.side, amplitude)
        if swing.is_clear(np.linalg.norm(swing.places[0] - centre, axis=1) - radius):
            break
    return ObstacleSphere(*map(float, centre), radius)


def _obstacle_post(amplitude: float, staging: Staging, random: np.random.Generator) -> ObstaclePost:
    """m, by which the free end would enter the post."""
    swing, body = staging.swing, staging.body
    for _ in range(_TRIES):
        beside = np.array([body.lower[0] + random.uniform(0.1, 0.3) * body.length, 0.0])
        radius = random.uniform(0.015, 0.025)
        centre = _entered(swing.everywhere[:, :2], beside, radius, swing.side, amplitude)
        if swing.is_clear(np.linalg.norm(swing.places[0, :, :2] - centre, axis=1) - radius):
            break
    return ObstaclePost(*map(float, centre), 0.25, radius)


def _grip_slip(amplitude: float, staging: Staging, random: np.random.Generator) -> GripSlip:
    """m/s."""
    return GripSlip(*map(float, amplitude * _direction(random)))


def _grip_offset(amplitude: float, staging: Staging, random: np.random.Generator) -> GripOffset:
    """m; never down into the table."""
    x, y, z = amplitude * _direction(random)
    return GripOffset(float(x), float(y), float(abs(z)))


def _camera_drift(amplitude: float, staging: Staging, random: np.random.Generator) -> CameraDrift:
    """m/s; and four times as many rad/s of roll."""
    return CameraDrift(*map(float, amplitude * _direction(random)), roll=random.choice([-1, 1]) * 4 * amplitude)


def _depth_bias(amplitude: float, staging: Staging, random: np.random.Generator) -> DepthBias:
    """Share; and a fifth as many metres of offset."""
    return DepthBias(0.2 * random.choice([-1, 1]) * amplitude, random.choice([-1, 1]) * amplitude)


def _beside(staging: Staging, random: np.random.Generator, away: float) -> float:
    """y of a place `away` [m] to one side of the body [m]."""
    side = random.choice([-1, 1])
    return float(side * (away + (staging.body.upper[1] if side > 0 else -staging.body.lower[1])))


def _magnet(amplitude: float, staging: Staging, random: np.random.Generator) -> Magnet:
    """N at 0.05 m; below the swinging end, to one side."""
    return Magnet(amplitude, float(staging.body.lower[0]) - 0.01, _beside(staging, random, 0.038), 0.03)


def _tether(amplitude: float, staging: Staging, random: np.random.Generator) -> Tether:
    """N/m; from the table beyond the free end, slack until the body is lifted half way."""
    return Tether(amplitude, 0.08, float(staging.body.lower[0]) - 0.03, random.choice([-1, 1]) * 0.04, 0.0)


def _charge(amplitude: float, staging: Staging, random: np.random.Generator) -> Charge:
    """m/s^2 at 0.1 m; beyond the free end, to one side and above."""
    x, y = (
        float(staging.body.lower[0]) - random.uniform(0.02, 0.05),
        _beside(staging, random, random.uniform(0.05, 0.08)),
    )
    return Charge(amplitude * 0.1**2, x, y, random.uniform(0.05, 0.12))


LIBRARY: dict[str, Maker] = {
    "linear_drag": _alone(LinearDrag),
    "quadratic_drag": _alone(QuadraticDrag),
    "surface_drag": _alone(SurfaceDrag),
    "wind": _wind,
    "gravity": _gravity,
    "kelvin_voigt": _alone(KelvinVoigt),
    "hysteretic_damping": _alone(HystereticDamping),
    "standard_linear_solid": _standard_linear_solid,
    "maxwell_creep": _alone(MaxwellCreep),
    "plastic_yield": _alone(PlasticYield),
    "strain_stiffening": _alone(StrainStiffening),
    "fibres": _fibres,
    "soft_spot": _soft_spot,
    "rest_shape": _rest_shape,
    "payload": _payload,
    "density_gradient": _density_gradient,
    "ground_adhesion": _adhesion,
    "stick_slip": _stick_slip,
    "rate_friction": _alone(RateFriction),
    "ground_plane": _ground_plane,
    "obstacle_plane": _obstacle_plane,
    "obstacle_sphere": _obstacle_sphere,
    "obstacle_post": _obstacle_post,
    "grip_slip": _grip_slip,
    "grip_compliance": _alone(GripCompliance),
    "grip_offset": _grip_offset,
    "grip_lag": _signed(GripLag),
    "camera_drift": _camera_drift,
    "depth_bias": _depth_bias,
    "frame_rate": _signed(FrameRate),
    OUTSIDE + "magnet": _magnet,
    OUTSIDE + "breathing": lambda amplitude, staging, random: Breathing(amplitude, random.uniform(0.8, 1.6)),
    OUTSIDE + "turntable": _signed(Turntable),
    OUTSIDE + "tether": _tether,
    OUTSIDE + "charge": _charge,
    OUTSIDE + "gradient_field": _signed(GradientField),
    OUTSIDE + "gyration": _signed(Gyration),
}
