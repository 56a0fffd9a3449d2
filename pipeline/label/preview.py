"""The mask that the clicks in one frame ask for, at once: the stage's own question to SAM 2."""

import threading

import numpy as np

from physreal_core.array_types import Array, Bool
from physreal_core.errors import InputError
from pipeline.clicks import Clicks
from pipeline.label.clip import Clip
from pipeline.models import default_folder, require
from pipeline.products.masks import Role


class Preview:
    """SAM 2, opened with the first page or question.

    Attributes:
        why_not: why there is no preview; empty as long as there is one.
    """

    def __init__(self, clip: Clip) -> None:
        self.clip, self.why_not = clip, ""
        self._segmenter = None
        self._one_at_a_time = threading.Lock()

    def mask(self, t: int, role: Role, clicks: Clicks) -> Bool[Array, "H W"] | None:
        """The mask of a thing in frame t by its clicks; None without clicks, or where there is no network."""
        from physreal_core.perception.corrections import Correction, corrected_mask

        if clicks.empty or self.why_not:
            return None
        if not self.open():
            return None
        with self._one_at_a_time:
            image = self.clip.frame(t)
            expected = self.clip.mask(role, t)
            expected = np.zeros(image.shape[:2], bool) if expected is None else expected
            points = np.array(clicks.points, np.float32).reshape(-1, 2)
            asked = Correction(t, role, points, np.array(clicks.labels, int), clicks.box)
            return corrected_mask(image, asked, expected, self._segmenter)

    def open(self) -> bool:
        """Open the network, which takes seconds; whether it is there."""
        from physreal_core.perception.sam2 import Sam2Segmenter

        with self._one_at_a_time:
            if self._segmenter is None and not self.why_not:
                try:
                    files = require("sam2", default_folder())
                    self._segmenter = Sam2Segmenter(files["sam2_encoder.ort"], files["sam2_decoder.onnx"])
                except InputError as error:
                    self.why_not = str(error)
        return not self.why_not
