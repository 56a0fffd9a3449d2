"""Films of textured surfaces whose motion is known to the last digit: each pixel is looked up on the material."""

from collections.abc import Callable

import numpy as np

HEIGHT, WIDTH = 144, 192

Place = Callable[[np.ndarray, int], np.ndarray]
"""Pixels [..., 2] of frame t on the material, or points of the material in frame t."""


def texture(seed: int, tint: tuple[float, float, float], grain: float = 2.0) -> np.ndarray:
    """Smoothed noise, which is like itself nowhere else [512, 512, 3]."""
    import cv2

    noise = np.random.default_rng(seed).normal(0, 1, (512, 512)).astype(np.float32)
    noise = cv2.GaussianBlur(noise, (0, 0), grain)
    return np.clip((0.55 + 0.15 * noise / noise.std())[..., None] * np.array(tint) * 255, 0, 255).astype(np.float32)


def looked_up(image: np.ndarray, material: np.ndarray) -> np.ndarray:
    """Colours [H, W, 3] of a texture at places [H, W, 2] of the material, whose origin is the texture's middle."""
    import cv2

    at = (material + 256).astype(np.float32)
    return cv2.remap(image, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)


def pixels() -> np.ndarray:
    """[H, W, 2]."""
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(float)
    return np.stack([u, v], -1)


def noisy(frames: list[np.ndarray], seed: int, deviation: float = 2.0) -> list[np.ndarray]:
    """As a camera with this noise gives them [grey levels]."""
    random = np.random.default_rng(seed)
    return [np.clip(f + random.normal(0, deviation, f.shape), 0, 255).astype(np.uint8) for f in frames]


def turned(points: np.ndarray, angle: float, about: tuple[float, float]) -> np.ndarray:
    """Points [..., 2] turned about a centre [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return (points - about) @ np.array([[c, s], [-s, c]]) + about


def grid(left: float, right: float, top: float, bottom: float, step: float) -> np.ndarray:
    """Points [J, 2] of a rectangle."""
    u, v = np.meshgrid(np.arange(left, right, step), np.arange(top, bottom, step))
    return np.stack([u, v], -1).reshape(-1, 2).astype(np.float32)
