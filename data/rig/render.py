"""Pictures of a truth: colour, exact depth and labels by ray casting, with a lamp, its shadow and a table."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from data.rig import texture
from data.rig.mesh import mesh_shape
from data.rig.raycast import Raycaster, pixel_rays
from data.rig.rig_scene import Look, RigScene
from data.rig.trajectory import Trajectory
from physreal_core.array_types import Array, Float, Int, UInt8

BACKGROUND, OBJECT, HAND, TABLE, FURTHER_HAND = -1, 0, 1, 2, 3
_TABLE_HALF, _HORIZON = 1.5, 0.30


@dataclass(frozen=True)
class Picture:
    """Noise-free image: rgb [H,W,3] in 0-1, depth [H,W] m (0 = nothing), label [H,W], slope [H,W] = angle between
    ray and surface normal [degrees]."""

    rgb: Float[Array, "H W 3"]
    depth: Float[Array, "H W"]
    label: Int[Array, "H W"]
    slope: Float[Array, "H W"]


class Stage:
    """Everything in front of the camera: the object's surface, the hand's (`hand`, at frame 0), the table, and further
    hands (`others`, at frame 0).

    Args:
        scene: what is filmed.
        trajectory: how the object moved.
        placed: where hand and table are, from where they would be were the table level at z = 0.
    """

    def __init__(self, scene: RigScene, trajectory: Trajectory, placed: Callable[[Array], Array] = np.asarray) -> None:
        self._look, self.view = scene.look, scene.view
        self._lamp = np.array(scene.look.lamp) / np.linalg.norm(scene.look.lamp)
        hand = mesh_shape(scene.hand, scene.hand_spacing)
        hand.vertices[:] = placed(hand.vertices)
        corners = _TABLE_HALF * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
        self.hand = hand
        self.others = [mesh_shape(other.shape, scene.hand_spacing) for other in scene.others]
        self._rest = [trajectory.mesh.vertices, hand.vertices, placed(corners), *(m.vertices for m in self.others)]
        faces = [trajectory.mesh.faces, hand.faces, np.array([[0, 1, 2], [0, 2, 3]]), *(m.faces for m in self.others)]
        offsets = np.cumsum([0] + [len(points) for points in self._rest[:-1]])
        self._faces = np.concatenate([part + offset for part, offset in zip(faces, offsets, strict=True)])
        self._label = np.repeat(
            [OBJECT, HAND, TABLE] + [FURTHER_HAND] * len(self.others), [len(part) for part in faces]
        )
        self._paint = np.concatenate(self._rest)

    def picture(
        self,
        vertices: Float[Array, "V 3"],
        hand: Float[Array, "3"],
        supersampling: int = 2,
        pose: Float[Array, "4 4"] | None = None,
        others: Float[Array, "A 3"] | None = None,
    ) -> Picture:
        """The view of the object at `vertices` [m] with the hand displaced by `hand` [m], further ones by `others` [m].

        Colour is averaged over `supersampling`^2 rays a pixel; depth and label are those of the pixel's centre. The camera
        stands at `pose` (T_world_camera), by default where the scene's view says.
        """
        moved = [] if others is None else [rest + by for rest, by in zip(self._rest[3:], others, strict=True)]
        points = np.concatenate([vertices, self._rest[1] + hand, self._rest[2], *moved])
        caster = Raycaster(points, self._faces)
        normals = _vertex_normals(points, self._faces)
        view = self.view
        pose = view.pose() if pose is None else pose
        offsets = (np.arange(supersampling) + 0.5) / supersampling - 0.5
        colours = [self._shade(caster, points, normals, pose, (u, v))[0] for u in offsets for v in offsets]
        _, depth, label, slope = self._shade(caster, points, normals, pose, (0.0, 0.0))
        shape = (view.height, view.width)
        rgb = np.mean(colours, axis=0).reshape(*shape, 3)
        return Picture(rgb, depth.reshape(shape), label.reshape(shape), slope.reshape(shape))

    def _shade(
        self, caster: Raycaster, points: Array, normals: Array, pose: Array, shift: tuple[float, float]
    ) -> tuple:
        view = self.view
        eye, directions, scale = pixel_rays(view.intrinsics(), pose, view.width, view.height, shift)
        hits = caster.cast(np.broadcast_to(eye, directions.shape), directions)
        hit = hits.triangle >= 0
        corners, weights = self._faces[hits.triangle[hit]], hits.weights[hit][..., None]
        label = np.full(len(directions), BACKGROUND)
        label[hit] = self._label[hits.triangle[hit]]
        rgb = np.full((len(directions), 3), _HORIZON)
        position = eye + directions[hit] * hits.distance[hit, None]
        normal = (normals[corners] * weights).sum(axis=1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        towards = -(normal * directions[hit]).sum(axis=1)
        lamp = np.clip(normal @ self._lamp, 0, 1)
        lamp[caster.blocked(position + 1.5e-3 * normal, self._lamp)] *= self._look.shade
        painted = (self._paint[corners] * weights).sum(axis=1)
        rgb[hit] = _paint(painted, label[hit], self._look) * (self._look.ambient + self._look.diffuse * lamp)[:, None]
        slope = np.zeros(len(directions))
        slope[hit] = np.degrees(np.arccos(np.clip(towards, 0, 1)))
        depth = np.where(hit, np.where(hit, hits.distance, 0) / scale, 0)
        return np.clip(rgb, 0, 1) ** texture.GAMMA, depth, label, slope


def quantise(rgb: Float[Array, "H W 3"]) -> UInt8[Array, "H W 3"]:
    """0-1 to 0-255."""
    return np.clip(np.round(rgb * 255), 0, 255).astype(np.uint8)


def _paint(points: Array, label: Array, look: Look) -> Array:
    colour = np.empty_like(points)
    names = {OBJECT: look.body, HAND: look.hand, TABLE: look.table, FURTHER_HAND: look.hand}
    for value, name in names.items():
        colour[label == value] = texture.paint(name, points[label == value], look.seed)
    return colour


def _vertex_normals(points: Array, faces: Array) -> Array:
    a, b, c = (points[faces[:, k]] for k in range(3))
    normals = np.zeros_like(points)
    for k in range(3):
        np.add.at(normals, faces[:, k], np.cross(b - a, c - a))
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-18)
