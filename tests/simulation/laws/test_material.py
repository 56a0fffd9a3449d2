"""The material at every kind of F: lanes and float32 are one particle in float64, the whole is the sum of its parts."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from physreal_core.simulation.laws import ELASTIC_LAWS, ResidualConfig, reference
from tests.simulation.laws import driver
from tests.simulation.laws.driver import CONFIG, DTYPES, LANES, material, partner
from tests.simulation.laws.points import generic_points, rotations, special_points

TOLERANCE = {"float64": 1e-12, "float32": 2e-5}
"""Relative errors that rounding leaves: of 1e-16, and of 6e-8, where singular values are as small as 1/50."""
LAWS = sorted(ELASTIC_LAWS)
NUMBERS = [("lanes", "float64"), ("lanes", "float32"), ("one", "float32")]
"""Beside the measure, one particle in float64, which the other files hold to torch twins and finite differences."""
FLOWS = [  # law and its parameters: viscous, perfect; with cohesion and friction, without either
    ("von_mises", (0.5, 0.3)),
    ("von_mises", (0.5, 0.0)),
    ("drucker_prager", (0.5, 0.05)),
    ("drucker_prager", (0.5, 0.0)),
    ("drucker_prager", (0.0, 0.5)),
]
DT, SHARE = 0.1, 0.2


def problem(dtype: str, count: int = 40, dilated: bool = False) -> SimpleNamespace:
    """F = 1, repeated and extreme singular values, random ones: an odd number, which no width divides.

    All numbers are those of `dtype`, so that only the arithmetic on them differs; `dilated` leaves out F that keep volume.
    """
    rng = np.random.default_rng(1)
    F = np.concatenate([np.eye(3)[None], special_points(rng), generic_points(count, rng), 1.01 * np.eye(3)[None]])
    if dilated:
        F = F[abs(np.log(np.linalg.det(F))) > 1e-3]
    F = F[(len(F) + 1) % 2 :]
    n = len(F)
    values = {
        "F": F,
        "seed": rng.normal(size=F.shape),
        "E": np.linspace(3.0, 6.0, n),
        "nu": np.linspace(0.05, 0.45, n),
        "latent": rng.normal(size=(n, CONFIG.latent_size)),
        "weights": 0.7 * rng.normal(size=CONFIG.weight_count),
    }
    return SimpleNamespace(**{name: value.astype(dtype).astype(np.float64) for name, value in values.items()})


def assert_close(ours: np.ndarray, expected: np.ndarray, tolerance: float, floor: float = 0.0) -> None:
    """Difference of each particle (first axis) against the size of its result and the natural size `floor`."""
    rows = len(expected)
    assert ours.shape == expected.shape and np.isfinite(expected).all()
    difference = np.linalg.norm((ours - expected).reshape(rows, -1), axis=1)
    size = np.linalg.norm(expected.reshape(rows, -1), axis=1) + floor
    assert np.max(difference / size) < tolerance


@pytest.mark.parametrize("form, dtype", NUMBERS)
@pytest.mark.parametrize("law", LAWS)
def test_stress_and_its_adjoint_are_those_of_one_particle_in_float64(law, form, dtype):
    a = problem(dtype)
    ours = material(law, partner(law), None, form, dtype)(a.F, a.seed, a.E, a.nu)
    expected = driver.elastic(law, "one")(a.F, a.E, a.nu, a.seed)
    tolerance, modulus = TOLERANCE[dtype], a.E.max()
    assert_close(ours.out, expected.tau, tolerance, modulus)
    assert_close(ours.F_bar, expected.F_bar, tolerance, modulus)
    assert_close(ours.E_bar, expected.E_bar, tolerance, 1.0)
    assert_close(ours.nu_bar, expected.nu_bar, tolerance, modulus)
    assert not ours.padding.any()


@pytest.mark.parametrize("form, dtype", NUMBERS)
@pytest.mark.parametrize("law, y", FLOWS)
def test_flow_and_its_adjoint_are_those_of_one_particle_in_float64(law, y, form, dtype):
    a = problem(dtype, dilated=y[1] == 0.0 and law == "drucker_prager")  # at volume one that law has a kink
    parameters = np.tile(np.array(y, dtype).astype(np.float64), (len(a.F), 1))
    ours = material(partner(law), law, None, form, dtype)(a.F, a.seed, a.E, a.nu, y=parameters, dt=DT, flow=True)
    dt = np.full(len(a.F), np.array(DT, dtype), np.float64)
    expected = driver.plastic(law, "one")(a.F, a.E, a.nu, parameters, dt, a.seed)
    flowed = (expected.F_new != a.F).any((1, 2))
    assert 5 < flowed.sum() < len(a.F) - 5
    np.testing.assert_array_equal(ours.out[~flowed], a.F[~flowed])
    np.testing.assert_array_equal(ours.F_bar[~flowed], a.seed[~flowed])
    tolerance = TOLERANCE[dtype]
    assert_close(ours.out, expected.F_new, tolerance)
    assert_close(ours.F_bar, expected.F_bar, tolerance)
    assert_close(ours.E_bar, expected.E_bar, tolerance, 1.0)
    assert_close(ours.nu_bar, expected.nu_bar, tolerance, 1.0)
    assert_close(ours.y_bar, expected.y_bar, tolerance, 1.0)
    assert not ours.padding.any()


def test_nothing_flows_where_no_particle_yields(form):
    a = problem("float64")
    y = np.tile((1e9, 0.0), (len(a.F), 1))
    ours = material("neo_hookean", "von_mises", None, form, "float64")(a.F, a.seed, a.E, a.nu, y=y, dt=DT, flow=True)
    np.testing.assert_array_equal(ours.out, a.F)
    np.testing.assert_array_equal(ours.F_bar, a.seed)
    assert not ours.E_bar.any() and not ours.nu_bar.any() and not ours.y_bar.any()


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("strain", [1e-3, 0.03, 0.6])
def test_flow_begins_at_the_surface_where_all_particles_are_near_it(strain, dtype, form):
    """Blocks of which every particle is just inside, or just outside: none of either may be told from a bound alone."""
    rng = np.random.default_rng(5)
    count, E, nu = 32, 4.0, 0.25
    direction = rng.normal(size=(count, 3))
    direction -= direction.mean(1, keepdims=True)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    yield_stress = np.sqrt(1.5) * strain * E / (1 + nu)  # where |dev eps| is `strain`
    y = np.tile((yield_stress, 0.0), (count, 1))
    evaluate = material("neo_hookean", "von_mises", None, form, dtype)
    for factor in (0.999, 1.001):
        sigma = np.exp(factor * strain * direction + rng.normal(size=(count, 1)) / 10)
        F = (rotations(count, rng) * sigma[:, None, :]) @ rotations(count, rng)
        F = F.astype(dtype).astype(np.float64)
        out = evaluate(F, F, np.full(count, E), np.full(count, nu), y=y, dt=DT, flow=True).out
        np.testing.assert_array_equal((out != F).any((1, 2)), factor > 1)


def hybrid_stress(law: str, a: SimpleNamespace) -> SimpleNamespace:
    """Expert and residual together, from either alone, for one particle in float64."""
    expert = driver.elastic(law, "one")(a.F, a.E, a.nu, a.seed)
    neural = driver.residual("stress", "one")(a.F, expert.tau, a.E, a.latent, a.weights, a.seed)
    expert_bar = driver.elastic(law, "one")(a.F, a.E, a.nu, a.seed + neural.expert_bar)
    return SimpleNamespace(
        out=expert.tau + neural.delta,
        F_bar=neural.F_bar + expert_bar.F_bar,
        E_bar=neural.E_bar + expert_bar.E_bar,
        nu_bar=expert_bar.nu_bar,
        latent_bar=neural.latent_bar,
        weights_bar=neural.weights_bar,
    )


def hybrid_flow(law: str, y: np.ndarray, a: SimpleNamespace, dtype: str) -> SimpleNamespace:
    """The same of plastic flow; without a law, y is not used."""
    dt, share = (np.full(len(a.F), np.array(value, dtype), np.float64) for value in (DT, SHARE))
    expert = None if law == "identity" else driver.plastic(law, "one")(a.F, a.E, a.nu, y, dt, a.seed)
    F = a.F if expert is None else expert.F_new
    neural = driver.residual("plastic", "one")(a.F, F, share, a.latent, a.weights, a.seed)
    bar = a.seed + neural.expert_bar
    zero = np.zeros(len(a.F))
    none = SimpleNamespace(F_bar=bar, E_bar=zero, nu_bar=zero, y_bar=np.zeros((len(a.F), 2)))
    expert_bar = none if expert is None else driver.plastic(law, "one")(a.F, a.E, a.nu, y, dt, bar)
    return SimpleNamespace(
        out=F + neural.delta,
        F_bar=neural.F_bar + expert_bar.F_bar,
        E_bar=expert_bar.E_bar,
        nu_bar=expert_bar.nu_bar,
        y_bar=expert_bar.y_bar,
        latent_bar=neural.latent_bar,
        weights_bar=neural.weights_bar,
    )


HYBRIDS = [("neo_hookean", "identity"), ("fixed_corotated", "von_mises")]
MANY = 1300
"""Particles that fill the batches of the widest blocks several times, and leave a rest."""


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("law, plastic", HYBRIDS)
def test_stress_with_its_residual(law, plastic, dtype, form):
    a = problem(dtype, MANY)
    evaluate = material(law, plastic, CONFIG, form, dtype)
    ours = evaluate(a.F, a.seed, a.E, a.nu, latent=a.latent, weights=a.weights)
    expected = hybrid_stress(law, a)
    tolerance = TOLERANCE[dtype]
    for name in ("out", "F_bar", "E_bar", "nu_bar"):
        assert_close(getattr(ours, name), getattr(expected, name), tolerance, a.E.max())
    assert_close(ours.latent_bar[0], expected.latent_bar, tolerance, a.E.max())
    assert_close(ours.weights_bar[:1], expected.weights_bar[None], tolerance)
    assert not ours.latent_bar[1].any() and not ours.weights_bar[1].any() and not ours.padding.any()


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("elastic, law", HYBRIDS)
def test_flow_with_its_residual(elastic, law, dtype, form):
    a = problem(dtype, MANY)
    y = np.tile(np.array((0.5, 0.3), dtype).astype(np.float64), (len(a.F), 1))
    evaluate = material(elastic, law, CONFIG, form, dtype)
    settings = {"latent": a.latent, "weights": a.weights, "dt": DT, "share": SHARE, "flow": True}
    ours = evaluate(a.F, a.seed, a.E, a.nu, y=y, **settings)
    expected = hybrid_flow(law, y, a, dtype)
    tolerance = TOLERANCE[dtype]
    for name in ("out", "F_bar", "E_bar", "nu_bar", "y_bar"):
        assert_close(getattr(ours, name), getattr(expected, name), tolerance, 1.0)
    assert_close(ours.latent_bar[1], expected.latent_bar, tolerance, 1.0)
    assert_close(ours.weights_bar[1:], expected.weights_bar[None], tolerance)
    assert not ours.latent_bar[0].any() and not ours.weights_bar[0].any() and not ours.padding.any()


@pytest.mark.parametrize("config", [ResidualConfig(latent_size=0, hidden=5), ResidualConfig()], ids=str)
def test_networks_of_other_sizes_against_torch(config, form):
    F = generic_points(41, np.random.default_rng(3))
    rng = np.random.default_rng(4)
    n = len(F)
    seed, latent = rng.normal(size=F.shape), rng.normal(size=(n, config.latent_size))
    weights, E, nu = 0.7 * rng.normal(size=config.weight_count), np.linspace(3.0, 6.0, n), np.full(n, 0.3)
    leaves = F_, E_, nu_, latent_, weights_ = [torch.tensor(v, requires_grad=True) for v in (F, E, nu, latent, weights)]
    expert = reference.neo_hookean(F_, E_, nu_)
    stress = expert + reference.stress_residual(config, F_, expert, E_, latent_, weights_)
    flow = F_ + reference.plastic_residual(
        config, F_, F_, torch.full((n,), SHARE, dtype=torch.float64), latent_, weights_
    )
    evaluate = material("neo_hookean", "identity", config, form, "float64")
    for kind, twin in enumerate((stress, flow)):
        ours = evaluate(F, seed, E, nu, latent=latent, weights=weights, share=SHARE, flow=kind == 1)
        grads = torch.autograd.grad(twin, leaves, torch.tensor(seed), retain_graph=True, allow_unused=True)
        F_bar, _, _, latent_bar, weights_bar = [0.0 if g is None else g.numpy() for g in grads]
        assert_close(ours.out, twin.detach().numpy(), 1e-12)
        assert_close(ours.F_bar, F_bar, 1e-10)  # torch's svd loses digits where singular values are near
        assert_close(ours.weights_bar[kind][None], weights_bar[None], 1e-11)
        np.testing.assert_allclose(ours.latent_bar[kind], latent_bar, rtol=1e-10, atol=1e-11)


def some_inverted() -> tuple[SimpleNamespace, np.ndarray]:
    a = problem("float64")
    inverted = np.zeros(len(a.F), bool)
    inverted[[3, 17, 18, 30]] = True
    a.F[inverted] = a.F[inverted] @ np.diag([1.0, 1.0, -1.0])
    inverted[40], a.F[40] = True, np.diag([1.0, 1.2, 0.0])
    return a, inverted


@pytest.mark.parametrize("law", LAWS)
def test_stress_of_inverted_particles_alone_is_not_a_number(law, form):
    a, inverted = some_inverted()
    ours = material(law, partner(law), None, form, "float64")(a.F, a.seed, a.E, a.nu)
    expected = driver.elastic(law, "one")(a.F[~inverted], a.E[~inverted], a.nu[~inverted], a.seed[~inverted])
    np.testing.assert_array_equal(np.isnan(ours.out).any((1, 2)), inverted)
    assert_close(ours.out[~inverted], expected.tau, 1e-12, a.E.max())
    assert_close(ours.F_bar[~inverted], expected.F_bar, 1e-12, a.E.max())


def test_flow_leaves_inverted_particles_as_they_are_and_its_residual_makes_them_no_number(form):
    a, inverted = some_inverted()
    y = np.tile((0.5, 0.3), (len(a.F), 1))
    ours = material("neo_hookean", "von_mises", None, form, "float64")(a.F, a.seed, a.E, a.nu, y=y, dt=DT, flow=True)
    np.testing.assert_array_equal(ours.out[inverted], a.F[inverted])
    hybrid = material("fixed_corotated", "von_mises", CONFIG, form, "float64")
    ours = hybrid(a.F, a.seed, a.E, a.nu, y=y, latent=a.latent, weights=a.weights, flow=True)
    np.testing.assert_array_equal(np.isnan(ours.out).any((1, 2)), inverted)


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("machine", sorted(LANES))
def test_narrower_processors_give_the_same(machine, dtype):
    a = problem(dtype, MANY)
    y = np.tile((0.5, 0.3), (len(a.F), 1))
    arguments = (a.F, a.seed, a.E, a.nu, y, a.latent, a.weights, DT, SHARE)
    for flow in (False, True):
        ours, wide = (
            material("fixed_corotated", "von_mises", CONFIG, "lanes", dtype, machine=m)(*arguments, flow=flow)
            for m in (machine, "host")
        )
        for name in ("out", "F_bar", "E_bar", "nu_bar", "y_bar"):
            assert_close(getattr(ours, name), getattr(wide, name), TOLERANCE[dtype], a.E.max())
        assert_close(ours.latent_bar[int(flow)], wide.latent_bar[int(flow)], TOLERANCE[dtype], 1.0)
        assert_close(ours.weights_bar[int(flow)][None], wide.weights_bar[int(flow)][None], TOLERANCE[dtype])
        assert ours.width == LANES[machine] and not ours.padding.any()
