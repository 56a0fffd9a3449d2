"""Frame 0 as geometry sees it: colour, depth, the object's mask, what the hand hides, and the camera."""

from dataclasses import dataclass

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Float
from physreal_core.errors import InputError
from physreal_core.evidence import require_pixels
from physreal_core.rendering import Camera


@dataclass(frozen=True)
class Observation:
    """One RGB-D view of the object.

    Attributes:
        rgb: 0..1, shape [H, W, 3].
        depth: along the camera's z [m], 0 = no reading, shape [H, W].
        mask: pixels that show the object, shape [H, W].
        hidden: pixels where something else may stand in front of it (the hand), shape [H, W].
        camera: calibrated, world frame with the support plane at z = 0.
    """

    rgb: Float[Array, "H W 3"]
    depth: Float[Array, "H W"]
    mask: Bool[Array, "H W"]
    hidden: Bool[Array, "H W"]
    camera: Camera

    def __post_init__(self) -> None:
        require_pixels(int(self.mask.sum()), "the object's mask", "masks/object/000000.png, frame 0")

    @property
    def measured(self) -> Bool[Array, "H W"]:
        """Object pixels with a depth reading."""
        return self.mask & (self.depth > 0)

    @property
    def pixel_size(self) -> float:
        """Width [m] of a pixel at the object's distance (median over its points)."""
        local = self.camera.to_camera(torch.as_tensor(self.points()))
        return float(local[:, 2].median()) / self.camera.intrinsics[0]

    def require_depth(self) -> None:
        """InputError where there is no depth to build a shape from, in the image or on the object."""
        if not (self.depth > 0).any():
            raise InputError(
                "frame 0 has no depth to build a shape from",
                where="build_object",
                remedy="add depth/ or a shape_prior.glb to the capture",
            )
        remedy = "check the depth image and the mask, or give T_world_object in capture.json"
        require_pixels(int(self.measured.sum()), "the depth on the object", "depth/000000.png, frame 0", remedy)

    def points(self) -> Float[Array, "n 3"]:
        """World positions [m] of the `measured` pixels, row by row.

        Without any depth in the whole image (a colour camera) the mask's pixels are laid onto the plane z = 0.

        Raises:
            InputError: too few of them.
        """
        if not (self.depth > 0).any():
            return self._on_plane()
        self.require_depth()
        return self._lifted(self.measured)

    def hand_points(self, reach: float) -> Float[Array, "n 3"]:
        """World positions [m] of the hidden pixels' surface within `reach` [m] of the object's; none without depth."""
        from scipy.spatial import cKDTree

        hand = self._lifted(self.hidden & (self.depth > 0))
        away, _ = cKDTree(self.points()).query(hand, distance_upper_bound=reach)
        return hand[np.isfinite(away)]

    def _lifted(self, where: Bool[Array, "height width"]) -> Float[Array, "n 3"]:
        """World positions [m] of pixels with depth, row by row."""
        v, u = np.nonzero(where)
        pixels = torch.as_tensor(np.stack([u, v], axis=1).astype(float))
        return self.camera.unproject(pixels, torch.as_tensor(self.depth[v, u].astype(float))).numpy()

    def _on_plane(self) -> Array:
        v, u = np.nonzero(self.mask)
        pixels = torch.as_tensor(np.stack([u, v], axis=1).astype(float))
        eye = self.camera.centre.numpy()
        directions = self.camera.unproject(pixels, torch.ones(len(u), dtype=torch.float64)).numpy() - eye
        down = directions[:, 2] < -1e-3
        remedy = "check T_world_camera in capture.json, and the mask"
        require_pixels(int(down.sum()), "the part of the object's mask below the horizon", "frame 0", remedy)
        return eye + directions[down] * (eye[2] / -directions[down, 2:])

    def reduced(self, factor: float, share: float = 0.5) -> "Observation":
        """The view at `factor` times the resolution: colours and depths are means over the object's pixels, depth over
        those with a reading; a pixel belongs to the object if that `share` of what is known of it does."""
        camera = self.camera.scaled(factor)
        cells = self._cells(factor, camera)
        total = lambda values, where: np.bincount(cells[where], values[where], camera.width * camera.height)
        ones = np.ones_like(self.depth)
        every = np.ones_like(self.mask)
        known = total(ones, every & ~self.hidden)
        hidden = total(ones, self.hidden) > known
        mask = (total(ones, self.mask & ~self.hidden) > share * known) & ~hidden
        count = total(ones, self.measured)
        depth = total(self.depth, self.measured) / np.maximum(count, 1)
        area = np.maximum(total(ones, every), 1)
        inside = np.maximum(total(ones, self.mask), 1)
        rgb = [
            np.where(mask, total(c, self.mask) / inside, total(c, every) / area) for c in np.moveaxis(self.rgb, 2, 0)
        ]
        shape = (camera.height, camera.width)
        return Observation(
            np.stack(rgb, axis=1).reshape(*shape, 3),
            np.where(mask, depth, 0).reshape(shape),
            mask.reshape(shape),
            hidden.reshape(shape),
            camera,
        )

    def _cells(self, factor: float, camera: Camera) -> Array:
        height, width = self.mask.shape
        rows = np.minimum(((np.arange(height) + 0.5) * factor).astype(int), camera.height - 1)
        columns = np.minimum(((np.arange(width) + 0.5) * factor).astype(int), camera.width - 1)
        return rows[:, None] * camera.width + columns[None]
