"""The same effects by laws of another form than the library's: for each name, from the effect as the library has it to one that a
person would call the same.

The right name stays the library's. Such an effect states only the coefficients that mean the same in both laws, most often none.
"""

from collections.abc import Callable

from data.rig.hidden import other_laws as laws
from data.rig.hidden import other_material as material
from data.rig.hidden.effect import Hidden

OTHER_FORMS: dict[str, Callable[[Hidden], Hidden]] = {
    "linear_drag": lambda e: laws.PowerDrag(e.rate, 1.25, laws.SPEED),
    "quadratic_drag": lambda e: laws.PowerDrag(e.rate * laws.SPEED, 1.6, laws.SPEED),
    "wind": lambda e: laws.ProfiledWind(e.x, e.y, e.z),
    "kelvin_voigt": lambda e: material.ShearZener(e.time),
    "maxwell_creep": lambda e: material.TwoTimesCreep(e.rate),
    "plastic_yield": lambda e: material.HardeningYield(e.inverse_yield_strain),
    "strain_stiffening": lambda e: material.ExponentialStiffening(e.ratio),
    "fibres": lambda e: material.TensionFibres(e.ratio, e.azimuth, e.elevation),
    "soft_spot": lambda e: material.SoftEllipsoid(e.loss, e.x, e.y, e.z, e.radius),
    "rest_shape": lambda e: material.UnevenlyBent(e.stretch, e.curvature_1, e.curvature_2),
    "payload": lambda e: laws.ExtendedPayload(e.ratio, e.x, e.y, e.z, 1.6 * e.radius),
    "density_gradient": lambda e: laws.TwoDensities(e.x, e.y, e.z),
    "ground_adhesion": lambda e: laws.TriangularAdhesion(e.strength, e.range),
    "stick_slip": lambda e: laws.HyperbolicStickSlip(e.excess, e.speed),
    "rate_friction": lambda e: laws.SaturatingFriction(e.rate, laws.SLIDING),
    "obstacle_sphere": lambda e: laws.ObstacleEllipsoid(e.x, e.y, e.z, e.radius),
    "obstacle_post": lambda e: laws.ObstaclePillar(e.x, e.y, e.height, e.radius),
    "grip_slip": lambda e: laws.SaturatingSlip(e.x, e.y, e.z),
    "grip_compliance": lambda e: laws.HardeningGrip(e.compliance),
    "grip_offset": lambda e: laws.SlowOffset(e.x, e.y, e.z),
    "grip_lag": lambda e: laws.WanderingLag(e.lag),
    "camera_drift": lambda e: laws.SwayingCamera(e.x, e.y, e.z, e.roll),
    "depth_bias": lambda e: laws.CurvedDepth(e.offset, e.scale),
}
"""Gravity, the ground plane, the wall and the frame rate are not in it: another form of them would be another effect."""

VOLUMES_ALONE = ("kelvin_voigt", "fibres")
"""Effects of thin bodies whose law of another form is one of tetrahedra."""
