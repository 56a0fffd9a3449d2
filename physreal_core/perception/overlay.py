"""A video to judge the parsing by eye: masks, tracks with tails (grey: not visible), controller points."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from physreal_core.array_types import Array, Bool, Float, UInt8
from physreal_core.perception.choices import Choice
from physreal_core.perception.tracker import Tracks

_OBJECT, _CONTROLLER = np.array([60, 200, 90]), np.array([230, 80, 60])
_RIVALS = [(70, 130, 240), (220, 170, 40), (180, 90, 220), (120, 120, 120)]
_TAIL = 8


def draw_overlay(
    frames: Sequence[UInt8[Array, "H W 3"]],
    object_masks: Bool[Array, "T H W"],
    controller_masks: Bool[Array, "T H W"],
    tracks: Tracks,
    controllers: Float[Array, "T C 2"] | None = None,
    *,
    scale: int = 2,
    max_tracks: int = 150,
) -> list[UInt8[Array, "h w 3"]]:
    """One picture per frame, `scale` times as large; controllers are pixels (u, v)."""
    shown = np.linspace(0, tracks.points.shape[1] - 1, min(max_tracks, tracks.points.shape[1])).astype(int)
    colours = _rainbow(tracks.points[0, shown])
    return [
        _draw(t, frames[t], object_masks[t], controller_masks[t], tracks, controllers, shown, colours, scale)
        for t in range(len(frames))
    ]


def draw_choice(
    frame: UInt8[Array, "H W 3"], choice: Choice, hand: Bool[Array, "H W"], *, scale: int = 2
) -> UInt8[Array, "h w 3"]:
    """Frame 0 with the chosen object, the hand, and the outlines of what else could have been meant, with its share."""
    import cv2

    tinted = frame.astype(np.float32)
    for mask, colour in ((choice.mask, _OBJECT), (hand, _CONTROLLER)):
        tinted[mask] = 0.65 * tinted[mask] + 0.35 * colour
    picture = cv2.resize(tinted.astype(np.uint8), None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
    rivals = (
        [] if choice.rivals is None else list(zip(choice.rivals, choice.shares, _RIVALS[:1] + _RIVALS, strict=False))
    )
    labels = [(choice.mask, f"chosen {choice.sure:.2f}", tuple(_OBJECT.tolist()))]
    labels += [(mask, f"{i + 2}. {share:.2f}", colour) for i, (mask, share, colour) in enumerate(rivals[1:])]
    for row, (mask, text, colour) in reversed(list(enumerate(labels))):
        large = cv2.resize(mask.astype(np.uint8), None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
        edges = cv2.findContours(large, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
        cv2.drawContours(picture, edges, -1, colour, 2 if row == 0 else 1)
        cv2.putText(picture, text, (8, 22 * (row + 1)), cv2.FONT_HERSHEY_SIMPLEX, 0.6, colour, 2, cv2.LINE_AA)
    return picture


def write_video(path: str | Path, pictures: Sequence[UInt8[Array, "h w 3"]], fps: float) -> None:
    """H.264 in .mp4 with even sides, so that browsers play it; by one thread, for with three the bytes differed now and then."""
    import imageio_ffmpeg

    height, width = (n - n % 2 for n in pictures[0].shape[:2])
    writer = imageio_ffmpeg.write_frames(
        str(path),
        (width, height),
        fps=fps,
        codec="libx264",
        quality=7,
        macro_block_size=2,
        ffmpeg_log_level="error",
        output_params=["-threads", "1"],
    )
    writer.send(None)
    for picture in pictures:
        writer.send(np.ascontiguousarray(picture[:height, :width]))
    writer.close()


def _draw(
    t: int,
    frame: Array,
    object_mask: Array,
    controller_mask: Array,
    tracks: Tracks,
    controllers: Array | None,
    shown: Array,
    colours: Array,
    scale: int,
) -> Array:
    import cv2

    tinted = frame.astype(np.float32)
    for mask, colour in ((object_mask, _OBJECT), (controller_mask, _CONTROLLER)):
        tinted[mask] = 0.65 * tinted[mask] + 0.35 * colour
    picture = cv2.resize(tinted.astype(np.uint8), None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
    for mask, colour in ((object_mask, _OBJECT), (controller_mask, _CONTROLLER)):
        large = cv2.resize(mask.astype(np.uint8), None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
        edges = cv2.findContours(large, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
        cv2.drawContours(picture, edges, -1, colour.tolist(), 1)
    for j, colour in zip(shown, colours, strict=True):
        tail = [_at(tracks.points[s, j], scale) for s in range(max(0, t - _TAIL), t + 1) if tracks.visible[s, j]]
        if len(tail) > 1 and tracks.visible[t, j]:
            cv2.polylines(picture, [np.array(tail)], False, colour.tolist(), 1, cv2.LINE_AA)
        if tracks.visible[t, j]:
            cv2.circle(picture, _at(tracks.points[t, j], scale), 2, colour.tolist(), -1, cv2.LINE_AA)
        else:
            cv2.circle(picture, _at(tracks.points[t, j], scale), 2, (120, 120, 120), 1, cv2.LINE_AA)
    for point in [] if controllers is None else controllers[t]:
        cv2.drawMarker(picture, _at(point, scale), (255, 255, 0), cv2.MARKER_CROSS, 7, 1)
    return picture


def _at(point: Array, scale: int) -> tuple[int, int]:
    u, v = np.clip(np.rint((np.nan_to_num(point) + 0.5) * scale - 0.5), -10000, 10000)
    return int(u), int(v)


def _rainbow(points: Float[Array, "J 2"]) -> Array:
    """A colour for each point by its place in frame 0, so that neighbours can be told to stay together."""
    import cv2

    if len(points) == 0:
        return np.zeros((0, 3), np.uint8)
    low, span = points.min(0), np.maximum(np.ptp(points, axis=0), 1e-6)
    place = (points - low) / span
    hsv = np.stack([150 * place[:, 0], np.full(len(points), 220), 150 + 105 * place[:, 1]], -1)
    return cv2.cvtColor(hsv[None].astype(np.uint8), cv2.COLOR_HSV2RGB)[0]
