"""All candidate effects by name, in the order in which they act. A new one is a file in its family and a line here."""

from physreal_core.effects.around.gravity import Gravity
from physreal_core.effects.around.linear_drag import LinearDrag
from physreal_core.effects.around.quadratic_drag import QuadraticDrag
from physreal_core.effects.around.surface_drag import SurfaceDrag
from physreal_core.effects.around.wind import Wind
from physreal_core.effects.contact.ground_adhesion import GroundAdhesion
from physreal_core.effects.contact.ground_plane import GroundPlane
from physreal_core.effects.contact.obstacle_plane import ObstaclePlane
from physreal_core.effects.contact.obstacle_post import ObstaclePost
from physreal_core.effects.contact.obstacle_sphere import ObstacleSphere
from physreal_core.effects.contact.rate_friction import RateFriction
from physreal_core.effects.contact.stick_slip import StickSlip
from physreal_core.effects.effect import Effect
from physreal_core.effects.grip.grip_compliance import GripCompliance
from physreal_core.effects.grip.grip_lag import GripLag
from physreal_core.effects.grip.grip_offset import GripOffset
from physreal_core.effects.grip.grip_slip import GripSlip
from physreal_core.effects.mass.density_gradient import DensityGradient
from physreal_core.effects.mass.payload import Payload
from physreal_core.effects.material.fibres import Fibres
from physreal_core.effects.material.hysteretic_damping import HystereticDamping
from physreal_core.effects.material.kelvin_voigt import KelvinVoigt
from physreal_core.effects.material.maxwell_creep import MaxwellCreep
from physreal_core.effects.material.plastic_yield import PlasticYield
from physreal_core.effects.material.rest_shape import RestShape
from physreal_core.effects.material.soft_spot import SoftSpot
from physreal_core.effects.material.standard_linear_solid import StandardLinearSolid
from physreal_core.effects.material.strain_stiffening import StrainStiffening
from physreal_core.effects.measurement.camera_drift import CameraDrift
from physreal_core.effects.measurement.depth_bias import DepthBias
from physreal_core.effects.measurement.frame_rate import FrameRate

EFFECTS: dict[str, Effect] = {
    effect.name: effect
    for effect in (
        LinearDrag(),
        QuadraticDrag(),
        SurfaceDrag(),
        Wind(),
        Gravity(),
        SoftSpot(),
        KelvinVoigt(),
        HystereticDamping(),
        StandardLinearSolid(),
        MaxwellCreep(),
        PlasticYield(),
        StrainStiffening(),
        Fibres(),
        RestShape(),
        Payload(),
        DensityGradient(),
        GroundAdhesion(),
        StickSlip(),
        RateFriction(),
        ObstaclePlane(),
        ObstacleSphere(),
        ObstaclePost(),
        GripSlip(),
        GripCompliance(),
        GripOffset(),
        GripLag(),
        GroundPlane(),  # turns what the others have placed in the world
        CameraDrift(),
        DepthBias(),
        FrameRate(),
    )
}
"""The library of effects, by name."""
