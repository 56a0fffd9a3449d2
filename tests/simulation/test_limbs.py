"""Limbs: parts that would share nodes of the grid although they hang together only farther away move apart, and where they meet nothing changes."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.simulation import Body, Clamp, Parameters, SimulationConfig, Simulator, limbs
from physreal_core.simulation.lattice import base_nodes, lattice_of, nodes_around
from physreal_core.simulation.start import NodeStart, stencils
from tests.simulation.numpy_twin import Twin
from tests.simulation.scenes import (
    STEPS_OF_NUMBERS,
    assert_adjoints_agree,
    block,
    directional_errors,
    numbers_of_every_kind,
    random_loss,
    two_point_grip,
)

H = 0.01
NO_POINTS = torch.zeros(4, 0, 3)


def body(keep, counts: tuple[int, int, int] = (14, 12, 4), height: float = 0.0) -> Body:
    """Particles of a block of `counts` spacings where `keep` says so, at this height [m]."""
    cells = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, 3)
    x0 = H * (cells[keep(*cells.T)] + 0.5) + [0.0, 0.0, height]
    return Body(x0, np.full(len(x0), H**3), np.full(len(x0), 500.0), H)


def fork(gap: int, height: float = 0.0) -> Body:
    """Two prongs along x with `gap` spacings of air between them along y, joined where x < 4 spacings."""
    low = 6 - (gap + 1) // 2
    return body(lambda x, y, z: (x < 4) | (y < low) | (y >= low + gap), height=height)


def prongs(of: Body) -> tuple[np.ndarray, np.ndarray]:
    """Whether each particle is of the lower or the upper prong, outside the base."""
    out, y = of.x0[:, 0] > 4 * H, of.x0[:, 1]
    return out & (y < 6 * H), out & (y > 6 * H)


def parameters(**others) -> Parameters:
    return Parameters(torch.tensor(5e4), torch.tensor(0.3), torch.tensor(0.3), **others)


def moved(own: Body, config: SimulationConfig, clamps: tuple[Clamp, ...] = (), **others) -> torch.Tensor:
    x = Simulator(own, config, clamps=clamps).rollout(parameters(**others), NO_POINTS).x
    return x[-1] - x[0]


# --- who shares nodes -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gap", [1, 2, 3])
def test_prongs_share_no_node_and_the_base_joins_them(gap):
    own = fork(gap)
    lattice = lattice_of(own, ())
    around = lattice.first_copy[nodes_around(base_nodes(lattice.place, lattice), lattice)]
    lower, upper = ({*around[prong & (own.x0[:, 0] > 8 * H)].ravel()} for prong in prongs(own))
    assert not lower & upper
    base = {*around[own.x0[:, 0] < 4 * H].ravel()}
    assert base & {*around[prongs(own)[0]].ravel()} and base & {*around[prongs(own)[1]].ravel()}
    assert own.piece.max() == 0 and lattice.limb.max() == 1


def test_a_convex_body_has_one_limb_and_pieces_are_no_limbs_of_each_other():
    whole, slit = body(lambda x, y, z: x >= 0), body(lambda x, y, z: (y < 5) | (y >= 7))
    assert lattice_of(whole, ()).limb.max() == 0 and not len(lattice_of(whole, ()).copies)
    assert lattice_of(slit, ()).limb.max() == 1 and not len(lattice_of(slit, ()).copies)
    np.testing.assert_array_equal(lattice_of(slit, ()).limb, slit.piece)


def test_places_and_weights_are_those_in_the_body():
    own = fork(2)
    lattice = lattice_of(own, ())
    around = nodes_around(base_nodes(lattice.place, lattice), lattice)
    _, places = lattice.nodes_of_pieces()
    weights = stencils(lattice.place, lattice)[1]
    np.testing.assert_allclose((weights[..., None] * places[around]).sum(1), own.x0, atol=1e-12)
    np.testing.assert_allclose(places, places[lattice.first_copy], atol=1e-12)


def test_particles_that_share_all_their_nodes_are_one_limb():
    assert lattice_of(block((1, 1, 1), H), ()).limb.max() == 0 == lattice_of(block((2, 2, 2), H), ()).limb.max()


def test_a_corner_that_a_node_sees_a_little_of_is_no_limb():
    """Single particles on a face are less than eight, and joined with the face beside the node."""
    studs = body(lambda x, y, z: (z < 3) | ((x % 4 == 0) & (y % 4 == 0)))
    assert lattice_of(studs, ()).limb.max() == 0


# --- what they do -----------------------------------------------------------------------------------------------


def coloured_by_chance(groups) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 3, len(groups.group) // 27)


SCENE = SimulationConfig(fps=60, dtype="float64", ground_height=0.0, terms=("gravity", "density"))
THROWN = {"initial_velocity": torch.tensor([0.5, 0.3, -0.4])}
HELD = (Clamp((-1.0, -1.0, -1.0), (0.015, 1.0, 1.0)),)


@pytest.mark.parametrize("clamps", [(), HELD])
def test_which_limb_a_particle_is_of_changes_nothing(form, monkeypatch, clamps):
    """A block whose particles are dealt out among three lattices falls on the ground, or hangs, as in one."""
    own = block((5, 4, 4), H, corner=(0.0, 0.0, 0.001))
    alone = Simulator(own, SCENE, clamps=clamps).rollout(parameters(**THROWN), NO_POINTS)
    monkeypatch.setattr(limbs, "_colours", coloured_by_chance)
    assert len(lattice_of(own, ()).copies) > 20
    dealt = Simulator(own, SCENE, clamps=clamps).rollout(parameters(**THROWN), NO_POINTS)
    torch.testing.assert_close(dealt.x, alone.x, rtol=0, atol=1e-12)
    torch.testing.assert_close(dealt.F, alone.F, rtol=0, atol=1e-10)


def test_every_parameter_has_its_gradient(form):
    own = body(lambda x, y, z: (x < 3) | (y < 3) | (y >= 4), (7, 7, 3))
    assert len(lattice_of(own, ()).copies)
    points = own.x0[[0, 24]] + [0.001, 0.0, 0.05]
    simulator = Simulator(own, dataclasses.replace(SCENE, ground_height=-0.001), two_point_grip(own, points, 30))
    assert_adjoints_agree(
        directional_errors(simulator, *numbers_of_every_kind(own, points), random_loss([1, 2, 3]), STEPS_OF_NUMBERS)
    )


def test_gradients_do_not_depend_on_the_limbs(form, monkeypatch):
    own = block((5, 4, 4), H, corner=(0.0, 0.0, 0.001))
    points = own.x0[[0, 24]] + [0.001, 0.0, 0.05]
    found = []
    for _ in range(2):
        numbers, path = numbers_of_every_kind(own, points)
        leaves = {name: getattr(numbers, name).requires_grad_() for name in STEPS_OF_NUMBERS}
        simulator = Simulator(own, SCENE, two_point_grip(own, points, 30))
        random_loss([1, 2, 3])(simulator.rollout(numbers, path)).backward()
        found.append({name: leaf.grad for name, leaf in leaves.items()})
        monkeypatch.setattr(limbs, "_colours", coloured_by_chance)
    for name, alone in found[0].items():
        torch.testing.assert_close(found[1][name], alone, rtol=1e-8, atol=1e-9 * float(alone.abs().max()), msg=name)


def test_one_prong_is_bent_and_the_other_stays(form):
    """Held by the base, with the lower prong alone thrown sideways: the other moves by what the base lets through."""
    own = fork(2)
    clamp = Clamp((-1.0, -1.0, -1.0), (3 * H, 1.0, 1.0))
    lower, upper = prongs(own)
    velocity = np.zeros_like(own.x0)
    velocity[lower, 1] = -0.5 * (own.x0[lower, 0] / H - 4) / 10
    config = SimulationConfig(fps=60, dtype="float64", gravity=(0.0, 0.0, 0.0))
    found = moved(own, config, (clamp,), initial_velocity=torch.tensor(velocity))[:, 1]
    far = own.x0[:, 0] > 12 * H
    assert float(found[lower & far].mean()) < -0.008
    assert float(found[upper & far].abs().max()) < 0.05 * float(found[lower & far].abs().mean())


def test_a_prong_bends_as_one_alone(form):
    """Both prongs at a wall sag sideways as a single one there does, but for where the grid lies."""
    size = (14, 8, 2)
    single, both = body(lambda x, y, z: y < 3, size), body(lambda x, y, z: (y < 3) | (y >= 5) | (x < 1), size)
    clamp = Clamp((-1.0, -1.0, -1.0), (3 * H, 1.0, 1.0))
    config = SimulationConfig(fps=60, dtype="float64", gravity=(0.0, -9.81, 0.0))
    alone, beside = (moved(own, config, (clamp,))[own.x0[:, 1] < 3 * H] for own in (single, both))
    sag = alone[single.x0[:, 0] > 12 * H, 1].mean()
    assert sag < -0.003
    torch.testing.assert_close(beside[(both.x0[:, 0] > 12 * H)[both.x0[:, 1] < 3 * H], 1].mean(), sag, rtol=0.1, atol=0)


def test_a_step_is_that_of_the_written_out_one(form):
    own = body(lambda x, y, z: (x < 3) | (y < 3) | (y >= 4), (7, 7, 2), height=-0.004)
    rng = np.random.default_rng(1)
    E, nu = 5e4 * (1 + rng.random(len(own.x0))), 0.3 + 0.05 * rng.random(len(own.x0))
    v = rng.normal(0, 0.3, own.x0.shape)
    simulator = Simulator(own, SimulationConfig(fps=240, dtype="float64", ground_height=0.0))
    numbers = Parameters(torch.tensor(E), torch.tensor(nu), torch.tensor(0.3), initial_velocity=torch.tensor(v))
    x = simulator.rollout(numbers, torch.zeros(2, 0, 3)).x
    steps = simulator.substeps(numbers)
    gravity = np.array([0.0, 0.0, -9.81])
    twin = Twin(
        own,
        simulator.lattice if hasattr(simulator, "lattice") else lattice_of(own, ()),
        E,
        nu,
        0.3,
        gravity,
        own.x0,
        v.copy(),
    )
    for _ in range(steps):
        twin.step(1 / 240 / steps, np.zeros_like(v))
    np.testing.assert_allclose(x[-1], twin.x, atol=1e-9)


def test_a_batch_is_single_rollouts_and_a_rerun_gives_the_same_bytes(form):
    simulator = Simulator(fork(2, height=0.001), SimulationConfig(fps=60, dtype="float32", ground_height=0.0))
    moduli = torch.tensor([[5e4], [5e4]])
    many = simulator.rollout_batch(dataclasses.replace(parameters(**THROWN), youngs_modulus=moduli), NO_POINTS)
    again = simulator.rollout_batch(dataclasses.replace(parameters(**THROWN), youngs_modulus=moduli), NO_POINTS)
    assert torch.equal(many.x, again.x) and torch.equal(many.x[0], many.x[1])


def test_copies_start_with_the_same_velocity_and_the_map_has_its_adjoint():
    own = fork(2)
    rng = np.random.default_rng(0)
    lattice = lattice_of(own, ())
    start = NodeStart(own, lattice, torch.float64, "cpu")
    v = torch.tensor(rng.normal(size=(1, *own.x0.shape)))
    nodes = start.nodes(v)
    assert torch.equal(nodes, nodes[:, lattice.first_copy])
    bar = torch.tensor(rng.normal(size=(1, lattice.nodes, 4)))[:, lattice.first_copy]  # each copy has the whole
    counts = torch.as_tensor(lattice.first_copy == np.arange(lattice.nodes))[:, None]
    forward = (nodes * bar * counts)[..., :3].sum()
    assert float((v * start.particles(bar)).sum()) == pytest.approx(float(forward), rel=1e-12)
