"""Elastic experts in both number types: torch twins, finite differences, objectivity, linear elasticity at small strain."""

import numpy as np
import pytest
import torch

from physreal_core.simulation.laws import ELASTIC_LAWS, reference
from tests.simulation.laws.driver import elastic
from tests.simulation.laws.points import directional, generic_points, inner, rotations, special_points

LAWS = sorted(ELASTIC_LAWS)
E0, NU0 = 3.0, 0.3


def material(count: int) -> tuple[np.ndarray, np.ndarray]:
    return np.linspace(E0, 2 * E0, count), np.linspace(0.05, 0.45, count)


def points() -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.concatenate([special_points(rng), generic_points(40, rng)])


@pytest.mark.parametrize("law", LAWS)
def test_values_are_those_of_the_torch_twin(law, form):
    F = points()
    E, nu = material(len(F))
    seed = np.random.default_rng(2).normal(size=F.shape)
    out = elastic(law, form)(F, E, nu, seed)
    twin = getattr(reference, law)(torch.tensor(F), torch.tensor(E), torch.tensor(nu)).numpy()
    np.testing.assert_allclose(out.tau, twin, atol=1e-12 * abs(twin).max())


@pytest.mark.parametrize("law", LAWS)
def test_gradients_are_those_of_torch_where_singular_values_differ(law, form):
    rng = np.random.default_rng(3)
    F = generic_points(40, rng)
    E, nu = material(len(F))
    seed = rng.normal(size=F.shape)
    out = elastic(law, form)(F, E, nu, seed)
    leaves = [torch.tensor(a, requires_grad=True) for a in (F, E, nu)]
    getattr(reference, law)(*leaves).backward(torch.tensor(seed))
    for ours, leaf in zip((out.F_bar, out.E_bar, out.nu_bar), leaves, strict=True):
        np.testing.assert_allclose(ours, leaf.grad.numpy(), rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_adjoint_agrees_with_finite_differences_everywhere(law, form):
    F = points()
    E, nu = material(len(F))
    rng = np.random.default_rng(4)
    seed = rng.normal(size=F.shape)
    evaluate = elastic(law, form)
    out = evaluate(F, E, nu, seed)
    # a step relative to the smallest singular value: the laws curve on that scale near inversion
    smallest = np.linalg.svd(F)[1].min(1)[:, None, None]
    direction = rng.normal(size=F.shape) * smallest
    measured = directional(lambda x: evaluate(x, E, nu, seed).tau, F, direction, seed, 1e-3)
    scale = np.linalg.norm((out.F_bar * smallest).reshape(len(F), -1), axis=1)
    assert np.max(abs(measured - inner(out.F_bar, direction)) / scale) < 1e-6
    ones = np.ones(len(F))
    for values, bar in (
        (directional(lambda x: evaluate(F, x, nu, seed).tau, E, ones, seed, 1e-3), out.E_bar),
        (directional(lambda x: evaluate(F, E, x, seed).tau, nu, ones, seed, 1e-4), out.nu_bar),
    ):
        np.testing.assert_allclose(values, bar, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_stress_turns_with_the_body_and_is_symmetric(law, form):
    F = points()
    E, nu = material(len(F))
    Q = rotations(len(F), np.random.default_rng(5))
    tau = elastic(law, form)(F, E, nu, F).tau
    turned = elastic(law, form)(Q @ F, E, nu, F).tau
    scale = abs(tau).max((1, 2), keepdims=True) + E[:, None, None]
    assert np.max(abs(turned - Q @ tau @ Q.transpose(0, 2, 1)) / scale) < 1e-13
    assert np.max(abs(tau - tau.transpose(0, 2, 1)) / scale) < 1e-13


@pytest.mark.parametrize("law", LAWS)
def test_isotropy_rotating_the_rest_shape_changes_nothing(law, form):
    F = points()
    E, nu = material(len(F))
    Q = rotations(len(F), np.random.default_rng(6))
    tau = elastic(law, form)(F, E, nu, F).tau
    scale = abs(tau).max((1, 2), keepdims=True) + E[:, None, None]
    assert np.max(abs(elastic(law, form)(F @ Q, E, nu, F).tau - tau) / scale) < 1e-13


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_no_stress_without_strain(law, dtype, form):
    rng = np.random.default_rng(7)
    turned = rotations(20, rng)
    F = np.concatenate([np.eye(3)[None], turned])
    E, nu = np.full(len(F), E0), np.full(len(F), NU0)
    tau = elastic(law, form, dtype)(F, E, nu, F).tau
    assert (tau[0] == 0).all()
    # a rotation rounded to the scalar type is itself a strain of the order of its rounding
    assert abs(tau).max() < 20 * E0 * np.finfo(dtype).eps


@pytest.mark.parametrize("law", LAWS)
def test_small_strain_is_linear_elasticity(law, form):
    rng = np.random.default_rng(8)
    size = 1e-6
    gradient = rng.normal(size=(30, 3, 3))
    E, nu = material(30)
    tau = elastic(law, form)(np.eye(3) + size * gradient, E, nu, gradient).tau / size
    strain = (gradient + gradient.transpose(0, 2, 1)) / 2
    mu, lam = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    trace = np.trace(strain, axis1=1, axis2=2)
    linear = 2 * mu[:, None, None] * strain + (lam * trace)[:, None, None] * np.eye(3)
    # the laws differ from it in second order: relative 1e-6 times a constant
    np.testing.assert_allclose(tau, linear, atol=50 * size * abs(linear).max())


@pytest.mark.parametrize("law", LAWS)
def test_uniaxial_stress_at_small_strain_gives_youngs_modulus_and_poissons_ratio(law, form):
    e = 1e-6
    F = np.diag([1 + e, 1 - NU0 * e, 1 - NU0 * e])[None]
    tau = elastic(law, form)(F, np.array([E0]), np.array([NU0]), F).tau[0] / e
    np.testing.assert_allclose(tau, np.diag([E0, 0, 0]), atol=1e-5 * E0)


@pytest.mark.parametrize("law", LAWS)
def test_float32_is_float64_to_its_rounding(law, form):
    rng = np.random.default_rng(9)
    F = np.concatenate([special_points(rng), generic_points(200, rng)])
    sigma = np.linalg.svd(F)[1]
    F = F[sigma.min(1) > 0.1]  # below, float32's rounding of F itself is amplified by the condition number
    E, nu = material(len(F))
    seed = rng.normal(size=F.shape)
    wide, narrow = elastic(law, form)(F, E, nu, seed), elastic(law, form, "float32")(F, E, nu, seed)
    for name, tolerance in (("tau", 5e-6), ("F_bar", 2e-5), ("E_bar", 1e-5), ("nu_bar", 1e-5)):
        a, b = getattr(wide, name), getattr(narrow, name)
        size = np.abs(a).reshape(len(F), -1).max(1) + np.abs(a).mean()
        error = np.abs(a - b).reshape(len(F), -1).max(1) / size
        assert error.max() < tolerance, f"{name}: {error.max():.1e}"


@pytest.mark.parametrize("law", LAWS)
def test_an_inverted_or_flattened_particle_has_no_finite_stress(law, form):
    F = np.array([np.diag([1.0, 1.0, -1.0]), np.diag([0.5, -1.0, 2.0]), np.diag([1.0, 1.0, 0.0])])
    E, nu = np.full(3, E0), np.full(3, NU0)
    tau = elastic(law, form)(F, E, nu, F).tau
    assert (~np.isfinite(tau)).any(axis=(1, 2)).all()
