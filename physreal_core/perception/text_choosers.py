"""Target choosers by words: ConSE (an image classifier and a sentence encoder), and a CLIP of one's own."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from physreal_core.array_types import Array, Bool, Float, UInt8
from physreal_core.errors import InputError
from physreal_core.perception.mask_geometry import box_of
from physreal_core.perception.session import open_session
from physreal_core.perception.text_encoder import TextEncoder

_CLIP_MEAN = np.array([0.48145466, 0.4578275, 0.40821073], np.float32)  # of CLIP's training images
_CLIP_STD = np.array([0.26862954, 0.26130258, 0.27577711], np.float32)


class ConseChooser:
    """Convex combination of semantic embeddings (Norouzi et al. 2014, eq. 4).

    A crop's vector is the mean of the vectors of its likeliest classes' names, weighted by their probabilities; its score
    is the cosine with the description's vector over a temperature. It knows things of the classifier's classes and what
    is called like them, no colours and no people.
    """

    def __init__(
        self,
        classifier: str | Path,
        names: Sequence[str],
        encoder: TextEncoder,
        *,
        top: int = 10,
        temperature: float = 0.1,
        threads: int = 0,
    ) -> None:
        """Args:
        classifier: .onnx, `image` [N, 3, S, S] RGB in 0 to 1 -> probabilities [N, C].
        names: C names of the classes.
        top: how many classes the mean is taken over.
        temperature: cosines of crops that have nothing to do with the description differ by about this much.
        """
        self._classifier = open_session(classifier, threads=threads, inputs=1, outputs=1)
        self._names, self._encoder, self._top = list(names), encoder, top
        self._temperature = temperature
        self._where = str(classifier)

    def scores(self, image: UInt8[Array, "H W 3"], masks: Bool[Array, "N H W"], description: str) -> Float[Array, " N"]:
        """Cosine of each masked crop's vector with the description's, over the temperature."""
        wanted = self._encoder([description])[0]
        cosines = [self._vector(p) @ wanted for p in self.probabilities(image, masks)]
        return np.array(cosines) / self._temperature

    def probabilities(self, image: UInt8[Array, "H W 3"], masks: Bool[Array, "N H W"]) -> Float[Array, "N C"]:
        """What the classifier says of each masked crop."""
        found = _run_each(self._classifier, masked_crops(image, masks, _size_of(self._classifier)))
        if found.shape[-1] != len(self._names):
            raise InputError(
                f"the classifier has {found.shape[-1]} classes", where=self._where, expected=f"{len(self._names)} names"
            )
        return found

    def _vector(self, probabilities: Array) -> Array:
        top = np.argsort(-probabilities, kind="stable")[: self._top]
        mean = probabilities[top] @ self._encoder([self._names[i] for i in top])
        return mean / max(float(np.linalg.norm(mean)), 1e-12)


class ClipChooser:
    """An image encoder and a text encoder that share their space (CLIP, SigLIP), as .onnx of one's own."""

    def __init__(
        self, image_encoder: str | Path, encoder: TextEncoder, *, temperature: float = 0.03, threads: int = 0
    ) -> None:
        """Args:
        image_encoder: .onnx, first input [N, 3, S, S] RGB with CLIP's mean and deviation taken out (S = 224 where it
            is left open) -> `image_embeds` or else the first output [N, D].
        temperature: wider than the 0.01 that CLIP is trained with, since a part of the target speaks like the whole.
        """
        self._session = open_session(image_encoder, threads=threads, inputs=1, outputs=1)
        self._encoder, self._temperature, self._where = encoder, temperature, str(image_encoder)

    def scores(self, image: UInt8[Array, "H W 3"], masks: Bool[Array, "N H W"], description: str) -> Float[Array, " N"]:
        """Cosine of each masked crop's vector with the description's, over the temperature."""
        crops = masked_crops(image, masks, _size_of(self._session))
        crops = (crops - _CLIP_MEAN[:, None, None]) / _CLIP_STD[:, None, None]
        seen, wanted = _run_each(self._session, crops, "image_embeds"), self._encoder([description])[0]
        if seen.shape[-1] != len(wanted):
            raise InputError(
                f"images become vectors of {seen.shape[-1]}, texts of {len(wanted)} numbers",
                where=self._where,
                expected="image and text encoder of the same network",
            )
        cosines = seen @ wanted / np.maximum(np.linalg.norm(seen, axis=-1), 1e-12)
        return cosines / self._temperature


def masked_crops(
    image: UInt8[Array, "H W 3"], masks: Bool[Array, "N H W"], size: int, margin: float = 0.1
) -> Float[Array, "N 3 S S"]:
    """Each mask's square surroundings, RGB in 0 to 1, with grey for all that is not on the mask."""
    import cv2

    crops = np.full((len(masks), size, size, 3), 0.5, np.float32)
    for crop, mask in zip(crops, masks, strict=True):
        if not mask.any():
            continue
        u0, v0, u1, v1 = box_of(mask)
        side = max(u1 - u0, v1 - v0, 1) * (1 + 2 * margin)
        corner = np.array([(u0 + u1 - side) / 2, (v0 + v1 - side) / 2])
        shown = np.where(mask[..., None], image, 127).astype(np.float32) / 255
        scale = size / side
        if scale < 1:  # averaged over the pixels that fall together
            shown = cv2.GaussianBlur(shown, (0, 0), 0.5 / scale)
        to_crop = np.array([[scale, 0, -scale * corner[0]], [0, scale, -scale * corner[1]]])
        crop[:] = cv2.warpAffine(shown, to_crop, (size, size), borderValue=(0.5, 0.5, 0.5))
    return np.ascontiguousarray(crops.transpose(0, 3, 1, 2))


def _run_each(session, crops: Array, output: str = "") -> Array:
    """One crop at a time: networks are exported with a batch of one, or any."""
    name = session.get_inputs()[0].name
    outputs = [o.name for o in session.get_outputs()]
    wanted = output if output in outputs else outputs[0]
    return np.stack([session.run([wanted], {name: crop[None]})[0][0] for crop in crops]).astype(np.float64)


def _size_of(session) -> int:
    size = session.get_inputs()[0].shape[-1]
    return size if isinstance(size, int) else 224
