"""MediaPipe's palm detector and hand landmarks through ONNX Runtime, on overlapping tiles so that small hands count."""

from pathlib import Path

import numpy as np

from physreal_core.array_types import Array, Float, UInt8
from physreal_core.perception.hand_finder import Hand
from physreal_core.perception.session import open_session

_ROI_SCALE, _ROI_SHIFT = 2.6, -0.5  # palm box to hand box, from MediaPipe's hand_landmark graph
_WRIST, _MIDDLE_KNUCKLE = 0, 2  # among the palm detector's seven keypoints


class MediaPipeHands:
    """Hands by palm detection and landmark regression.

    Args:
        palm: network [1, 192, 192, 3] (RGB, 0 to 1) -> 2016 boxes with seven keypoints [1, 2016, 18], logits
            [1, 2016, 1].
        landmark: network [1, 224, 224, 3] (RGB, 0 to 1) -> 21 points [1, 63], presence [1, 1], ...
        min_palm: least palm probability to look closer.
        min_presence: least presence of a hand; below 0.9 things of skin colour pass.
    """

    def __init__(
        self,
        palm: str | Path,
        landmark: str | Path,
        *,
        min_palm: float = 0.4,
        min_presence: float = 0.9,
        threads: int = 0,
    ) -> None:
        self._palm = open_session(palm, threads=threads, inputs=1, outputs=2)
        self._landmark = open_session(landmark, threads=threads, inputs=1, outputs=2)
        self.min_palm, self.min_presence = min_palm, min_presence
        self._anchors = _palm_anchors()

    def find(self, image: UInt8[Array, "H W 3"]) -> list[Hand]:
        """Hands in an RGB image, the surest first."""
        hands = []
        for tile in _tiles(*image.shape[:2]):
            hands += [self._look_closer(image, keypoints, side) for keypoints, side in self._palms(image, tile)]
        hands = sorted((h for h in hands if h.presence >= self.min_presence), key=lambda h: -h.presence)
        kept: list[Hand] = []
        for hand in hands:
            size = np.ptp(hand.points, axis=0).max()
            if all(np.linalg.norm(hand.points.mean(0) - k.points.mean(0)) > 0.5 * size for k in kept):
                kept.append(hand)
        return kept

    def _palms(self, image: Array, tile: tuple[float, float, float]) -> list[tuple[Float[Array, "7 2"], float]]:
        """Palm keypoints [px of the image] and palm box sides [px] in a square tile (u, v, side)."""
        patch, to_image = _cut(image, np.array(tile[:2]) + tile[2] / 2, tile[2], 0.0, 192)
        outputs = self._palm.run(None, {self._palm.get_inputs()[0].name: patch[None]})
        boxes, logits = sorted((o[0] for o in outputs), key=lambda o: -o.shape[-1])
        probability = 1 / (1 + np.exp(-np.clip(logits[:, 0], -50, 50)))
        best, found = np.argsort(-probability)[:8], []
        for i in best[probability[best] >= self.min_palm]:
            keypoints = boxes[i, 4:18].reshape(7, 2) + self._anchors[i] * 192
            found.append((_apply(to_image, keypoints), float(boxes[i, 2] * tile[2] / 192)))
        return found[:3]

    def _look_closer(self, image: Array, keypoints: Float[Array, "7 2"], side: float) -> Hand:
        """Landmarks in the square that MediaPipe lays around a palm: turned so that the fingers point up."""
        up = keypoints[_MIDDLE_KNUCKLE] - keypoints[_WRIST]
        angle = np.arctan2(up[0], -up[1])
        middle = (keypoints.min(0) + keypoints.max(0)) / 2
        shift = np.array([-np.sin(angle), np.cos(angle)]) * _ROI_SHIFT * side
        patch, to_image = _cut(image, middle + shift, side * _ROI_SCALE, angle, 224)
        outputs = [o.reshape(-1) for o in self._landmark.run(None, {self._landmark.get_inputs()[0].name: patch[None]})]
        points = next(o for o in outputs if o.size == 63).reshape(21, 3)[:, :2]
        presence = float(next(o for o in outputs if o.size == 1)[0])
        return Hand(_apply(to_image, points).astype(np.float32), presence)


def _palm_anchors() -> Float[Array, "2016 2"]:
    """Centres of MediaPipe's SSD anchors, fractions of the tile: strides 8 (two each) and 16 (six each)."""
    rows = []
    for cells, each in ((24, 2), (12, 6)):
        v, u = np.meshgrid(*[(np.arange(cells) + 0.5) / cells] * 2, indexing="ij")
        rows.append(np.repeat(np.stack([u, v], -1).reshape(-1, 2), each, axis=0))
    return np.concatenate(rows)


def _tiles(height: int, width: int) -> list[tuple[float, float, float]]:
    """Squares (u, v, side): the whole image letterboxed, then overlapping ones of its short side and half of that."""
    whole, short = max(height, width), min(height, width)
    tiles = [((width - whole) / 2, (height - whole) / 2, float(whole))]
    for side in (float(short), short / 2):
        across, down = (max(int(np.ceil(2 * n / side)) - 1, 1) for n in (width, height))
        for v in np.linspace(0, height - side, down):
            tiles += [(float(u), float(v), side) for u in np.linspace(0, width - side, across)]
    return tiles


def _cut(image: Array, middle: Array, side: float, angle: float, size: int) -> tuple[Float[Array, "S S 3"], Array]:
    """A square of the image, turned by `angle` and resized to `size`, in 0 to 1; and the affine map back [2, 3]."""
    import cv2

    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) * side / size
    to_image = np.concatenate([turn, (middle - turn @ np.full(2, size / 2))[:, None]], 1)
    patch = cv2.warpAffine(image, to_image, (size, size), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
    return patch.astype(np.float32) / 255, to_image


def _apply(affine: Array, points: Float[Array, "K 2"]) -> Float[Array, "K 2"]:
    return points @ affine[:, :2].T + affine[:, 2]
