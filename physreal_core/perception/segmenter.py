"""Segmenter protocol: an image, and prompts if there are any, to candidate masks C_t with scores."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from physreal_core.array_types import Array, Bool, Float, Int, UInt8


@dataclass(frozen=True)
class Prompt:
    """What points at one thing in the image.

    Attributes:
        points: [K, 2] pixels (u, v) [px].
        labels: [K] 1 on the thing, 0 off it.
        box: (u0, v0, u1, v1) [px] around the thing, or None.
        mask: [H, W] roughly where the thing is, or None; a segmenter that takes none ignores it.
    """

    points: Float[Array, "K 2"]
    labels: Int[Array, " K"]
    box: tuple[float, float, float, float] | None = None
    mask: Bool[Array, "H W"] | None = None


@dataclass(frozen=True)
class Candidates:
    """Candidate masks of one image: masks [N, H, W], scores [N] (0 to 1), prompt_index [N] (-1: found unprompted)."""

    masks: Bool[Array, "N H W"]
    scores: Float[Array, " N"]
    prompt_index: Int[Array, " N"]

    def __len__(self) -> int:
        return len(self.masks)

    def where(self, keep: Array) -> "Candidates":
        """The candidates that a boolean mask or an index array keeps."""
        return Candidates(self.masks[keep], self.scores[keep], self.prompt_index[keep])

    @staticmethod
    def empty(height: int, width: int) -> "Candidates":
        """No candidates for an image of this size."""
        return Candidates(np.zeros((0, height, width), bool), np.zeros(0, np.float32), np.zeros(0, np.int64))

    @staticmethod
    def join(parts: Sequence["Candidates"]) -> "Candidates":
        """One after another; the parts are of one image."""
        return Candidates(
            *(np.concatenate([getattr(p, n) for p in parts]) for n in ("masks", "scores", "prompt_index"))
        )


@runtime_checkable
class Segmenter(Protocol):
    """Anything that proposes masks: SAM 2, an entity segmenter, masks made elsewhere.

    Attributes:
        promptable: whether prompts change the answer; one that ignores them is always shown the whole image.
    """

    promptable: bool

    def candidates(self, image: UInt8[Array, "H W 3"], prompts: Sequence[Prompt] | None = None) -> Candidates:
        """Candidate masks of an RGB image; prompts=None asks for everything in it.

        A segmenter that knows no prompts ignores them and proposes everything.
        """


def drop_duplicates(candidates: Candidates, max_iou: float = 0.85) -> Candidates:
    """Of masks that overlap by more than max_iou (intersection over union), keep the best scored."""
    if len(candidates) == 0:
        return candidates
    order = np.argsort(-candidates.scores, kind="stable")
    flat = candidates.masks.reshape(len(candidates), -1).astype(np.float32)
    area, shared = flat.sum(1), flat @ flat.T
    kept: list[int] = []
    for i in order:
        if all(shared[i, k] <= max_iou * (area[i] + area[k] - shared[i, k]) for k in kept):
            kept.append(i)
    return candidates.where(np.array(kept, int))


def zoomed_candidates(
    segmenter: Segmenter,
    image: UInt8[Array, "H W 3"],
    prompts: Sequence[Prompt] | None,
    window: tuple[int, int, int, int],
) -> Candidates:
    """Candidates of a window (u0, v0, u1, v1) of the image, put back into the whole image.

    A network has one input size, so a thin object is cut more finely when only its surroundings are shown.
    """
    if not segmenter.promptable:
        return segmenter.candidates(image, prompts)
    u0, v0, u1, v1 = window
    offset = np.array([u0, v0], np.float32)
    moved = None if prompts is None else [_moved(p, offset, window) for p in prompts]
    found = segmenter.candidates(np.ascontiguousarray(image[v0:v1, u0:u1]), moved)
    masks = np.zeros((len(found), *image.shape[:2]), bool)
    masks[:, v0:v1, u0:u1] = found.masks
    return Candidates(masks, found.scores, found.prompt_index)


def _moved(prompt: Prompt, offset: Float[Array, " 2"], window: tuple[int, int, int, int]) -> Prompt:
    """The prompt in the window's pixels; points outside it are left out, unless none is left."""
    u0, v0, u1, v1 = window
    box = None if prompt.box is None else tuple(np.array(prompt.box) - np.tile(offset, 2))
    mask = None if prompt.mask is None else prompt.mask[v0:v1, u0:u1]
    points = prompt.points - offset
    inside = ((points >= 0) & (points < np.array([u1 - u0, v1 - v0]))).all(-1)
    if not (inside & (prompt.labels > 0)).any() and box is None:
        inside[:] = True
    return Prompt(points[inside], prompt.labels[inside], box, mask)
