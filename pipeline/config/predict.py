"""Parameters of `predict`: none of its own beyond where it computes; laws and material come with the model."""

from typing import Literal

from pydantic import Field

from pipeline.config._base import StageParameters


class Predict(StageParameters):
    """Rolling a sequence out with another sequence's model."""

    device: Literal["cpu", "cuda:0"] = Field("cpu", description="where the rollout is computed")
