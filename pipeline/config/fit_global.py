"""Parameters of `fit_global` (Stage 1): the laws, where E, nu, mu_f and the grip start and may go, the objective, the descent."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pipeline.config._base import StageParameters
from pipeline.config._fitting import Descent, Device, Losses, Masks, Variable, device_field

_MATERIAL = ("youngs_modulus", "poissons_ratio", "bending_ratio", "weft_ratio", "shear_ratio")
_CONTACT = ("friction_coefficient", "grip_stiffness", "grip_damping")
_PUSH = ("tool_stiffness", "tool_friction")
_LAYERS = ("layer_friction",)
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


class SheetYoungsModulus(YoungsModulus):
    initial: float = Field(
        1e6, gt=0, description="start, middle of the scan; a fabric's is 50 to 5000 N/m over its thickness [Pa]"
    )
    lower: float = Field(2e4, gt=0, description="[Pa]")
    upper: float = Field(2e7, gt=0, description="[Pa]; the time step shrinks with its root")


class RopeYoungsModulus(YoungsModulus):
    initial: float = Field(1e7, gt=0, description="start, middle of the scan; of the section as if it were solid [Pa]")
    lower: float = Field(1e5, gt=0, description="[Pa]; an elastic cord")
    upper: float = Field(3e8, gt=0, description="[Pa]; the time step shrinks with its root")


class SheetPoissonsRatio(PoissonsRatio):
    rate: float = Field(0.05, ge=0, description=_RATE.format("logit"))


class BendingRatio(Variable):
    initial: float = Field(
        0.3, gt=0, description="start, middle of the scan; 1: as a solid sheet or bar of its modulus"
    )
    lower: float = Field(1e-3, gt=0, description="threads or fibres that slip on each other")
    upper: float = Field(10.0, gt=0, description="a coated fabric, a stiff core")
    rate: float = Field(
        0.15, ge=0, description=f"{_RATE.format('logarithm')}; the modulus' steps leave the bending stiffness"
    )


class WeftRatio(Variable):
    initial: float = Field(1.0, gt=0, description="start; 1: as stiff as along `sample_particles.warp`")
    lower: float = Field(0.1, gt=0, description="")
    upper: float = Field(10.0, gt=0, description="")
    rate: float = Field(0.0, ge=0, description=_RATE.format("logarithm"))


class ShearRatio(Variable):
    initial: float = Field(1.0, gt=0, description="start; 1: as an isotropic sheet, a woven fabric's is 0.01 to 0.3")
    lower: float = Field(1e-3, gt=0, description="")
    upper: float = Field(2.0, gt=0, description="")
    rate: float = Field(0.0, ge=0, description=_RATE.format("logarithm"))


class FrictionCoefficient(Variable):
    initial: float = Field(0.4, gt=0, description="start")
    lower: float = Field(0.01, gt=0, description="")
    upper: float = Field(2.0, gt=0, description="")
    rate: float = Field(0.1, ge=0, description=_RATE.format("logarithm"))


class GripStiffness(Variable):
    initial: float = Field(
        4000.0,
        gt=0,
        description="k_f: force of a bond of weight one at unit strain; that of a hand that does not give way [N]",
    )
    lower: float = Field(0.01, gt=0, description="[N]")
    upper: float = Field(2e4, gt=0, description="[N]")
    rate: float = Field(0.0, ge=0, description=_RATE.format("logarithm"))


class ThinGripStiffness(GripStiffness):
    initial: float = Field(200.0, gt=0, description="k_f, start; a thin body's hold also keeps its direction [N]")
    upper: float = Field(5e3, gt=0, description="[N]")
    rate: float = Field(0.05, ge=0, description=_RATE.format("logarithm"))


Reaches = Annotated[tuple[Annotated[float, Field(gt=0)], ...], Field(max_length=8)]


def _reaches(default: tuple[float, ...]) -> Reaches:
    text = "distances from the hand's points up to which it holds; each is fitted, the best kept. (): all that is bound [m]"
    return Field(default, description=text)


SheetReaches = Annotated[tuple[float, ...], Field(max_length=8)]


class Sheet(StageParameters):
    """Material of a planar body and its hold, in place of those above."""

    youngs_modulus: SheetYoungsModulus = Field(SheetYoungsModulus(), description="E of stretching along the warp")
    poissons_ratio: SheetPoissonsRatio = Field(SheetPoissonsRatio(), description="nu")
    bending_ratio: BendingRatio = Field(BendingRatio(), description="bending stiffness over that of a solid sheet")
    weft_ratio: WeftRatio = Field(WeftRatio(), description="E across the warp over that along it")
    shear_ratio: ShearRatio = Field(ShearRatio(), description="shear stiffness over that of an isotropic sheet")
    grip_stiffness: ThinGripStiffness = Field(ThinGripStiffness(), description="k_f (eq. interaction_force)")
    grip_reaches: SheetReaches = Field(
        (0.0, -0.002, -0.004, -0.006),
        description="how far beyond its outline the hand holds, negative within; each is fitted, the best kept. (): all that is bound [m]",
    )


class Rope(StageParameters):
    """Material of a linear body and its hold, in place of those above."""

    youngs_modulus: RopeYoungsModulus = Field(RopeYoungsModulus(), description="E of stretching")
    bending_ratio: BendingRatio = Field(
        BendingRatio(initial=0.1), description="bending stiffness over that of a solid bar"
    )
    grip_stiffness: ThinGripStiffness = Field(ThinGripStiffness(), description="k_f (eq. interaction_force)")
    grip_reaches: Reaches = _reaches((0.008, 0.012, 0.016))


class GripDamping(Variable):
    initial: float = Field(0.01, ge=0, description="dashpot along a bond, start; 0 only if held [N s/m]")
    lower: float = Field(1e-4, gt=0, description="[N s/m]")
    upper: float = Field(10.0, gt=0, description="[N s/m]")
    rate: float = Field(0.0, ge=0, description=_RATE.format("logarithm"))


class ToolStiffness(Variable):
    initial: float = Field(
        1e7, gt=0, description="push per mass and depth, start; so firm that the hand sinks in by a millimetre [1/s2]"
    )
    lower: float = Field(1e4, gt=0, description="[1/s2]")
    upper: float = Field(1e8, gt=0, description="[1/s2]; the time step shrinks with its root")
    rate: float = Field(0.0, ge=0, description=_RATE.format("logarithm"))


class ToolFriction(Variable):
    initial: float = Field(0.4, gt=0, description="start")
    lower: float = Field(0.01, gt=0, description="")
    upper: float = Field(1.0, gt=0, description="the time step shrinks in proportion to it")
    rate: float = Field(0.1, ge=0, description=_RATE.format("logarithm"))


class LayerFriction(Variable):
    initial: float = Field(0.4, gt=0, description="start")
    lower: float = Field(0.01, gt=0, description="")
    upper: float = Field(1.0, gt=0, description="")
    rate: float = Field(0.1, ge=0, description=_RATE.format("logarithm"))


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
    self_contact: bool = Field(
        False,
        description="whether layers of a cloth, strands of a rope, parts and pieces of a volume touch",
    )

    def setting(self) -> dict:
        """As `Model.simulation` holds it."""
        ground_height = 0.0 if self.ground else None
        setting = {"ground_height": ground_height, "courant": self.courant, "dtype": self.dtype}
        return setting | ({"self_contact": True} if self.self_contact else {})


class Scan(StageParameters):
    """Forward rollouts at several Young's moduli and grips; the descent starts at the best of them."""

    count: int = Field(5, ge=1, description="how many; 1: none but the start itself")
    factor: float = Field(2.0, gt=1, description="each modulus relative to the one before")
    bending: float = Field(4.0, gt=1, description="each bending ratio of a thin body relative to the one before")
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
    planar: Sheet = Field(Sheet(), description="a cloth's, in place of youngs_modulus and poissons_ratio")
    linear: Rope = Field(Rope(), description="a rope's, in place of youngs_modulus and poissons_ratio")
    friction_coefficient: FrictionCoefficient = Field(FrictionCoefficient(), description="mu_f of the ground")
    grip_stiffness: GripStiffness = Field(GripStiffness(), description="k_f (eq. interaction_force)")
    grip_damping: GripDamping = Field(GripDamping(), description="")
    tool_stiffness: ToolStiffness = Field(
        ToolStiffness(), description="of a hand that pushes (sample_particles.grip.contact)"
    )
    tool_friction: ToolFriction = Field(ToolFriction(), description="mu of a hand that pushes")
    layer_friction: LayerFriction = Field(
        LayerFriction(), description="mu where the object touches itself (simulation.self_contact)"
    )
    grip_reaches: Reaches = Field(
        (0.006, 0.009, 0.012, 0.016, 0.032),
        description="distances from the hand's points up to which it holds what it hides from the camera, and, less grip.radius, what is seen "
        "beside it; each is fitted, the farthest of the good ones kept. (): all that is bound [m]",
    )
    simulation: Simulation = Field(Simulation(), description="")
    losses: Losses = Field(Losses(), description="")
    masks: Masks = Field(Masks(), description="")
    scan: Scan = Field(Scan(), description="")
    descent: Descent = Field(Descent(iterations=14, warmup=3), description="")
    device: Device = device_field()

    @model_validator(mode="after")
    def _starts_in_range(self) -> "FitGlobal":
        for geometry in ("volumetric", "planar", "linear"):
            for name, variable in self.variables(geometry, pushed=True).items():
                if variable.rate > 0 and not variable.lower <= variable.initial <= variable.upper:
                    where = name if geometry == "volumetric" else f"{geometry}.{name}"
                    raise ValueError(
                        f"{where}.initial = {variable.initial} within [{variable.lower}, {variable.upper}]"
                    )
        return self

    def variables(self, geometry: str, *, pushed: bool = False) -> dict[str, Variable]:
        """What may move of the model of a body of this geometry, by the model's field; `pushed`: with what a hand has that pushes."""
        block = self.of(geometry)
        material = {name: getattr(block, name) for name in _MATERIAL if hasattr(block, name)}
        contact = (*_CONTACT, *(_PUSH if pushed else ()), *(_LAYERS if self.simulation.self_contact else ()))
        return material | {name: getattr(block, name, getattr(self, name)) for name in contact}

    def of(self, geometry: str) -> "FitGlobal | Sheet | Rope":
        """The block for a body of this geometry."""
        return self if geometry == "volumetric" else getattr(self, geometry)
