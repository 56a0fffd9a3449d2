"""The optional laws' kernels and their adjoints, held to the torch twins and torch's derivatives of them."""

import math

import numpy as np
import pytest
import torch
import warp as wp
from physreal_core.simulation.plain.particle_forces import particle_force_kernels
from physreal_core.simulation.plain.stress_terms import stress_term_kernels

from physreal_core.simulation import term_laws
from physreal_core.simulation.scalars import scalar_types
from tests.simulation.constitutive.points import generic_points

wp.init()  # before tensors are wrapped for it

COUNT = 40
TYPES = scalar_types("float64")
VECTORS = {(): TYPES.scalar, (2,): TYPES.vec2, (3,): TYPES.vec3, (3, 3): TYPES.mat33}
CAPSULES = {
    "post": (0.1, -0.1, 0.2, 0.3, 0.1, 0.5, 0.8, 900.0),
    "ball": (0.1, -0.1, 0.2, 0.0, 0.0, 0.0, 0.9, 900.0),
}


def random(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def wrapped(tensor: torch.Tensor, slots: bool = False) -> wp.array:
    """[N, ...] as a Warp array of vectors; [1, N, ...] as one slot of a state."""
    tensor = tensor.detach().contiguous()
    return wp.from_torch(tensor[None] if slots else tensor, VECTORS[tuple(tensor.shape[1:])])


def assert_law(law, forward, adjoint, inputs: dict[str, torch.Tensor], states: tuple[str, ...]) -> None:
    """`forward(slot, *inputs, out)` is law(**inputs), and `adjoint` its vector-Jacobian product; both add.

    The adjoint takes the inputs, the result's adjoint, and bars of the inputs, those of the states first. An input of one
    entry is for all particles, its bar one for each.
    """
    leaves = {name: value.clone().requires_grad_() for name, value in inputs.items()}
    expected = law(**leaves)
    seed = random(*expected.shape, seed=9)
    (expected * seed).sum().backward()
    stress = expected.ndim == 3
    arguments = [wrapped(value, name in states) for name, value in inputs.items()]
    before = random(*expected.shape, seed=8)
    out = before.clone()
    wp.launch(forward, COUNT, inputs=[0, *arguments, wrapped(out, stress)], device="cpu")
    expected = expected.detach()
    torch.testing.assert_close(out - before, expected, rtol=1e-11, atol=1e-11 * float(expected.abs().max()))

    order = [name for name in inputs if name in states] + [name for name in inputs if name not in states]
    bars = {name: torch.ones(COUNT, *inputs[name].shape[1:], dtype=torch.float64) for name in order}
    given = [*arguments, wrapped(seed), *(wrapped(bar) for bar in bars.values())]
    wp.launch(adjoint, COUNT, inputs=[0, *given], device="cpu")
    for name, bar in bars.items():
        found = (bar - 1.0).sum(0, keepdim=True) if len(inputs[name]) == 1 else bar - 1.0
        scale = float(leaves[name].grad.abs().max())
        torch.testing.assert_close(found, leaves[name].grad, rtol=1e-10, atol=1e-11 * scale, msg=name)


def test_drag():
    kernels = particle_force_kernels("float64")
    v = random(COUNT, 3)
    v[0] = 0.0  # |v| has no derivative there, the force has
    inputs = {"linear": random(COUNT, seed=1).abs(), "quadratic": random(COUNT, seed=2).abs(), "v": v}
    assert_law(term_laws.drag, kernels.drag, kernels.drag_adjoint, inputs, ("v",))


def test_adhesion():
    kernels = particle_force_kernels("float64")
    inputs = {
        "peak": random(COUNT).abs(),
        "reach": torch.tensor([0.7], dtype=torch.float64),
        "start": random(COUNT, 3, seed=1),
        "x": random(COUNT, 3, seed=2),
    }

    def law(peak, reach, start, x):
        return term_laws.adhesion((x - start)[:, 2], peak, reach)

    assert_law(law, kernels.adhesion, kernels.adhesion_adjoint, inputs, ("x",))


def test_adhesion_is_a_cohesive_zone():
    """The largest pull is `peak` at u = `reach`, and the work of separation e times their product."""
    height = torch.linspace(0, 0.1, 200001, dtype=torch.float64)
    pull = -term_laws.adhesion(height, torch.tensor(3.0), torch.tensor(0.002))[:, 2]
    assert float(pull.max()) == pytest.approx(3.0, rel=1e-6)
    assert float(height[pull.argmax()]) == pytest.approx(0.002, rel=1e-3)
    assert float(torch.trapezoid(pull, height)) == pytest.approx(math.e * 3.0 * 0.002, rel=1e-5)


@pytest.mark.parametrize("kind", CAPSULES)
def test_obstacle(kind):
    kernels = particle_force_kernels("float64")
    x, mass = 0.5 * random(COUNT, 3), random(COUNT, seed=1).abs()
    capsule = torch.tensor(CAPSULES[kind], dtype=torch.float64)
    leaves = [x.clone().requires_grad_(), mass.clone().requires_grad_(), capsule.clone().requires_grad_()]
    expected, seed = term_laws.obstacle(*leaves), random(COUNT, 3, seed=9)
    (expected * seed).sum().backward()
    touching = (expected.detach() != 0).any(1)
    assert 5 < int(touching.sum()) < COUNT  # some are in it, some are not
    force = torch.zeros(COUNT, 3, dtype=torch.float64)
    model = [wp.from_torch(capsule), wrapped(mass), wrapped(x, True)]
    wp.launch(kernels.obstacle, COUNT, inputs=[0, *model, wrapped(force)], device="cpu")
    torch.testing.assert_close(force, expected.detach(), rtol=1e-12, atol=1e-12)
    x_bar, mass_bar, capsule_bar = torch.zeros_like(x), torch.zeros_like(mass), torch.zeros(COUNT, 8).double()
    given = [wrapped(seed), wrapped(x_bar), wrapped(mass_bar), wp.from_torch(capsule_bar)]
    wp.launch(kernels.obstacle_adjoint, COUNT, inputs=[0, *model, *given], device="cpu")
    torch.testing.assert_close(x_bar, leaves[0].grad, rtol=1e-9, atol=1e-10)
    torch.testing.assert_close(mass_bar, leaves[1].grad, rtol=1e-9, atol=1e-10)
    expected_bar = leaves[2].grad
    if kind == "ball":  # a sphere has no axis: the derivative by it starts with its square
        expected_bar = torch.cat([expected_bar[:3], capsule_bar.sum(0)[3:6], expected_bar[6:]])
    torch.testing.assert_close(capsule_bar.sum(0), expected_bar, rtol=1e-9, atol=1e-8)


def test_obstacle_pushes_outwards_by_depth():
    """A ball of radius 0.9: at 0.5 from its middle the acceleration is k 0.4, away from it; outside it is zero."""
    capsule = torch.tensor(CAPSULES["ball"], dtype=torch.float64)
    centre, mass = capsule[:3], torch.tensor([2.0, 2.0], dtype=torch.float64)
    x = centre + torch.tensor([[0.0, 0.5, 0.0], [0.0, 0.0, 0.91]], dtype=torch.float64)
    force = term_laws.obstacle(x, mass, capsule)
    expected = torch.tensor([[0.0, 2.0 * 900.0 * 0.4, 0.0], [0.0, 0.0, 0.0]], dtype=torch.float64)
    torch.testing.assert_close(force, expected, rtol=1e-9, atol=1e-9)


def stretches() -> torch.Tensor:
    """Random F, one of them 1."""
    F = generic_points(COUNT - 1, np.random.default_rng(0))
    return torch.as_tensor(np.concatenate([np.eye(3)[None], F]))


def test_viscosity():
    kernels = stress_term_kernels("float64")
    rate = random(COUNT, 3, 3)
    inputs = {"coefficients": random(COUNT, 2, seed=1).abs(), "F": stretches(), "rate": rate + rate.mT}

    def law(coefficients, F, rate):  # the rate is symmetric, and so is its adjoint
        return term_laws.viscosity(F, (rate + rate.mT) / 2, coefficients)

    assert_law(law, kernels.viscosity, kernels.viscosity_adjoint, inputs, ("F", "rate"))


def test_stiffening():
    kernels = stress_term_kernels("float64")
    inputs = {"modulus": random(COUNT, seed=1).abs(), "F": stretches()}
    assert_law(term_laws.stiffening, kernels.stiffening, kernels.stiffening_adjoint, inputs, ("F",))


def test_fibres():
    kernels = stress_term_kernels("float64")
    inputs = {"modulus": random(COUNT, seed=1).abs(), "direction": random(COUNT, 3, seed=2), "F": stretches()}
    assert_law(term_laws.fibres, kernels.fibres, kernels.fibres_adjoint, inputs, ("F",))


ENERGIES = {
    "stiffening": lambda F, c: c * (torch.linalg.det(F) ** (-2 / 3) * F.square().sum((-2, -1)) - 3.0) ** 2,
    "fibres": lambda F, k: k / 8 * ((F @ torch.tensor([0.6, 0.0, 0.8]).double()).square().sum(-1) - 1.0) ** 2,
}


@pytest.mark.parametrize("law", ENERGIES)
def test_stress_is_the_energys(law):
    """tau = dW/dF F^T, of the energies that the laws are named after."""
    F, modulus = stretches().requires_grad_(), random(COUNT, seed=1).abs()
    (P,) = torch.autograd.grad(ENERGIES[law](F, modulus).sum(), F)
    direction = () if law == "stiffening" else (torch.tensor([0.6, 0.0, 0.8]).double().expand(COUNT, 3),)
    tau = getattr(term_laws, law)(F, modulus, *direction)
    torch.testing.assert_close(tau, P @ F.mT, rtol=1e-10, atol=1e-10)
