"""Parameters of `find_gap`: which effects are tried, how many are fitted, and how careful the answer is."""

from pydantic import Field

from pipeline.config._base import StageParameters
from pipeline.config._effects import EffectName
from pipeline.config._fitting import Device, device_field

_CALIBRATED = "null: as calibrated on captures of known truth"


class FindGap(StageParameters):
    """Where the expert model and the measurement disagree, and which effect of the library is missing."""

    search: bool = Field(
        True,
        description="what is missing is looked for; false: only where model and measurement disagree, in a minute in place of many",
    )
    candidates: list[EffectName] = Field(
        default_factory=list, description="effects that are tried; []: the whole library"
    )
    shortlist: int | None = Field(None, ge=1, description=f"candidates that screening hands on to a fit; {_CALIBRATED}")
    seconds: int | None = Field(None, ge=0, description=f"candidates tried beside each of the best ones; {_CALIBRATED}")
    iterations: int | None = Field(None, ge=1, description=f"steps of a candidate's fit, at most; {_CALIBRATED}")
    prior_none: float | None = Field(
        None, gt=0, lt=1, description=f"probability that nothing is missing, before looking; {_CALIBRATED}"
    )
    false_alarms: float | None = Field(
        None, gt=0, lt=1, description=f"share of captures without a gap in which one may be named; {_CALIBRATED}"
    )
    grip_fitted: bool | None = Field(
        None,
        description="whether the grip's stiffness stays an unknown (Stage 1 fitted it); false: it is known, and grip_compliance a candidate; null: as Stage 1's defaults, an unknown of a thin body alone",
    )
    device: Device = device_field()

    def given(self) -> dict:
        """What is given of the search's settings, by their names in `GapSettings`."""
        given = self.model_dump(exclude={"search", "candidates", "device"}, exclude_none=True)
        return {"candidates": tuple(self.candidates), **given}
