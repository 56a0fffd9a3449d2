"""A small film made by code, with its truth: a textured disc pushed sideways by a textured hand over a textured table."""

from dataclasses import dataclass

import numpy as np

HEIGHT, WIDTH = 96, 128
K = np.array([[140.0, 0, 63.5], [0, 140.0, 47.5], [0, 0, 1.0]])
T_WORLD_CAMERA = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0.6], [0, 0, 0, 1]])  # looks straight down
TABLE, OBJECT, HAND = 0.60, 0.56, 0.52  # depth of the flat tops [m]


@dataclass(frozen=True)
class Film:
    """frames [T, H, W, 3] uint8, object and hand masks [T, H, W], depth [T, H, W] m, motion [T, 2] px of both."""

    frames: list[np.ndarray]
    objects: np.ndarray
    hands: np.ndarray
    depth: np.ndarray
    motion: np.ndarray


def film(count: int = 6, step: tuple[float, float] = (1.7, 0.6), occluder: bool = False) -> Film:
    """The disc and the hand beside it move `step` px a frame; an `occluder` bar hides the disc's left in the middle."""
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    frames, objects, hands, depth = [], [], [], []
    motion = np.arange(count)[:, None] * np.array(step)
    for t, (du, dv) in enumerate(motion):
        disc = (u - 60 - du) ** 2 + (v - 45 - dv) ** 2 < 20**2
        hand = (np.abs(u - 92 - du) < 12) & (v < 55 + dv) & (v > 22 + dv)
        disc = disc & ~hand
        colour = _texture(u, v, 0.9, (0.45, 0.45, 0.4))
        colour = np.where(disc[..., None], _texture(u - du, v - dv, 2.0, (0.15, 0.5, 0.55)), colour)
        colour = np.where(hand[..., None], _texture(u - du, v - dv, 3.0, (0.8, 0.5, 0.4)), colour)
        z = np.where(hand, HAND, np.where(disc, OBJECT, TABLE))
        if occluder and 1 <= t < count - 1:
            bar = np.abs(u - 52 - du) < 6
            colour, z = np.where(bar[..., None], _texture(u, v, 4.0, (0.9, 0.9, 0.2)), colour), np.where(bar, 0.4, z)
            disc = disc & ~bar
        frames.append(np.clip(colour * 255, 0, 255).astype(np.uint8))
        objects.append(disc), hands.append(hand), depth.append(z)
    return Film(frames, np.stack(objects), np.stack(hands), np.stack(depth), motion)


def _texture(u: np.ndarray, v: np.ndarray, seed: float, tint: tuple[float, float, float]) -> np.ndarray:
    """A smooth pattern without a period that matters, so that sub-pixel motion is well defined."""
    pattern = sum(
        np.sin(u * a * np.cos(seed + i) + v * a * np.sin(seed + i) + i) for i, a in enumerate((0.25, 0.4, 0.6, 0.85))
    )
    return np.array(tint) * (1 + 0.14 * pattern[..., None])


class FilmSegmenter:
    """A segmenter for tests: it knows the film's pixels and proposes object, hand, half the object, and everything."""

    promptable = False

    def __init__(self, film: Film) -> None:
        self._of = {f.tobytes(): (o, h) for f, o, h in zip(film.frames, film.objects, film.hands, strict=True)}
        self.asked = 0

    def candidates(self, image, prompts=None):
        from physreal_core.perception.segmenter import Candidates

        self.asked += 1
        disc, hand = self._of[image.tobytes()]
        half = disc & (np.arange(WIDTH) < 60)
        masks = np.stack([half, disc, hand, disc | hand, np.ones_like(disc)])
        return Candidates(masks, np.array([0.9, 0.88, 0.9, 0.7, 0.99], np.float32), np.full(5, -1))
