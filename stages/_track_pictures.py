"""Pictures of a capture without images: measured points and the simulated surface, seen from the side."""

import numpy as np

from physreal_core.array_types import Array, Bool, Float

WIDTH, HEIGHT, MARGIN = 400, 300, 0.12
"""Of a panel [px]; the room around what moves [share of its extent]."""
_PAPER, _GROUND, _INK = (255, 255, 255), (203, 213, 225), (15, 23, 42)
_SURFACE, _APART = (94, 158, 160), (200, 60, 40)


class SideView:
    """A view along one horizontal axis that holds all measured points of all frames.

    Args:
        measured: tracks [T, J, 3] m.
        valid: which entries were measured.
    """

    def __init__(self, measured: Float[Array, "T J 3"], valid: Bool[Array, "T J"]) -> None:
        points = measured[valid]
        low, high = points.min(0), points.max(0)
        self.across = int(np.argmax((high - low)[:2]))
        low, high = low[[self.across, 2]], high[[self.across, 2]]
        room = MARGIN * (high - low).max()
        low, high = low - room, high + room
        self.scale = float(min(WIDTH / (high - low)[0], HEIGHT / (high - low)[1]))
        self.centre = (low + high) / 2

    def pixels(self, points: Float[Array, "N 3"]) -> Array:
        """(u, v) of world points [m], whole pixels."""
        offset = (points[:, [self.across, 2]] - self.centre) * self.scale
        pixels = np.array([WIDTH / 2, HEIGHT / 2]) + offset * [1, -1]
        return np.rint(pixels.clip(-9999, 9999)).astype(int)

    def picture(
        self,
        measured: Float[Array, "J 3"],
        valid: Bool[Array, " J"],
        surface: Float[Array, "S 3"],
        ours: Float[Array, "J 3"],
        title: str,
    ) -> Array:
        """[HEIGHT, WIDTH, 3] uint8: the simulated surface, measured points over it, joined to where the simulation has them."""
        import cv2

        panel = np.full((HEIGHT, WIDTH, 3), _PAPER, np.uint8)
        ground = int(self.pixels(np.zeros((1, 3)))[0, 1])
        cv2.line(panel, (0, ground), (WIDTH, ground), _GROUND, 2)
        for at in self.pixels(surface):
            cv2.circle(panel, tuple(map(int, at)), 2, _SURFACE, -1, cv2.LINE_AA)
        there, here = self.pixels(measured[valid]), self.pixels(ours[valid])
        for a, b in zip(there, here, strict=True):
            cv2.line(panel, tuple(map(int, a)), tuple(map(int, b)), _APART, 1, cv2.LINE_AA)
            cv2.circle(panel, tuple(map(int, a)), 2, _INK, -1, cv2.LINE_AA)
        cv2.putText(panel, title, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.45, _INK, 1, cv2.LINE_AA)
        return panel
