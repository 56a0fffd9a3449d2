"""Forces of shells and rods against their energies in torch, and the adjoint against central differences in float64."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.simulation import Body, Grip, Parameters, SimulationConfig, Simulator
from physreal_core.simulation.laws import ResidualConfig
from physreal_core.simulation.thin.reference import (
    framed_rod_energy,
    rod_drag,
    rod_energy,
    rod_invariants,
    shell_dissipation,
    shell_drag,
    shell_energy,
    shell_invariants,
)
from physreal_core.simulation.thin.residual import coefficients, factors
from physreal_core.simulation.thin.rod import FRAMED_TERMS, Rod
from tests.simulation.conftest import FUSED
from tests.simulation.scenes import assert_adjoints_agree, directional_errors, path_derivatives, random_loss
from tests.simulation.thin.scenes import crumpled, framed_ropes, ropes

FRAMES = 4
STEPS = {
    "youngs_modulus": 1e-1,
    "poissons_ratio": 1e-5,
    "bending_ratio": 1e-6,
    "weft_ratio": 1e-6,
    "shear_ratio": 1e-6,
    "twisting_ratio": 1e-5,
    "rest_curvature": 1e-5,
    "retardation_time": 1e-8,
    "initial_director": 1e-7,
    "friction_coefficient": 1e-5,
    "grip_stiffness": 1e-6,
    "grip_damping": 1e-7,
    "initial_velocity": 3e-7,
    "gravity": 1e-5,
    "density": 1e-4,
    "force": 1e-8,
    "initial_position": 1e-9,
    "linear_drag": 1e-8,
    "quadratic_drag": 1e-7,
    "viscosity": 1e-4,
    "surface_drag": 1e-4,
    "fibre_modulus": 1e-1,
    "fibre_direction": 1e-6,
    "latent_elastic": 1e-6,
    "network_elastic": 1e-6,
}
RESIDUAL = ResidualConfig(latent_size=2, hidden=3, beta_elastic=0.5, strain_scale=0.1, thin=True)
RESIDUAL_OF_ROD = dataclasses.replace(RESIDUAL, strain_scale=0.3)


def scattered(count: int, value: float, seed: int, *axes: int) -> torch.Tensor:
    """Values about one, [count, ...]."""
    generator = torch.Generator().manual_seed(seed)
    return value * (1.0 + 0.2 * torch.rand(count, *axes, generator=generator, dtype=torch.float64))


def parameters_of(kind: str, count: int, **others) -> Parameters:
    own = {"youngs_modulus": scattered(count, 2e5, 1), "bending_ratio": scattered(count, 0.5, 3)}
    own["poissons_ratio"] = scattered(count, 0.25, 2)
    if kind in DRAGGED:
        own["surface_drag"] = scattered(count, 5.0, 12)
    if kind in CORRECTED:
        generator = torch.Generator().manual_seed(15)
        own["latent_elastic"] = torch.randn(count, 2, generator=generator, dtype=torch.float64)
        own["network_elastic"] = 0.5 * torch.randn(RESIDUAL.weight_count, generator=generator, dtype=torch.float64)
    if kind in ("shell", "viscous", "dragged", "fibrous", "corrected", "corrected_viscous"):
        own |= {"weft_ratio": scattered(count, 0.7, 4), "shear_ratio": scattered(count, 0.4, 5)}
    if kind == "fibrous":
        direction = torch.randn(count, 3, generator=torch.Generator().manual_seed(13), dtype=torch.float64)
        own |= {"fibre_modulus": scattered(count, 3e5, 14), "fibre_direction": direction}
    if kind in ("viscous", "corrected_viscous"):
        own |= {"viscosity": scattered(count, 1000.0, 10, 2)}
    elif kind == "framed":
        generator = torch.Generator().manual_seed(10)
        own["twisting_ratio"] = scattered(count, 0.8, 4)
        own["rest_curvature"] = 5.0 * torch.randn(count, 2, generator=generator, dtype=torch.float64)
        own["retardation_time"] = scattered(count, 3e-4, 5, 2)
    return Parameters(**own, **others)


def held_in_part(body: Body, count: int) -> Body:
    """The body with its first vertices in a hold that does not move them."""
    if not count:
        return body
    elements = dataclasses.replace(body.elements, held=np.arange(len(body.x0)) < count)
    lengths = "bend_lengths" if isinstance(elements, Rod) else "widths"
    assert (getattr(elements, lengths) != getattr(body.elements, lengths)).any()
    return dataclasses.replace(body, elements=elements)


def framed_energy(rod: Rod, x: torch.Tensor, stiffness: torch.Tensor) -> torch.Tensor:
    return framed_rod_energy(rod, x, torch.tensor(rod.directors), stiffness)


BODIES = {
    "shell": (crumpled, shell_energy, ("bending", "fabric")),
    "viscous": (crumpled, shell_energy, ("bending", "fabric", "viscosity", "surface_drag")),
    "dragged": (crumpled, shell_energy, ("bending", "fabric", "surface_drag")),
    "fibrous": (crumpled, shell_energy, ("bending", "fabric", "fibres")),
    "corrected": (crumpled, shell_energy, ("bending", "fabric")),
    "corrected_viscous": (crumpled, shell_energy, ("bending", "fabric", "viscosity", "surface_drag")),
    "rod": (ropes, rod_energy, ("bending",)),
    "corrected_rod": (ropes, rod_energy, ("bending",)),
    "dragged_rod": (ropes, rod_energy, ("bending", "surface_drag")),
    "framed": (framed_ropes, framed_energy, ("bending", "surface_drag", *FRAMED_TERMS)),
}
DRAGGED = tuple(kind for kind, (_, _, terms) in BODIES.items() if "surface_drag" in terms)
CORRECTED = ("corrected", "corrected_viscous", "corrected_rod")
OF_RESIDUAL = {"latent_elastic", "network_elastic"}
OF_FRAMES = {"twisting_ratio", "rest_curvature", "retardation_time", "initial_director"}
OF_FIBRES = {"fibre_modulus", "fibre_direction"}
OF_SHELLS = {"poissons_ratio", "weft_ratio", "shear_ratio", "viscosity", *OF_FIBRES}
ABSENT = {
    "shell": {"viscosity", "surface_drag", *OF_FIBRES, *OF_FRAMES, *OF_RESIDUAL},
    "viscous": OF_FIBRES | OF_FRAMES | OF_RESIDUAL,
    "corrected": {"viscosity", "surface_drag", *OF_FIBRES, *OF_FRAMES},
    "corrected_viscous": OF_FIBRES | OF_FRAMES,
    "dragged": {"viscosity", *OF_FIBRES, *OF_FRAMES, *OF_RESIDUAL},
    "fibrous": {"viscosity", "surface_drag", *OF_FRAMES, *OF_RESIDUAL},
    "rod": {"surface_drag", *OF_SHELLS, *OF_FRAMES, *OF_RESIDUAL},
    "corrected_rod": {"surface_drag", *OF_SHELLS, *OF_FRAMES},
    "dragged_rod": {*OF_SHELLS, *OF_FRAMES, *OF_RESIDUAL},
    "framed": (OF_SHELLS - {"poissons_ratio"}) | OF_RESIDUAL,
}


def residual_of(kind: str) -> ResidualConfig | None:
    return {"corrected_rod": RESIDUAL_OF_ROD}.get(kind, RESIDUAL if kind in CORRECTED else None)


@pytest.fixture(params=BODIES)
def kind(request) -> str:
    fused = "form" in request.fixturenames and request.getfixturevalue("form") == FUSED
    if fused and request.param in ("framed", *DRAGGED):
        pytest.skip("directors, viscosity and drag by area have the native form alone")
    return request.param


@pytest.mark.parametrize("count", [0, 7], ids=["free", "held"])
def test_forces_are_the_slope_of_the_energy(kind, count, form):
    """Also where some of the vertices are held, so that the hinges at the end of the hold bend on one side alone."""
    make, energy, terms = BODIES[kind]
    body = held_in_part(make(), count)
    config = SimulationConfig(fps=1e6, dtype="float64", ground_height=None, gravity=(0.0, 0.0, 0.0), terms=terms)
    config = dataclasses.replace(config, residual=residual_of(kind))
    parameters = parameters_of(kind, len(body.x0))
    states = Simulator(body, config).rollout(parameters, torch.zeros(2, 0, 3))
    x = torch.tensor(body.x0, requires_grad=True)
    stiffness = body.elements.stiffness(parameters)
    if kind in CORRECTED:
        stiffness = corrected(body, parameters, stiffness, config.residual)
    energy(body.elements, x, stiffness).backward()
    force = states.v[1] * config.fps * torch.tensor(body.mass)[:, None]
    assert torch.allclose(force, -x.grad, rtol=0, atol=1e-9 * float(x.grad.abs().max()))


def corrected(body: Body, parameters: Parameters, stiffness: torch.Tensor, residual: ResidualConfig) -> torch.Tensor:
    """The stiffness where the residual has scaled it."""
    elements, rod = body.elements, isinstance(body.elements, Rod)
    codes = parameters.latent_elastic, parameters.network_elastic
    own = coefficients(residual, elements.own, elements.half_height, *codes)
    invariants = (rod_invariants if rod else shell_invariants)(elements, torch.tensor(body.x0))
    stretching, bending = factors(own, invariants, residual.beta_elastic)
    for factor in (stretching, bending):
        assert ((1 - factor).abs() < residual.beta_elastic).all() and factor.std() > 0.01
    first = 2 if rod else 6
    return torch.cat([stretching * stiffness[:first], bending * stiffness[first:]])


def test_a_network_without_outputs_changes_nothing():
    body = crumpled()
    config = SimulationConfig(fps=30, dtype="float64", terms=("bending",), courant=0.2)
    plain = Parameters(scattered(len(body.x0), 2e5, 1), torch.tensor(0.3), torch.tensor(0.3))
    zero = torch.zeros(RESIDUAL.weight_count, dtype=torch.float64)
    codes = torch.randn(len(body.x0), 2, generator=torch.Generator().manual_seed(15), dtype=torch.float64)
    with_network = dataclasses.replace(plain, latent_elastic=codes, network_elastic=zero)
    share = (1.0 + RESIDUAL.beta_elastic) ** 0.5
    both = dataclasses.replace(config, residual=RESIDUAL, courant=0.2 * share)
    controllers = torch.zeros(4, 0, 3)
    found, expected = (
        Simulator(body, both).rollout(with_network, controllers),
        Simulator(body, config).rollout(plain, controllers),
    )
    assert torch.equal(found.x, expected.x)


def test_a_turned_body_gets_the_turned_correction():
    body = crumpled()
    config = SimulationConfig(
        fps=100, dtype="float64", ground_height=None, gravity=(0.0, 0.0, 0.0), terms=("bending",), residual=RESIDUAL
    )
    own = {
        n: v
        for n, v in vars(parameters_of("corrected", len(body.x0))).items()
        if n in ("youngs_modulus", "poissons_ratio", *OF_RESIDUAL)
    }
    turn = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(2), dtype=torch.float64))[0]
    turn = turn * torch.linalg.det(turn)
    x0 = torch.tensor(body.x0)
    config = dataclasses.replace(config, terms=("bending", "initial_position"))
    simulator, controllers = Simulator(body, config), torch.zeros(5, 0, 3)
    lying, turned = (
        simulator.rollout(Parameters(**own, initial_position=x), controllers).x[-1] for x in (x0, x0 @ turn.T)
    )
    moved = (lying - x0).abs().max()
    assert torch.allclose(turned, lying @ turn.T, rtol=0, atol=1e-7 * float(moved))


def test_spins_follow_the_slope_of_the_energy_by_a_turn_of_directors():
    body = framed_ropes()
    rod, count = body.elements, len(body.x0)
    terms = BODIES["framed"][2]
    config = SimulationConfig(fps=1e6, dtype="float64", ground_height=None, gravity=(0.0, 0.0, 0.0), terms=terms)
    parameters = parameters_of("framed", count)
    player = Simulator(body, config).play(parameters, torch.zeros(0, 3))
    x, director = torch.tensor(body.x0), torch.tensor(rod.directors, requires_grad=True)
    framed_rod_energy(rod, x, director, rod.stiffness(parameters)).backward()
    way = x.diff(dim=0, append=x[:1])
    across = torch.linalg.cross(way / way.norm(dim=1, keepdim=True), director.detach())
    torque = -(director.grad * across).sum(1)
    begins = torch.tensor(rod.begins)
    spin = player.step(torch.zeros(0, 3)).spin * config.fps
    expected = (torque * rod.mobility(torch.tensor(body.density)))[begins]
    assert torch.allclose(spin[begins], expected, rtol=0, atol=1e-9 * float(expected.abs().max()))


def test_viscous_forces_are_the_slope_of_the_dissipation():
    body = crumpled()
    terms = BODIES["viscous"][2]
    config = SimulationConfig(fps=1e6, dtype="float64", ground_height=None, gravity=(0.0, 0.0, 0.0), terms=terms)
    v = torch.randn(body.x0.shape, generator=torch.Generator().manual_seed(3), dtype=torch.float64).requires_grad_()
    still = dataclasses.replace(parameters_of("viscous", len(body.x0)), surface_drag=None)
    moving = dataclasses.replace(still, initial_velocity=v.detach())
    simulator = Simulator(body, config)
    elastic, whole = (simulator.rollout(p, torch.zeros(2, 0, 3)).v[1] for p in (still, moving))
    stiffness = body.elements.stiffness(still)
    shell_dissipation(body.elements, torch.tensor(body.x0), v, stiffness).backward()
    force = (whole - v.detach() - elastic) * config.fps * torch.tensor(body.mass)[:, None]
    assert torch.allclose(force, -v.grad, rtol=0, atol=1e-9 * float(v.grad.abs().max()))


@pytest.mark.parametrize(("kind", "drag"), [("dragged", shell_drag), ("dragged_rod", rod_drag), ("framed", rod_drag)])
def test_drag_is_that_of_the_formula(kind, drag):
    make, _, terms = BODIES[kind]
    body = make()
    config = SimulationConfig(fps=1e6, dtype="float64", ground_height=None, gravity=(0.0, 0.0, 0.0), terms=terms)
    x = torch.tensor(body.x0)
    v = torch.randn(x.shape, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    moving = parameters_of(kind, len(x), initial_velocity=v)
    without = dataclasses.replace(moving, surface_drag=torch.zeros(len(x), dtype=torch.float64))
    if kind == "framed":  # what lags behind its moment does so by the velocity as well
        moving, without = (dataclasses.replace(p, retardation_time=torch.zeros(len(x), 2)) for p in (moving, without))
    dragged, free = (Simulator(body, config).rollout(p, torch.zeros(2, 0, 3)).v[1] for p in (moving, without))
    force = (dragged - free) * config.fps * torch.tensor(body.mass)[:, None]
    expected = drag(body.elements, x, v, moving.surface_drag)
    assert torch.allclose(force, expected, rtol=0, atol=1e-8 * float(expected.abs().max()))


def scene(kind: str, speed: tuple, friction: float):
    """A bent body that comes down on the ground, held by two moving points, with all parameters that it has."""
    make, _, own_terms = BODIES[kind]
    body = make(height=0.003)
    terms = (*own_terms, "gravity", "density", "force", "initial_position", "drag")
    courant = 0.3 if kind == "framed" else 0.4  # at 0.4 a vertex of these ropes just misses the ground
    config = SimulationConfig(fps=60, courant=courant, dtype="float64", terms=terms, residual=residual_of(kind))
    points = body.x0[[0, 8]] + np.r_[0.0, 0.0, 0.02]
    bound = np.array([0, 1, 4, 8, 9])
    owner = np.array([0, 0, 0, 1, 1])
    lengths = np.linalg.norm(body.x0[bound] - points[owner], axis=1)
    simulator = Simulator(body, config, Grip(bound, owner, np.linspace(0.5, 1.5, 5), lengths))
    count = len(body.x0)
    time = torch.linspace(0, 1, FRAMES, dtype=torch.float64)[:, None, None]
    controllers = torch.tensor(points) + time * torch.tensor([0.01, 0.005, 0.01], dtype=torch.float64)
    others = {}
    if kind == "framed":
        others["initial_director"] = torch.tensor(body.elements.directors) + 0.1 * scattered(count, 1.0, 11, 3)
    parameters = parameters_of(
        kind,
        count,
        **others,
        friction_coefficient=torch.tensor(friction, dtype=torch.float64),
        grip_stiffness=torch.tensor(0.3, dtype=torch.float64),
        grip_damping=torch.tensor(0.005, dtype=torch.float64),
        initial_velocity=torch.tensor(speed, dtype=torch.float64).expand(count, 3),
        gravity=torch.tensor([0.5, 0.0, -9.0], dtype=torch.float64),
        density=scattered(count, 300.0, 6),
        force=scattered(count, 1e-4, 7, 3),
        initial_position=torch.tensor(body.x0),
        linear_drag=scattered(count, 1e-4, 8),
        quadratic_drag=scattered(count, 1e-3, 9),
    )
    steps = {name: step for name, step in STEPS.items() if name not in ABSENT[kind]}
    return simulator, parameters, controllers, steps


def test_every_parameter_while_it_slips_over_the_ground(kind, form):
    simulator, parameters, controllers, steps = scene(kind, (0.5, 0.2, -0.2), 0.3)
    assert_adjoints_agree(directional_errors(simulator, parameters, controllers, random_loss([1, 2, 3]), steps))


def test_every_parameter_while_it_sticks_to_the_ground(kind, form):
    simulator, parameters, controllers, steps = scene(kind, (0.05, 0.02, -0.2), 1e8)
    results = directional_errors(simulator, parameters, controllers, random_loss([1, 2, 3]), steps)
    assert results.pop("friction_coefficient") == (0.0, 0.0)  # every vertex sticks
    assert_adjoints_agree(results)


def test_a_deformation_gradient_first_seen_without_gradients_has_them(kind):
    """F follows from the rest of the state where it is asked for first, which may be under `no_grad`."""
    simulator, parameters, controllers, _ = scene(kind, (0.5, 0.2, -0.2), 0.3)
    E = parameters.youngs_modulus.clone().requires_grad_()
    states = simulator.rollout(dataclasses.replace(parameters, youngs_modulus=E), controllers)
    with torch.no_grad():
        assert states.F.shape == (*states.x.shape, 3) and torch.isfinite(states.F).all()
    states.F[-1].square().sum().backward()
    assert E.grad.any()
    with torch.no_grad():
        states = simulator.rollout(parameters, controllers)
    assert not states.F.requires_grad


def test_controller_points_have_a_gradient(kind, form):
    simulator, parameters, controllers, _ = scene(kind, (0.5, 0.2, -0.2), 0.3)
    adjoint, difference = path_derivatives(simulator, parameters, controllers, random_loss([1, 2, 3]), step=1e-7)
    assert adjoint == pytest.approx(difference, rel=1e-5)


def test_a_batch_equals_single_rollouts_with_gradients(kind):
    """Also where they need different numbers of substeps; in the fused form all take the largest (cuda/test_thin.py)."""
    simulator, parameters, controllers, _ = scene(kind, (0.5, 0.2, -0.2), 0.3)
    factors = torch.tensor([0.7, 1.0, 1.6], dtype=torch.float64)
    moduli = (factors[:, None] * parameters.youngs_modulus).requires_grad_()
    batch = simulator.rollout_batch(dataclasses.replace(parameters, youngs_modulus=moduli), controllers)
    batch.x[:, -1].square().sum().backward()
    for row, factor in enumerate(factors):
        own = (factor * parameters.youngs_modulus).requires_grad_()
        alone = simulator.rollout(dataclasses.replace(parameters, youngs_modulus=own), controllers)
        alone.x[-1].square().sum().backward()
        assert torch.equal(batch.x[row], alone.x)
        assert torch.equal(batch.F[row], alone.F)
        assert torch.allclose(moduli.grad[row], own.grad, rtol=1e-9, atol=0)
