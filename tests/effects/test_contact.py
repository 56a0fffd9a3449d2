"""Effects of contact against closed forms."""

import math
from dataclasses import replace

import pytest
import torch

from physreal_core.effects import EFFECTS
from tests.effects.specimen import Specimen, complete, held_specimen, lattice_body, material

GRAVITY, SPACING = 9.81, 0.008


def block(
    frames: int, fps: float = 60.0, friction: float = 0.4, corner=(0.0, 0.0, 0.0), E: float = 6e4, **scene
) -> Specimen:
    """A flat block, by default lying on the ground without a hand."""
    body = lattice_body((8, 8, 4), SPACING, 300.0, corner)
    points = torch.zeros(frames, 0, 3, dtype=torch.float64)
    given = material(body, E, 0.3, friction_coefficient=friction)
    return Specimen(body, points, fps, replace(given, **scene.pop("given", {})), **scene)


def travelled(scene: Specimen, **values: dict[str, float]) -> torch.Tensor:
    """Displacement of the centre of mass by frame [m], shape [T, 3]."""
    with torch.no_grad():
        x = scene.rollout(**values).x
    return (x - x[0]).mean(1)


def moving(*velocity: float) -> dict[str, torch.Tensor]:
    return {"initial_velocity": torch.tensor(velocity, dtype=torch.float64)}


@pytest.mark.parametrize(("degrees", "slides"), [(21, False), (33, True)])
def test_static_friction_holds_a_block_up_to_its_own_angle(degrees, slides):
    """mu_f = 0.3 (16.7 degrees), static 0.5 (26.6): at rest below it, and sliding once it is exceeded."""
    angle = math.radians(degrees)
    slope = block(25, friction=0.3, gravity=(GRAVITY * math.sin(angle), 0.0, -GRAVITY * math.cos(angle)))
    way = travelled(slope, stick_slip={"excess": 0.2, "speed": 0.3})[:, 0]
    assert float(travelled(slope)[-1, 0]) > 0.05  # without the excess it slides on either slope
    if slides:
        slow, fast = (GRAVITY * (math.sin(angle) - mu * math.cos(angle)) * (24 / 60) ** 2 / 2 for mu in (0.5, 0.3))
        assert slow < float(way[-1]) < fast
    else:
        assert abs(float(way[-1] - way[10])) < 1e-4


def test_friction_that_rises_with_speed_stops_a_block_after_less_way():
    """dv/dt = -g (mu + b v): it stops at t = ln(1 + b v0 / mu) / (b g), after (v0 - mu g t) / (b g).

    A stiff block: a soft one's lower face shears and swings against the friction.
    """
    mu, b, v0 = 0.3, 0.2, 1.0
    scene = block(40, friction=mu, E=3e5, given=moving(v0, 0.0, 0.0))
    time = math.log(1 + b * v0 / mu) / (b * GRAVITY)
    way = (v0 - mu * GRAVITY * time) / (b * GRAVITY)
    assert way < 0.8 * v0**2 / (2 * mu * GRAVITY)
    assert float(travelled(scene, rate_friction={"rate": b})[-1, 0]) == pytest.approx(way, rel=0.03)


@pytest.mark.parametrize(("share", "leaves"), [(0.7, False), (1.1, True)])
def test_adhesion_holds_against_less_than_its_strength_and_no_more(share, leaves):
    """A steady pull on the whole body against the traction on its lower face, damped, so that nothing overshoots."""
    scene = block(40)
    strength, body = 400.0, scene.body
    face = (8 * SPACING) ** 2
    pull = GRAVITY + share * strength * face / float(body.mass.sum())
    damped = {"linear_drag": {"rate": 20.0}}
    stuck = {"ground_adhesion": {"strength": strength, "range": 0.004}}
    up = replace(scene, gravity=(0.0, 0.0, pull - GRAVITY))  # net: weight and pull
    height = travelled(up, **damped, **stuck)[:, 2]
    if leaves:
        assert float(height[-1]) > 0.02
    else:
        assert float(height[-1]) < 0.004
        assert abs(float(height[-1] - height[-10])) < 2e-4


def test_adhesion_is_for_what_lies_on_a_ground():
    effect = EFFECTS["ground_adhesion"]
    assert effect.starts(block(2).setting)
    assert effect.starts(block(2, corner=(0.0, 0.0, 0.1)).setting) == ()
    assert effect.starts(block(2, ground_height=None).setting) == ()


def test_a_body_slides_down_the_true_ground_without_friction():
    """Along the slope with g sin(a), seen in the world's frame."""
    slope = 0.2
    way = travelled(block(25, friction=0.0), ground_plane={"slope_x": slope})
    angle = math.atan(slope)
    expected = -GRAVITY * math.sin(angle) * (24 / 60) ** 2 / 2
    assert float(way[-1, 0]) == pytest.approx(expected * math.cos(angle), rel=0.03)
    assert float(way[-1, 2]) == pytest.approx(expected * math.sin(angle), rel=0.03, abs=1e-3)


def test_a_body_falls_onto_the_true_ground():
    """16 mm lower than believed, to a quarter of a cell, which contact through the grid leaves after a fall."""
    scene = block(40)
    way = travelled(scene, ground_plane={"height": -0.016}, linear_drag={"rate": 20.0})
    assert float(way[-1, 2]) == pytest.approx(-0.016, abs=0.25 * scene.body.cell)


def test_the_ground_is_turned_with_what_stands_in_the_world():
    """In mid-air a turned frame shows nothing: drag, wind, obstacle and hand as in the level one."""
    scene = held_specimen(6)
    raised = replace(scene, ground_height=-1.0)
    others = {
        "wind": {"x": 3.0, "y": -2.0},
        "linear_drag": {"rate": 3.0},
        "fibres": {"ratio": 1.0, "azimuth": 0.4, "elevation": 0.3},
        "rest_shape": {"stretch": 0.02, "curvature_1": 0.5},
        "obstacle_sphere": {"stiffness": 4e3, "x": 0.1, "y": 0.02, "z": 0.03, "radius": 0.03},
    }
    with torch.no_grad():
        level = raised.rollout(**others).x
        turned = raised.rollout(**others, ground_plane={"slope_x": 0.02, "slope_y": -0.03}).x
    # the grid lies otherwise in the body: its error changes by a small share of the motion
    assert (turned - level).norm(dim=-1).max() < 0.02 * (level - level[0]).norm(dim=-1).max()


def thrown_block(frames: int, velocity: float) -> Specimen:
    """Along +x without weight."""
    return block(frames, ground_height=None, gravity=(0.0, 0.0, 0.0), given=moving(velocity, 0.0, 0.0))


def test_a_wall_lets_the_surface_no_deeper_than_its_spring_and_throws_the_body_back():
    """Between v / sqrt(k), each particle at its own spring, and v sqrt(8 / k), the first of 8 layers bearing all. The surface
    lies half a spacing before the outermost particles."""
    velocity, stiffness, distance = 0.5, 1e5, 0.05
    scene = thrown_block(24, velocity)
    wall = {"stiffness": stiffness, "azimuth": 0.0, "elevation": 0.0, "distance": distance}
    with torch.no_grad():
        states = scene.rollout(obstacle_plane=wall)
    surface = float(states.x[..., 0].max()) + scene.body.spacing / 2
    depth = surface - (scene.body.x0[:, 0].mean() + distance)
    assert velocity / math.sqrt(stiffness) < depth < velocity * math.sqrt(8 / stiffness)
    assert -velocity < float(states.v[-1, :, 0].mean()) < -0.6 * velocity  # the rest swings inside


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("obstacle_sphere", {"x": 0.11, "y": 0.032, "z": 0.016, "radius": 0.02}),
        ("obstacle_post", {"x": 0.11, "y": 0.032, "height": 0.1, "radius": 0.02}),
    ],
)
def test_a_ball_and_a_post_push_out_what_enters_them_and_nothing_else(name, place):
    """Nothing stays inside; moved out of the way (below the block, the post's top too), nothing happens."""
    scene = thrown_block(20, 0.5)
    with torch.no_grad():
        free = scene.rollout().x
        met = scene.rollout(**{name: {"stiffness": 1e6, **place}}).x
        beside = {**place, **({"height": -0.05} if "height" in place else {"z": -0.05})}
        missed = scene.rollout(**{name: {"stiffness": 1e6, **beside}}).x

    def depth(x: torch.Tensor) -> float:
        r = x - torch.tensor([place["x"], place["y"], place.get("z", 0.0)])
        r = r if "z" in place else r[..., :2]
        return place["radius"] + scene.body.spacing / 2 - float(r.norm(dim=-1).min())

    assert depth(free) > 0.01
    assert depth(met) < 0.006
    torch.testing.assert_close(missed, free, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["obstacle_plane", "obstacle_sphere", "obstacle_post"])
def test_obstacles_are_tried_where_the_body_goes_and_was_not_before(name):
    """At every start the obstacle changes the motion, and not its first frames."""
    scene = replace(held_specimen(16), ground_height=None)
    with torch.no_grad():
        motion = scene.rollout()
    starts = EFFECTS[name].starts(scene.setting, motion)
    assert 1 <= len(starts) <= 8
    for start in starts:
        with torch.no_grad():
            change = (scene.rollout(**{name: {"stiffness": 1e5, **start}}).x - motion.x).abs().amax((1, 2))
        assert change[1] < 1e-15  # rounding: another form of the step runs with an obstacle
        assert change[-1] > 1e-5
    assert EFFECTS[name].starts(scene.setting) == ()


@pytest.mark.parametrize("name", ["stick_slip", "rate_friction", "ground_plane"])
def test_without_a_ground_there_is_nothing_to_try(name):
    assert EFFECTS[name].starts(block(2).setting)
    assert EFFECTS[name].starts(block(2, ground_height=None).setting) == ()


def test_the_two_laws_of_friction_go_together_in_either_order():
    scene, laws = block(2), {"stick_slip": {"excess": 0.2, "speed": 0.05}, "rate_friction": {"rate": 0.7}}
    full = {name: complete(name, own) for name, own in laws.items()}
    for order in (full, dict(reversed(full.items()))):
        law = scene.inputs(order).parameters.friction_law
        torch.testing.assert_close(law, torch.tensor([0.2, 0.05, 0.7], dtype=torch.float64))
