"""Parameters of `fit_patches` (Stage 2): how far E and nu of a patch may go from the global material."""

from pydantic import Field

from pipeline.config._base import StageParameters
from pipeline.config._fitting import Descent, Device, Losses, Masks, Variable, device_field

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


class FitPatches(StageParameters):
    """Stage 2: a material per patch; the laws and all else come with Stage 1's model."""

    youngs_modulus: PatchYoungsModulus = Field(PatchYoungsModulus(), description="E^k")
    poissons_ratio: PatchPoissonsRatio = Field(PatchPoissonsRatio(), description="nu^k")
    losses: Losses = Field(Losses(), description="")
    masks: Masks = Field(Masks(), description="")
    descent: Descent = Field(Descent(iterations=14, every_term=True, slack=0.02), description="")
    device: Device = device_field()
