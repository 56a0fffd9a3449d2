"""The frames at working size, written and read one by one."""

from dataclasses import dataclass
from pathlib import Path

from physreal_core.array_types import Array, UInt8
from pipeline.frames import COLOUR, DEPTH, frame_file, read_colour, read_depth

ANY_DEPTH = (0.0, float("inf"))  # parse_video has judged the unit


@dataclass(frozen=True)
class FrameImages:
    """color/000000.png and, of a capture with depth, depth/000000.png of parse_video.

    Attributes:
        folder: parse_video's output.
    """

    folder: Path

    @property
    def has_depth(self) -> bool:
        """Whether the capture has depth."""
        return (self.folder / DEPTH).is_dir()

    def save(self, frame: int, colour: UInt8[Array, "H W 3"], depth: Array | None) -> None:
        """Write one frame: RGB, and depth [H, W] uint16 in mm, 0 = no reading."""
        from PIL import Image

        for name, image in ((COLOUR, colour), (DEPTH, depth)):
            if image is not None:
                (self.folder / name).mkdir(exist_ok=True)
                Image.fromarray(image).save(frame_file(self.folder / name, frame), compress_level=3)

    def colour(self, frame: int) -> UInt8[Array, "H W 3"]:
        """RGB of one frame, InputError where the image is missing or cannot be read."""
        return read_colour(frame_file(self.folder / COLOUR, frame))

    def depth(self, frame: int) -> Array | None:
        """Depth [H, W] of one frame along z, uint16 in mm, 0 = no reading; None where the capture has none."""
        return read_depth(frame_file(self.folder / DEPTH, frame), ANY_DEPTH) if self.has_depth else None
