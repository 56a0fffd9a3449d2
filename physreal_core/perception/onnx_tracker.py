"""A point tracker of the user's own (CoTracker3 and its kin) through ONNX Runtime."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from physreal_core.array_types import Array, Bool, Float, UInt8
from physreal_core.checkpoints import remembered
from physreal_core.perception.flow import inside_image
from physreal_core.perception.session import open_session
from physreal_core.perception.tracker import Tracks


class OnnxTracker:
    """Runs a network with CoTracker3's offline interface.

    Args:
        network: `video` [1, T, 3, H, W] (RGB, 0 to 255) and `queries` [1, J, 3] (frame, u, v) -> tracks [1, T, J, 2]
            (u, v) [px], visibility [1, T, J] (0 to 1, or confidence). A fixed H, W has the frames resized.
        min_visibility: a point below this is not visible.
        threads: threads of ONNX Runtime; 0 lets it choose.
    """

    def __init__(self, network: str | Path, *, min_visibility: float = 0.6, threads: int = 0) -> None:
        self._session = open_session(network, threads=threads, inputs=2, outputs=2)
        self.min_visibility = min_visibility

    def track(
        self,
        frames: Sequence[UInt8[Array, "H W 3"]],
        queries: Float[Array, "J 2"],
        occluders: Bool[Array, "T H W"] | None = None,
    ) -> Tracks:
        """Follow `queries` (u, v) [px] of frame 0; see `Tracker`."""
        height, width = frames[0].shape[:2]
        shape = len(frames), len(queries)
        run = remembered(
            "track",
            lambda: [queries],
            {"points": (*shape, 2), "visible": shape},
            lambda: self._run(frames, queries),
        )
        found, visible = run["points"], run["visible"] & inside_image(run["points"], height, width)
        return Tracks(found, visible & ~inside_masks(found, occluders) if occluders is not None else visible)

    def _run(self, frames: Sequence[Array], queries: Array) -> dict[str, Array]:
        """The network's tracks [px], and which of them it takes to be visible."""
        import cv2

        height, width = frames[0].shape[:2]
        video_input, query_input = self._session.get_inputs()[:2]
        size = [s if isinstance(s, int) else d for s, d in zip(video_input.shape[-2:], (height, width), strict=True)]
        scale = np.array([size[1] / width, size[0] / height], np.float32)
        video = np.stack([cv2.resize(f, (size[1], size[0])) for f in frames]).transpose(0, 3, 1, 2)[None]
        points = np.concatenate([np.zeros((len(queries), 1)), queries * scale], 1)[None]
        feed = {video_input.name: video.astype(np.float32), query_input.name: points.astype(np.float32)}
        tracks, visibility = (np.asarray(o)[0] for o in self._session.run(None, feed)[:2])
        found = (tracks / scale).astype(np.float32)
        return {"points": found, "visible": visibility.reshape(found.shape[:2]) >= self.min_visibility}


def inside_masks(points: Float[Array, "T J 2"], masks: Bool[Array, "T H W"]) -> Bool[Array, "T J"]:
    """Whether each point lies on its frame's mask (nearest pixel); outside the image it does not."""
    count, height, width = masks.shape
    inside = inside_image(points, height, width)
    pixel = np.rint(np.where(inside[..., None], points, 0)).astype(int)
    return inside & masks[np.arange(count)[:, None], pixel[..., 1], pixel[..., 0]]
