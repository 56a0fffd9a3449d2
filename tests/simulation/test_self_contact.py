"""Pieces and limbs of a volume touch: against the energy in torch, conservation laws, and scenes whose end is known."""

import dataclasses
import math

import numpy as np
import pytest
import torch

from benchmarks.thin.touching import two_blocks
from physreal_core.geometry import Mesh
from physreal_core.geometry.filling import fill_pieces
from physreal_core.simulation import Body, Clamp, Parameters, SimulationConfig, Simulator
from physreal_core.simulation.contact import surface as surface_module
from physreal_core.simulation.contact.reference import contact_energy
from physreal_core.simulation.lattice import lattice_of
from physreal_core.simulation.start import stencils
from tests.simulation.scenes import assert_adjoints_agree, block, directional_errors, random_loss
from tests.simulation.test_limbs import fork, prongs
from tests.simulation.test_physics import elastic_energy, node_masses

H = 0.01
NO_POINTS = torch.zeros(4, 0, 3, dtype=torch.float64)
WEIGHTLESS = SimulationConfig(fps=200, ground_height=None, gravity=(0.0, 0.0, 0.0), dtype="float64", self_contact=True)


def number(value: float) -> torch.Tensor:
    return torch.tensor(value, dtype=torch.float64)


def stones(seed: int = 0) -> Body:
    """Two lumps of unlike particles, one above the other and turned against it, half a spacing of air between them."""
    rng = np.random.default_rng(seed)
    lower, upper = block((4, 4, 3), H).x0, block((3, 3, 3), H).x0
    c, s = np.cos(0.4), np.sin(0.4)
    turned = (upper - upper.mean(0)) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    upper = turned + [*lower.mean(0)[:2], 3 * H + 0.5 * H + 1.5 * H]
    x0 = np.concatenate([lower, upper]) + 0.08 * H * rng.uniform(-1, 1, (len(lower) + len(upper), 3))
    volume = H**3 * rng.uniform(0.6, 1.2, len(x0))
    pieces = np.repeat([0, 1], [len(lower), len(upper)])
    return Body(x0, volume, np.full(len(x0), 300.0), H, pieces=pieces)


def sign(body: Body) -> torch.Tensor:
    """1 of the upper piece, -1 of the lower one, [N, 1]."""
    return torch.tensor(2.0 * body.piece - 1.0)[:, None]


def pressed(body: Body) -> torch.Tensor:
    """Where the particles are when the upper piece has come down by 0.7 spacings."""
    return torch.tensor(body.x0) - 0.7 * H * (sign(body) > 0) * torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)


# --- the surface ------------------------------------------------------------------------------------------------


def test_the_surface_of_a_block_is_its_outermost_particles():
    body = block((6, 5, 4), H)
    surface = body.surface
    inside = ((body.x0 > 1.1 * H) & (body.x0 < [4.9 * H, 3.9 * H, 2.9 * H])).all(1)
    np.testing.assert_array_equal(surface.weight == 0, inside)
    a, b, c = np.moveaxis(body.x0[surface.faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area == pytest.approx(2 * (5 * 4 + 4 * 3 + 5 * 3) * H**2, rel=1e-9)
    assert len(surface.edges) == 3 * len(surface.faces) // 2  # closed
    np.testing.assert_allclose(surface.reach, H / 2)


@pytest.mark.parametrize("gap", [0.26, 0.5, 1.0])
def test_a_filled_mesh_at_rest_touches_nowhere(gap):
    """Two boxes with little air between them, one turned, with parts of cells filled: contact neither moves them nor has energy."""
    import trimesh

    boxes = [trimesh.creation.box((0.063, 0.055, 0.034)), trimesh.creation.box((0.045, 0.045, 0.034))]
    boxes[1].apply_transform(trimesh.transformations.rotation_matrix(0.3, (0.0, 0.0, 1.0)))
    boxes[1].apply_translation((0.004, 0.003, 0.034 + gap * H))
    mesh = trimesh.util.concatenate(boxes)
    x0, volume, pieces = fill_pieces(Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces)), H)
    body = Body(x0, volume, np.full(len(x0), 300.0), H, pieces=pieces)
    assert body.piece.max() == 1
    modulus = torch.full((len(x0),), 5e4, dtype=torch.float64)
    assert float(contact_energy(body.surface, torch.tensor(x0), modulus)) < 1e-20
    parameters = Parameters(number(5e4), number(0.3), layer_friction=number(0.3))
    states = Simulator(body, WEIGHTLESS).rollout(parameters, NO_POINTS)
    assert float((states.x[-1] - states.x[0]).abs().max()) < 1e-12


# --- forces -----------------------------------------------------------------------------------------------------


def test_forces_are_the_slope_of_the_energy(form):
    """What contact adds to the velocities of one step is the energy's slope, brought to the nodes and back."""
    body = stones()
    config = dataclasses.replace(WEIGHTLESS, fps=1e6, terms=("initial_position",))
    modulus = 5e4 * (1 + torch.rand(len(body.x0), generator=torch.Generator().manual_seed(0), dtype=torch.float64))
    parameters = Parameters(modulus, number(0.3), initial_position=pressed(body), layer_friction=number(0.5))
    touching = Simulator(body, config).rollout(parameters, NO_POINTS[:2]).v[1]
    alone = dataclasses.replace(parameters, layer_friction=None)
    free = Simulator(body, dataclasses.replace(config, self_contact=False)).rollout(alone, NO_POINTS[:2]).v[1]
    x = pressed(body).requires_grad_()
    contact_energy(body.surface, x, modulus).backward()
    lattice = lattice_of(body, ())
    nodes, weights = stencils(lattice.place, lattice)
    whole = np.zeros((len(body.x0), lattice.nodes))
    np.put_along_axis(whole, nodes, weights, 1)
    mass = whole.T @ body.mass
    expected = whole @ (-(whole.T @ x.grad.numpy()) / np.maximum(mass, 1e-300)[:, None]) / config.fps
    assert np.abs(expected).max() > 1e-9
    np.testing.assert_allclose((touching - free).numpy(), expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def collision(body: Body, config: SimulationConfig, friction: float, slide: tuple[float, float] = (0.3, 0.1)):
    start = sign(body) * torch.tensor([*slide, -0.4], dtype=torch.float64)
    parameters = Parameters(number(2e4), number(0.3), initial_velocity=start, layer_friction=number(friction))
    simulator = Simulator(body, config)
    given = simulator._complete(parameters, 1)
    shown, record = simulator._loop.forward(given, torch.zeros(21, 1, 0, 3), None, keep=True)
    x, v, F = (shown[name][:, 0] for name in ("x", "v", "F"))
    return x, v, F, record.further["nodes"][:, 0, :, :3]


def test_momentum_is_kept(form):
    """With friction, linear and angular."""
    body = stones()
    _, v, _, nodes = collision(body, WEIGHTLESS, 0.5)
    lattice = lattice_of(body, ())
    mass = node_masses(dataclasses.replace(body, x0=lattice.place), lattice)[:, None]
    momentum = (mass * nodes).sum(1)
    scale = float((mass * nodes[0].abs()).sum())
    upper = torch.tensor(body.piece == 1)
    assert float((v[-1] - v[0])[upper, 2].mean()) > 0.4  # they do collide
    assert float((momentum - momentum[0]).abs().max()) < 1e-10 * scale


def test_a_bounce_without_friction_keeps_the_energy(form):
    body = stones()
    lattice = lattice_of(body, ())
    mass = node_masses(dataclasses.replace(body, x0=lattice.place), lattice)[:, None]
    errors = []
    for courant in (0.4, 0.1):
        x, _, F, nodes = collision(body, dataclasses.replace(WEIGHTLESS, courant=courant), 0.0)
        modulus = torch.full((len(body.x0),), 2e4, dtype=torch.float64)
        contact = torch.stack([contact_energy(body.surface, own, modulus) for own in x])
        energy = (0.5 * mass * nodes**2).sum((1, 2)) + elastic_energy(body, F, 2e4, 0.3) + contact
        assert float(contact.max()) > 0.02 * float(energy[0])
        errors.append(float((energy / energy[0] - 1).abs().max()))
    assert errors[0] < 0.08
    assert errors[1] < 0.02


def test_which_pairs_are_listed_and_how_many_threads_list_them_does_not_matter(monkeypatch):
    body = stones()
    start = sign(body) * torch.tensor([0.3, 0.1, -0.4], dtype=torch.float64)
    results = []
    for margin, threads in ((0.02, 1), (10.0, 1), (0.5, 2)):
        monkeypatch.setattr(surface_module, "FINDING", margin)
        monkeypatch.setattr("physreal_core.simulation.native.stepper.PARTICLES_PER_THREAD", 32)
        torch.set_num_threads(threads)
        parameters = Parameters(
            number(2e4).requires_grad_(), number(0.3), initial_velocity=start, layer_friction=number(0.3)
        )
        simulator = Simulator(body, dataclasses.replace(WEIGHTLESS, fps=50))
        assert simulator._stepper.threads == threads
        states = simulator.rollout(parameters, NO_POINTS)
        states.x[-1].square().sum().backward()
        results.append((states.x.detach(), parameters.youngs_modulus.grad))
    for x, grad in results[1:]:
        assert torch.allclose(results[0][0], x, rtol=0, atol=1e-9)
        assert torch.allclose(results[0][1], grad, rtol=1e-5, atol=0)


@pytest.mark.parametrize("slide", [0.3, 1e-4])
def test_every_parameter_through_contact(slide, form):
    """While the pieces slide past each other, and while friction holds them."""
    body, rng = stones(), torch.Generator().manual_seed(3)
    count = len(body.x0)
    scattered = lambda value: value * (1 + 0.2 * torch.rand(count, generator=rng, dtype=torch.float64))
    terms = ("gravity", "density", "initial_position")
    start = sign(body) * torch.tensor([slide, 0.4 * slide, -0.05], dtype=torch.float64)
    parameters = Parameters(
        scattered(2e4), scattered(0.3), initial_velocity=start, layer_friction=number(0.4),
        gravity=torch.tensor([0.5, 0.0, -9.0], dtype=torch.float64), density=scattered(300.0),
        initial_position=pressed(body),
    )  # fmt: skip
    simulator = Simulator(body, dataclasses.replace(WEIGHTLESS, terms=terms))
    steps = {"youngs_modulus": 1e-2, "poissons_ratio": 1e-6, "layer_friction": 1e-6, "gravity": 1e-5}
    steps |= {"initial_velocity": 1e-7, "density": 1e-4, "initial_position": 1e-9}
    assert_adjoints_agree(directional_errors(simulator, parameters, NO_POINTS, random_loss([1, 2, 3]), steps))


def test_a_batch_is_single_rollouts(form):
    body = stones()
    start = sign(body) * torch.tensor([0.3, 0.1, -0.8], dtype=torch.float64)
    parameters = Parameters(number(2e4), number(0.3), initial_velocity=start, layer_friction=number(0.3))
    frictions = torch.tensor([0.0, 0.3, 0.8], dtype=torch.float64)
    simulator = Simulator(body, WEIGHTLESS)
    batch = simulator.rollout_batch(dataclasses.replace(parameters, layer_friction=frictions), NO_POINTS)
    for row in range(3):
        alone = simulator.rollout(dataclasses.replace(parameters, layer_friction=frictions[row]), NO_POINTS)
        assert torch.equal(batch.x[row], alone.x)


# --- scenes whose end is known ----------------------------------------------------------------------------------


@pytest.mark.parametrize("corner", [(0.02, 0.02), (0.025, 0.025), (0.023, 0.024)])
def test_a_block_that_falls_on_another_comes_to_rest_on_it(corner):
    """Wherever its lattice lies against the other's."""
    body = two_blocks(H, (8, 8, 4), (4, 4, 3), corner, 1.5 * H)
    parameters = Parameters(
        torch.tensor(4e4), torch.tensor(0.3), torch.tensor(0.4), layer_friction=torch.tensor(0.3),
        linear_drag=torch.tensor(3.0 * body.mass).float(),
    )  # fmt: skip
    simulator = Simulator(body, SimulationConfig(fps=60, self_contact=True, terms=("drag",)))
    states = simulator.rollout(parameters, torch.zeros(40, 0, 3))
    height = states.x[-1, :, 2]
    upper = torch.tensor(body.piece == 1)
    assert float(states.v[-1].norm(dim=1).mean()) < 0.01
    assert float(height[upper].min() - height[~upper].max()) == pytest.approx(H, rel=0.1)


@pytest.mark.parametrize("touching", [True, False])
def test_prongs_that_are_thrown_at_each_other_do_not_pass_through(touching, form):
    """Held at the base. Without contact they cross."""
    body = fork(2)
    lower, upper = prongs(body)
    velocity = np.zeros_like(body.x0)
    for prong, way in ((lower, 1.0), (upper, -1.0)):
        velocity[prong, 1] = way * 2.0 * (body.x0[prong, 0] / H - 4) / 10
    config = SimulationConfig(fps=120, ground_height=None, gravity=(0.0,) * 3, self_contact=touching)
    parameters = Parameters(torch.tensor(3e4), torch.tensor(0.3), initial_velocity=torch.tensor(velocity).float())
    if touching:
        parameters = dataclasses.replace(parameters, layer_friction=torch.tensor(0.3))
    base = Clamp((-1.0, -1.0, -1.0), (3 * H, 1.0, 1.0))
    y = Simulator(body, config, clamps=(base,)).rollout(parameters, torch.zeros(16, 0, 3)).x[..., 1]
    tip = body.x0[:, 0] > 11 * H
    apart = (y[:, upper & tip].amin(1) - y[:, lower & tip].amax(1)) / H
    assert float(apart[0]) == pytest.approx(3.0)
    if touching:
        assert float(apart.min()) > 0.4
        assert float(apart[-1]) > 1.0  # they have bounced off
    else:
        assert float(apart.min()) < -1.0


def test_friction_between_pieces_comes_back_from_their_motion():
    """By its gradient through a slide."""
    body = two_blocks(H, (10, 6, 2), (4, 4, 2), (0.023, 0.024), 0.1 * H)
    held = Clamp((-1.0, -1.0, -1.0), (1.0, 1.0, H))
    config = SimulationConfig(fps=60, gravity=(3.0, 0.0, -9.0), ground_height=None, self_contact=True)
    simulator = Simulator(body, config, clamps=(held,))
    slide = lambda friction: (
        simulator.rollout(
            Parameters(torch.tensor(5e4), torch.tensor(0.3), layer_friction=friction), torch.zeros(8, 0, 3)
        ).x
    )
    with torch.no_grad():
        measured = slide(torch.tensor(0.25))
    logarithm = torch.tensor(math.log(0.1), requires_grad=True)
    optimiser = torch.optim.LBFGS([logarithm], lr=1.0, max_iter=12, line_search_fn="strong_wolfe")

    def loss() -> torch.Tensor:
        optimiser.zero_grad()
        value = 1e6 * (slide(logarithm.exp()) - measured).square().mean()
        value.backward()
        return value

    optimiser.step(loss)
    assert float(logarithm.detach().exp()) == pytest.approx(0.25, rel=0.01)
