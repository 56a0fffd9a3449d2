"""Videos: .mp4 files, frame by frame, through OpenCV's FFmpeg."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from physreal_core.array_types import Array
from physreal_core.errors import InputError
from pipeline.reading.files import regular_file, too_large
from pipeline.reading.images import PIXELS

_EXPECTED, _REMEDY = "a whole .mp4 video", "export it again as .mp4 (H.264), or as images color/000000.png ..."


def read_video(path: Path, *, remedy: str = "") -> Iterator[Array]:
    """Frames [height, width, 3] uint8 RGB, in order.

    Args:
        path: a regular file.
        remedy: what to do where it is missing.

    Raises:
        InputError: the file is missing, truncated, no .mp4, holds no frame or frames that are too large.
    """
    import cv2

    path = regular_file(path, expected=_EXPECTED, remedy=remedy)
    _check_boxes(path)
    # The one backend that takes the name for a file's: others take it for a pattern of images or a pipeline.
    video = cv2.VideoCapture(str(path.resolve()), cv2.CAP_FFMPEG)
    try:
        if not video.isOpened():
            raise InputError("the video cannot be opened", where=str(path), expected=_EXPECTED, remedy=_REMEDY)
        width, height = (int(video.get(key)) for key in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        if width * height > PIXELS:
            raise too_large(path, f"frames of {width}x{height} pixels", f"at most {PIXELS} pixels")
        count = 0
        while (read := video.read())[0]:
            count += 1
            yield np.ascontiguousarray(read[1][..., ::-1])
        if count == 0:
            raise InputError("the video holds no frame", where=str(path), expected=_EXPECTED, remedy=_REMEDY)
    finally:
        video.release()


def _check_boxes(path: Path) -> None:
    """InputError unless the file is a row of whole boxes that begins as an .mp4 does.

    FFmpeg goes by the content, so that a playlist by the name of a video would lead it to other files and hosts; and it
    ends quietly where a video is truncated.
    """
    size, at = path.stat().st_size, 0
    with path.open("rb") as file:
        while at < size:
            file.seek(at)
            head = file.read(16)
            length, kind = int.from_bytes(head[:4], "big"), head[4:8]
            if at == 0 and kind != b"ftyp":
                raise InputError("it is no .mp4 video", where=str(path), expected=_EXPECTED, remedy=_REMEDY)
            if length == 1:
                length = int.from_bytes(head[8:16], "big")
            elif length == 0:  # to the end of the file
                length = size - at
            if length < 8 or at + length > size:
                raise InputError(
                    f"the video is truncated: {size} bytes, of which the part {kind!r} at byte {at} needs {length}",
                    where=str(path),
                    expected=_EXPECTED,
                    remedy=_REMEDY,
                )
            at += length
    if size == 0:
        raise InputError("the file is empty", where=str(path), expected=_EXPECTED, remedy=_REMEDY)
