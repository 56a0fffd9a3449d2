"""The optional laws in both number types, and friction: values and adjoints are those of the torch twins."""

import math

import numpy as np
import pytest
import torch

from physreal_core.simulation.laws import terms_reference
from physreal_core.simulation.solids import Solids
from tests.simulation.laws.driver import DTYPES, branch, friction, term
from tests.simulation.laws.points import generic_points

COUNT = 40
TOLERANCE = {"float64": (1e-11, 1e-10, 1e-11), "float32": (2e-5, 2e-5, 2e-5)}
"""Relative to the number itself, of values and of adjoints; and to the largest."""
CAPSULES = {
    "post": (0.1, -0.1, 0.2, 0.3, 0.1, 0.5, 0.8, 900.0),
    "ball": (0.1, -0.1, 0.2, 0.0, 0.0, 0.0, 0.9, 900.0),
}


def random(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def stretches() -> torch.Tensor:
    """Random F, one of them 1."""
    F = generic_points(COUNT - 1, np.random.default_rng(0))
    return torch.as_tensor(np.concatenate([np.eye(3)[None], F]))


def assert_close(found: np.ndarray, expected: torch.Tensor, relative: float, of_largest: float, name: str) -> None:
    expected = expected.detach().numpy()
    np.testing.assert_allclose(found, expected, rtol=relative, atol=of_largest * abs(expected).max(), err_msg=name)


def assert_law(
    law, name: str, form: str, dtype: str, inputs: dict[str, torch.Tensor], device: str = "cpu", **around: Solids
) -> None:
    """The header of `name` is law(**inputs), with its vector-Jacobian product; nothing else has an adjoint."""
    leaves = {key: value.to(getattr(torch, dtype)).double().requires_grad_() for key, value in inputs.items()}
    expected = law(**leaves)
    seed = random(*expected.shape, seed=9).to(getattr(torch, dtype)).double()
    (expected * seed).sum().backward()
    values = {key: leaf.detach().numpy() for key, leaf in leaves.items()}
    found = term(name, form, dtype, device, **around)(seed.numpy(), **values)
    of_value, of_adjoint, of_largest = TOLERANCE[dtype]
    assert_close(found.value, expected, of_value, of_largest, name)
    for key, bar in found.bars.items():
        if key in inputs:
            assert_close(bar, leaves[key].grad, of_adjoint, of_largest, key)
        else:
            assert not bar.any(), key


def drag_case() -> tuple:
    v = random(COUNT, 3)
    v[0] = 0.0  # |v| has no derivative there, the force has
    inputs = {"linear_drag": random(COUNT, seed=1).abs(), "quadratic_drag": random(COUNT, seed=2).abs(), "v": v}
    return lambda linear_drag, quadratic_drag, v: terms_reference.drag(v, linear_drag, quadratic_drag), inputs


def adhesion_case() -> tuple:
    inputs = {
        "adhesion": random(COUNT).abs(),
        "adhesion_range": torch.tensor([0.7], dtype=torch.float64),
        "start_height": random(COUNT, seed=1),
        "x": random(COUNT, 3, seed=2),
    }
    return lambda adhesion, adhesion_range, start_height, x: terms_reference.adhesion(
        x[:, 2] - start_height, adhesion, adhesion_range
    ), inputs


def obstacle_case() -> tuple:
    capsule = torch.tensor(CAPSULES["post"], dtype=torch.float64)
    inputs = {"x": 0.5 * random(COUNT, 3), "mass": random(COUNT, seed=1).abs(), "obstacle": capsule}
    return lambda x, mass, obstacle: terms_reference.obstacle(x, mass, obstacle), inputs


def viscosity_case() -> tuple:
    rate = random(COUNT, 3, 3)
    inputs = {"viscosity": random(COUNT, 2, seed=1).abs(), "F": stretches(), "rate": rate + rate.mT}

    def law(viscosity, F, rate):  # the rate is symmetric, and so is its adjoint
        return terms_reference.viscosity(F, (rate + rate.mT) / 2, viscosity)

    return law, inputs


def stiffening_case() -> tuple:
    inputs = {"stiffening": random(COUNT, seed=1).abs(), "F": stretches()}
    return lambda stiffening, F: terms_reference.stiffening(F, stiffening), inputs


def fibres_case() -> tuple:
    inputs = {
        "fibre_modulus": random(COUNT, seed=1).abs(),
        "fibre_direction": random(COUNT, 3, seed=2),
        "F": stretches(),
    }
    return lambda fibre_modulus, fibre_direction, F: terms_reference.fibres(F, fibre_modulus, fibre_direction), inputs


def branch_strains(count: int) -> torch.Tensor:
    """b - 1 of isochoric b, one of them relaxed."""
    F = generic_points(count * COUNT - 1, np.random.default_rng(4))
    F = torch.as_tensor(np.concatenate([np.eye(3)[None], F])).unflatten(0, (COUNT, count))
    b = torch.linalg.det(F)[..., None, None] ** (-2 / 3) * F @ F.mT
    return b - torch.eye(3).double()


def branches_case(name: str, count: int) -> tuple:
    shape = (COUNT,) if count == 1 else (COUNT, count)
    inputs = {f"{name}_modulus": random(*shape, seed=1).abs(), "branches": branch_strains(count)}

    def law(branches, **modulus):  # the strains are symmetric, and so are their adjoints
        (m,) = modulus.values()
        return terms_reference.branches((branches + branches.mT) / 2, m.reshape(COUNT, count))

    return law, inputs


CASES = {
    "relaxation": lambda: branches_case("relaxation", 1),
    "hysteresis": lambda: branches_case("hysteresis", 3),
    "drag": drag_case,
    "adhesion": adhesion_case,
    "obstacle": obstacle_case,
    "viscosity": viscosity_case,
    "stiffening": stiffening_case,
    "fibres": fibres_case,
}


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("name", CASES)
def test_value_and_adjoint_are_those_of_the_torch_twin(name, dtype, form):
    law, inputs = CASES[name]()
    assert_law(law, name, form, dtype, inputs)


def ball_and_corner() -> Solids:
    """A ball beside a box, whose surfaces meet, on a lattice whose places are not round numbers."""
    x = np.stack(np.meshgrid(*(0.13 * np.arange(n) - 1.4 for n in (22, 23, 24)), indexing="ij"), -1)
    box = np.abs(x - [0.4, 0.0, 0.0]) - [0.5, 0.6, 0.4]
    out = np.linalg.norm(np.maximum(box, 0.0), axis=-1) + np.minimum(box.max(-1), 0.0)
    return Solids(np.minimum(out, np.linalg.norm(x + [0.4, 0.1, 0.0], axis=-1) - 0.6), x[0, 0, 0], 0.13)


@pytest.mark.parametrize("dtype", DTYPES)
def test_solids(dtype, form):
    around = ball_and_corner()
    inputs = {
        "x": 0.6 * random(COUNT, 3),
        "v": random(COUNT, 3, seed=1),
        "mass": random(COUNT, seed=2).abs(),
        "solid_reach": 0.1 + 0.2 * random(COUNT, seed=3).abs(),
        "solid_stiffness": torch.tensor([30.0], dtype=torch.float64),
        "solid_friction": torch.tensor([0.4], dtype=torch.float64),
    }

    def law(x, v, mass, solid_reach, solid_stiffness, solid_friction):
        distance = around.at(x)
        return terms_reference.solids(distance, x, v, mass, solid_reach, solid_stiffness, solid_friction)

    depth = inputs["solid_reach"] - around.at(inputs["x"])
    assert 5 < int((depth > 0).sum()) < COUNT  # some are in it, some are not
    assert_law(law, "solids", form, dtype, inputs, solids=around)


def test_the_distance_from_solids_is_exact_at_planes_and_near_it_elsewhere():
    around = ball_and_corner()
    x = torch.tensor([[0.97, 0.1, 0.0], [0.5, 0.7, 0.0], [-1.1, -0.1, 0.0], [5.0, 0.0, 0.0]], dtype=torch.float64)
    found = around.at(x)
    assert found[:2].tolist() == pytest.approx([0.07, 0.1], abs=1e-12)
    assert float(found[2]) == pytest.approx(0.1, abs=0.13**2 / 8 * 2 / 0.6 + 1e-3)  # of a ball by half of its curvature
    assert found[3] == math.inf


def assert_branch_step(form: str, dtype: str, device: str = "cpu") -> None:
    dt, time = 0.03, 0.05
    as_dtype = getattr(torch, dtype)
    A, step = (a.to(as_dtype).double() for a in (branch_strains(1)[:, 0], 0.1 * random(COUNT, 3, 3, seed=5)))
    seed = random(COUNT, 3, 3, seed=9).to(as_dtype).double()
    leaves = [a.clone().requires_grad_() for a in (A, step, torch.tensor(time, dtype=torch.float64))]
    kept = (-0.5 * dt / leaves[2]).exp()
    expected = terms_reference.branch_step((leaves[0] + leaves[0].mT) / 2, leaves[1], kept)
    (expected * seed).sum().backward()
    found = branch(form, dtype, device)(A.numpy(), step.numpy(), dt, time, seed.numpy())
    of_value, of_adjoint, of_largest = TOLERANCE[dtype]
    assert_close(found.value, expected, of_value, of_largest, "value")
    for name, leaf in zip(("A_bar", "step_bar", "time_bar"), leaves, strict=True):
        assert_close(getattr(found, name), leaf.grad, of_adjoint, of_largest, name)


@pytest.mark.parametrize("dtype", DTYPES)
def test_the_step_of_a_branch_is_the_torch_twins(form, dtype):
    assert_branch_step(form, dtype)


def test_stress_relaxes_as_in_zeners_solid(form):
    """A sudden simple shear that is held: the shear stress begins (1 + g) times the elastic one and fades to it over the time.

    The elastic one is that of neo-Hookean elasticity, whose shear stress is mu times the shear; so is the branch's.
    """
    shear, mu, share, time, dt = 0.4, 3.0, 0.7, 0.2, 0.004
    step = np.zeros((1, 3, 3))
    step[0, 0, 1] = shear
    A, found = np.zeros((1, 3, 3)), []
    for number in range(100):
        # the strain comes within an instant, the rest of the time is without motion
        length = 1e-12 if number == 0 else dt
        A = branch(form)(A, step if number == 0 else 0 * step, length, time, A).value
        tau = term("relaxation", form)(A, relaxation_modulus=np.array([share * mu]), branches=A[:, None]).value
        found.append(mu * shear + tau[0, 0, 1])
    t = dt * np.arange(100)
    np.testing.assert_allclose(found, mu * shear * (1 + share * np.exp(-t / time)), rtol=1e-9)


def test_a_small_strain_of_a_branch_is_not_rounded_away(form):
    """Steps of 1e-5 in float32: a step's strain keeps the accuracy that float32 gives small numbers."""
    step = (1e-5 * random(COUNT, 3, 3)).float().double()
    A = torch.zeros(COUNT, 3, 3, dtype=torch.float64)
    expected = terms_reference.branch_step(A, step, torch.tensor(1.0))
    found = branch(form, "float32")(A.numpy(), step.numpy(), 1e-9, 1.0, A.numpy()).value
    off = np.array([[0, 1, 1], [1, 0, 1], [1, 1, 0]], bool)
    error = (found - expected.numpy())[:, off]
    assert abs(error).max() < 1e-11


def test_the_strain_of_a_branch_is_that_of_the_deformation_where_it_does_not_relax():
    """Many steps of a rotating, shearing motion: b is F F^T less its volume."""
    F, A = (torch.eye(3, dtype=torch.float64), torch.zeros(3, 3, dtype=torch.float64))
    for step in 0.02 * random(60, 3, 3, seed=3):
        F, A = F + step @ F, terms_reference.branch_step(A, step, torch.tensor(1.0))
    b = torch.linalg.det(F) ** (-2 / 3) * F @ F.mT
    torch.testing.assert_close(A, b - torch.eye(3).double(), rtol=1e-12, atol=1e-12)


def test_a_branch_is_objective():
    """Seen by an observer who turns by Q_n until substep n, the strain is Q A Q^T and the stress Q tau Q^T."""
    one = torch.eye(3, dtype=torch.float64)
    A = turned = torch.zeros(3, 3, dtype=torch.float64)
    Q, kept, modulus = one, torch.tensor(0.97).double(), torch.tensor([2.0]).double()
    for step, spin in zip(0.03 * random(40, 3, 3, seed=3), 0.1 * random(40, 3, 3, seed=4), strict=True):
        following = torch.linalg.matrix_exp(spin - spin.mT) @ Q
        A = terms_reference.branch_step(A, step, kept)
        turned = terms_reference.branch_step(turned, following @ (one + step) @ Q.mT - one, kept)
        Q = following
    torch.testing.assert_close(turned, Q @ A @ Q.mT, rtol=1e-12, atol=1e-12)
    stresses = [terms_reference.branches(a[None], modulus) for a in (turned, A)]
    torch.testing.assert_close(stresses[0], Q @ stresses[1] @ Q.mT, rtol=1e-12, atol=1e-12)


def test_a_branch_never_gives_more_than_it_took():
    """What is left of the work done on it, over any motion, is no less than its energy 1/2 (tr b - 3 - log det b).

    The work of a substep is the energy that carrying b along adds; relaxation, before and after, only takes from it.
    """
    one, kept = torch.eye(3, dtype=torch.float64), torch.tensor(0.9).double()
    A = torch.zeros(200, 3, 3, dtype=torch.float64)

    def energy(A: torch.Tensor) -> torch.Tensor:
        b = one + A
        return 0.5 * (b.diagonal(dim1=-2, dim2=-1).sum(-1) - 3.0 - torch.linalg.slogdet(b)[1])

    lost = torch.zeros(200, dtype=torch.float64)
    for number in range(50):
        step = 0.1 * random(200, 3, 3, seed=number)
        before, half = A, kept * A
        pushed = terms_reference.branch_step(half, step, torch.tensor(1.0).double())
        A = terms_reference.branch_step(before, step, kept)
        torch.testing.assert_close(A, kept * pushed)
        assert (torch.linalg.eigvalsh(one + A) > 0).all()
        for earlier, later in ((before, half), (pushed, A)):
            taken = energy(earlier) - energy(later)
            assert (taken >= -1e-14).all()
            lost += taken
    assert (lost > 0.1).all()


def test_the_stress_of_a_branch_is_its_energys():
    """The energy that a small step of strain adds to a relaxing branch is tau : D dt."""
    one, A = torch.eye(3, dtype=torch.float64), branch_strains(1)[:, 0]
    step = torch.zeros(COUNT, 3, 3, dtype=torch.float64, requires_grad=True)
    b = one + terms_reference.branch_step(A, step, torch.tensor(1.0).double())
    energy = 0.5 * (b.diagonal(dim1=-2, dim2=-1).sum(-1) - 3.0 - torch.linalg.slogdet(b)[1])
    (power,) = torch.autograd.grad(energy.sum(), step)
    tau = terms_reference.branches(A[:, None], torch.ones(COUNT, 1, dtype=torch.float64))
    torch.testing.assert_close(power, tau, rtol=1e-10, atol=1e-10)


def test_adhesion_is_a_cohesive_zone():
    """The largest pull is `peak` at u = `reach`, and the work of separation e times their product."""
    height = torch.linspace(0, 0.1, 200001, dtype=torch.float64)
    pull = -terms_reference.adhesion(height, torch.tensor(3.0), torch.tensor(0.002))[:, 2]
    assert float(pull.max()) == pytest.approx(3.0, rel=1e-6)
    assert float(height[pull.argmax()]) == pytest.approx(0.002, rel=1e-3)
    assert float(torch.trapezoid(pull, height)) == pytest.approx(math.e * 3.0 * 0.002, rel=1e-5)


@pytest.mark.parametrize("kind", CAPSULES)
def test_obstacle(kind, form):
    x, mass = 0.5 * random(COUNT, 3), random(COUNT, seed=1).abs()
    capsule = torch.tensor(CAPSULES[kind], dtype=torch.float64)
    leaves = [x.clone().requires_grad_(), mass.clone().requires_grad_(), capsule.clone().requires_grad_()]
    expected, seed = terms_reference.obstacle(*leaves), random(COUNT, 3, seed=9)
    (expected * seed).sum().backward()
    touching = (expected.detach() != 0).any(1)
    assert 5 < int(touching.sum()) < COUNT  # some are in it, some are not
    found = term("obstacle", form)(seed.numpy(), x=x.numpy(), mass=mass.numpy(), obstacle=capsule.numpy())
    np.testing.assert_allclose(found.value, expected.detach().numpy(), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found.bars["x"], leaves[0].grad.numpy(), rtol=1e-9, atol=1e-10)
    np.testing.assert_allclose(found.bars["mass"], leaves[1].grad.numpy(), rtol=1e-9, atol=1e-10)
    expected_bar = leaves[2].grad.numpy()
    if kind == "ball":  # a sphere has no axis: the derivative by it starts with its square
        expected_bar[3:6] = found.bars["obstacle"][3:6]
    np.testing.assert_allclose(found.bars["obstacle"], expected_bar, rtol=1e-9, atol=1e-8)


def test_obstacle_pushes_outwards_by_depth(form):
    """A ball of radius 0.9: at 0.5 from its middle the acceleration is k 0.4, away from it; outside it is zero."""
    capsule = np.array(CAPSULES["ball"])
    x = capsule[:3] + np.array([[0.0, 0.5, 0.0], [0.0, 0.0, 0.91]])
    expected = [[0.0, 2.0 * 900.0 * 0.4, 0.0], [0.0, 0.0, 0.0]]
    of_twin = terms_reference.obstacle(*(torch.as_tensor(a) for a in (x, np.full(2, 2.0), capsule)))
    of_header = term("obstacle", form)(np.ones((2, 3)), x=x, mass=np.full(2, 2.0), obstacle=capsule).value
    for force in (of_twin.numpy(), of_header):
        np.testing.assert_allclose(force, expected, rtol=1e-9, atol=1e-9)


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
    tau = getattr(terms_reference, law)(F, modulus, *direction)
    torch.testing.assert_close(tau, P @ F.mT, rtol=1e-10, atol=1e-10)


FRICTIONS = {
    "static peak": (0.3, 0.2, 0.05),
    "a slope that ends at zero": (0.2, 0.3, -0.6),
    "Coulomb's": (0.0, 0.01, 0.0),
}


def assert_friction(kind: str, dtype: str, device: str = "cpu") -> None:
    rng = np.random.default_rng(3)
    dynamic, law, speed, seed = (
        np.asarray(a, dtype).astype(np.float64)
        for a in (0.4, FRICTIONS[kind], rng.uniform(0.0, 2.0, COUNT), rng.normal(size=COUNT))
    )
    leaves = [torch.tensor(a, requires_grad=True) for a in (dynamic, law, speed)]
    expected = terms_reference.friction_coefficient(*leaves)
    assert bool((expected == 0).any()) == (kind == "a slope that ends at zero")
    (expected * torch.tensor(seed)).sum().backward()
    found = friction(dtype, device)(dynamic, law, speed, seed)
    of_value, of_adjoint, of_largest = TOLERANCE[dtype]
    assert_close(found.value, expected, of_value, of_largest, "value")
    for name, leaf in zip(("dynamic_bar", "law_bar", "speed_bar"), leaves, strict=True):
        assert_close(getattr(found, name), leaf.grad, of_adjoint, of_largest, name)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("kind", FRICTIONS)
def test_friction_is_the_torch_twins(kind, dtype):
    """Of one node at a time: no form of the step has friction on lanes."""
    assert_friction(kind, dtype)
