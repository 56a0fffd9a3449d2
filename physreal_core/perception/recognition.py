"""Frame 0 recognised in a later frame, densely: what became of every point, lost ones among them.

The later frame is warped into frame 0 by a smooth map through the tracks in sight, and the small flow between the two tells
what the map gets wrong. Many pixels agree in such a flow, so it finds points again that a patch of a few pixels does not.
"""

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Float, Int, UInt8
from physreal_core.perception.flow import Flow, pixel_grid, sample
from physreal_core.perception.neighbourhood import local_map, nearest_among

_MARGIN = 24  # around the points [px]
_STRIDE = 8  # the map is smooth: made on a coarse grid and interpolated [px]


@dataclass(frozen=True)
class Recognised:
    """N points of frame 0 in a later frame.

    Attributes:
        points: [N, 2] px.
        miss: [N] px, by which the flow between frame 0 and the warped frame misses, there and back.
        correction: [N] px, how far from the smooth map the point lies.
    """

    points: Float[Array, "N 2"]
    miss: Float[Array, " N"]
    correction: Float[Array, " N"]


class Recognition:
    """Frame 0 around its points.

    Args:
        frame: frame 0.
        points: J points of it [px].
        flow: between the frame and what was warped into it.
        neighbours: tracks that carry a place of the map.
        floor: departures below this are not told from none [px].
    """

    def __init__(
        self, frame: UInt8[Array, "H W 3"], points: Float[Array, "J 2"], flow: Flow, neighbours: int, floor: float
    ) -> None:
        self.points, self.flow, self.neighbours, self.floor = points, flow, neighbours, floor
        low = np.maximum(np.floor(points.min(0)).astype(int) - _MARGIN, 0)
        high = np.minimum(np.ceil(points.max(0)).astype(int) + _MARGIN, np.array(frame.shape[1::-1]) - 1)
        self.low, self.size = low, (int(high[1] - low[1] + 1), int(high[0] - low[0] + 1))
        self.image = np.ascontiguousarray(frame[low[1] : high[1] + 1, low[0] : high[0] + 1])
        rows, columns = (-(-n // _STRIDE) + 1 for n in self.size)
        self.nodes = pixel_grid(rows, columns) * _STRIDE + low

    def find(
        self, frame: UInt8[Array, "H W 3"], now: Float[Array, "J 2"], sight: Int[Array, " M"], which: Int[Array, " N"]
    ) -> Recognised:
        """The points `which` in another frame, where the points are at `now`, those of `sight` for certain."""
        import cv2

        places = self.nodes.reshape(-1, 2).astype(np.float32)
        everything = np.concatenate([self.points, places])
        near = nearest_among(everything, np.arange(len(self.points), len(everything)), sight, self.neighbours)
        usable = np.ones(near.shape, bool)
        carried = local_map(places, self.points[near], now[near], usable, floor=self.floor)
        nodes = carried.points.reshape(self.nodes.shape)
        local = pixel_grid(*self.size) / _STRIDE
        where = cv2.remap(nodes, local[..., 0], local[..., 1], cv2.INTER_LINEAR)
        warped = cv2.remap(frame, where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        forward, backward = self.flow(self.image, warped), self.flow(warped, self.image)
        here = (self.points[which] - self.low).astype(np.float32)
        step = sample(forward, here)
        miss = np.linalg.norm(step + sample(backward, here + step), axis=1)
        return Recognised(sample(where, here + step), miss, np.linalg.norm(step, axis=1))
