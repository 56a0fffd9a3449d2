"""Parameters of `fit_global` (Stage 1): the laws, where E, nu, mu_f and the grip start and may go, the objective, the descent."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pipeline.config._base import StageParameters
from pipeline.config._fitting import Descent, Device, Losses, Masks, Variable, device_field

_RATE = "Adam's step in its {} per iteration; 0: held at the start"


class YoungsModulus(Variable):
    initial: float = Field(5e4, gt=0, description="start, middle of the scan [Pa]")
    lower: float = Field(1e3, gt=0, description="[Pa]")
    upper: float = Field(5e6, gt=0, description="[Pa]; the time step shrinks with its root")
    rate: float = Field(0.1, ge=0, description=_RATE.format("logarithm"))


class PoissonsRatio(Variable):
    initial: float = Field(0.3, gt=0, lt=0.5, description="start")
    lower: float = Field(0.05, ge=0, lt=0.5, description="")
    upper: float = Field(0.45, gt=0, lt=0.5, description="the time step goes to zero at 0.5")
    rate: float = Field(0.1, ge=0, description=_RATE.format("logit"))


class FrictionCoefficient(Variable):
    initial: float = Field(0.4, gt=0, description="start")
    lower: float = Field(0.01, gt=0, description="")
    upper: float = Field(2.0, gt=0, description="")
    rate: float = Field(0.1, ge=0, description=_RATE.format("logarithm"))


class GripStiffness(Variable):
    initial: float = Field(12.0, gt=0, description="k_f: force of a bond of weight one at unit strain, start [N]")
    lower: float = Field(0.01, gt=0, description="[N]")
    upper: float = Field(150.0, gt=0, description="[N]; substeps grow with its root, from about 100 N on")
    rate: float = Field(0.05, ge=0, description=_RATE.format("logarithm"))


class GripDamping(Variable):
    initial: float = Field(0.01, ge=0, description="dashpot along a bond, start; 0 only if held [N s/m]")
    lower: float = Field(1e-4, gt=0, description="[N s/m]")
    upper: float = Field(10.0, gt=0, description="[N s/m]")
    rate: float = Field(0.0, ge=0, description=_RATE.format("logarithm"))


class Material(StageParameters):
    """Expert laws and what of them is not fitted."""

    elastic_law: Literal["fixed_corotated", "neo_hookean", "hencky", "saint_venant_kirchhoff"] = Field(
        "fixed_corotated", description="C_e"
    )
    plastic_law: Literal["identity", "von_mises", "drucker_prager"] = Field("identity", description="C_p")
    yield_stress: float = Field(5e3, gt=0, description="von_mises: stress at which it flows [Pa]")
    viscosity: float = Field(0.0, ge=0, description="von_mises: viscosity of the flow, 0 for perfectly plastic [Pa s]")
    friction_angle: float = Field(0.6, gt=0, lt=1.57, description="drucker_prager: angle of internal friction [rad]")
    cohesion: float = Field(0.0, ge=0, description="drucker_prager: cohesion [Pa]")

    def plastic(self) -> tuple[float, float] | None:
        """The plastic law's two numbers, None for `identity`."""
        pairs = {
            "von_mises": (self.yield_stress, self.viscosity),
            "drucker_prager": (self.friction_angle, self.cohesion),
        }
        return pairs.get(self.plastic_law)


class Simulation(StageParameters):
    """The setting that later stages and predictions take over with the model."""

    ground: bool = Field(True, description="whether the support plane z = 0 is there")
    courant: float = Field(
        0.6,
        gt=0,
        le=0.85,
        description="time step relative to the elastic wave's time through a cell; a Poisson's ratio of 0.45 holds up to 0.65",
    )
    dtype: Literal["float32", "float64"] = Field("float32", description="precision of the simulator")

    def setting(self) -> dict:
        """As `Model.simulation` holds it."""
        ground_height = 0.0 if self.ground else None
        return {"ground_height": ground_height, "courant": self.courant, "dtype": self.dtype}


class Scan(StageParameters):
    """Forward rollouts at several Young's moduli and grips; the descent starts at the best of them."""

    count: int = Field(5, ge=1, description="how many; 1: none but the start itself")
    factor: float = Field(2.0, gt=1, description="each modulus relative to the one before")
    grips: tuple[Annotated[float, Field(gt=0)], ...] = Field(
        (1.0, 8.0),
        min_length=1,
        description="the grip's stiffness relative to its start, for what slips from a soft one",
    )


class FitGlobal(StageParameters):
    """Stage 1: one material for the whole object, and the grip."""

    material: Material = Field(Material(), description="")
    youngs_modulus: YoungsModulus = Field(YoungsModulus(), description="E")
    poissons_ratio: PoissonsRatio = Field(PoissonsRatio(), description="nu")
    friction_coefficient: FrictionCoefficient = Field(FrictionCoefficient(), description="mu_f of the ground")
    grip_stiffness: GripStiffness = Field(GripStiffness(), description="k_f (eq. interaction_force)")
    grip_damping: GripDamping = Field(GripDamping(), description="")
    simulation: Simulation = Field(Simulation(), description="")
    losses: Losses = Field(Losses(), description="")
    masks: Masks = Field(Masks(), description="")
    scan: Scan = Field(Scan(), description="")
    descent: Descent = Field(Descent(iterations=14, warmup=3), description="")
    device: Device = device_field()

    @model_validator(mode="after")
    def _starts_in_range(self) -> "FitGlobal":
        for name in ("youngs_modulus", "poissons_ratio", "friction_coefficient", "grip_stiffness", "grip_damping"):
            variable = getattr(self, name)
            if variable.rate > 0 and not variable.lower <= variable.initial <= variable.upper:
                raise ValueError(f"{name}.initial = {variable.initial} within [{variable.lower}, {variable.upper}]")
        return self
