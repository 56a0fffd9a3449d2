"""Triangle meshes: closedness, volume, similarity transforms, reading and writing (.glb, .stl, .obj, .ply)."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from physreal_core.array_types import Array, Float, Int
from physreal_core.errors import InputError

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True)
class Mesh:
    """Triangles, oriented so that normals point out of a closed body.

    Attributes:
        vertices: [m], or in the unit of a shape prior, shape [V, 3].
        faces: vertex indices, anticlockwise seen from outside, shape [F, 3].
        colours: RGB in 0..1 per vertex, shape [V, 3], or None.
    """

    vertices: Float[Array, "V 3"]
    faces: Int[Array, "F 3"]
    colours: Float[Array, "V 3"] | None = None

    @property
    def corners(self) -> Float[Array, "F 3 3"]:
        """Positions of each face's three corners."""
        return self.vertices[self.faces]

    @property
    def area_vectors(self) -> Float[Array, "F 3"]:
        """Outward normal of each face times its area [m2]."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        return 0.5 * np.cross(b - a, c - a)

    @property
    def area(self) -> float:
        """Area of all faces [m2]."""
        return float(np.linalg.norm(self.area_vectors, axis=1).sum())

    @property
    def volume(self) -> float:
        """Enclosed volume [m3] by the divergence theorem; means something for closed meshes only."""
        return float(np.einsum("fi,fi->", self.corners.mean(axis=1), self.area_vectors) / 3)

    @property
    def centroid(self) -> Float[Array, "3"]:
        """Centre of the enclosed volume [m], shape [3]."""
        origin = self.vertices.mean(axis=0)
        corners = self.corners - origin
        tetrahedra = np.linalg.det(corners) / 6
        return origin + (tetrahedra[:, None] * corners.sum(axis=1) / 4).sum(axis=0) / tetrahedra.sum()

    @property
    def bounds(self) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Lower and upper corner of the axis-aligned box [m]."""
        return self.vertices.min(axis=0), self.vertices.max(axis=0)

    def transformed(self, T: Float[Array, "4 4"]) -> "Mesh":
        """The mesh under an affine map, shape [4, 4]; a map that mirrors also turns the faces around."""
        vertices = self.vertices @ T[:3, :3].T + T[:3, 3]
        faces = self.faces if np.linalg.det(T[:3, :3]) > 0 else self.faces[:, ::-1]
        return replace(self, vertices=vertices, faces=faces)

    def open_edges(self) -> int:
        """How many edges lack a neighbouring face that runs along them the other way; 0 for a closed mesh."""
        edges = self.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        direction = np.where(edges[:, 0] < edges[:, 1], 1, -1)
        _, edge = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True)
        return int(np.count_nonzero(np.bincount(edge.ravel(), weights=direction)))


def require_closed(mesh: Mesh, *, where: str = "", remedy: str = "close it, or ask for a repair") -> Mesh:
    """The mesh itself if it encloses a volume.

    Raises:
        InputError: it has open edges, or no volume.
    """
    if count := mesh.open_edges():
        raise InputError(f"mesh is not closed: {count} open edges", where=where, expected="0", remedy=remedy)
    if mesh.volume <= 0:
        raise InputError(
            f"mesh encloses no volume ({mesh.volume:.3g})", where=where, remedy="turn its normals outwards"
        )
    return mesh


def close_mesh(mesh: Mesh) -> Mesh:
    """Caps every hole with a fan about the centroid of its rim; a guess at what is missing, so the user must ask for it.

    A mesh whose edges have three or more faces stays open: `require_closed` says so afterwards.
    """
    vertices, caps = list(mesh.vertices), []
    for rim in _rims(mesh.faces):
        caps += [(b, a, len(vertices)) for a, b in zip(rim, np.roll(rim, -1), strict=True)]
        vertices.append(mesh.vertices[rim].mean(axis=0))
    faces = np.concatenate([mesh.faces, np.array(caps, int).reshape(-1, 3)])
    colours = mesh.colours
    if colours is not None:
        colours = np.concatenate([colours, [colours[rim].mean(axis=0) for rim in _rims(mesh.faces)]])
    return oriented(np.array(vertices), faces, colours)


def _rims(faces: Array) -> list[Array]:
    """Loops of open edges, in the direction in which the faces beside them run."""
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    there = {tuple(edge) for edge in edges.tolist()}
    follow: dict[int, list[int]] = {}
    for a, b in sorted(there):
        if (b, a) not in there:
            follow.setdefault(a, []).append(b)
    rims = []
    for start in list(follow):
        while follow[start]:  # as many open edges enter a vertex as leave it, so every walk comes back
            rim = [start]
            while follow.get(rim[-1]):
                rim.append(follow[rim[-1]].pop())
                if rim[-1] == start:
                    break
            rims.append(np.array(rim[:-1]))
    return rims


def load_mesh(path: str | Path) -> Mesh:
    """Reads a mesh file as one mesh: scene transforms applied, duplicate vertices merged, normals outwards.

    Vertex colours are kept; a texture is turned into vertex colours.

    Raises:
        InputError: the file is missing, is no mesh, or has no faces.
    """
    loaded = read_trimesh(Path(path))
    colours = _vertex_colours(loaded)
    vertices, index, inverse = np.unique(
        np.asarray(loaded.vertices, float), axis=0, return_index=True, return_inverse=True
    )
    faces = inverse.ravel()[np.asarray(loaded.faces)]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    return oriented(vertices, faces, None if colours is None else colours[index])


def read_trimesh(path: Path, *, merge: bool = False) -> "trimesh.Trimesh":
    """A mesh file as one of trimesh, with its colours or its texture; no other file that it names is opened.

    Args:
        path: the file.
        merge: make one vertex of those that lie at the same place.

    Raises:
        InputError: as of `load_mesh`; a vertex is not finite or a face names none.
    """
    import trimesh
    from PIL import EpsImagePlugin

    expected, remedy = "a .glb, .stl, .obj or .ply mesh", "export the mesh again"
    if not path.is_file():
        raise InputError("file is missing", where=str(path), expected=expected)
    EpsImagePlugin.gs_binary = False  # a texture may be an image of any kind: none of them starts Ghostscript
    try:
        no_other_files = trimesh.resolvers.ZipResolver({})
        loaded = trimesh.load(path, process=merge, resolver=no_other_files)
        if isinstance(loaded, trimesh.Scene):
            loaded = loaded.to_mesh()
    except Exception as error:  # trimesh raises whatever its parsers raise
        what = f"no mesh can be read from it ({error})"
        raise InputError(what, where=str(path), expected=expected, remedy=remedy) from error
    if not isinstance(loaded, trimesh.Trimesh) or len(loaded.faces) == 0:
        raise InputError("file holds no triangles", where=str(path), expected=expected, remedy=remedy)
    faces = np.asarray(loaded.faces)
    if not np.isfinite(loaded.vertices).all() or faces.min() < 0 or faces.max() >= len(loaded.vertices):
        what = "a vertex is not finite, or a face names a vertex that is not there"
        raise InputError(what, where=str(path), expected=expected, remedy=remedy)
    return loaded


def save_mesh(path: str | Path, mesh: Mesh) -> None:
    """Writes a mesh in the format of the file's ending; coordinates as they are (z up, also in a .glb)."""
    import trimesh

    colours = None if mesh.colours is None else (np.clip(mesh.colours, 0, 1) * 255).round().astype(np.uint8)
    trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_colors=colours, process=False).export(Path(path))


def _vertex_colours(loaded) -> Array | None:
    visual = loaded.visual
    if visual.kind == "texture":
        visual = visual.to_color()
    if visual.kind is None:
        return None
    return np.asarray(visual.vertex_colors, float)[:, :3] / 255


def oriented(vertices: Array, faces: Array, colours: Array | None) -> Mesh:
    """Faces turned so that neighbours agree and the enclosed volume is positive."""
    mesh = Mesh(vertices, np.asarray(faces, np.int64), colours)
    if mesh.open_edges():
        import trimesh

        body = trimesh.Trimesh(vertices, mesh.faces, process=False)
        trimesh.repair.fix_winding(body)
        mesh = replace(mesh, faces=np.asarray(body.faces, np.int64))
    return mesh if mesh.volume >= 0 else replace(mesh, faces=mesh.faces[:, ::-1])
