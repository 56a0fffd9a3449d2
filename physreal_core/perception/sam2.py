"""SAM 2 image segmenter through ONNX Runtime: one encoder run per image, one light decoder run per prompt."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from physreal_core.array_types import Array, Bool, Float, UInt8
from physreal_core.errors import InputError
from physreal_core.perception.mask_geometry import signed_distance
from physreal_core.perception.segmenter import Candidates, Prompt, drop_duplicates
from physreal_core.perception.session import open_session

_MEAN = np.array([0.485, 0.456, 0.406], np.float32)
_STD = np.array([0.229, 0.224, 0.225], np.float32)
_SURE, _LOGITS_PER_PIXEL = 8.0, 2.0  # a mask given as a prompt: logits well inside it, and their slope at its edge
_BOX_CORNERS = (2, 3)  # the decoder's labels for the two corners of a box


class Sam2Segmenter:
    """Candidate masks by SAM 2.

    Args:
        encoder: network `image` [1, 3, S, S] (RGB, ImageNet-normalised) -> `high_res_feats_0`, `high_res_feats_1`,
            `image_embed`.
        decoder: network `image_embed`, `high_res_feats_0`, `high_res_feats_1`, `point_coords` [1, K, 2] (pixels of
            the S x S image), `point_labels` [1, K], `mask_input` [1, 1, S/4, S/4], `has_mask_input` [1]
            -> mask logits [1, 3, S/4, S/4], predicted IoU [1, 3].
        grid: points a side of the grid that asks for everything.
        min_score, min_stability: filters of the unprompted candidates: predicted IoU, and the IoU of the mask cut at
            logit +1 with the one cut at -1.
        threads: threads of ONNX Runtime; 0 lets it choose.
    """

    promptable = True

    def __init__(
        self,
        encoder: str | Path,
        decoder: str | Path,
        *,
        grid: int = 12,
        min_score: float = 0.7,
        min_stability: float = 0.8,
        threads: int = 0,
    ) -> None:
        self._encoder = open_session(encoder, threads=threads, inputs=1, outputs=3)
        self._decoder = open_session(decoder, threads=threads, inputs=7, outputs=2)
        _need_names(self._encoder.get_outputs(), {"high_res_feats_0", "high_res_feats_1", "image_embed"}, encoder)
        _need_names(self._decoder.get_inputs(), {"point_coords", "point_labels", "mask_input", "image_embed"}, decoder)
        self.size = int(self._encoder.get_inputs()[0].shape[-1])
        self.grid, self.min_score, self.min_stability = grid, min_score, min_stability
        self._embedded: tuple[bytes, dict[str, Array]] | None = None

    def candidates(self, image: UInt8[Array, "H W 3"], prompts: Sequence[Prompt] | None = None) -> Candidates:
        """Three masks (part, whole, group) for each prompt; with prompts=None the filtered answers to a point grid."""
        features = self._embed(image)
        if prompts is not None:
            return self._answers(features, image.shape[:2], prompts)[0]
        found, stability = self._answers(features, image.shape[:2], _grid_prompts(image.shape[:2], self.grid))
        area = found.masks.mean((1, 2))
        keep = (found.scores >= self.min_score) & (stability >= self.min_stability) & (area > 1e-4) & (area < 0.9)
        found = drop_duplicates(found.where(keep))
        return Candidates(found.masks, found.scores, np.full(len(found), -1))

    def _embed(self, image: Array) -> dict[str, Array]:
        """Encoder features of an image; the last image's are kept, since object and hand are asked for in turn."""
        import cv2

        key = image.tobytes()
        if self._embedded is None or self._embedded[0] != key:
            resized = cv2.resize(image, (self.size, self.size), interpolation=cv2.INTER_LINEAR)
            normal = ((resized.astype(np.float32) / 255 - _MEAN) / _STD).transpose(2, 0, 1)[None]
            names = [o.name for o in self._encoder.get_outputs()]
            outputs = self._encoder.run(names, {self._encoder.get_inputs()[0].name: normal})
            self._embedded = (key, dict(zip(names, outputs, strict=True)))
        return self._embedded[1]

    def _answers(
        self, features: dict[str, Array], shape: tuple[int, int], prompts: Sequence[Prompt]
    ) -> tuple[Candidates, Float[Array, " N"]]:
        parts, stability = [Candidates.empty(*shape)], [np.zeros(0)]
        for index, prompt in enumerate(prompts):
            logits, scores = self._decode(features, shape, prompt)
            parts.append(Candidates(_to_image(logits, shape) > 0, scores, np.full(len(scores), index)))
            stability.append((logits > 1).sum((1, 2)) / np.maximum((logits > -1).sum((1, 2)), 1))
        return Candidates.join(parts), np.concatenate(stability)

    def _decode(self, features: dict[str, Array], shape: tuple[int, int], prompt: Prompt) -> tuple[Array, Array]:
        points, labels = np.asarray(prompt.points, np.float32).reshape(-1, 2), np.asarray(prompt.labels, np.float32)
        if prompt.box is not None:
            points = np.concatenate([points, np.asarray(prompt.box, np.float32).reshape(2, 2)])
            labels = np.concatenate([labels, np.array(_BOX_CORNERS, np.float32)])
        # Pixel centres are at integers here, at halves in the network's image.
        scale = self.size / np.array([shape[1], shape[0]], np.float32)
        quarter = self.size // 4
        before = np.zeros((1, 1, quarter, quarter), np.float32)
        if prompt.mask is not None:
            before[0, 0] = _as_logits(prompt.mask, quarter)
        feed = {
            **features,
            "point_coords": ((points + 0.5) * scale)[None].astype(np.float32),
            "point_labels": labels[None].astype(np.float32),
            "mask_input": before,
            "has_mask_input": np.full(1, prompt.mask is not None, np.float32),
        }
        wanted = {i.name for i in self._decoder.get_inputs()}
        logits, scores = self._decoder.run(None, {k: v for k, v in feed.items() if k in wanted})[:2]
        return logits[0], np.clip(scores[0], 0, 1)


def _as_logits(mask: Bool[Array, "H W"], size: int) -> Float[Array, "S S"]:
    """A mask as the logits that the decoder would have answered before: smooth at the edge, cut at `_SURE`."""
    import cv2

    small = cv2.resize(signed_distance(mask).astype(np.float32), (size, size), interpolation=cv2.INTER_AREA)
    return np.clip(small * _LOGITS_PER_PIXEL, -_SURE, _SURE)


def _to_image(logits: Float[Array, "N h w"], shape: tuple[int, int]) -> Float[Array, "N H W"]:
    import cv2

    height, width = shape
    return np.stack([cv2.resize(one, (width, height), interpolation=cv2.INTER_LINEAR) for one in logits])


def _grid_prompts(shape: tuple[int, int], count: int) -> list[Prompt]:
    height, width = shape
    v, u = np.meshgrid(
        (np.arange(count) + 0.5) / count * height, (np.arange(count) + 0.5) / count * width, indexing="ij"
    )
    return [Prompt(p[None].astype(np.float32), np.ones(1, np.int64)) for p in np.stack([u, v], -1).reshape(-1, 2)]


def _need_names(found: Sequence, names: set[str], path: str | Path) -> None:
    missing = names - {f.name for f in found}
    if missing:
        raise InputError(
            f"the network lacks {', '.join(sorted(missing))}",
            where=str(path),
            expected="the interface of SAM 2's ONNX export (see physreal_core/perception/sam2.py)",
        )
