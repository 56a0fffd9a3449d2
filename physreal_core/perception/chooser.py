"""Target chooser protocol, and the choices by point, box, colour word and touch."""

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np

from physreal_core.array_types import Array, Bool, Float, UInt8
from physreal_core.errors import InputError
from physreal_core.perception.colour import colour_mask, largest_part
from physreal_core.perception.mask_geometry import intersection_over_union, spread_points
from physreal_core.perception.segmenter import Prompt


@runtime_checkable
class TargetChooser(Protocol):
    """Anything that says how well candidates fit a description (a text encoder, CLIP)."""

    def scores(self, image: UInt8[Array, "H W 3"], masks: Bool[Array, "N H W"], description: str) -> Float[Array, " N"]:
        """How well each candidate fits: the logarithm of a likelihood, up to a constant (1 more counts e times)."""


def hint_prompts(image: UInt8[Array, "H W 3"], hint: Mapping[str, Any], where: str) -> list[Prompt]:
    """Prompts for a hint {"point": [u, v]}, {"box": [u0, v0, u1, v1]} or {"colour": "teal"}.

    Raises:
        InputError: the hint is none of these, lies outside the image, or no pixel has the colour.
    """
    height, width = image.shape[:2]
    expected = '{"point": [u, v]}, {"box": [u0, v0, u1, v1]} or {"colour": "teal"}'
    if len(hint) != 1 or next(iter(hint)) not in ("point", "box", "colour"):
        raise InputError(f"the hint is {dict(hint)}", where=where, expected=expected)
    kind, value = next(iter(hint.items()))
    if kind == "colour":
        blob = largest_part(opened(colour_mask(image, value)))
        if not blob.any():
            raise InputError(f"no pixel of frame 0 is {value}", where=where, remedy="give a point or a box instead")
        points = spread_points(blob, 5)
        v, u = np.nonzero(blob)
        box = tuple(float(x) for x in (u.min() - 2, v.min() - 2, u.max() + 2, v.max() + 2))
        return [_on(points[:1]), _on(points[:3]), _on(points), _on(points[:3], box)]
    numbers = np.asarray(value, np.float32).reshape(-1)
    if len(numbers) != (2 if kind == "point" else 4) or not np.isfinite(numbers).all():
        raise InputError(f"{kind} is {value}", where=where, expected=expected)
    corners = numbers.reshape(-1, 2)
    if (corners < 0).any() or (corners > [width - 1, height - 1]).any():
        raise InputError(
            f"{kind} {value} lies outside the image", where=where, expected=f"0..{width - 1}, 0..{height - 1}"
        )
    if kind == "point":
        return [_on(corners)]
    box = tuple(float(x) for x in numbers)
    return [_on(np.zeros((0, 2), np.float32), box), _on(corners.mean(0, keepdims=True), box)]


def fit_to_hint(
    image: UInt8[Array, "H W 3"], masks: Bool[Array, "N H W"], hint: Mapping[str, Any]
) -> Float[Array, " N"]:
    """How well each mask fits a hint (0 to 1): holds the point, fills the box, or has the colour's pixels."""
    kind, value = next(iter(hint.items()))
    if kind == "point":
        u, v = np.rint(value).astype(int)
        return masks[:, v, u].astype(np.float64)
    if kind == "box":
        u0, v0, u1, v1 = np.rint(value).astype(int).tolist()
        inside = masks[:, v0 : v1 + 1, u0 : u1 + 1].sum((1, 2))
        union_box = np.array([_box_iou(m, (u0, v0, u1, v1)) for m in masks])
        return union_box * inside / np.maximum(masks.sum((1, 2)), 1)
    blob = colour_mask(image, value)
    return np.array([intersection_over_union(m, blob) for m in masks])


def _on(points: Array, box: tuple[float, ...] | None = None) -> Prompt:
    return Prompt(points, np.ones(len(points), np.int64), box)


def opened(mask: Array) -> Array:
    """Specks taken out, unless nothing else is there."""
    import cv2

    clean = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0
    return clean if clean.any() else mask


def _box_iou(mask: Array, box: tuple[int, int, int, int]) -> float:
    if not mask.any():
        return 0.0
    v, u = np.nonzero(mask)
    low, high = np.maximum([u.min(), v.min()], box[:2]), np.minimum([u.max(), v.max()], box[2:])
    shared = np.prod(np.maximum(high - low + 1, 0))
    whole = (np.ptp(u) + 1) * (np.ptp(v) + 1) + (box[2] - box[0] + 1) * (box[3] - box[1] + 1)
    return float(shared / (whole - shared))
