"""Pieces of a volume: what does not hang together moves apart, and what the spacing cannot carry is refused."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.simulation import Body, Clamp, Parameters, SimulationConfig, Simulator
from physreal_core.simulation.lattice import base_nodes, lattice_of, nodes_around
from physreal_core.simulation.pieces import one_particle_thick, pieces_of
from physreal_core.simulation.start import NodeStart, stencils
from tests.simulation.scenes import (
    STEPS_OF_NUMBERS,
    assert_adjoints_agree,
    block,
    directional_errors,
    numbers_of_every_kind,
    random_loss,
    two_point_grip,
)

H = 0.008
NO_POINTS = torch.zeros(4, 0, 3)


def beside(*bodies: Body) -> Body:
    """One body of several, whose pieces nearness has to tell."""
    joined = (np.concatenate([getattr(body, name) for body in bodies]) for name in ("x0", "volume", "density"))
    return Body(*joined, bodies[0].spacing)


def slabs(gap: float, counts: tuple[int, int, int] = (6, 5, 2)) -> Body:
    """Two slabs one above the other [m], the lower one 5 cm above the ground."""
    thickness = counts[2] * H
    lower, upper = (block(counts, H, corner=(0.0, 0.0, 0.05 + n * (thickness + gap))) for n in range(2))
    return beside(lower, upper)


def parameters(**others) -> Parameters:
    return Parameters(torch.tensor(5e4), torch.tensor(0.3), torch.tensor(0.3), **others)


@pytest.mark.parametrize("gap", [0.004, 0.008, 0.012, 0.016])
def test_slabs_fall_separately(form, gap):
    """The upper one is held; the lower one falls as far as a free body, and stays flat."""
    body = slabs(gap)
    half = len(body.x0) // 2
    clamp = Clamp((-1.0, -1.0, float(body.x0[half:, 2].min()) - H / 2), (1.0, 1.0, 1.0))
    simulator = Simulator(body, SimulationConfig(fps=60, dtype="float64"), clamps=(clamp,))
    x = simulator.rollout(parameters(), NO_POINTS).x
    moved = x[-1] - x[0]
    assert moved[half:].abs().max() < 2e-5  # of its own weight
    steps = 3 * simulator.substeps(parameters())
    fallen = 9.81 / 2 * (3 / 60) ** 2 * (1 + 1 / steps)  # of symplectic steps
    expected = torch.tensor([0.0, 0.0, -fallen], dtype=torch.float64).expand(half, 3)
    torch.testing.assert_close(moved[:half], expected, rtol=0, atol=1e-12)


def test_each_of_two_pieces_moves_as_if_alone(form):
    """The lower one shears over the ground, the upper one is thrown up: their states are those of single bodies to rounding."""
    body = slabs(0.004)
    config = SimulationConfig(fps=60, dtype="float64", ground_height=0.05)
    velocity = np.zeros_like(body.x0)
    velocity[:60, 0] = 3.0 * body.x0[:60, 1]
    velocity[60:, 2] = 1.0
    both = Simulator(body, config).rollout(parameters(initial_velocity=torch.tensor(velocity)), NO_POINTS)
    for own in (slice(0, 60), slice(60, 120)):
        piece = Body(body.x0[own], body.volume[own], body.density[own], H)
        alone = Simulator(piece, config).rollout(parameters(initial_velocity=torch.tensor(velocity[own])), NO_POINTS)
        torch.testing.assert_close(both.x[:, own], alone.x, rtol=0, atol=1e-11)
        torch.testing.assert_close(both.F[:, own], alone.F, rtol=0, atol=1e-9)


def test_every_parameter_has_its_gradient(form):
    body = slabs(0.004, (4, 3, 2))
    points = body.x0[[0, 24]] + [0.001, 0.0, 0.05]
    config = SimulationConfig(fps=60, dtype="float64", ground_height=0.049, terms=("gravity", "density"))
    simulator = Simulator(body, config, two_point_grip(body, points, 30))
    given, controllers = numbers_of_every_kind(body, points)
    assert_adjoints_agree(directional_errors(simulator, given, controllers, random_loss([1, 2, 3]), STEPS_OF_NUMBERS))


def test_a_batch_of_pieces_is_single_rollouts(form):
    simulator = Simulator(slabs(0.004), SimulationConfig(fps=60, dtype="float64", ground_height=0.05))
    moduli = torch.tensor([[4e4], [5e4]], dtype=torch.float64)
    velocity = torch.tensor([0.5, 0.0, -0.2])
    many = simulator.rollout_batch(
        dataclasses.replace(parameters(initial_velocity=velocity), youngs_modulus=moduli), NO_POINTS
    )
    for row, E in enumerate(moduli[:, 0]):
        one = dataclasses.replace(parameters(initial_velocity=velocity), youngs_modulus=E)
        # the fused form takes the substeps of the stiffest for all
        alone = simulator.rollout(one, NO_POINTS) if form == "native" or row == 1 else None
        if alone is not None:
            torch.testing.assert_close(many.x[row], alone.x, rtol=0, atol=1e-12)


# --- the grid ---------------------------------------------------------------------------------------------------


def test_pieces_share_no_node_and_lie_as_if_alone():
    body = beside(*(block((5, 4, 3), H, corner=(0.0, 0.052 * n, 0.013 * n)) for n in range(3)))
    body = dataclasses.replace(body, x0=body.x0 + np.random.default_rng(0).uniform(-1e-4, 1e-4, body.x0.shape))
    lattice = lattice_of(body, ())
    around = nodes_around(base_nodes(lattice.place, lattice), lattice)
    owners, places = lattice.nodes_of_pieces()
    assert (owners[around] == body.piece[:, None]).all()
    weights = stencils(lattice.place, lattice)[1]
    np.testing.assert_allclose((weights[..., None] * places[around]).sum(1), body.x0, atol=1e-12)
    for piece in range(3):
        own = body.piece == piece
        alone = lattice_of(Body(body.x0[own], body.volume[own], body.density[own], H), ())
        np.testing.assert_allclose(stencils(alone.place, alone)[1], weights[own], atol=1e-9)


def test_a_clamp_holds_the_nodes_where_they_are_in_the_body():
    """A box about the further piece alone: the laid-aside grid of another lies in it too, and is not held."""
    body = beside(block((4, 4, 4), H), block((4, 4, 4), H, corner=(0.0, 0.0, 0.04)))
    clamp = Clamp((-1.0, -1.0, 0.039), (1.0, 1.0, 1.0))
    config = SimulationConfig(fps=60, dtype="float64", ground_height=None)
    x = Simulator(body, config, clamps=(clamp,)).rollout(parameters(), NO_POINTS).x
    assert (x[-1, 64:] - x[0, 64:]).abs().max() < 1e-4
    assert float((x[-1, :64] - x[0, :64])[:, 2].max()) < -0.01


def test_the_start_of_pieces_that_turn_is_exact():
    """Each piece has an affine field of its own."""
    body = slabs(0.004)
    rng = np.random.default_rng(0)
    velocity = np.empty_like(body.x0)
    for piece in range(2):
        own = body.piece == piece
        velocity[own] = (body.x0[own] - body.x0[own].mean(0)) @ rng.normal(0, 5, (3, 3)) + rng.normal(size=3)
    lattice = lattice_of(body, ())
    start = NodeStart(body, lattice, torch.float64, "cpu")
    found = start.nodes(torch.as_tensor(velocity)[None])[0, :, :3].numpy()
    nodes, weights = stencils(lattice.place, lattice)
    assert np.abs((weights[..., None] * found[nodes]).sum(1) - velocity).max() < 1e-12 * np.abs(velocity).max()
    bar = torch.tensor(rng.normal(size=(1, lattice.nodes, 4)))
    v = torch.tensor(rng.normal(size=(1, *body.x0.shape)))
    forward = (start.nodes(v) * bar)[..., :3].sum()
    assert float((v * start.particles(bar)).sum()) == pytest.approx(float(forward), rel=1e-12)


def test_pieces_that_nearness_tells():
    assert pieces_of(block((4, 4, 4), H).x0, H).max() == 0
    assert pieces_of(slabs(0.002).x0, H).max() == 0  # a quarter of a spacing is not told from an uneven lattice
    np.testing.assert_array_equal(pieces_of(slabs(0.004).x0, H), np.repeat([0, 1], 60))
    chain = np.stack([np.arange(5) * 1.7 * H + 4 * H, *2 * [np.full(5, 2 * H)]], 1)  # a limb of slivers on a block
    assert pieces_of(np.concatenate([block((4, 4, 4), H).x0, chain]), H).max() == 0


def test_pieces_given_are_checked():
    body = slabs(0.002)
    assert dataclasses.replace(body, pieces=np.repeat([0, 1], 60)).piece.max() == 1
    for wrong in (np.repeat([0, 2], 60), np.repeat([-1, 0], 60)):
        with pytest.raises(InputError, match=r"Body\.pieces"):
            dataclasses.replace(body, pieces=wrong)


def test_pieces_stay_apart_in_a_coarse_body():
    from physreal_core.fitting.coarsening import _merged

    body = slabs(0.004)
    coarse, shares = _merged(body, 1.6)
    assert len(coarse.x0) < 60
    assert coarse.piece.max() == 1
    for piece in (0, 1):
        assert shares[coarse.piece == piece][:, body.piece == piece].sum() == pytest.approx(60)


# --- too thin ---------------------------------------------------------------------------------------------------


def turned(x: np.ndarray) -> np.ndarray:
    axis = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
    skew = np.cross(np.eye(3), axis)
    return x @ (np.eye(3) + np.sin(0.8) * skew + (1 - np.cos(0.8)) * skew @ skew)


def test_one_layer_is_thin_however_it_lies_and_two_are_not():
    for counts, thin in (
        ((9, 8, 1), True),
        ((20, 1, 1), True),
        ((1, 1, 1), True),
        ((9, 8, 2), False),
        ((12, 2, 2), False),
    ):
        x = block(counts, H).x0
        assert one_particle_thick(x, H).all() == thin, counts
        assert one_particle_thick(turned(x), H).all() == thin, counts
        assert one_particle_thick(x, H).any() == thin, counts


def test_a_volume_one_particle_thick_is_refused_with_its_thickness():
    sheet = block((9, 8, 1), H)
    sheet = dataclasses.replace(sheet, volume=np.full(72, 0.003 * H**2))
    with pytest.raises(InputError) as caught:
        Simulator(sheet, SimulationConfig(fps=30))
    told = str(caught.value)
    for word in ("3 mm", "8 mm", "spacing of 1.5 mm", "planar", "linear"):
        assert word in told, told


def test_a_thick_body_with_a_thin_limb_is_not_refused():
    limb = np.stack([np.arange(6) * H + 6.5 * H, *2 * [np.full(6, 2.5 * H)]], 1)
    thick = block((6, 5, 5), H)
    x = np.concatenate([thick.x0, limb])
    assert one_particle_thick(x, H)[-3:].all()
    Simulator(Body(x, np.full(len(x), H**3), np.full(len(x), 300.0), H), SimulationConfig(fps=30))


def test_a_body_of_one_piece_lies_on_the_grid_where_it_is():
    body = block((5, 4, 3), H, corner=(0.1, 0.2, 0.3))
    lattice = lattice_of(body, ())
    np.testing.assert_array_equal(lattice.place, body.x0)
    assert not lattice.shift.any()
