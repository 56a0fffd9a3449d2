"""The surface in the middle of a thin body, and its thickness, from the closed skin around it.

A face of the skin belongs to a side where a ray into the body soon meets a face that looks the other way. Sides end at the rim, where that is
not so, and where the skin turns sharply. The middle surface is the larger side, moved by half of the way to the other.
"""

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from physreal_core.array_types import Array, Bool, Float, Int
from physreal_core.errors import InputError
from physreal_core.geometry.mesh import Mesh
from physreal_core.geometry.ways import edges_of

THIN = 0.15
"""Largest thickness of a sheet over the root of its area: that of a plate 7 times as wide as thick."""
FACING = -0.7
"""Cosine between the normals of two faces, below which they look to opposite sides."""
SOON = 3.0
"""Thicknesses within which a ray meets the other side."""
SHARP = 0.5
"""Cosine between neighbours, below which a side ends between them."""
LEAST = 0.75
"""Share of half of the skin that one side has at least."""
STEP = 1e-3
"""Of the thickness, by which a ray starts below the skin."""
_EXPECTED, _REMEDY = (
    "the closed skin of a sheet, which has two sides with the same thin gap between them everywhere",
    "set `geometry` of the sequence to what the object is, mend the mesh, or give its middle surface as an open mesh",
)


def middle_surface(mesh: Mesh) -> tuple[Float[Array, "vertices 3"], Int[Array, "triangles 3"], float]:
    """Vertices and triangles of the middle surface [m], and the thickness with which it has the skin's volume [m].

    Args:
        mesh: the closed skin of a sheet [m].

    Raises:
        InputError: the mesh is not thin, or not like a sheet.
    """
    thickness = 2.0 * mesh.volume / mesh.area
    width = np.sqrt(mesh.area / 2.0)
    if thickness > THIN * width:
        raise InputError(
            f"it is {1e3 * thickness:.3g} mm thick and {1e3 * width:.3g} mm wide, which is not thin",
            where="the middle surface",
            expected=f"at most {THIN:g} times as thick as wide",
            remedy="set `geometry: volumetric`",
        )
    normals = mesh.area_vectors / np.maximum(np.linalg.norm(mesh.area_vectors, axis=1, keepdims=True), 1e-30)
    way, met = _ways_through(mesh, normals, STEP * thickness)
    sided = (met >= 0) & (way < SOON * thickness)
    sided[sided] = (normals[sided] * normals[met[sided]]).sum(1) < FACING
    side = _largest_side(mesh, normals, sided)
    if np.isin(met[side], np.flatnonzero(side)).mean() > 0.5:
        raise InputError(
            "the skin has one side all around", where="the middle surface", expected=_EXPECTED, remedy=_REMEDY
        )
    vertices, triangles = _moved(mesh, side, way)
    return vertices, triangles, mesh.volume / Mesh(vertices, triangles).area


def _ways_through(mesh: Mesh, normals: Array, step: float) -> tuple[Float[Array, " faces"], Int[Array, " faces"]]:
    """From the middle of each face into the body: how far it is to the next face [m], and which that is (-1: none)."""
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    centre = mesh.vertices.mean(axis=0)
    scene.add_triangles(
        o3d.core.Tensor((mesh.vertices - centre).astype(np.float32)), o3d.core.Tensor(mesh.faces.astype(np.uint32))
    )
    start = mesh.corners.mean(axis=1) - centre - step * normals
    hits = scene.cast_rays(o3d.core.Tensor(np.concatenate([start, -normals], axis=1).astype(np.float32)))
    way, met = hits["t_hit"].numpy().astype(float), hits["primitive_ids"].numpy().astype(np.int64)
    return way + step, np.where(np.isfinite(way), met, -1)


def _largest_side(mesh: Mesh, normals: Array, sided: Array) -> Bool[Array, " faces"]:
    """Faces of the largest part of the skin that hangs together without rim and sharp edges."""
    _, number = edges_of(mesh.faces)
    order = np.argsort(number, axis=None, kind="stable")
    shared = np.flatnonzero(np.diff(number.ravel()[order]) == 0)
    one, two = order[shared] // 3, order[shared + 1] // 3
    joined = sided[one] & sided[two] & ((normals[one] * normals[two]).sum(1) > SHARP)
    count = len(mesh.faces)
    graph = csr_matrix((np.ones(joined.sum()), (one[joined], two[joined])), shape=(count, count))
    _, part = connected_components(graph, directed=False)
    areas = np.bincount(part, np.linalg.norm(mesh.area_vectors, axis=1) * sided)
    if areas.max() < LEAST * mesh.area / 2.0:
        raise InputError(
            f"its largest side is {200 * areas.max() / mesh.area:.0f} % of half of the skin",
            where="the middle surface",
            expected=_EXPECTED,
            remedy=_REMEDY,
        )
    return sided & (part == areas.argmax())


def _moved(mesh: Mesh, side: Array, way: Array) -> tuple[Array, Array]:
    """The side, each of its vertices moved by half of the mean way of the faces around it."""
    used, triangles = np.unique(mesh.faces[side], return_inverse=True)
    triangles = triangles.reshape(-1, 3)
    area = np.linalg.norm(mesh.area_vectors[side], axis=1)
    inward, total, half = np.zeros((len(used), 3)), np.zeros(len(used)), np.zeros(len(used))
    for k in range(3):
        np.add.at(inward, triangles[:, k], -mesh.area_vectors[side])
        np.add.at(half, triangles[:, k], area * way[side] / 2.0)
        np.add.at(total, triangles[:, k], area)
    inward /= np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), 1e-30)
    return mesh.vertices[used] + (half / total)[:, None] * inward, triangles
