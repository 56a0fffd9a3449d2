"""Parameters of `measure_body`."""

from pydantic import Field

from pipeline.config._base import StageParameters


class MeasureBody(StageParameters):
    """Size and mass of the posed object."""

    density: float | None = Field(None, gt=0, description="null: the one that the capture gives, if any [kg/m3]")
