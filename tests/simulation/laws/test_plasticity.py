"""Plastic experts in both number types: elastic domain, surface, objectivity, adjoints on both sides of the kink."""

import math

import numpy as np
import pytest
import torch

from physreal_core.simulation.laws import PLASTIC_LAWS, reference
from tests.simulation.laws.driver import plastic
from tests.simulation.laws.points import directional, generic_points, inner, rotations, special_points

LAWS = sorted(set(PLASTIC_LAWS) - {"identity"})
PARAMETERS = {"von_mises": (0.3, 0.02), "drucker_prager": (0.6, 0.1)}
RATE_INDEPENDENT = {"von_mises": (0.3, 0.0), "drucker_prager": (0.6, 0.1)}
DT = 0.01


def points() -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.concatenate([special_points(rng), generic_points(40, rng), 0.8 * generic_points(20, rng)])


def arguments(law: str, F: np.ndarray, parameters: dict = PARAMETERS) -> tuple[np.ndarray, ...]:
    n = len(F)
    return F, np.linspace(2, 4, n), np.linspace(0.1, 0.4, n), np.tile(parameters[law], (n, 1)), np.full(n, DT)


def apply(law: str, form: str, args: tuple[np.ndarray, ...]) -> np.ndarray:
    return plastic(law, form)(*args, args[0]).F_new


def over_yield(law: str, F: np.ndarray, E: np.ndarray, nu: np.ndarray, y: np.ndarray, _: np.ndarray) -> np.ndarray:
    """Yield function [Pa] of the Hencky stress, positive outside, in the textbooks' invariants."""
    mu, lam = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    eps = np.log(np.linalg.svd(F)[1])
    tau = 2 * mu[:, None] * eps + (lam * eps.sum(1))[:, None]
    s = tau - tau.mean(1, keepdims=True)
    J2 = (s * s).sum(1) / 2
    if law == "von_mises":
        return np.sqrt(3 * J2) - y[:, 0]
    sine, cosine = np.sin(y[:, 0]), np.cos(y[:, 0])
    slope, cohesion = 2 * sine / (math.sqrt(3) * (3 - sine)), 6 * y[:, 1] * cosine / (math.sqrt(3) * (3 - sine))
    return np.maximum(np.sqrt(J2) + slope * tau.sum(1) - cohesion, tau.sum(1) - cohesion / slope)


@pytest.mark.parametrize("law", LAWS)
def test_values_are_those_of_the_torch_twin(law, form):
    args = arguments(law, points())
    expected = getattr(reference, law)(*(torch.tensor(a) for a in args)).numpy()
    np.testing.assert_allclose(apply(law, form, args), expected, atol=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_inside_nothing_changes_and_outside_lands_on_the_surface(law, form):
    args = arguments(law, points(), RATE_INDEPENDENT)
    F, rest = args[0], args[1:]
    new = apply(law, form, args)
    inside = over_yield(law, *args) <= -1e-9
    outside = over_yield(law, *args) > 1e-9
    assert inside.sum() >= 2 and outside.sum() >= 20
    np.testing.assert_array_equal(new[inside], F[inside])
    np.testing.assert_allclose(over_yield(law, new, *rest)[outside], 0, atol=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_returning_twice_is_returning_once(law, form):
    args = arguments(law, points(), RATE_INDEPENDENT)
    once = apply(law, form, args)
    np.testing.assert_allclose(apply(law, form, (once, *args[1:])), once, atol=1e-14)


@pytest.mark.parametrize("law", LAWS)
def test_the_return_turns_with_the_body_and_with_the_rest_shape(law, form):
    args = arguments(law, points())
    rng = np.random.default_rng(2)
    Q, P = rotations(len(args[0]), rng), rotations(len(args[0]), rng)
    turned = apply(law, form, (Q @ args[0] @ P, *args[1:]))
    np.testing.assert_allclose(turned, Q @ apply(law, form, args) @ P, atol=1e-12)


@pytest.mark.parametrize("law", LAWS)
def test_the_rotation_of_F_stays(law, form):
    args = arguments(law, generic_points(40, np.random.default_rng(3)))
    before, after = (reference.polar_rotation(torch.tensor(F)) for F in (args[0], apply(law, form, args)))
    np.testing.assert_allclose(after, before, atol=1e-12)


def test_von_mises_keeps_the_volume_and_drucker_prager_keeps_it_off_the_tip(form):
    for law in LAWS:
        args = arguments(law, points())
        new = apply(law, form, args)
        ratio = np.linalg.det(new) / np.linalg.det(args[0])
        at_tip = np.ptp(np.linalg.svd(new)[1], axis=1) < 1e-9
        np.testing.assert_allclose(ratio[~at_tip | (law == "von_mises")], 1, atol=1e-11)


def test_von_mises_in_pure_shear_holds_the_yield_stress_over_root_three(form):
    F = np.eye(3)[None].copy()
    F[0, 0, 1] = 1.0
    E, nu, sigma_y = 3.0, 0.3, 0.2
    new = apply("von_mises", form, (F, np.array([E]), np.array([nu]), np.array([[sigma_y, 0.0]]), np.array([DT])))
    tau = reference.hencky(*(torch.tensor(a, dtype=torch.float64) for a in (new, [E], [nu]))).numpy()[0]
    principal = np.linalg.eigvalsh(tau - np.trace(tau) / 3 * np.eye(3))
    assert principal[2] - principal[0] == pytest.approx(2 * sigma_y / math.sqrt(3), rel=1e-12)


def test_viscosity_relaxes_at_the_same_rate_whatever_the_substep(form):
    """Perzyna's excess decays as exp(-2 mu t / eta); many small steps reach it, and fewer steps come close."""
    mu, eta, sigma_y, duration = 1.0, 0.5, 0.1, 0.2
    E, nu = np.array([2 * mu * 1.3]), np.array([0.3])
    F0 = np.diag(np.exp([0.4, -0.2, -0.2]))[None]
    q0, radius = math.sqrt(0.24), math.sqrt(2 / 3) * sigma_y / (2 * mu)
    exact = radius + (q0 - radius) * math.exp(-2 * mu * duration / eta)
    for steps, tolerance in ((20, 2e-2), (400, 1e-3)):
        F = F0
        for _ in range(steps):
            F = apply("von_mises", form, (F, E, nu, np.array([[sigma_y, eta]]), np.array([duration / steps])))
        q = np.linalg.norm(np.log(np.linalg.svd(F)[1]))
        assert q == pytest.approx(exact, rel=tolerance)


def test_cohesionless_sand_opens_freely_and_carries_the_coulomb_cone_of_its_angle(form):
    """In triaxial compression the principal stresses stand as (1 + sin phi) / (1 - sin phi)."""
    angle = 0.6
    rest = np.array([3.0]), np.array([0.3]), np.array([[angle, 0.0]]), np.array([DT])
    stretched = apply("drucker_prager", form, (1.1 * np.eye(3)[None], *rest))
    np.testing.assert_allclose(stretched[0], np.eye(3), atol=1e-14)
    pressed = np.diag(np.exp([-0.3, 0.08, 0.08]))[None]
    new = apply("drucker_prager", form, (pressed, *rest))
    tau = reference.hencky(torch.tensor(new), torch.tensor(rest[0]), torch.tensor(rest[1])).numpy()[0]
    assert tau[0, 0] / tau[1, 1] == pytest.approx((1 + math.sin(angle)) / (1 - math.sin(angle)), rel=1e-10)


@pytest.mark.parametrize("law", LAWS)
def test_adjoint_agrees_with_finite_differences_on_both_sides_of_the_surface(law, form):
    args = arguments(law, points())
    margin = over_yield(law, *args)
    # the map has a kink at the surface, and Drucker-Prager's another where the cone meets the tip
    away = abs(margin) > 0.02
    args = tuple(a[away] for a in args)
    assert (margin[away] < 0).sum() >= 2 and (margin[away] > 0).sum() >= 20
    rng = np.random.default_rng(4)
    seed = rng.normal(size=args[0].shape)
    evaluate = plastic(law, form)
    out = evaluate(*args, seed)
    smallest = np.linalg.svd(args[0])[1].min(1)[:, None, None]
    parameters = np.ones_like(args[3])
    directions = (
        (0, rng.normal(size=args[0].shape) * smallest, out.F_bar, 2e-4),
        (1, np.ones(len(seed)), out.E_bar, 1e-4),
        (2, np.ones(len(seed)), out.nu_bar, 1e-4),
        (3, parameters * [1, 0], out.y_bar, 1e-4),
        (3, parameters * [0, 1], out.y_bar, 1e-4),
    )
    for k, direction, bar, step in directions:
        measured = directional(
            lambda x, k=k: evaluate(*args[:k], x, *args[k + 1 :], seed).F_new, args[k], direction, seed, step
        )
        scale = np.linalg.norm((bar * abs(direction)).reshape(len(seed), -1), axis=1) + 0.1
        worst = np.max(abs(measured - inner(bar, direction)) / scale)
        assert worst < 1e-6, f"argument {k}: {worst:.1e}"


@pytest.mark.parametrize("law", LAWS)
def test_gradients_are_those_of_torch_where_singular_values_differ(law, form):
    rng = np.random.default_rng(5)
    args = arguments(law, 0.9 * generic_points(60, rng))
    seed = rng.normal(size=args[0].shape)
    out = plastic(law, form)(*args, seed)
    leaves = [torch.tensor(a, requires_grad=True) for a in args]
    getattr(reference, law)(*leaves).backward(torch.tensor(seed))
    for ours, leaf in zip((out.F_bar, out.E_bar, out.nu_bar, out.y_bar), leaves[:4], strict=True):
        np.testing.assert_allclose(ours, leaf.grad.numpy(), rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("law", LAWS)
def test_the_kink_values_join_and_the_derivative_jumps_as_documented(law, form):
    """F_new is continuous across the surface; inside the adjoint is the identity, outside it is not."""
    E, nu, y = 3.0, 0.3, PARAMETERS[law]
    direction = np.array([0.5, 0.1, -0.6])

    def args(size: float) -> tuple[np.ndarray, ...]:
        F = np.diag(np.exp(size * direction))[None]
        return F, np.array([E]), np.array([nu]), np.array([y]), np.array([DT])

    low, high = 0.0, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (low, middle) if over_yield(law, *args(middle))[0] > 0 else (middle, high)
    just_in, just_out = args(low - 1e-6), args(high + 1e-6)
    np.testing.assert_allclose(apply(law, form, just_in), apply(law, form, just_out), atol=1e-5)
    seed = np.diag(direction)[None]
    np.testing.assert_array_equal(plastic(law, form)(*just_in, seed).F_bar, seed)
    assert np.linalg.norm(plastic(law, form)(*just_out, seed).F_bar - seed) > 0.1 * np.linalg.norm(seed)


@pytest.mark.parametrize("law", LAWS)
def test_float32_is_float64_to_its_rounding(law, form):
    rng = np.random.default_rng(6)
    args = arguments(law, generic_points(200, rng))
    away = abs(over_yield(law, *args)) > 1e-3  # nearer, the two may stand on different sides of the kink
    args = tuple(a[away] for a in args)
    seed = rng.normal(size=args[0].shape)
    wide, narrow = plastic(law, form)(*args, seed), plastic(law, form, "float32")(*args, seed)
    for name, tolerance in (("F_new", 2e-6), ("F_bar", 2e-5), ("E_bar", 2e-5), ("nu_bar", 5e-5), ("y_bar", 2e-5)):
        a, b = getattr(wide, name), getattr(narrow, name)
        error = np.max(abs(a - b)) / np.max(abs(a))
        assert error < tolerance, f"{name}: {error:.1e}"


def test_every_law_that_flows_names_its_two_parameters():
    assert {law: len(names) for law, names in PLASTIC_LAWS.items()} == {law: 2 for law in LAWS} | {"identity": 0}
