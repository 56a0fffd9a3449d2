"""Blocks that the three fit stages have in common; the core's dataclasses of the same names say what each does."""

from typing import Literal

from pydantic import Field, model_validator

from pipeline.config._base import StageParameters


class Losses(StageParameters):
    """The training objective (eq. training_objective); a term of 1 is an error of about one scale."""

    motion: float = Field(1.0, ge=0, description="weight of L_motion (eq. motion_loss)")
    mask: float = Field(1.0, ge=0, description="weight of L_mask, cross-entropy per object pixel [nat]; 0: off")
    motion_3d: float = Field(1.0, ge=0, description="weight of L_3D within L_motion")
    motion_2d: float = Field(0.5, ge=0, description="weight of L_2D within L_motion")
    penalty: Literal["charbonnier", "huber"] = Field("charbonnier", description="robust penalty of a distance")
    track_scale: float = Field(0.005, gt=0, description="model error expected of a track in 3D, beside its sigma [m]")
    pixel_scale: float = Field(2.0, gt=0, description="error expected of a track in the image [px]")
    settled: float = Field(
        0.0,
        ge=0,
        description="weight of the settled term, in place of L_motion: mean of the swing against the state at rest",
    )
    settled_simulated: int = Field(
        72, ge=2, description="frames after release whose windowed mean the settled term takes"
    )
    settled_measured: int = Field(50, ge=1, description="last observed frames in which the object is at rest")


class Masks(StageParameters):
    """Which silhouettes L_mask sees."""

    frames: int = Field(8, ge=1, description="observed frames it is computed in, evenly spaced")
    reduction: int = Field(2, ge=1, description="pixels of the image to one pixel of the silhouettes, a side")
    hidden_margin: int = Field(2, ge=0, description="pixels around the controller that count as hidden [px]")


class Descent(StageParameters):
    """Adam (see physreal_core.fitting.descent.DescentConfig)."""

    iterations: int = Field(20, ge=1, description="gradient steps")
    warmup: int = Field(0, ge=0, description="leading iterations over which the horizon grows to all observed frames")
    first_horizon: float = Field(0.4, gt=0, le=1, description="share of the observed frames seen at first")
    decay: float = Field(0.1, gt=0, le=1, description="size of the last step relative to the first")
    rejections: int = Field(6, ge=0, description="halvings of a step that makes the rollout non-finite")
    checkpoint_every: int = Field(3, ge=1, description="iterations between checkpoints")
    every_term: bool = Field(False, description="keep an iterate only if no term is worse than at the start")
    slack: float = Field(0.0, ge=0, description="how much worse a term may be, relative, where every_term is set")

    @model_validator(mode="after")
    def _reaches_the_full_horizon(self) -> "Descent":
        if self.warmup > self.iterations:
            raise ValueError(f"warmup at most iterations ({self.iterations})")
        return self


class Variable(StageParameters):
    """What may move, how far, how fast."""

    @model_validator(mode="after")
    def _range_in_order(self) -> "Variable":
        if not self.lower < self.upper:
            raise ValueError("lower below upper")
        return self


Device = Literal["cpu", "cuda:0"]


def device_field() -> Device:
    return Field("cpu", description="where the rollout is computed")
