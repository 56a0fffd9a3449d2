"""All hidden effects by name, with the directions and places that a seed draws for them.

An amplitude is the one number of an effect that its strength sets (`strengths.py`); its unit is given at each maker.
"""

from collections.abc import Callable, Mapping

import numpy as np

from data.rig.hidden.around import Gravity, LinearDrag, QuadraticDrag, Wind
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
from data.rig.hidden.outside import Breathing, Magnet, Tether, Turntable
from data.rig.hidden.relaxation import HystereticDamping, StandardLinearSolid
from data.rig.rig_scene import RigScene
from data.rig.specimen import run
from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError

Scenes = Mapping[str, RigScene]  # by motion, of one object
Maker = Callable[[float, Scenes, np.random.Generator], Hidden]
"""From an amplitude, the scenes of a case and a generator for directions and places to the effect."""

OUTSIDE = "outside:"  # begins the names of effects that the search does not know


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
    return lambda amplitude, scenes, random: effect(amplitude)


def _signed(effect: Callable[[float], Hidden]) -> Maker:
    """The same, of either sign."""
    return lambda amplitude, scenes, random: effect(random.choice([-1, 1]) * amplitude)


def _body(scenes: Scenes) -> tuple[Array, Array]:
    """Corners of the body [m]."""
    body = next(iter(scenes.values())).body
    return np.asarray(body.lower), np.asarray(body.upper)


def _inside(scenes: Scenes, random: np.random.Generator, lower: list, upper: list) -> Float[Array, "3"]:
    """A place in the body, each coordinate between two shares of its length."""
    corner, opposite = _body(scenes)
    return corner + (opposite - corner) * random.uniform(lower, upper)


def _level(random: np.random.Generator) -> Float[Array, "2"]:
    """A horizontal direction."""
    angle = random.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _direction(random: np.random.Generator) -> Float[Array, "3"]:
    vector = random.normal(size=3)
    return vector / np.linalg.norm(vector)


def _wind(amplitude: float, scenes: Scenes, random: np.random.Generator) -> Wind:
    """m/s^2."""
    return Wind(*(amplitude * _level(random)), 0.0)


def _gravity(amplitude: float, scenes: Scenes, random: np.random.Generator) -> Gravity:
    """rad, of the tilt; the size is off by a third of that share."""
    return Gravity(*(amplitude * _level(random)), 0.3 * random.choice([-1, 1]) * amplitude)


def _standard_linear_solid(amplitude: float, scenes: Scenes, random: np.random.Generator) -> StandardLinearSolid:
    """Share of the modulus; the time is about that of a swing, or some of it."""
    return StandardLinearSolid(amplitude, float(np.exp(random.uniform(np.log(0.03), np.log(0.3)))))


def _fibres(amplitude: float, scenes: Scenes, random: np.random.Generator) -> Fibres:
    """Modulus over Young's. Oblique to the bar, so that bending twists it; along it they would only raise the modulus."""
    return Fibres(amplitude, random.choice([-1, 1]) * random.uniform(0.4, 0.8), random.uniform(-0.2, 0.2))


def _soft_spot(amplitude: float, scenes: Scenes, random: np.random.Generator) -> SoftSpot:
    """Share of the modulus lost; between the middle and the hand, where bending is largest."""
    place = _inside(scenes, random, [0.5, 0.2, 0.3], [0.72, 0.8, 0.7])
    return SoftSpot(min(amplitude, 0.95), *map(float, place), radius=0.035)


def _rest_shape(amplitude: float, scenes: Scenes, random: np.random.Generator) -> RestShape:
    """Curvature, 1/m, in one direction; and some stretch."""
    sideways, upwards = amplitude * _level(random)
    return RestShape(0.005 * random.choice([-1, 1]) * amplitude, sideways, upwards)


def _payload(amplitude: float, scenes: Scenes, random: np.random.Generator) -> Payload:
    """Mass over the body's; in the free part near one side, so that the bar twists (in its middle it would pass for a lower
    modulus)."""
    x, y, z = _inside(scenes, random, [0.1, 0.1, 0.3], [0.5, 0.25, 0.7])
    return Payload(amplitude, float(x), float(random.choice([-1, 1]) * y), float(z), radius=0.02)


def _density_gradient(amplitude: float, scenes: Scenes, random: np.random.Generator) -> DensityGradient:
    """1/m, along the bar; half as much across it."""
    along, across = random.choice([-1, 1]) * amplitude, random.uniform(-0.5, 0.5) * amplitude
    return DensityGradient(along, across, 0.0)


def _adhesion(amplitude: float, scenes: Scenes, random: np.random.Generator) -> GroundAdhesion:
    """Pa."""
    return GroundAdhesion(amplitude, random.uniform(0.003, 0.006))


def _stick_slip(amplitude: float, scenes: Scenes, random: np.random.Generator) -> StickSlip:
    """Excess of the static coefficient; it fades at about the speed of the drag, or else too early to show."""
    return StickSlip(amplitude, random.uniform(0.1, 0.25))


def _ground_plane(amplitude: float, scenes: Scenes, random: np.random.Generator) -> GroundPlane:
    """Slope; as high as it takes for all of the body to be above z = 0."""
    slope_x, slope_y = amplitude * _level(random)
    lower, upper = _body(scenes)
    half = (upper - lower) / 2
    return GroundPlane(abs(slope_x) * half[0] + abs(slope_y) * half[1], slope_x, slope_y)


def _swung(scenes: Scenes) -> tuple[Float[Array, "T F 3"], float]:
    """Where the free part of the lifted bar goes when nothing is in its way [m]; and the side, 1 or -1, to which it is jerked.

    With the elements of the capture: a coarser bar swings by millimetres less or more, as much as it should enter an obstacle.
    """
    scene = scenes["lift_swing"]
    motion = run(scene)
    free = motion.mesh.vertices[:, 0] < scene.grasp.lower[0] - scene.mesh_spacing
    return motion.vertices[:, free], float(np.sign(scene.motion.displacement(10.0)[1]))


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


def _obstacle_plane(amplitude: float, scenes: Scenes, random: np.random.Generator) -> ObstaclePlane:
    """m, by which the free end would enter the wall; oblique, so that the hand passes it."""
    places, side = _swung(scenes)
    angle = random.uniform(0.5, 0.8)
    towards = np.array([-np.sin(angle), side * np.cos(angle), 0.0])
    lower, upper = _body(scenes)
    reach = ((places - (lower + upper) / 2) @ towards).max()
    return ObstaclePlane(float(np.arctan2(towards[1], towards[0])), 0.0, float(reach) - amplitude)


def _obstacle_sphere(amplitude: float, scenes: Scenes, random: np.random.Generator) -> ObstacleSphere:
    """m, by which the free end would enter the ball."""
    places, side = _swung(scenes)
    end = np.abs(places[0, :, 0] - random.uniform(-0.1, -0.06)).argmin()
    beside, radius = places[(side * places[:, end, 1]).argmax(), end], random.uniform(0.025, 0.035)
    x, y, z = _entered(places.reshape(-1, 3), beside, radius, side, amplitude)
    return ObstacleSphere(float(x), float(y), float(z), radius)


def _obstacle_post(amplitude: float, scenes: Scenes, random: np.random.Generator) -> ObstaclePost:
    """m, by which the free end would enter the post."""
    places, side = _swung(scenes)
    beside, radius = np.array([random.uniform(-0.1, -0.06), 0.0]), random.uniform(0.015, 0.025)
    x, y = _entered(places.reshape(-1, 3)[:, :2], beside, radius, side, amplitude)
    return ObstaclePost(float(x), float(y), 0.25, radius)


def _grip_slip(amplitude: float, scenes: Scenes, random: np.random.Generator) -> GripSlip:
    """m/s."""
    return GripSlip(*map(float, amplitude * _direction(random)))


def _grip_offset(amplitude: float, scenes: Scenes, random: np.random.Generator) -> GripOffset:
    """m; never down into the table."""
    x, y, z = amplitude * _direction(random)
    return GripOffset(float(x), float(y), float(abs(z)))


def _camera_drift(amplitude: float, scenes: Scenes, random: np.random.Generator) -> CameraDrift:
    """m/s; and four times as many rad/s of roll."""
    return CameraDrift(*map(float, amplitude * _direction(random)), roll=random.choice([-1, 1]) * 4 * amplitude)


def _depth_bias(amplitude: float, scenes: Scenes, random: np.random.Generator) -> DepthBias:
    """Share; and a fifth as many metres of offset."""
    return DepthBias(0.2 * random.choice([-1, 1]) * amplitude, random.choice([-1, 1]) * amplitude)


def _magnet(amplitude: float, scenes: Scenes, random: np.random.Generator) -> Magnet:
    """N at 0.05 m; below the swinging end, to one side."""
    return Magnet(amplitude, -0.13, random.choice([-1, 1]) * 0.06, 0.03)


def _tether(amplitude: float, scenes: Scenes, random: np.random.Generator) -> Tether:
    """N/m; from the table beyond the free end, slack until the bar is lifted half way."""
    return Tether(amplitude, 0.08, -0.15, random.choice([-1, 1]) * 0.04, 0.0)


LIBRARY: dict[str, Maker] = {
    "linear_drag": _alone(LinearDrag),
    "quadratic_drag": _alone(QuadraticDrag),
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
    OUTSIDE + "breathing": lambda amplitude, scenes, random: Breathing(amplitude, random.uniform(0.8, 1.6)),
    OUTSIDE + "turntable": _signed(Turntable),
    OUTSIDE + "tether": _tether,
}
