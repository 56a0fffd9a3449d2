"""Dense optical flow between two images: OpenCV's DIS, and GMFlow through ONNX Runtime refined by DIS."""

from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from physreal_core.array_types import Array, Bool, Float, UInt8
from physreal_core.errors import InputError
from physreal_core.perception.session import open_session


@runtime_checkable
class Flow(Protocol):
    """Where every pixel of the first image goes in the second."""

    def __call__(self, first: UInt8[Array, "H W 3"], second: UInt8[Array, "H W 3"]) -> Float[Array, "H W 2"]:
        """Displacement (du, dv) [px] of each pixel of `first`."""


class DisFlow:
    """Dense inverse search (Kroeger et al. 2016) on grey images.

    Args:
        upscale: images are enlarged by this factor first: patches of 8 px are coarse on a small image.
        patch_stride: distance of the patches [px]; smaller is denser and slower.
    """

    def __init__(self, *, upscale: float = 2.0, patch_stride: int = 3) -> None:
        import cv2

        self.upscale = upscale
        self._search = cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        self._search.setFinestScale(1 if upscale > 1 else 0)
        self._search.setPatchStride(patch_stride)

    def __call__(self, first: UInt8[Array, "H W 3"], second: UInt8[Array, "H W 3"]) -> Float[Array, "H W 2"]:
        """Displacement (du, dv) [px] of each pixel of `first`."""
        import cv2

        height, width = first.shape[:2]
        size = (round(width * self.upscale), round(height * self.upscale))
        grey = [
            cv2.resize(cv2.cvtColor(i, cv2.COLOR_RGB2GRAY), size, interpolation=cv2.INTER_CUBIC)
            for i in (first, second)
        ]
        flow = cv2.resize(self._search.calc(grey[0], grey[1], None), (width, height), interpolation=cv2.INTER_AREA)
        return flow * (np.array([width, height], np.float32) / np.array(size, np.float32))


class GmFlow:
    """GMFlow (Xu et al. 2022) for large motion, its bias of about a pixel taken out by a second, small flow.

    Args:
        network: `img0`, `img1` [1, 3, h, w] (RGB, 0 to 1) -> flow [1, 2, h, w] [px], at the fixed size of its export.
        refine: flow between the first image and the second warped back by GMFlow's answer; None leaves it out.
        threads: threads of ONNX Runtime; 0 lets it choose.
    """

    def __init__(self, network: str | Path, *, refine: Flow | None = None, threads: int = 0) -> None:
        self._session = open_session(network, threads=threads, inputs=2, outputs=1)
        self._names = [i.name for i in self._session.get_inputs()]
        size = self._session.get_inputs()[0].shape[-2:]
        if not all(isinstance(s, int) for s in size):
            raise InputError(f"its input size is {size}", where=str(network), expected="a fixed size [1, 3, h, w]")
        self.height, self.width = size
        self.refine = refine

    def __call__(self, first: UInt8[Array, "H W 3"], second: UInt8[Array, "H W 3"]) -> Float[Array, "H W 2"]:
        """Displacement (du, dv) [px] of each pixel of `first`."""
        import cv2

        feed = {
            name: cv2.resize(i, (self.width, self.height)).astype(np.float32).transpose(2, 0, 1)[None] / 255
            for name, i in zip(self._names, (first, second), strict=True)
        }
        raw = self._session.run(None, feed)[0][0].transpose(1, 2, 0)
        height, width = first.shape[:2]
        scale = np.array([width / self.width, height / self.height], np.float32)
        flow = cv2.resize(raw, (width, height), interpolation=cv2.INTER_LINEAR) * scale
        if self.refine is None:
            return flow
        correction = self.refine(first, warp_back(second, flow))
        return correction + sample(flow, pixel_grid(height, width) + correction)


def pixel_grid(height: int, width: int) -> Float[Array, "H W 2"]:
    """The pixel coordinates (u, v) of an image, centres at integers."""
    u, v = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    return np.stack([u, v], -1)


def sample(image: Array, points: Float[Array, "... 2"]) -> Array:
    """Bilinear samples [..., channels] of an image [H, W, channels] at pixels (u, v), the border repeated outside."""
    import cv2

    flat = np.asarray(points, np.float32).reshape(-1, 1, 2)
    if not len(flat):
        return np.zeros((*points.shape[:-1], *image.shape[2:]), image.dtype)
    rows = []
    for part in np.array_split(flat, len(flat) // 30000 + 1):  # OpenCV's remap stops at 32767 rows
        rows.append(cv2.remap(image, part[..., 0], part[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
    out = np.concatenate(rows).reshape(*points.shape[:-1], *image.shape[2:])
    return out


def warp_back(second: Array, flow: Float[Array, "H W 2"]) -> Array:
    """The second image seen in the first one's pixels: second(p + flow(p))."""
    import cv2

    where = pixel_grid(*flow.shape[:2]) + flow
    return cv2.remap(second, where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def round_trip_error(forward: Float[Array, "H W 2"], backward: Float[Array, "H W 2"]) -> Float[Array, "H W"]:
    """Distance [px] by which a pixel misses itself after going forward and back."""
    height, width = forward.shape[:2]
    return np.linalg.norm(forward + sample(backward, pixel_grid(height, width) + forward), axis=-1)


def inside_image(points: Float[Array, "... 2"], height: int, width: int) -> Bool[Array, "..."]:
    """Whether pixels (u, v) lie on the image; NaN does not."""
    with np.errstate(invalid="ignore"):
        return ((points >= 0) & (points <= np.array([width - 1, height - 1]))).all(-1)
