"""The scenes of the embedded bar: motion capture of one specimen in two motions, with an effect hidden in it or with none."""

from dataclasses import dataclass

from data.rig.case import Case
from pipeline.config.rig import Rig


@dataclass(frozen=True)
class BarScene:
    """One recording of the bar.

    Attributes:
        motion: of the hand, one of `motions.MOTIONS`.
        hides: whether the effect that the parameters name acts in it.
    """

    motion: str
    hides: bool

    def case(self, parameters: Rig, seed: int) -> Case:
        """What is hidden in which bar; scenes of one seed show the same bar."""
        return Case(parameters.hidden if self.hides else "none", parameters.strength, seed)


BARS = {
    "bar_lift": BarScene("lift_swing", hides=True),
    "bar_press": BarScene("press_drag", hides=True),
    "plain_lift": BarScene("lift_swing", hides=False),
    "plain_press": BarScene("press_drag", hides=False),
}
