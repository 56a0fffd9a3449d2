"""Places far from the baseline from which fits of some effects begin."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from physreal_core.effects import EFFECTS
from physreal_core.effects.effect import Setting
from physreal_core.effects.shape import axes, middle, underside
from physreal_core.simulation import Body
from tests.simulation.scenes import block


def _tilted(slope_x: float, slope_y: float, height: float) -> Body:
    """A flat block whose lower face lies in the plane with these slopes, `height` [m] high below its middle."""
    body = block((12, 6, 3), spacing=0.01)
    normal = np.array([-slope_x, -slope_y, 1.0]) / np.linalg.norm([-slope_x, -slope_y, 1.0])
    turn, _ = Rotation.align_vectors([normal], [[0.0, 0.0, 1.0]])
    points = turn.apply(body.x0 - body.x0.mean(0))
    lowest = points @ normal
    foot = (lowest.min() - 0.005) / normal[2]  # where the vertical through the middle meets the lower face
    return Body(points + [0.0, 0.0, height - foot], body.volume, body.density, body.spacing)


def _setting(body: Body, ground: float | None) -> Setting:
    return Setting(body, None, (), 30.0, (0.0, 0.0, -9.81), ground, torch.zeros(2, 0, 3))


@pytest.mark.parametrize(("slope_x", "slope_y", "height"), [(0.0, 0.0, 0.0), (0.06, -0.02, 0.004), (-0.3, 0.1, -0.01)])
def test_underside_is_the_plane_on_which_a_block_lies(slope_x, slope_y, height):
    """To what half a spacing counts less along the normal than straight down: its 1 - cos."""
    found = underside(_tilted(slope_x, slope_y, height))
    assert found[1:] == pytest.approx((slope_x, slope_y), abs=1e-6)
    steep = np.hypot(1.0, np.hypot(slope_x, slope_y))
    assert found[0] == pytest.approx(height, abs=0.005 * (steep - 1.0) + 1e-9)


def test_a_body_with_feet_rests_on_them():
    """Two rows of feet under a plate: the plane of the feet, not the plate's face, although most of it is that."""
    body = block((12, 6, 5), spacing=0.01)
    columns = np.round(body.x0[:, 0] / 0.01 - 0.5).astype(int)
    kept = (body.x0[:, 2] > 0.03) | np.isin(columns, (0, 11))
    assert underside(Body(body.x0[kept], body.volume[kept], body.density[kept], 0.01)) == pytest.approx(
        (0, 0, 0), abs=1e-9
    )


def test_the_ground_is_looked_for_where_the_body_lies_unless_that_is_as_assumed():
    ground = EFFECTS["ground_plane"]
    assert ground.large_starts(_setting(_tilted(0.0, 0.0, 0.0), 0.0)) == ()
    assert ground.large_starts(_setting(_tilted(0.1, 0.0, 0.0), None)) == ()
    (start,) = ground.large_starts(_setting(_tilted(0.06, -0.02, 0.104), 0.1))
    assert start == pytest.approx({"height": 0.004, "slope_x": 0.06, "slope_y": -0.02}, abs=1e-4)


def test_a_sheet_of_particles_says_nothing_of_the_ground():
    sheet = block((12, 6, 1), spacing=0.01)
    assert underside(sheet) is None
    assert EFFECTS["ground_plane"].large_starts(_setting(sheet, 0.0)) == ()


def test_a_gradient_of_density_begins_with_either_end_the_heavier():
    body = _tilted(0.1, 0.0, 0.0)
    first, second = EFFECTS["density_gradient"].large_starts(_setting(body, 0.0))
    along = np.array([first[axis] for axis in "xyz"])
    assert np.cross(along, axes(body)[0]) == pytest.approx(0.0, abs=1e-9) and np.linalg.norm(along) > 0
    assert [second[axis] for axis in "xyz"] == pytest.approx(-along)
    assert middle(body)[2] > 0
