"""What is on the page as splats: a body as it is now, and the backdrop."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from applications.appearance import Appearance
from applications.play.pictures import LARGEST
from applications.play.shades import FULL, colours_of, stress, stretch
from applications.twin import Twin
from physreal_core.fitting.thin import bind_to_body
from physreal_core.geometry.mesh import Mesh
from physreal_core.geometry.surface import vertex_normals
from physreal_core.playing import Session

_WITHIN = 0.4
"""Depth of the surface that takes the drags under splats, in cells of the grid or in thicknesses of a thin body."""


class Drawn:
    """One body on the page: splats where it was filmed, else its surface. The surface takes the drags, unseen under splats.

    Attributes:
        pictured: whether it has too many splats to send, so that pictures are drawn here.
        now: of splats, centres [G, 3] m on the page, covariances [G, 3, 3] m2 and colours [G, 3] as they are.
        opacities: of splats, [G, 1].
    """

    def __init__(self, server: Any, twin: Twin, number: int, aside: np.ndarray) -> None:
        self._twin, self._aside = twin, aside
        self._splatted = twin.gaussians is not None
        self.pictured = self._splatted and len(twin.gaussians) > LARGEST
        mesh = _within(twin) if self._splatted else twin.mesh
        self._mesh, self._binding = mesh, bind_to_body(mesh.vertices, twin.problem.body)
        self._surface = server.scene.add_mesh_simple(
            f"/body_{number}/surface",
            vertices=mesh.vertices.astype(np.float32),
            faces=mesh.faces.astype(np.uint32),
            color=(90, 160, 200),
            opacity=0.0 if self._splatted else None,
            wireframe=self._splatted,  # a filled surface, though unseen, hides the splats behind it
            side="double",
            position=tuple(aside),
        )
        if not self._splatted:
            return
        self._colours, self.opacities = twin.colours(), twin.opacities()
        count = len(self._colours)
        zeros = np.zeros((count, 3), np.float32), np.zeros((count, 3, 3), np.float32)
        self.now = *zeros, self._colours
        if not self.pictured:
            self._splats = server.scene.add_gaussian_splats(
                f"/body_{number}/splats",
                centers=zeros[0],
                covariances=zeros[1],
                rgbs=self._colours,
                opacities=self.opacities,
                position=tuple(aside),
            )

    def on_drag(self, called: Callable) -> None:
        """Have drags of the body told, with and without Shift."""
        self._surface.on_drag("left")(called)
        self._surface.on_drag("left", modifier="shift")(called)

    def draw(self, session: Session, shade: str) -> None:
        """The body as it is now, in its own colours or in those of its `stretch` or `stress`."""
        twin, state = self._twin, session.state
        self._surface.vertices = twin.carried(self._mesh.vertices, self._binding, state).astype(np.float32)
        if self._splatted:
            splats, colours = twin.splats(state), self._shaded(session, shade)
            self.now = (splats.centres + self._aside).astype(np.float32), splats.covariances, colours
            if not self.pictured:
                self._splats.set_gaussians(splats.centres, splats.covariances, colours, self.opacities)

    def _shaded(self, session: Session, shade: str) -> np.ndarray:
        if shade == "as filmed":
            return self._colours
        values, full = stretch(session), FULL
        if shade == "stress":
            values, full = stress(session), FULL * float(session.parameters.youngs_modulus.mean())
        return colours_of(values, full, self._twin.gaussian_binding).astype(np.float32)


class Behind:
    """The backdrop on the page: sent once, or kept for the pictures that are drawn here.

    Args:
        server: viser's.
        twin: whose.
        pictured: whether pictures are drawn here.

    Attributes:
        now: centres [m], covariances [m2] and colours as the filmed camera sees them.
        opacities: [G, 1].
    """

    def __init__(self, server: Any, twin: Twin, pictured: bool) -> None:
        gaussians = twin.backdrop.gaussians
        colours = gaussians.colours(Appearance.of(twin).camera.centre).clamp(0.0, 1.0)
        self.now = tuple(a.numpy() for a in (gaussians.means, gaussians.covariances(), colours))
        self.opacities = gaussians.opacities().numpy()[:, None]
        if not pictured:
            centres, covariances, rgbs = self.now
            server.scene.add_gaussian_splats(
                "/backdrop", centers=centres, covariances=covariances, rgbs=rgbs, opacities=self.opacities
            )


def _within(twin: Twin) -> Mesh:
    """The surface moved into the body, behind the splats that lie on it."""
    body = twin.problem.body
    depth = _WITHIN * (body.cell if body.elements is None else 2 * body.elements.half_height)
    mesh = twin.mesh
    return replace(mesh, vertices=mesh.vertices - depth * vertex_normals(mesh))
