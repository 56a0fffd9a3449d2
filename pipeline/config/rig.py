"""Parameters of the capture rig (data/rig): the truth that the example's captures are made with."""

from typing import Literal, Self

from pydantic import Field, model_validator

from pipeline.config._base import StageParameters


class Rig(StageParameters):
    """The `rig` block of params.yaml. `hidden` and `strength` are of the bars, all else is of what is filmed."""

    film: str = Field("", description='scene that is filmed; "": the one that has the sequence\'s name')
    shape: Literal["given", "seen"] = Field(
        "given",
        description="given: a film comes with the stress-free shape and a click on object and hand; seen: with neither, nor a thickness",
    )
    hidden: str = Field(
        "kelvin_voigt",
        description="effect hidden in bar_lift and bar_press: a name in data/rig/hidden/library.py, two joined by +, or none",
    )
    strength: Literal["weak", "middle", "high"] = Field(
        "high", description="how far it moves the bar: about 1, 3 or 7 mm"
    )

    youngs_modulus: float = Field(6e4, gt=0, description="true Young's modulus [Pa]")
    poissons_ratio: float = Field(0.3, ge=0, lt=0.49, description="true Poisson's ratio")
    density: float = Field(300.0, gt=0, description="density [kg/m^3]")
    damping: float = Field(
        0.004, ge=0, description="stiffness-proportional damping [s]; 0.004 is about 3 % of critical"
    )
    friction_coefficient: float = Field(0.5, ge=0, description="true Coulomb friction with the table")
    mesh_spacing: float = Field(0.009, gt=0.004, le=0.03, description="edge of the finite-element mesh's cubes [m]")
    timestep: float = Field(0.001, gt=0, le=0.005, description="largest step of the finite-element simulation [s]")
    colour_noise: float = Field(2.0, ge=0, description="standard deviation of colour noise [grey levels of 255]")
    depth_noise_base: float = Field(0.0005, ge=0, description="depth noise at distance 0 [m]")
    depth_noise_slope: float = Field(0.0015, ge=0, description="depth noise's growth with distance squared [1/m]")
    depth_holes: float = Field(0.01, ge=0, lt=1, description="share of pixels without a depth reading by chance")
    width: int = Field(320, ge=64, description="image width [px]")
    height: int = Field(240, ge=48, description="image height [px]")
    fps: float = Field(30.0, gt=0, description="frames per second [1/s]")
    frames: int = Field(60, ge=2, description="frames filmed")
    observed: int = Field(42, ge=1, description="frames that fits may see; the rest is the future")

    @model_validator(mode="after")
    def _some_future(self) -> Self:
        if self.observed > self.frames:
            raise ValueError(f"observed = {self.observed} is more than frames = {self.frames}")
        return self
