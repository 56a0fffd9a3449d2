"""Candidate masks by a network of the user's own (EntityV2, CropFormer), and candidates made elsewhere."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from physreal_core.array_types import Array, Bool, UInt8
from physreal_core.perception.segmenter import Candidates, Prompt
from physreal_core.perception.session import open_session


class OnnxCandidates:
    """Proposes everything in an image by one run of a network; prompts are not used.

    Args:
        network: image [1, 3, H, W] (RGB, 0 to 1; a fixed H, W has the image resized) -> masks [1, N, h, w]
            (probabilities or logits), scores [1, N]. A leading 1 may be left out of the outputs.
        min_score: masks below are dropped.
        logits: whether masks are logits, cut at 0, and not probabilities, cut at 0.5.
        threads: threads of ONNX Runtime; 0 lets it choose.
    """

    promptable = False

    def __init__(self, network: str | Path, *, min_score: float = 0.5, logits: bool = False, threads: int = 0) -> None:
        self._session = open_session(network, threads=threads, inputs=1, outputs=2)
        self.min_score, self.threshold = min_score, 0.0 if logits else 0.5

    def candidates(self, image: UInt8[Array, "H W 3"], prompts: Sequence[Prompt] | None = None) -> Candidates:
        """Every mask that the network is sure enough of; see `Segmenter`."""
        import cv2

        height, width = image.shape[:2]
        given = self._session.get_inputs()[0]
        size = [s if isinstance(s, int) else d for s, d in zip(given.shape[-2:], (height, width), strict=True)]
        feed = cv2.resize(image, (size[1], size[0])).astype(np.float32).transpose(2, 0, 1)[None] / 255
        outputs = [np.asarray(o) for o in self._session.run(None, {given.name: feed})[:2]]
        masks = next(o for o in outputs if o.ndim >= 3)
        masks = masks.reshape(-1, *masks.shape[-2:]).astype(np.float32)
        scores = next(o for o in outputs if o.ndim < 3).reshape(-1).astype(np.float32)
        keep = np.flatnonzero(scores >= self.min_score)
        if len(keep) == 0:
            return Candidates.empty(height, width)
        large = np.stack([cv2.resize(masks[i], (width, height), interpolation=cv2.INTER_LINEAR) for i in keep])
        return Candidates(large > self.threshold, scores[keep], np.full(len(keep), -1))


class GivenCandidates:
    """Candidates that another tool made for each frame, found again by the frame's pixels.

    Args:
        frames: RGB frames.
        masks: [N, H, W] for each of them.
    """

    promptable = False

    def __init__(self, frames: Sequence[UInt8[Array, "H W 3"]], masks: Sequence[Bool[Array, "N H W"]]) -> None:
        self._masks = {frame.tobytes(): mask for frame, mask in zip(frames, masks, strict=True)}

    def candidates(self, image: UInt8[Array, "H W 3"], prompts: Sequence[Prompt] | None = None) -> Candidates:
        """The candidates given for this frame; see `Segmenter`."""
        masks = self._masks.get(image.tobytes())
        if masks is None or len(masks) == 0:
            return Candidates.empty(*image.shape[:2])
        return Candidates(masks, np.ones(len(masks), np.float32), np.full(len(masks), -1))
