"""Where an obstacle may lie, told by how the body moves, or by another one that was found."""

import numpy as np
import pytest
import torch

from physreal_core.effects import EFFECTS
from physreal_core.effects.contact.places import contacts, reach
from physreal_core.effects.effect import Setting
from physreal_core.simulation import Body, States

WALL = {"stiffness": 2e5, "azimuth": 0.3, "elevation": 0.1, "distance": 0.12}
TOWARDS = np.array([np.cos(0.1) * np.cos(0.3), np.cos(0.1) * np.sin(0.3), np.sin(0.1)])
KINDS = ("obstacle_sphere", "obstacle_post", "obstacle_plane")


@pytest.fixture
def setting() -> Setting:
    """A lattice of particles around the origin."""
    x0 = np.stack(np.meshgrid(*[np.linspace(-0.04, 0.04, 5)] * 3), -1).reshape(-1, 3)
    body = Body(x0, np.ones(len(x0)), np.ones(len(x0)), 0.02)
    return Setting(body, None, (), 30.0, (0.0, 0.0, -9.81), None, torch.zeros(4, 0, 3))


def motion(setting: Setting, depth: float) -> States:
    """The body goes towards the wall until its foremost particle is `depth` in it [m]."""
    reach = (setting.body.x0 @ TOWARDS).max()
    way = np.linspace(0, WALL["distance"] + depth - reach, 4)
    x = torch.from_numpy(setting.body.x0 + way[:, None, None] * TOWARDS)
    return States(x, torch.zeros_like(x), torch.eye(3).expand(*x.shape, 3))


def tensors(values: dict[str, float]) -> dict[str, torch.Tensor]:
    return {name: torch.tensor(value, dtype=torch.float64) for name, value in values.items()}


def distance(name: str, values: dict[str, float], place: np.ndarray, setting: Setting) -> float:
    """Of a place from the surface of an obstacle [m]."""
    capsule = EFFECTS[name].capsule(tensors(values), setting, torch.zeros(1, dtype=torch.float64))
    centre, half, radius = (part.numpy() for part in capsule)
    along = np.clip((place - centre) @ half / max(half @ half, 1e-12), -1, 1)
    return float(np.linalg.norm(place - centre - along * half) - radius)


def test_the_body_presses_where_its_matter_is_in_the_wall(setting):
    capsule = EFFECTS["obstacle_plane"].capsule(tensors(WALL), setting, torch.zeros(1, dtype=torch.float64))
    found = contacts(motion(setting, 0.004), capsule, beyond=0.001)
    assert found and contacts(motion(setting, -0.001), capsule, beyond=0.0) == []
    assert contacts(motion(setting, -0.001), capsule, beyond=0.002)
    for place, towards in found:
        assert WALL["distance"] < place @ TOWARDS < WALL["distance"] + 0.0051
        assert towards @ TOWARDS > 0.999
    assert max(place @ TOWARDS for place, _ in found) == pytest.approx(WALL["distance"] + 0.005, abs=1e-4)


@pytest.mark.parametrize("name", ["obstacle_sphere", "obstacle_post"])
def test_a_search_begins_where_the_body_comes_a_spacing_into_it_on_its_way(name, setting):
    moved, spacing = motion(setting, 0.1), setting.body.spacing
    starts = EFFECTS[name].starts(setting, moved)
    assert len(starts) > 2 and EFFECTS[name].starts(setting) == ()
    for start in starts:
        first, *later = (
            max(reach(setting) - distance(name, start, place, setting) for place in frame) for frame in moved.x.numpy()
        )
        assert first < -spacing / 2 and max(later) == pytest.approx(spacing, abs=spacing / 4)


@pytest.mark.parametrize("name", KINDS)
def test_others_may_lie_where_the_body_meets_the_wall(name, setting):
    """Each touches the place and lies behind it; as stiff as the wall, or as an obstacle plainly is."""
    wall, moved = EFFECTS["obstacle_plane"], motion(setting, 0.004)
    starts = EFFECTS[name].replacement_starts(setting, wall, WALL, moved)
    capsule = wall.capsule(tensors(WALL), setting, torch.zeros(1, dtype=torch.float64))
    places = [place for place, _ in contacts(moved, capsule, reach(setting))]
    assert len(starts) >= len(places)
    for start in starts:
        assert start["stiffness"] == 1e6
        touched = [abs(distance(name, start, place, setting)) for place in places]
        assert min(touched) < 1e-3 and max(distance(name, start, p, setting) for p in places) >= -1e-3
        assert distance(name, start, np.zeros(3), setting) > 0.05  # the body's middle is free at frame 0


@pytest.mark.parametrize("name", KINDS)
def test_a_search_begins_too_where_it_would_keep_the_body_off_as_it_was_seen(name, setting):
    """Seen, the body stops at the wall; the baseline takes it 6 cm further. Where the two differ by half a spacing nothing does."""
    seen, expected, alike = (motion(setting, depth).x.numpy().reshape(-1, 3) for depth in (0.0, 0.06, 0.01))
    starts, spacing = EFFECTS[name].blocking_starts(setting, seen, expected), setting.body.spacing
    assert starts and EFFECTS[name].blocking_starts(setting, seen, alike) == ()
    for start in starts:
        assert start["stiffness"] == 1e6
        nearest, deepest = (min(distance(name, start, place, setting) for place in own) for own in (seen, expected))
        assert abs(nearest) <= spacing / 2 and deepest < -spacing
        assert min(distance(name, start, place, setting) for place in setting.body.x0) > spacing


def test_a_post_does_not_stand_behind_what_presses_upwards_and_nothing_follows_without_a_motion(setting):
    post, ball = EFFECTS["obstacle_post"], EFFECTS["obstacle_sphere"]
    assert post.touching(np.zeros(3), np.array([0.0, 0.0, 1.0]), setting) == []
    assert ball.replacement_starts(setting, EFFECTS["obstacle_plane"], WALL, None) == ()
    assert EFFECTS["payload"].replacement_starts(setting, EFFECTS["density_gradient"], {}, motion(setting, 0.0)) == ()
