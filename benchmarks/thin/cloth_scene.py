"""A cloth that lies flat on a table and is lifted by one corner along a recorded path.

Two fingers hold it along a line of 2 cm across its diagonal, which keeps its direction and about which the sheet may swing.
"""

from dataclasses import dataclass

import numpy as np
import torch

from benchmarks.thin.cloth_data import Recording, Surface
from benchmarks.thin.meshes import rectangle
from physreal_core.array_types import Float, Tensor
from physreal_core.simulation import Grip, Parameters, SimulationConfig, Simulator, shell_body

SIDE = 1.1222 / np.sqrt(2.0) / 3.06
"""Of the square cloth [m], as the published simulation has it (a diagonal of 1.1222 in the clouds' published scale)."""
CELLS = 18
THICKNESS, AREAL_DENSITY = 5e-4, 0.2
"""[m] and [kg/m2]. Only stiffness over mass shows in a motion under weight, so the mass is not fitted."""
POINT_HEIGHT = 0.002
"""Of the controller points over the two vertices that they hold [m], which is the bonds' length."""


@dataclass(frozen=True)
class Fabric:
    """What a fit may change, each positive.

    Attributes:
        stretching: stiffness of the membrane along warp and weft [N/m].
        shear: the membrane's [N/m].
        bending: [N m].
        friction: of the table.
        drag: by mass, rate [1/s]; or by area and normal, rho C_d / 2 [kg/m3].
        damping: time by which the bending's viscosity is late [s].
    """

    stretching: float | Tensor
    shear: float | Tensor
    bending: float | Tensor
    friction: float | Tensor
    drag: float | Tensor
    damping: float | Tensor


class Scene:
    """The square with a diagonal along the path, its held corner at the origin of a frame whose z = 0 is the table.

    Args:
        recording: of the cloth.
        away: 1 where the cloth lies along +y from its held corner, -1 along -y.
        cells: along each side.
        drag: `linear_drag` by mass, or `surface_drag` by area and normal.
        self_contact: whether layers touch.
    """

    def __init__(
        self,
        recording: Recording,
        away: float,
        cells: int = CELLS,
        drag: str = "linear_drag",
        self_contact: bool = False,
    ) -> None:
        self.recording, self.drag = recording, drag
        flat, triangles = rectangle((cells, cells), (SIDE, SIDE))
        across, along = flat[:, 0] - flat[:, 1], flat[:, 0] + flat[:, 1]  # of the diagonals
        vertices = np.stack([across, away * along, 0.0 * along], 1) / np.sqrt(2.0)
        if away < 0:
            triangles = triangles[:, ::-1].copy()
        vertices[:, 2] = THICKNESS / 2.0
        warp = (1.0 / np.sqrt(2.0), away / np.sqrt(2.0), 0.0)
        self.body = shell_body(vertices, triangles, THICKNESS, AREAL_DENSITY / THICKNESS, warp=warp)
        self.surface = Surface(triangles)
        held = np.array([1, cells + 1])  # next to the corner on both sides: the fingers' width
        points = vertices[held] + [0.0, 0.0, POINT_HEIGHT]
        grip = Grip(held, np.arange(2), np.full(2, 0.5), np.full(2, POINT_HEIGHT))
        self._held = torch.tensor(points, dtype=torch.float32)
        self._path = torch.tensor(recording.path[:, None], dtype=torch.float32)
        terms = ("bending", "fabric", "drag", "surface_drag", "viscosity")
        config = SimulationConfig(fps=recording.fps, terms=terms, self_contact=self_contact)
        self.simulator = Simulator(self.body, config, grip)
        by_mass = drag == "linear_drag"
        self._dragged = torch.tensor(self.body.mass if by_mass else np.ones(len(vertices)), dtype=torch.float32)

    def parameters(self, fabric: Fabric) -> Parameters:
        """Of the simulator. Without Poisson's ratio, E t is the stretching and E t^3 / 12 the bending times its ratio."""
        number = lambda value: torch.as_tensor(value, dtype=torch.float32)
        E = number(fabric.stretching) / THICKNESS
        bending = number(fabric.bending) / (E * THICKNESS**3 / 12.0)
        viscosity = torch.stack([0.5 * number(fabric.damping) * E, torch.zeros(())])
        return Parameters(
            E, torch.zeros(()), number(fabric.friction), torch.tensor(10.0), torch.tensor(0.05),
            bending_ratio=bending, shear_ratio=2.0 * number(fabric.shear) / number(fabric.stretching),
            viscosity=viscosity, **{self.drag: number(fabric.drag) * self._dragged},
        )  # fmt: skip

    def motion(
        self, fabric: Fabric, turn: float | Tensor, frames: int | None = None
    ) -> Float[Tensor, "frames vertices 3"]:
        """Places of the vertices [m] with the held corner's start at the origin and the diagonal along y; differentiable.

        Args:
            fabric: of the cloth.
            turn: of the cloth about its held corner [rad], which the path does not take part in.
            frames: how many.
        """
        turn = torch.as_tensor(turn, dtype=torch.float32)
        return self.simulator.rollout(self.parameters(fabric), self._held + turned(self._path, -turn), frames=frames).x

    def distances(
        self, x: Float[Tensor, "frames vertices 3"], pose: Float[Tensor, "4"], first: int = 0
    ) -> list[Tensor]:
        """From the clouds of frames from `first` on to the sheet [m]; x of the same frames, placed by `pose` (x, y, z [m], turn [rad])."""
        return [
            self.surface.distance(cloud, placed(frame, pose))
            for cloud, frame in zip(self.recording.clouds[first:], x, strict=False)
        ]


def placed(x: Float[Tensor, "vertices 3"], pose: Float[Tensor, "4"]) -> Float[Tensor, "vertices 3"]:
    """Places turned about the held corner's start and moved."""
    return turned(x, pose[3]) + pose[:3]


def turned(x: Float[Tensor, "*points 3"], angle: Float[Tensor, ""]) -> Float[Tensor, "*points 3"]:
    """Turned about the z axis."""
    cosine, sine = torch.cos(angle), torch.sin(angle)
    return torch.stack([cosine * x[..., 0] - sine * x[..., 1], sine * x[..., 0] + cosine * x[..., 1], x[..., 2]], -1)


def chamfer(distances: list[Tensor]) -> float:
    """Mean over frames of the mean distance [m]."""
    return float(torch.stack([d.mean() for d in distances]).mean())
