"""Pose and fabric of a real cloth from the frames that are observed, by a robust Chamfer distance and the simulator's gradients."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from scipy.spatial import cKDTree

from benchmarks.thin.cloth_data import FITTED_FRAMES, Recording
from benchmarks.thin.cloth_scene import Fabric, Scene, placed
from physreal_core.array_types import Array, Float, Tensor

DEFAULT = Fabric(stretching=1000.0, shear=40.0, bending=4e-5, friction=0.4, drag=0.5, damping=0.002)
"""In the middle of ten measured fabrics (docs/materials.md, "Fabrics"), with little air drag and damping."""
LOWEST = Fabric(stretching=30.0, shear=1.0, bending=5e-7, friction=0.1, drag=0.05, damping=2e-4)
LARGEST = Fabric(stretching=5000.0, shear=200.0, bending=2e-3, friction=2.0, drag=20.0, damping=0.02)
STARTS = (
    DEFAULT,
    Fabric(500.0, 30.0, 1e-5, 0.4, 2.0, 0.002),
    Fabric(500.0, 10.0, 1e-4, 0.8, 2.0, 0.002),
    Fabric(200.0, 30.0, 3e-4, 0.4, 6.0, 0.001),
)
"""From the best of which the descent begins."""
OF_AIR = (0.3, 0.7, 3.0)
"""Least, usual and largest drag of air by area [kg/m3]: rho C_d / 2 with C_d = 1.2 is 0.7."""
SATURATED = 0.015
"""Distance [m] at which a point's share in the objective is half of what it can be at most."""
RISEN = 0.05
"""Of the gripper [m], from which on a cloud shows the sheet and not only the creases that stood out over the table."""
HIDDEN = 0.05
"""Around the held corner [m], where the gripper was masked out of the clouds."""
MARGIN = 0.012
"""Over the height at which the table was cut off [m], from which on the sheet is to be seen."""
POINTS = 300
"""Of a cloud that the objective takes."""
POSE_SCALES = (0.007, 0.01, 0.015, 0.07)
"""How far x, y, z [m] and the turn [rad] may be from their starts."""
PRIOR = 0.05
"""Of one scale off, in the objective."""


def start_of_pose(recording: Recording) -> Float[Tensor, "4"]:
    """Where the held corner lay: under the highest points of the observed frames, less the way of the gripper; the table just under the
    height at which the clouds were cut. The turn is that of the plane that fits the upper half of the last
    three best."""
    tops, slopes = [], []
    for frame in risen_frames(recording):
        cloud = recording.clouds[frame]
        top = np.percentile(cloud[:, 2], 99.5)
        near = cloud[np.abs(cloud[:, 2] - top + 0.005) < 0.01]
        tops.append(np.median(near, axis=0) - recording.path[frame])
        upper = cloud[cloud[:, 2] > np.median(cloud[:, 2])]  # the lower part may lie in creases
        design = np.c_[upper[:, [0, 2]], np.ones(len(upper))]
        slopes.append(np.linalg.lstsq(design, upper[:, 1], rcond=None)[0][0])
    x, y, _ = np.median(tops, axis=0)
    turn = np.arctan(np.median(slopes[-3:]))
    return torch.tensor([x, y, recording.cut - 0.008, turn], dtype=torch.float32)


def risen_frames(recording: Recording) -> list[int]:
    """Observed frames in which the corner is up."""
    return [frame for frame in range(FITTED_FRAMES) if recording.path[frame, 2] > RISEN]


class Objective:
    """Saturating Chamfer distance, in both directions: from a part of each cloud to the sheet, and from the sheet to the cloud where it must be seen.

    Without the second, a pose is best where the sheet covers creases and strays.

    Args:
        scene: of the cloth.
    """

    def __init__(self, scene: Scene) -> None:
        rng = np.random.default_rng(0)
        recording = scene.recording
        self._scene, self.frames = scene, risen_frames(recording)[1::2]
        clouds = [recording.clouds[frame] for frame in self.frames]
        self._clouds = [cloud[rng.permutation(len(cloud))[:POINTS]] for cloud in clouds]
        self._trees = [(cKDTree(cloud), cloud) for cloud in clouds]
        x0 = scene.body.x0
        self._seen = np.linalg.norm(x0 - x0[0], axis=1) > HIDDEN

    def __call__(self, x: Float[Tensor, "frames vertices 3"], pose: Float[Tensor, "4"]) -> Tensor:
        """Between 0 and 2, over every other observed frame in which the corner is up; of the vertices' places before the pose."""
        total = x.new_zeros(())
        for frame, cloud, tree in zip(self.frames, self._clouds, self._trees, strict=True):
            at = placed(x[frame], pose)
            total = total + _saturated(self._scene.surface.distance(cloud, at)) + self._unseen_parts(at, *tree)
        return total / len(self.frames)

    def _unseen_parts(self, at: Tensor, tree: cKDTree, cloud: Float[Array, "points 3"]) -> Tensor:
        there = at.detach().numpy()
        visible = self._seen & (there[:, 2] > self._scene.recording.cut + MARGIN)
        if not visible.any():
            return at.new_zeros(())
        nearest = torch.as_tensor(cloud[tree.query(there[visible])[1]]).to(at)
        return _saturated((at[torch.as_tensor(visible)] - nearest).square().sum(1).clamp_min(1e-12).sqrt())


def _saturated(distance: Tensor) -> Tensor:
    return (distance**2 / (distance**2 + SATURATED**2)).mean()


def fit_place(objective: Objective, x: Tensor, start: Tensor, iterations: int = 25) -> Float[Tensor, "4"]:
    """The pose of a motion that is given; the turn stays."""
    place, turn = start[:3].clone().requires_grad_(), start[3:]
    descent = torch.optim.Adam([place], lr=0.002)
    for _ in range(iterations):
        descent.zero_grad()
        pose = torch.cat([place, turn])
        (objective(x, pose) + _prior(pose, start)).backward()
        descent.step()
    return torch.cat([place.detach(), turn])


def _prior(pose: Tensor, start: Tensor) -> Tensor:
    return PRIOR * ((pose - start) / torch.tensor(POSE_SCALES)).square().sum()


@dataclass(frozen=True)
class Fitted:
    """Fabric and pose, and the objective there."""

    fabric: Fabric
    pose: Float[Tensor, "4"]
    objective: float


def with_pose(scene: Scene, objective: Objective, fabric: Fabric) -> Fitted:
    """The best pose of a fabric."""
    start = start_of_pose(scene.recording)
    with torch.no_grad():
        x = scene.motion(fabric, start[3], FITTED_FRAMES)
    pose = fit_place(objective, x, start)
    with torch.no_grad():
        return Fitted(fabric, pose, float(objective(x, pose) + _prior(pose, start)))


def fit(scene: Scene, tell: Callable[[str], None] = lambda _: None, iterations: int = 60) -> tuple[Fitted, Fitted]:
    """The default fabric in its best pose, and what fits best: the best of `STARTS`, and a descent along the gradient from there.

    Args:
        scene: of the cloth.
        tell: called with a line of text now and then.
        iterations: of the descent.
    """
    objective = Objective(scene)
    tried = []
    for fabric in STARTS:
        fabric = fabric if scene.drag == "linear_drag" else replace(fabric, drag=OF_AIR[1])
        tried.append(with_pose(scene, objective, fabric))
        tell(f"{fabric}: {tried[-1].objective:.4f}")
    best = min(tried, key=lambda found: found.objective)
    return tried[0], descend(scene, objective, best, tell, iterations)


def descend(scene: Scene, objective: Objective, begun: Fitted, tell: Callable[[str], None], iterations: int) -> Fitted:
    """Adam by the logarithms of the fabric's numbers and by the pose, within bounds; the best that it comes by."""
    names = [field.name for field in fields(Fabric)]
    bounds = LOWEST, LARGEST
    if scene.drag == "surface_drag":
        bounds = replace(LOWEST, drag=OF_AIR[0]), replace(LARGEST, drag=OF_AIR[2])
    low, high = (torch.tensor([np.log(getattr(f, name)) for name in names]) for f in bounds)
    logs = torch.tensor([np.log(getattr(begun.fabric, name)) for name in names]).requires_grad_()
    pose, start, best = begun.pose.clone().requires_grad_(), start_of_pose(scene.recording), begun
    descent = torch.optim.Adam([{"params": [logs], "lr": 0.25}, {"params": [pose], "lr": 0.002}], betas=(0.8, 0.95))
    for iteration in range(iterations):
        descent.zero_grad()
        fabric = Fabric(*(value.float() for value in logs.exp()))
        total = objective(scene.motion(fabric, pose[3], FITTED_FRAMES), pose) + _prior(pose, start)
        total.backward()
        if float(total.detach()) < best.objective:
            values = [float(value) for value in logs.detach().exp()]
            best = Fitted(Fabric(*values), pose.detach().clone(), float(total.detach()))
        if iteration % 5 == 0:
            tell(f"{iteration}: {float(total.detach()):.4f} at {[f'{float(v):.3g}' for v in logs.detach().exp()]}")
        descent.step()
        with torch.no_grad():
            logs.clamp_(low, high)
    return best
