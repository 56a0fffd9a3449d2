"""What is supposed of an object that was filmed in colour alone."""

from physreal_core.resting import Resting
from pipeline.capture import Capture


def resting_of(capture: Capture, has_depth: bool) -> Resting | None:
    """What is supposed of an object that was filmed without depth by a camera whose place is known; None else."""
    if has_depth or capture.T_world_camera is None:
        return None
    return Resting(capture.geometry, capture.thickness)
