"""Parameters of `fit_residual` (Stage 3): sizes and bounds of the residual networks, and how fast they may move."""

from pydantic import Field

from pipeline.config._base import StageParameters
from pipeline.config._fitting import Descent, Device, Losses, Masks, device_field


class Residual(StageParameters):
    """The networks N_e and N_p; of a cloth or rope N_e alone."""

    latent_size: int = Field(4, ge=1, le=16, description="length of a patch's latent code")
    hidden: int = Field(16, ge=1, le=64, description="units of the hidden layers")
    beta_elastic: float = Field(
        0.2, ge=0, lt=1, description="|residual stress| at most this share of the expert's; 0: off"
    )
    beta_plastic: float = Field(0.02, ge=0, lt=1, description="|residual F| a frame at most this share of |F|; 0: off")
    strain_scale: float = Field(0.1, gt=0, description="strain that counts as one")
    thin_strain_scale: float = Field(
        0.01, gt=0, description="the same of a cloth or rope, whose surface is strained that much where it bends"
    )


class Rate(StageParameters):
    rate: float = Field(0.01, ge=0, description="Adam's step per iteration; 0: held")
    anchor: float = Field(0.001, ge=0, description="weight of the mean squared distance from the start")


class FitResidual(StageParameters):
    """Stage 3: what no expert law and no named effect explains; E and nu are held. Networks stay where unseen frames confirm them."""

    residual: Residual = Field(Residual(), description="")
    networks: Rate = Field(Rate(rate=0.02), description="the networks' weights")
    latents: Rate = Field(Rate(rate=0.04), description="the patches' latent codes")
    losses: Losses = Field(Losses(), description="")
    masks: Masks = Field(Masks(), description="")
    descent: Descent = Field(Descent(iterations=12, every_term=True), description="")
    kept_back: float = Field(
        0.25,
        ge=0,
        lt=1,
        description="last share of the observed frames that the networks are not fitted to: they stay if the objective is lower there and, "
        "where the fit has a companion, in that recording; 0: they are fitted to all and stay",
    )
    compare: bool = Field(
        True, description="where an effect was named, fit the networks without it too, for the report"
    )
    device: Device = device_field()
