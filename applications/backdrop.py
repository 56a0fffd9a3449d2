"""What is seen behind a twin and touches nothing: the splats of a file, or those of the sequence's own recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from applications.filmed import filmed_gaussians
from physreal_core.errors import InputError
from physreal_core.rendering import Camera, Gaussians, load_gaussians

FILMED = "filmed"
"""Names the recording itself in place of a file."""

_WHERE, _REMEDY = f"--backdrop {FILMED}", "name a file of splats: --backdrop FILE.ply"


@dataclass(frozen=True)
class Backdrop:
    """Gaussians that stand still and that nothing collides with.

    Attributes:
        source: `FILMED`, or the whole path of a file.
        gaussians: in the world [m].
    """

    source: str
    gaussians: Gaussians

    @classmethod
    def read(cls, source: str, sequence: str, video: Path, perceived: Path, camera: Camera | None) -> Backdrop:
        """What `--backdrop` names.

        Args:
            source: `FILMED`, or the path of a 3DGS .ply in the world's frame, in metres and z up.
            sequence: told in errors.
            video, perceived: output of parse_video and of segment_and_track for it, of which `FILMED` is made.
            camera: that filmed it; None of motion capture.

        Raises:
            InputError: the file cannot be read or holds no splat, or the recording has no images, no depth, or nothing beside object and hand.
        """
        if source == FILMED:
            if camera is None:
                raise InputError(
                    f"{sequence} was filmed by no camera",
                    where=_WHERE,
                    expected="a recording with colour and depth",
                    remedy=_REMEDY,
                )
            return cls(
                FILMED, filmed_gaussians(video, perceived, camera, where=f"{_WHERE}, {sequence}", remedy=_REMEDY)
            )
        gaussians = load_gaussians(source)
        if len(gaussians) == 0:
            raise InputError("there is no splat", where=source, expected="a 3DGS .ply with one or more")
        return cls(str(Path(source).resolve()), gaussians)
