"""Middle surfaces, centre lines and remeshing against shapes whose middle is known."""

import numpy as np
import pytest

from physreal_core.errors import InputError
from physreal_core.geometry import (
    centre_line,
    farthest_points,
    load_centre_line,
    middle_surface,
    patch_weights,
    remesh,
    resampled,
    ways_of,
)
from physreal_core.geometry.mesh import Mesh
from physreal_core.geometry.remeshing import rims_of
from physreal_core.geometry.ways import distances_along
from physreal_core.simulation import shell_body
from tests.geometry.scenes import blob, ellipsoid
from tests.geometry.skins import flat_skin, rolled, skin_of_sheet, tube
from tests.simulation.thin.scenes import sheet

HELIX = np.stack([[0.05 * np.cos(s), 0.05 * np.sin(s), 0.005 * s] for s in np.linspace(0, 3 * np.pi, 300)])


def triangle_angles(x: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """[M, 3] degrees."""
    a, b, c = x[triangles].transpose(1, 0, 2)
    sides = [(b - a, c - a), (c - b, a - b), (a - c, b - c)]
    cosine = [(u * v).sum(1) / np.linalg.norm(u, axis=1) / np.linalg.norm(v, axis=1) for u, v in sides]
    return np.degrees(np.arccos(np.clip(np.stack(cosine, 1), -1, 1)))


class TestMiddleSurface:
    def test_of_a_flat_skin(self):
        pytest.importorskip("open3d")
        vertices, triangles, thickness = middle_surface(flat_skin((0.26, 0.2), 0.0015))
        assert thickness == pytest.approx(0.0015, rel=1e-6)
        assert np.abs(vertices[:, 2]).max() < 1e-8
        assert Mesh(vertices, triangles).area == pytest.approx(0.26 * 0.2)

    def test_of_a_rolled_skin(self):
        """Within the sagitta of the skin's edges, 4 mm on 31 mm."""
        pytest.importorskip("open3d")
        upper, triangles = rolled(0.03, (0.16, 0.1), (40, 12), 0.001)
        lower, _ = rolled(0.03, (0.16, 0.1), (40, 12), -0.001)
        vertices, _, thickness = middle_surface(skin_of_sheet(upper, lower, triangles))
        radius = np.hypot(vertices[:, 0], vertices[:, 2] - 0.03)
        assert np.abs(radius - 0.03).max() < 1e-4
        assert thickness == pytest.approx(0.002, rel=0.01)

    def test_what_is_no_sheet_is_refused(self):
        pytest.importorskip("open3d")
        with pytest.raises(InputError, match="which is not thin.*volumetric"):
            middle_surface(blob())
        with pytest.raises(InputError, match="one side all around"):
            middle_surface(tube(HELIX, 0.005))


class TestCentreLine:
    def test_of_a_helix(self):
        """Within the middle of slices that are a radius thick: a fifth of the radius, and half a percent of the length."""
        line, radius = centre_line(tube(HELIX, 0.005, 24))
        distance = np.linalg.norm(line[:, None] - HELIX[None], axis=2)
        assert distance.min(axis=1).max() < 1e-3 and distance.min(axis=0).max() < 1e-3
        length = np.linalg.norm(np.diff(HELIX, axis=0), axis=1).sum()
        assert np.linalg.norm(np.diff(line, axis=0), axis=1).sum() == pytest.approx(length, rel=5e-3)
        assert radius == pytest.approx(0.005, rel=0.02)  # of a polygon of 24 sides: 0.994

    def test_resampled_evenly_from_end_to_end(self):
        line, _ = centre_line(tube(HELIX, 0.005, 24))
        vertices = resampled(line, 0.008)
        step = np.linalg.norm(np.diff(vertices, axis=0), axis=1)
        assert (vertices[[0, -1]] == line[[0, -1]]).all()
        assert step == pytest.approx(np.full(len(step), step.mean()), rel=0.01) and step.mean() == pytest.approx(
            0.008, rel=0.02
        )

    def test_what_is_no_rope_is_refused(self):
        with pytest.raises(InputError, match="which is not slender.*volumetric"):
            centre_line(ellipsoid())
        with pytest.raises(InputError, match="a slice across it is"):
            centre_line(flat_skin((0.26, 0.2), 0.004, (20, 16)))
        around = np.linspace(0, 2 * np.pi * 0.999, 100)
        ring = np.stack([0.05 * np.cos(around), 0.05 * np.sin(around), 0 * around], 1)
        with pytest.raises(InputError, match="with two ends"):
            centre_line(tube(ring, 0.005))

    def test_a_given_line_is_read_in_order(self, tmp_path):
        head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\n"
        head += "element edge 3\nproperty int vertex1\nproperty int vertex2\nend_header\n"
        points = "0 0 0\n2 0 0\n1 0 0\n3 0 0\n"
        (tmp_path / "line.ply").write_text(head + points + "0 2\n1 2\n1 3\n")
        assert load_centre_line(tmp_path / "line.ply")[:, 0].tolist() == [0, 1, 2, 3]
        (tmp_path / "fork.ply").write_text(head + points + "0 1\n0 2\n0 3\n")
        with pytest.raises(InputError, match="branch, close or leave vertices out"):
            load_centre_line(tmp_path / "fork.ply")


class TestRemeshing:
    @pytest.mark.parametrize("spacing", [0.008, 0.013])
    def test_of_a_rectangle_keeps_rim_and_area(self, spacing):
        corners = np.array([[0, 0, 0], [0.16, 0, 0], [0.16, 0.1, 0], [0, 0.1, 0]], float)
        x, triangles = remesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), spacing)
        assert Mesh(x, triangles).area == pytest.approx(0.16 * 0.1, rel=1e-9)
        assert np.linalg.norm(x[:, None] - corners[None], axis=2).min(axis=0).max() < 1e-12
        body = shell_body(x, triangles, 0.001, 300.0)
        assert body.spacing == pytest.approx(spacing, rel=0.1)
        assert triangle_angles(x, triangles).min() > 25.0

    def test_of_a_rolled_sheet_lies_on_it(self):
        fine, triangles = rolled(0.03, (0.16, 0.1), (64, 40))
        x, cells = remesh(fine, triangles, 0.01)
        assert np.abs(np.hypot(x[:, 0], x[:, 2] - 0.03) - 0.03).max() < 3e-4  # an edge's sagitta is 4e-4
        assert triangle_angles(x, cells).min() > 25.0
        assert len(rims_of(cells)) == 1

    def test_layers_a_millimetre_apart_are_not_joined(self):
        """A sheet folded over: its two halves meet at the fold alone."""
        radius = 0.001
        fine, triangles = sheet((80, 16), (0.16, 0.03))
        s = fine[:, 0] - 0.08
        bend = np.clip(s, -radius * np.pi / 2, radius * np.pi / 2) / radius
        straight = np.sign(s) * np.maximum(np.abs(s) - radius * np.pi / 2, 0.0)
        folded = np.stack([radius * np.cos(bend) - np.abs(straight), fine[:, 1], radius * np.sin(bend)], 1)
        x, cells = remesh(folded, triangles, 0.006)
        shell_body(x, cells, 0.0005, 300.0)
        ways = ways_of(cells)
        far = np.argmin(x[:, 0] + np.where(x[:, 2] > 0, 0.0, 1.0))
        other = np.argmin(x[:, 0] + np.where(x[:, 2] < 0, 0.0, 1.0))
        assert distances_along(x, ways, np.array([far]))[other, 0] > 0.14
        patches = farthest_points(x, 3, ways=ways)
        assert x[patches[0], 0] > -0.002 and (x[patches[1:], 0] < -0.07).all()
        assert sorted(np.sign(x[patches[1:], 2])) == [-1, 1], "one at the far end of either layer"
        _, weights = patch_weights(x, patches, 1, ways)
        assert weights == pytest.approx(np.ones((len(x), 1)))

    def test_sheets_that_meet_in_an_edge_are_refused(self):
        x, triangles = sheet((4, 4), (0.1, 0.1))
        up = x[:, [2, 1, 0]] + [0.05, 0.0, 0.0]
        joined, number = np.unique(np.concatenate([x, up]).round(9), axis=0, return_inverse=True)
        both = number.ravel()[np.concatenate([triangles, triangles + len(x)])]
        with pytest.raises(InputError, match="at most two triangles at an edge"):
            remesh(joined, both, 0.02)


def test_ways_across_a_surface_are_hardly_too_long():
    """Without the ways over edges a way against the grain of equal-sided triangles would be 15 % too long."""
    x, triangles = remesh(*sheet((4, 3), (0.2, 0.15)), 0.01)
    found = distances_along(x, ways_of(triangles), np.array([0]))[:, 0]
    straight = np.linalg.norm(x - x[0], axis=1)
    far = straight > 0.05
    assert (found[far] >= straight[far] - 1e-12).all() and (found / np.maximum(straight, 1e-9))[far].max() < 1.06
