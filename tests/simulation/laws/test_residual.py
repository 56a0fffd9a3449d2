"""Neural residuals in both number types: zero at the start, bounded for any weights, objective, adjoints."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.simulation.laws import ResidualConfig, initial_weights, reference, split_weights, turned_weights
from tests.simulation.laws.driver import CONFIG, residual
from tests.simulation.laws.points import directional, generic_points, inner, rotations, special_points

E0 = 3.0
SHARE = 0.1
KINDS = ("stress", "plastic")


def points(seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.concatenate([special_points(rng), generic_points(40, rng), np.eye(3) + 1e-3 * rng.normal(size=(9, 3, 3))])


def arguments(kind: str, F: np.ndarray, scale: float = 0.7) -> tuple[np.ndarray, ...]:
    """(F, the expert's result, E or share, latent, random weights): the expert is neo-Hookean, or a partial return."""
    rng = np.random.default_rng(2)
    n = len(F)
    latent, weights = rng.normal(size=(n, CONFIG.latent_size)), scale * rng.normal(size=CONFIG.weight_count)
    if kind == "stress":
        E, nu = np.linspace(E0, 2 * E0, n), np.full(n, 0.3)
        tau = reference.neo_hookean(*(torch.tensor(a) for a in (F, E, nu))).numpy()
        return F, tau, E, latent, weights
    F_exp = 0.5 * (F + reference.polar_rotation(torch.tensor(F)).numpy())
    return F, F_exp, np.full(n, SHARE), latent, weights


def delta(kind: str, form: str, args: tuple[np.ndarray, ...], dtype: str = "float64") -> np.ndarray:
    return residual(kind, form, dtype)(*args, args[0]).delta


def twin(kind: str, *args: torch.Tensor) -> torch.Tensor:
    if kind == "stress":
        return reference.stress_residual(CONFIG, *args)
    F, F_exp, share, latent, weights = args
    return reference.plastic_residual(CONFIG, F, F_exp, share, latent, weights)


def bound(kind: str, args: tuple[np.ndarray, ...]) -> np.ndarray:
    beta = CONFIG.beta_elastic if kind == "stress" else CONFIG.beta_plastic * SHARE
    return beta * np.linalg.norm(args[1], axis=(1, 2))


@pytest.mark.parametrize("kind", KINDS)
def test_values_are_those_of_the_torch_twin(kind, form):
    args = arguments(kind, points())
    expected = twin(kind, *(torch.tensor(a) for a in args)).numpy()
    # the reference's sqrt(a^2 + e^2) - e loses what the kernel's form keeps
    np.testing.assert_allclose(delta(kind, form, args), expected, atol=1e-12 * abs(expected).max())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_with_initial_weights_nothing_changes_at_all(kind, dtype, form):
    args = list(arguments(kind, points()))
    args[4] = initial_weights(CONFIG, 3)[KINDS.index(kind)].numpy()
    assert (delta(kind, form, tuple(args), dtype) == 0).all()


@pytest.mark.parametrize("kind", KINDS)
def test_the_first_step_from_initial_weights_sees_a_gradient(kind, form):
    args = list(arguments(kind, points()))
    args[4] = initial_weights(CONFIG, 3)[KINDS.index(kind)].numpy()
    seed = np.random.default_rng(4).normal(size=args[0].shape)
    bar = torch.tensor(residual(kind, form)(*args, seed).weights_bar)
    parts = split_weights(CONFIG, bar)
    assert all((part != 0).all() if name.endswith("_3") else (part == 0).all() for name, part in parts.items())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scale", [0.7, 5.0, 1e3])
def test_the_bound_holds_for_any_weights(kind, scale, form):
    args = arguments(kind, points(), scale)
    size = np.linalg.norm(delta(kind, form, args), axis=(1, 2))
    assert (size <= bound(kind, args) * (1 + 1e-12)).all()
    if scale == 1e3 and kind == "stress":  # and it is no idle bound: it is reached
        assert (size[1:] > 0.9 * bound(kind, args)[1:]).sum() > len(size) / 2


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_added_where_there_is_no_strain(kind, form):
    turned = rotations(5, np.random.default_rng(5))
    args = list(arguments(kind, turned))
    if kind == "stress":
        args[1] = np.zeros_like(turned)
    # a rounded rotation is a strain of 1e-16, and the residuals fade quadratically
    assert abs(delta(kind, form, tuple(args))).max() < 1e-25


@pytest.mark.parametrize("kind", KINDS)
def test_the_residual_turns_with_the_body(kind, form):
    args = list(arguments(kind, points()))
    Q = rotations(len(args[0]), np.random.default_rng(6))
    before = delta(kind, form, tuple(args))
    args[0] = Q @ args[0]
    args[1] = Q @ args[1] @ Q.transpose(0, 2, 1) if kind == "stress" else Q @ args[1]
    expected = Q @ before @ Q.transpose(0, 2, 1) if kind == "stress" else Q @ before
    scale = bound(kind, tuple(args))[:, None, None] + 1e-6
    assert np.max(abs(delta(kind, form, tuple(args)) - expected) / scale) < 1e-10


def test_stress_residual_is_symmetric_and_plastic_residual_keeps_the_rotation(form):
    args = arguments("stress", points())
    d = delta("stress", form, args)
    np.testing.assert_allclose(d, d.transpose(0, 2, 1), atol=1e-14 * abs(d).max())
    args = arguments("plastic", generic_points(30, np.random.default_rng(7)))
    before, after = args[0], args[1] + delta("plastic", form, args)
    R, R_new = (reference.polar_rotation(torch.tensor(F)).numpy() for F in (before, after))
    np.testing.assert_allclose(R_new, R, atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_adjoint_agrees_with_finite_differences_everywhere(kind, form):
    args = arguments(kind, points())
    rng = np.random.default_rng(8)
    seed = rng.normal(size=args[0].shape)
    evaluate = residual(kind, form)
    out = evaluate(*args, seed)
    bars = {0: out.F_bar, 1: out.expert_bar, 3: out.latent_bar} | ({2: out.E_bar} if kind == "stress" else {})
    smallest = np.linalg.svd(args[0])[1].min(1)[:, None, None]
    directions = [rng.normal(size=a.shape) for a in args]
    directions[0] *= smallest
    for k, bar in bars.items():
        # E enters through 1e-4 E alone; strains near zero meet the smooth corner of width 1e-4 to 1e-3
        step = 1e-2 if k == 2 else 2e-6
        measured = directional(
            lambda x, k=k: evaluate(*args[:k], x, *args[k + 1 :], seed).delta, args[k], directions[k], seed, step
        )
        scale = np.linalg.norm((bar * abs(directions[k])).reshape(len(seed), -1), axis=1) + 1e-4 * abs(bar).max()
        worst = np.max(abs(measured - inner(bar, directions[k])) / scale)
        assert worst < 1e-6, f"argument {k}: {worst:.1e}"


@pytest.mark.parametrize("kind", KINDS)
def test_weight_adjoint_of_every_layer_agrees_with_finite_differences(kind, form):
    args = arguments(kind, points())
    rng = np.random.default_rng(9)
    seed = rng.normal(size=args[0].shape)
    evaluate = residual(kind, form)
    bar = evaluate(*args, seed).weights_bar
    for name, part in split_weights(CONFIG, torch.arange(CONFIG.weight_count).double()).items():
        direction = np.zeros(CONFIG.weight_count)
        direction[part.flatten().long().numpy()] = rng.normal(size=part.numel())
        value = directional(lambda w: evaluate(*args[:4], w, seed).delta, args[4], direction, seed, 2e-4).sum()
        assert value == pytest.approx(bar @ direction, rel=1e-6, abs=1e-8 * np.linalg.norm(bar)), name


@pytest.mark.parametrize("kind", KINDS)
def test_gradients_are_those_of_torch_where_singular_values_differ(kind, form):
    rng = np.random.default_rng(10)
    args = arguments(kind, generic_points(40, rng))
    seed = rng.normal(size=args[0].shape)
    out = residual(kind, form)(*args, seed)
    leaves = [torch.tensor(a, requires_grad=True) for a in args]
    twin(kind, *leaves).backward(torch.tensor(seed))
    names = ("F_bar", "expert_bar", "E_bar" if kind == "stress" else None, "latent_bar")
    for name, leaf in zip(names, leaves[:4], strict=True):
        if name:
            np.testing.assert_allclose(getattr(out, name), leaf.grad.numpy(), rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(out.weights_bar, leaves[4].grad.numpy(), rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_float32_is_float64_to_its_rounding(kind, form):
    rng = np.random.default_rng(11)
    args = arguments(kind, generic_points(200, rng))
    seed = rng.normal(size=args[0].shape)
    wide, narrow = residual(kind, form)(*args, seed), residual(kind, form, "float32")(*args, seed)
    for name in vars(wide):
        a, b = getattr(wide, name), getattr(narrow, name)
        error = np.max(abs(a - b)) / np.max(abs(a))
        assert error < 5e-5, f"{name}: {error:.1e}"


def test_weights_lie_in_the_flat_vector_as_documented_and_come_from_the_seed():
    elastic, plastic = initial_weights(CONFIG, 5)
    again, _ = initial_weights(CONFIG, 5)
    other, _ = initial_weights(CONFIG, 6)
    assert elastic.shape == plastic.shape == (CONFIG.weight_count,)
    assert torch.equal(elastic, again) and not torch.equal(elastic, other) and not torch.equal(elastic, plastic)
    parts = split_weights(CONFIG, elastic)
    assert {name: tuple(part.shape) for name, part in parts.items()} == CONFIG.weight_shapes
    torch.testing.assert_close(torch.cat([part.flatten() for part in parts.values()]), elastic)
    assert (parts["weight_3"] == 0).all() and (parts["bias_3"] == 0).all() and (parts["weight_1"] != 0).all()


@pytest.mark.parametrize("field", ["latent_size", "hidden", "beta_elastic", "beta_plastic", "strain_scale"])
def test_a_size_or_bound_out_of_range_is_refused(field):
    bad = -1 if field in ("latent_size", "hidden") else -1.0
    with pytest.raises(InputError, match=field):
        dataclasses.replace(ResidualConfig(), **{field: bad})


@pytest.mark.parametrize("kind", KINDS)
def test_in_a_turned_body_the_turned_network_gives_the_turned_residual(kind, form):
    """Body and deformation turned by R: F, the expert's result and the residual become R . R^T. Without turning the network it differs."""
    F, expert, other, latent, weights = arguments(kind, points())
    R = rotations(1, np.random.default_rng(5))[0]
    around = lambda matrices: R @ matrices @ R.T
    turned = turned_weights(CONFIG, torch.tensor(weights), torch.tensor(R)).numpy()
    there = (around(F), around(expert), other, latent)
    expected = around(delta(kind, form, (F, expert, other, latent, weights)))
    np.testing.assert_allclose(delta(kind, form, (*there, turned)), expected, atol=1e-10 * abs(expected).max())
    assert abs(delta(kind, form, (*there, weights)) - expected).max() > 0.1 * abs(expected).max()


def test_turning_a_network_back_gives_it_back():
    weights = torch.tensor(arguments("stress", points())[-1])
    R = torch.tensor(rotations(1, np.random.default_rng(6))[0])
    back = turned_weights(CONFIG, turned_weights(CONFIG, weights, R), R.mT)
    torch.testing.assert_close(back, weights, rtol=0, atol=1e-12)
