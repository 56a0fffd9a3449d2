"""Pictures of the page: a frame with outlines and tracks, and all frames on one sheet, as JPEG."""

import math
from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Bool, UInt8
from pipeline.label.clip import Clip
from pipeline.products.masks import ROLES, Role

COLOURS: dict[Role, tuple[int, int, int]] = {"object": (60, 220, 90), "controller": (255, 90, 60)}
"""RGB of the outlines."""
NAMES: dict[Role, str] = {"object": "object", "controller": "hand"}
"""What the page calls them."""
THUMBNAIL = 128
"""Width of a frame on the sheet [px]."""
COLUMNS = 8
LARGEST_SHEET = 240
"""More frames than this are not all on the sheet: every second one, or third, is."""
MOST_TRACKS = 400
QUALITY = 85


def picture(clip: Clip, t: int, *, masks: bool = True, tracks: bool = True) -> bytes:
    """Frame t with the outlines of object and hand, and its tracks as dots: green where sure, red where not."""
    import cv2

    image = np.array(clip.frame(t), order="C")
    if masks:
        for role in ROLES:
            if (mask := clip.mask(role, t)) is not None:
                _outline(image, mask, COLOURS[role], 2)
    if tracks and clip.found is not None and t < len(clip.found.tracks):
        points, seen, sure = clip.found.tracks[t], clip.found.visible[t], clip.found.confidence[t]
        step = max(1, math.ceil(len(points) / MOST_TRACKS))
        for point, confidence in zip(points[seen][::step], sure[seen][::step], strict=True):
            if np.isfinite(point).all():
                colour = (int(255 * (1 - confidence)), int(255 * confidence), 60)
                cv2.circle(image, tuple(int(x) for x in np.rint(point)), 2, colour, -1, cv2.LINE_AA)
    return jpeg(image)


@dataclass(frozen=True)
class Sheet:
    """Where the frames are on the sheet.

    Attributes:
        count: of the clip's frames.
        size: of a thumbnail, width and height [px].
        stride: every so manieth frame is there.
        columns: in a row.
    """

    count: int
    size: tuple[int, int]
    stride: int
    columns: int

    @classmethod
    def of(cls, clip: Clip) -> "Sheet":
        """The sheet for a clip."""
        width, height = clip.size
        stride = math.ceil(len(clip) / LARGEST_SHEET)
        shown = math.ceil(len(clip) / stride)
        return cls(len(clip), (THUMBNAIL, max(1, round(THUMBNAIL * height / width))), stride, min(COLUMNS, shown))

    @property
    def frames(self) -> range:
        """Those that are there, in order."""
        return range(0, self.count, self.stride)

    @property
    def extent(self) -> tuple[int, int]:
        """Width and height of the sheet [px]."""
        rows = math.ceil(len(self.frames) / self.columns)
        return self.columns * self.size[0], rows * self.size[1]

    def corner(self, t: int) -> tuple[int, int]:
        """Upper left corner of the thumbnail of frame t, or of the one before it that is there [px]."""
        row, column = divmod(t // self.stride, self.columns)
        return column * self.size[0], row * self.size[1]

    def frame_at(self, u: float, v: float) -> int:
        """The frame whose thumbnail holds a pixel."""
        place = int(v // self.size[1]) * self.columns + int(min(u // self.size[0], self.columns - 1))
        return self.frames[min(max(place, 0), len(self.frames) - 1)]


def sheet_picture(clip: Clip, sheet: Sheet) -> bytes:
    """All frames with the outlines of object and hand."""
    import cv2

    width, height = sheet.extent
    page = np.zeros((height, width, 3), np.uint8)
    for t in sheet.frames:
        small = cv2.resize(clip.frame(t), sheet.size, interpolation=cv2.INTER_AREA)
        for role in ROLES:
            if clip.found is not None and t < len(clip.found.masks[role]):
                mask = cv2.resize(clip.found.masks[role][t].astype(np.uint8), sheet.size, interpolation=cv2.INTER_AREA)
                small[mask > 0] = (0.55 * small[mask > 0] + 0.45 * np.array(COLOURS[role])).astype(np.uint8)
                _outline(small, mask > 0, COLOURS[role], 1)
        u, v = sheet.corner(t)
        page[v : v + sheet.size[1], u : u + sheet.size[0]] = small
        cv2.putText(page, str(t), (u + 3, v + 12), cv2.FONT_HERSHEY_SIMPLEX, 0.36, (255, 255, 255), 1, cv2.LINE_AA)
    return jpeg(page)


def outline_path(mask: Bool[Array, "H W"]) -> str:
    """The outline of a mask as the `d` of an SVG path, in pixels of the image."""
    import cv2

    contours = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]
    rings = [contour.reshape(-1, 2) + 0.5 for contour in contours if len(contour) > 2]
    return " ".join("M" + " L".join(f"{u:g},{v:g}" for u, v in ring) + " Z" for ring in rings)


def jpeg(image: UInt8[Array, "H W 3"]) -> bytes:
    """An RGB image as a JPEG file."""
    import cv2

    return cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()


def _outline(image: Array, mask: Array, colour: tuple[int, int, int], width: int) -> None:
    import cv2

    contours = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    cv2.drawContours(image, contours, -1, colour, width, cv2.LINE_AA)
