"""Parameters of `fit_patches` (Stage 2): how far E and nu of a patch may go from the global material."""

from pydantic import Field

from pipeline.config._base import StageParameters
from pipeline.config._fitting import Descent, Device, Losses, Masks, Variable, device_field

_MATERIAL = ("youngs_modulus", "poissons_ratio", "bending_ratio", "weft_ratio", "shear_ratio")
_ANCHOR = "weight of the mean squared distance from the global value in this coordinate"


class PatchYoungsModulus(Variable):
    lower: float = Field(1e3, gt=0, description="[Pa]")
    upper: float = Field(5e6, gt=0, description="[Pa]")
    rate: float = Field(0.08, ge=0, description="Adam's step in its logarithm per iteration; 0: held")
    anchor: float = Field(0.02, ge=0, description=_ANCHOR)


class PatchPoissonsRatio(Variable):
    lower: float = Field(0.05, ge=0, lt=0.5, description="")
    upper: float = Field(0.45, gt=0, lt=0.5, description="")
    rate: float = Field(0.05, ge=0, description="Adam's step in its logit per iteration; 0: held")
    anchor: float = Field(0.02, ge=0, description=_ANCHOR)


class PatchSheetModulus(PatchYoungsModulus):
    lower: float = Field(2e4, gt=0, description="[Pa]")
    upper: float = Field(2e7, gt=0, description="[Pa]")


class PatchRopeModulus(PatchYoungsModulus):
    lower: float = Field(1e5, gt=0, description="[Pa]")
    upper: float = Field(3e8, gt=0, description="[Pa]")


class PatchBendingRatio(Variable):
    lower: float = Field(1e-3, gt=0, description="")
    upper: float = Field(10.0, gt=0, description="")
    rate: float = Field(0.08, ge=0, description="Adam's step in its logarithm per iteration; 0: held")
    anchor: float = Field(0.02, ge=0, description=_ANCHOR)


class PatchWeftRatio(PatchBendingRatio):
    lower: float = Field(0.1, gt=0, description="")
    rate: float = Field(0.0, ge=0, description="Adam's step in its logarithm per iteration; 0: held")


class PatchShearRatio(PatchBendingRatio):
    upper: float = Field(2.0, gt=0, description="")
    rate: float = Field(0.0, ge=0, description="Adam's step in its logarithm per iteration; 0: held")


class PatchSheet(StageParameters):
    """Material of a planar body, in place of E and nu above."""

    youngs_modulus: PatchSheetModulus = Field(PatchSheetModulus(), description="E^k of stretching")
    poissons_ratio: PatchPoissonsRatio = Field(PatchPoissonsRatio(rate=0.0), description="nu^k")
    bending_ratio: PatchBendingRatio = Field(PatchBendingRatio(), description="")
    weft_ratio: PatchWeftRatio = Field(PatchWeftRatio(), description="moves only where Stage 1 has it")
    shear_ratio: PatchShearRatio = Field(PatchShearRatio(), description="moves only where Stage 1 has it")


class PatchRope(StageParameters):
    """Material of a linear body, in place of E and nu above."""

    youngs_modulus: PatchRopeModulus = Field(PatchRopeModulus(), description="E^k of stretching")
    bending_ratio: PatchBendingRatio = Field(PatchBendingRatio(), description="")


class FitPatches(StageParameters):
    """Stage 2: a material per patch; the laws and all else come with Stage 1's model."""

    youngs_modulus: PatchYoungsModulus = Field(PatchYoungsModulus(), description="E^k")
    poissons_ratio: PatchPoissonsRatio = Field(PatchPoissonsRatio(), description="nu^k")
    planar: PatchSheet = Field(PatchSheet(), description="a cloth's, in place of youngs_modulus and poissons_ratio")
    linear: PatchRope = Field(PatchRope(), description="a rope's, in place of youngs_modulus and poissons_ratio")
    losses: Losses = Field(Losses(), description="")
    masks: Masks = Field(Masks(), description="")
    descent: Descent = Field(Descent(iterations=60, every_term=True, slack=0.02), description="")
    device: Device = device_field()

    def variables(self, geometry: str) -> dict[str, Variable]:
        """What may move of the model of a body of this geometry, by the model's field."""
        block = self if geometry == "volumetric" else getattr(self, geometry)
        return {name: getattr(block, name) for name in _MATERIAL if hasattr(block, name)}
