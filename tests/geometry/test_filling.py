"""Meshes and their filling against closed forms."""

import numpy as np
import pytest

from physreal_core.errors import InputError
from physreal_core.geometry.filling import fill_mesh, fill_pieces
from physreal_core.geometry.mesh import Mesh, close_mesh, load_mesh, require_closed, save_mesh

trimesh = pytest.importorskip("trimesh")


def from_trimesh(body) -> Mesh:
    return Mesh(np.array(body.vertices, float), np.array(body.faces))


def ellipsoid(a=0.08, b=0.05, c=0.03) -> Mesh:
    body = trimesh.creation.icosphere(subdivisions=4)
    return Mesh(np.array(body.vertices) * [a, b, c], np.array(body.faces))


def test_volume_and_centroid_of_a_moved_ellipsoid():
    T = np.eye(4)
    T[:3, :3] = 2 * trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])[:3, :3]
    T[:3, 3] = 0.3, -0.2, 0.5
    mesh = ellipsoid().transformed(T)
    assert mesh.volume == pytest.approx(8 * 4 / 3 * np.pi * 0.08 * 0.05 * 0.03, rel=0.01)  # 2562 vertices inscribed
    np.testing.assert_allclose(mesh.centroid, [0.3, -0.2, 0.5], atol=1e-9)


@pytest.mark.parametrize("spacing", [0.004, 0.008])
def test_filling_keeps_volume_centre_and_second_moment(spacing):
    mesh = ellipsoid()
    x, volume = fill_mesh(mesh, spacing)
    assert volume.sum() == pytest.approx(mesh.volume, rel=1e-12)
    np.testing.assert_allclose((volume[:, None] * x).sum(0) / volume.sum(), 0, atol=0.01 * spacing)
    second = (volume[:, None] * x**2).sum(0) / volume.sum()
    # A point per cell lacks the cell's own h^2/12.
    np.testing.assert_allclose(second + spacing**2 / 12, np.array([0.08, 0.05, 0.03]) ** 2 / 5, rtol=0.02)


def test_box_of_whole_cells_is_the_lattice():
    x, volume = fill_mesh(from_trimesh(trimesh.creation.box([0.4, 0.2, 0.1])), 0.05)
    assert len(x) == 8 * 4 * 2
    np.testing.assert_allclose(volume, 0.05**3, rtol=1e-6)
    np.testing.assert_allclose(np.unique(x[:, 2].round(9)), [-0.025, 0.025])
    np.testing.assert_allclose(np.unique(x[:, 0].round(5)), np.arange(-0.175, 0.2, 0.05), atol=1e-5)


def test_limb_thinner_than_the_spacing_is_kept():
    body = trimesh.creation.box([0.1, 0.02, 0.02])
    limb = trimesh.creation.box([0.1, 0.004, 0.004]).apply_translation([0.0999, 0.0013, 0.0007])
    mesh = from_trimesh(trimesh.boolean.union([body, limb], engine="manifold"))
    x, volume = fill_mesh(mesh, 0.01)
    tip = x[:, 0] > 0.055
    assert x[:, 0].max() > 0.14
    assert volume[tip].sum() == pytest.approx((0.1499 - 0.055) * 0.004**2, rel=0.2)  # 1.25 mm columns, 4 mm limb


def test_overlapping_bodies_fill_once():
    a, b = trimesh.creation.box([0.1] * 3), trimesh.creation.box([0.1] * 3).apply_translation([0.05, 0.001, 0.002])
    x, _ = fill_mesh(from_trimesh(trimesh.util.concatenate([a, b])), 0.01)
    from scipy.spatial.distance import pdist

    assert pdist(x).min() > 0.004


def test_open_mesh_is_an_error_and_closing_it_must_be_asked_for():
    mesh = ellipsoid()
    opened = Mesh(mesh.vertices, mesh.faces[:-30])
    with pytest.raises(InputError, match="mesh is not closed: [0-9]+ open edges"):
        require_closed(opened)
    with pytest.raises(InputError, match="not closed"):
        fill_mesh(opened, 0.01)
    closed = close_mesh(opened)
    assert closed.open_edges() == 0
    assert closed.volume == pytest.approx(mesh.volume, rel=0.01)


@pytest.mark.parametrize("ending", ["glb", "stl", "obj", "ply"])
def test_mesh_files_keep_the_shape(tmp_path, ending):
    mesh = ellipsoid()
    save_mesh(tmp_path / f"m.{ending}", mesh)
    back = load_mesh(tmp_path / f"m.{ending}")
    assert back.open_edges() == 0
    assert back.volume == pytest.approx(mesh.volume, rel=1e-5)  # float32 on disk


def test_glb_keeps_vertex_colours_and_turned_faces_are_turned_back(tmp_path):
    mesh = ellipsoid()
    colours = np.random.default_rng(0).integers(0, 255, mesh.vertices.shape) / 255
    save_mesh(tmp_path / "m.glb", Mesh(mesh.vertices, mesh.faces[:, ::-1], colours))
    back = load_mesh(tmp_path / "m.glb")
    assert back.volume > 0
    order = [np.lexsort(np.round(v, 6).T) for v in (mesh.vertices, back.vertices)]
    np.testing.assert_allclose(back.colours[order[1]], colours[order[0]], atol=1e-6)


def test_files_that_are_no_mesh(tmp_path):
    (tmp_path / "m.glb").write_bytes(b"nothing of the kind")
    for name in ("m.glb", "missing.stl"):
        with pytest.raises(InputError, match=name):
            load_mesh(tmp_path / name)


# --- pieces -----------------------------------------------------------------------------------------------------


def boxes(*parts: tuple) -> Mesh:
    """Boxes of sizes at centres [m], as one mesh."""
    return from_trimesh(
        trimesh.util.concatenate([trimesh.creation.box(size).apply_translation(at) for size, at in parts])
    )


@pytest.mark.parametrize("gap", [0.004, 0.008, 0.016])
def test_slabs_with_air_between_are_two_pieces(gap):
    """However the lattice lies to the gap, no particle belongs to both: volumes and heights of each are its own."""
    size = (0.08, 0.06, 0.021)
    x, volume, pieces = fill_pieces(boxes((size, (0, 0, 0)), (size, (0, 0, 0.021 + gap))), 0.008)
    assert pieces.max() == 1
    for piece in (0, 1):
        assert volume[pieces == piece].sum() == pytest.approx(np.prod(size), rel=1e-3)
        centre = np.average(x[pieces == piece], axis=0, weights=volume[pieces == piece])
        np.testing.assert_allclose(centre, [0, 0, piece * (0.021 + gap)], atol=1e-5)


def test_parts_that_touch_overlap_or_lie_in_one_another_are_one_piece():
    cube, small = (0.05,) * 3, (0.02,) * 3
    for other in (
        (cube, (0.0515, 0, 0)),
        (cube, (0.03, 0.01, 0.01)),
        (small, (0, 0, 0)),
        ((0.2, 0.01, 0.01), (0, 0, 0)),
    ):
        assert fill_pieces(boxes((cube, (0, 0, 0)), other), 0.008)[2].max() == 0, other
    outer, inner = trimesh.creation.box([0.06] * 3), trimesh.creation.box([0.03] * 3)
    inner.invert()  # a cavity
    _, volume, pieces = fill_pieces(from_trimesh(trimesh.util.concatenate([outer, inner])), 0.006)
    assert pieces.max() == 0
    assert volume.sum() == pytest.approx(0.06**3 - 0.03**3, rel=1e-6)


def test_a_sheet_that_the_spacing_cannot_carry_is_refused():
    from physreal_core.simulation.pieces import require_thickness

    turn = trimesh.transformations.rotation_matrix(0.4, [1, 2, 0.5])
    for T in (np.eye(4), turn):
        sheet = from_trimesh(trimesh.creation.box([0.2, 0.15, 0.003]).apply_transform(T))
        x, volume = fill_mesh(sheet, 0.008)
        with pytest.raises(InputError, match="one particle thick"):
            require_thickness(x, volume, 0.008, "sample_particles.spacing")
        x, volume = fill_mesh(sheet, 0.0014)
        assert require_thickness(x, volume, 0.0014, "sample_particles.spacing") < 0.05
