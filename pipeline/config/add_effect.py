"""Parameters of `add_effect`; how it fits comes with find_gap's own."""

from pydantic import Field

from pipeline.config._base import StageParameters
from pipeline.config._effects import EffectName
from pipeline.config._fitting import Device, device_field


class AddEffect(StageParameters):
    """The named effect put into the model, if it shrinks the gap on frames that its fit never saw."""

    effects: list[EffectName] = Field(
        default_factory=list, description="names to add instead of find_gap's; []: find_gap's"
    )
    device: Device = device_field()
