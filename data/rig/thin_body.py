"""What the rig's world needs to know of a thin body beside its nodes: MuJoCo's elements, and where the hold ends."""

from collections.abc import Callable

import numpy as np

from data.rig.rope import Line, Rope
from data.rig.thin import Cloth, Sheet
from physreal_core.array_types import Array, Bool, Float, Int

ThinBody = Cloth | Rope
MiddleMesh = Sheet | Line

_HINGE, _TWIST = 4, 8  # places of the two stiffnesses in a record of MuJoCo's rod
_FIRST, _RECORD = 1, 10  # of `flex_bending` of a rod: where its records begin, and how long one is
_HINGES = (9 / 8) / (105 / 128)  # means of cos^4 and of cos^8 over three hinges: `stiffen_along`
_FRAME = 6  # numbers of a segment's frame in `mjData.plastic`: tangent, then a unit vector across


def ends_at_nodes(body: object) -> bool:
    """Whether the hold of a body shall end at its nodes."""
    return isinstance(body, Rope) or (isinstance(body, Cloth) and body.equilateral)


def edges(mesh: MiddleMesh, body: ThinBody) -> str:
    """XML of the springs along a rope's segments; MuJoCo's rod has no stretching of its own. Nothing for a cloth."""
    return f'<edge stiffness="{body.stretching_stiffness / mesh.spacing:.9g}"/>' if isinstance(body, Rope) else ""


def held_twists(mesh: MiddleMesh, held: Int[Array, " B"], fast: str) -> str:
    """XML constraints, `fast` their attributes, that keep segments between held nodes of a rope from turning about themselves."""
    if not isinstance(mesh, Line):
        return ""
    inside = np.isin(mesh.elements, held).all(axis=1)
    return "".join(f'<joint joint1="{twist_joint(mesh, s)}" {fast}/>' for s in np.flatnonzero(inside))


def twist_joint(mesh: Line, segment: int) -> str:
    """The name of the hinge that turns a segment about itself."""
    return "s_twist" if segment == len(mesh.elements) - 1 else f"s_twist_{segment}"


def end_hold_at_nodes(model, mesh: MiddleMesh, held: Int[Array, " B"]) -> None:
    """Doubles the stiffness of the hinges where the hold ends.

    A hinge stands for the bending of half an element on its either side. In the hold nothing bends, so there the hinge stands for
    the outer half alone. Without this the body is clamped half an element deeper in the hold.
    """
    fixed = np.zeros(len(mesh.vertices), bool)
    fixed[held] = True
    if isinstance(mesh, Line):
        records = model.flex_bending[_FIRST:].reshape(-1, _RECORD)
        nodes = records[:, :3].astype(int)
        records[np.ix_(fixed[nodes[:, 1]] & (fixed[nodes].sum(axis=1) == 2), (_HINGE, _TWIST))] *= 2
        return
    ends, sides = model.flex_edge, model.flex_edgeflap
    records = model.flex_bending.reshape(len(ends), -1)
    records[_on_border(fixed, ends, sides)] *= 2


def _on_border(fixed: Bool[Array, " V"], ends: Int[Array, "E 2"], sides: Int[Array, "E 2"]) -> Bool[Array, " E"]:
    """Edges that are held and have the hold on one side only."""
    return fixed[ends].all(axis=1) & (sides >= 0).all(axis=1) & (fixed[sides].sum(axis=1) == 1)


def scale_stiffness(model, mesh: MiddleMesh, share: Callable[[Float[Array, "P 3"]], Float[Array, " P"]]) -> None:
    """Multiplies stiffnesses by a share that depends on the place [m]: of a membrane in the middle of each triangle, of bending and
    twisting at each hinge. MuJoCo has one stiffness for the stretching of all of a rope, which stays."""
    rest = mesh.vertices
    if isinstance(mesh, Line):
        records = model.flex_bending[_FIRST:].reshape(-1, _RECORD)
        records[:, (_HINGE, _TWIST)] *= share(rest[records[:, 1].astype(int)])[:, None]
        return
    stiffness = model.flex_stiffness.reshape(len(mesh.elements), -1)
    stiffness[:] *= share(mesh.centres())[:, None]
    model.flex_bending.reshape(len(model.flex_edge), -1)[:] *= share(rest[model.flex_edge].mean(axis=1))[:, None]


def stiffen_along(model, mesh: Sheet, body: Cloth, along: Float[Array, "2"], ratio: float) -> None:
    """Adds fibres to a level cloth, with `ratio` of its modulus: in the membrane the energy k/2 (a . E a)^2 of Green's strain E exactly.

    A hinge with the normal n in the sheet sees the part (a . n)^4 of the fibres' bending, times that with which triangles of equal sides
    have the right bending along a in the mean over all directions a.

    Args:
        model: MuJoCo's.
        mesh, body: of the cloth.
        along: the part of the unit vector a in the sheet.
        ratio: of the fibres' modulus to the cloth's.
    """
    ends = model.flex_edge[model.flex_elemedge.reshape(-1, 3)]
    x, y = np.moveaxis(mesh.vertices[ends[..., 1]] - mesh.vertices[ends[..., 0]], -1, 0)[:2]
    to_strain = np.linalg.inv(2 * np.stack([x * x, y * y, x * y], axis=-1))  # from squared edge lengths
    row = np.einsum("i,mij->mj", [along[0] ** 2, along[1] ** 2, along[0] * along[1]], to_strain)
    size = 2 * ratio * body.membrane_stiffness * mesh.volumes() / mesh.thickness
    added = size[:, None, None] * row[:, :, None] * row[:, None, :]
    model.flex_stiffness.reshape(len(row), -1)[:, :6] += added[:, *np.triu_indices(3)]
    edge = (mesh.vertices[model.flex_edge[:, 1]] - mesh.vertices[model.flex_edge[:, 0]])[:, :2]
    seen = (edge[:, 1] * along[0] - edge[:, 0] * along[1]) / np.linalg.norm(edge, axis=1)
    gained = ratio * (1 - body.poissons_ratio**2) * _HINGES * seen**4
    model.flex_bending.reshape(len(edge), -1)[:] *= 1 + gained[:, None]


class Directors:
    """Unit vectors across the segments of a rope that turn with them, from `Line.directors` on.

    Args:
        model: MuJoCo's.
        mesh: the centre line.
    """

    def __init__(self, model, mesh: Line) -> None:
        import mujoco

        self._mesh, self._count = mesh, len(mesh.elements)
        joints = [model.joint(twist_joint(mesh, segment)) for segment in range(self._count)]
        self._twists = np.array([joint.qposadr[0] for joint in joints])
        scratch = mujoco.MjData(model)
        mujoco.mj_step(model, scratch)  # MuJoCo chooses its frames in the first step
        tangent, across = self._frames(scratch)
        wanted = mesh.directors()
        self._start = np.arctan2((wanted * np.cross(tangent, across)).sum(axis=1), (wanted * across).sum(axis=1))

    def __call__(self, data) -> Float[Array, "S 3"]:
        """At the beginning of the last step."""
        tangent, across = self._frames(data)
        if not across.any():  # no step has been taken
            return self._mesh.directors()
        angle = (self._start + data.qpos[self._twists])[:, None]
        return np.cos(angle) * across + np.sin(angle) * np.cross(tangent, across)

    def _frames(self, data) -> tuple[Float[Array, "S 3"], Float[Array, "S 3"]]:
        """Tangents, and MuJoCo's unit vectors across, which are carried along without twist."""
        frames = data.plastic[: _FRAME * self._count].reshape(self._count, 2, 3)
        return frames[:, 0], frames[:, 1]


def stable_step(body: ThinBody) -> float:
    """A stable explicit step [s]: a quarter of the time that the fastest of its waves takes from node to node.

    A stretching wave runs at sqrt(E A / m), in a sheet at sqrt(E t / (1 - nu^2) m); a bending wave of the shortest length makes
    4 sqrt(E I / m) / h^2 radians a second.
    """
    if isinstance(body, Rope):
        mass, bending = body.mass_per_length, body.bending_stiffness
        speed = np.sqrt(body.stretching_stiffness / mass)
    else:
        mass, bending = body.areal_density, body.bending_stiffness
        speed = np.sqrt(body.membrane_stiffness / (1 - body.poissons_ratio**2) / mass)
    return float(min(body.spacing / speed, body.spacing**2 / np.sqrt(bending / mass) / 2) / 4)
