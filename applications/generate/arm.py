"""A ViperX 300 S beside the body: joints that bring its fingers along a way of the hand, and what it looks like there.

Its links, joints and surfaces are those of the package gym-aloha (Apache-2.0), which is unpacked and not installed (`physreal models viperx`).
Joints are found by mink: inverse kinematics as a quadratic program in each step, within the joints' ranges.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch

from applications.generate.look import Look
from applications.generate.way import HandWay
from physreal_core.array_types import Array, Float

JOINTS = ["waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate"]
NAMES = [*JOINTS, "gripper"]

AWAY = 0.32
"""Distance of the arm's foot from where the body is taken [m]: near enough for the highest way, far enough to point straight down."""

ASIDE = np.pi / 4
"""Angle between where the arm faces and where the camera is [rad], as seen from above."""

TOLERANCE = 0.003
"""How far the fingers may be from the way [m]."""

OPEN, CLOSED = 0.057, 0.030
"""Places of the finger joints [m]; closed, the fingers leave 16 mm for what they hold."""

_XML = (
    '<mujoco><include file="vx300s_dependencies.xml"/><worldbody><include file="vx300s_left.xml"/></worldbody></mujoco>'
)
_ROBOT = "vx300s_left"
_BETWEEN = (0.145, 0.0, 0.0)
"""Where the hand's place lies in the gripper's frame [m]: between the fingers, 9 mm from their ends."""

_HOME = (0.0, -0.96, 1.16, 0.0, 0.9, 0.0)
"""Joints of an arm at rest [rad]: bent, and the gripper points down."""

_ITERATIONS, _FIRST, _STEP = 20, 200, 0.1
"""Of the inverse kinematics in a frame, in the first frame; and its step of time [s], which bounds no velocity here."""

_DOWN = 0.02
"""Weight of the gripper's direction [1/rad] over that of its place [1/m]: where a place is too high, the gripper tilts."""

_SPACING, _GREY = 0.006, 0.16
"""Of the Gaussians on the surface [m]; colour of the arm."""


class OutOfReach(ValueError):
    """The arm cannot bring its fingers along a way."""


@dataclass(frozen=True)
class Poses:
    """Of the arm, frame by frame.

    Attributes:
        joints: as of `JOINTS` [rad].
        opening: 1 where the fingers are open, 0 where they are closed.
    """

    joints: Float[Array, "frames 6"]
    opening: Float[Array, " frames"]

    @property
    def states(self) -> Float[Array, "frames 7"]:
        """As of `NAMES`."""
        return np.concatenate([self.joints, self.opening[:, None]], axis=1).astype(np.float32)


class Arm:
    """One arm that stands on the table.

    Args:
        files: of the arm, by name.
        foot: where it stands [m].
        facing: horizontal direction in which it stretches at rest, of length 1.

    Attributes:
        foot, facing: as given.
        model: of MuJoCo.
    """

    def __init__(self, files: dict[str, Path], foot: Float[Array, " 3"], facing: Float[Array, " 3"]) -> None:
        import mujoco

        self.foot, self.facing = foot, facing
        contents = {name: path.read_bytes() for name, path in files.items()}
        models = {name: content for name, content in contents.items() if name.endswith(".xml")}
        specification = mujoco.MjSpec.from_string(_XML, include=models, assets=contents)
        base, wrist = specification.body(_ROBOT), specification.body(f"{_ROBOT}/gripper_link")
        base.pos = foot
        angle = np.arctan2(facing[1], facing[0])
        base.quat = [np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)]
        wrist.add_site(name="fingers", pos=_BETWEEN)
        self.model = specification.compile()
        forward, up = np.array([*facing[:2], 0.0]), np.array([0.0, 0.0, 1.0])
        # The gripper's x axis points away from the wrist, and its fingers open along y.
        self._down = np.stack([-up, np.cross(up, forward), forward], axis=1)

    @classmethod
    def beside(
        cls, files: dict[str, Path], taken: Float[Array, "grasps 3"], floor: float, eye: Float[Array, " 3"]
    ) -> "Arm":
        """An arm behind the body and to its right, as the camera at `eye` [m] sees them: in the picture, and not before the body.

        Args:
            files: of the arm, by name.
            taken: places where the body is taken [m].
            floor: height of the table [m].
            eye: of the camera.
        """
        middle = taken.mean(0)
        to_camera = np.arctan2(*(eye - middle)[1::-1])
        facing = np.array([np.cos(to_camera - ASIDE), np.sin(to_camera - ASIDE), 0.0])
        return cls(files, np.array([*(middle - AWAY * facing)[:2], floor]), facing)

    def along(self, way: HandWay) -> Poses:
        """Joints that bring the fingers along a way, the gripper pointing down where it can.

        Raises:
            OutOfReach: the fingers come no nearer than `TOLERANCE` to a place.
        """
        import mink

        configuration = mink.Configuration(self.model, np.array([*self._towards(way.places[0]), CLOSED, -CLOSED]))
        fingers = mink.FrameTask("fingers", "site", position_cost=1.0, orientation_cost=_DOWN, lm_damping=1e-6)
        still = mink.PostureTask(self.model, cost=1e-5)
        limits, joints = [mink.ConfigurationLimit(self.model)], []
        for frame, place in enumerate(way.places):
            target = mink.SE3.from_rotation_and_translation(mink.SO3.from_matrix(self._down), place)
            fingers.set_target(target)
            still.set_target_from_configuration(configuration)
            for _ in range(_FIRST if frame == 0 else _ITERATIONS):
                step = mink.solve_ik(configuration, [fingers, still], _STEP, solver="daqp", limits=limits)
                configuration.integrate_inplace(step, _STEP)
                if np.linalg.norm(step[: len(JOINTS)]) * _STEP < 1e-5:
                    break
            off = np.linalg.norm(configuration.data.site("fingers").xpos - place)
            if off > TOLERANCE:
                raise OutOfReach(f"the fingers stay {1e3 * off:.0f} mm from frame {frame} of the hand's way")
            joints.append(configuration.q[: len(JOINTS)].copy())
        return Poses(np.array(joints), np.where(way.closed, 0.0, 1.0))

    def _towards(self, place: Float[Array, " 3"]) -> Float[Array, " 6"]:
        """`_HOME`, turned to a place [rad]: from elsewhere the first frame may be found with the wrist over on its other side."""
        ahead, joints = place - self.foot, np.array(_HOME)
        aside = self.facing[0] * ahead[1] - self.facing[1] * ahead[0]
        # the gripper keeps its direction over the table, so the wrist turns as far as the waist
        joints[[JOINTS.index("waist"), JOINTS.index("wrist_rotate")]] = np.arctan2(aside, self.facing[:2] @ ahead[:2])
        return joints

    def look(self, poses: Poses) -> Look:
        """What it looks like in some poses."""
        import mujoco

        data, places, normals = mujoco.MjData(self.model), [], []
        for joints, opening in zip(poses.joints, poses.opening, strict=True):
            finger = CLOSED + opening * (OPEN - CLOSED)
            data.qpos[:] = [*joints, finger, -finger]
            mujoco.mj_kinematics(self.model, data)
            turned = [data.geom_xmat[part].reshape(3, 3) for part in self._skin]
            places.append(
                np.concatenate(
                    [p @ R.T + data.geom_xpos[part] for R, (part, (p, _)) in zip(turned, self._skin.items())]
                )
            )
            normals.append(np.concatenate([n @ R.T for R, (_, n) in zip(turned, self._skin.values())]))
        points, across = (torch.as_tensor(np.array(a), dtype=torch.float32) for a in (places, normals))
        return Look(points, across, torch.full((points.shape[1], 3), _GREY), 0.75 * _SPACING)

    @cached_property
    def _skin(self) -> "dict[int, tuple[Array, Array]]":
        """Of each geom, points on its surface in its frame [m] and normals there; the same in every run."""
        import trimesh

        model, found = self.model, {}
        for part in range(model.ngeom):
            mesh = model.geom_dataid[part]
            vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
            faces = model.mesh_face[model.mesh_faceadr[mesh] :][: model.mesh_facenum[mesh]]
            surface = trimesh.Trimesh(vertices, faces, process=False)
            points, face = trimesh.sample.sample_surface(surface, round(surface.area / _SPACING**2), seed=part)
            found[part] = np.asarray(points), surface.face_normals[face]
        return found
