"""The native form of a frame against the fused one, values and gradients, with everything that a body can have."""

from dataclasses import fields, replace

import numpy as np
import pytest
import torch

from physreal_core.errors import SimulationError
from physreal_core.simulation import Clamp, Parameters, PointLoad, SimulationConfig, Simulator
from physreal_core.simulation.laws import ELASTIC_LAWS, PLASTIC_LAWS, ResidualConfig, initial_weights
from physreal_core.simulation.native.stepper import PARTICLES_PER_THREAD
from tests.simulation.conftest import FUSED, NATIVE, take_fused
from tests.simulation.scenes import block, random_loss, two_point_grip

FRAMES = 3
PLASTIC = {"identity": (0.0, 0.0), "von_mises": (60.0, 0.5), "drucker_prager": (0.5, 40.0)}
# float64: sums in another order. float32: a gradient of many terms of both signs loses about three digits.
WIDTHS = ["float64", pytest.param("float32", marks=pytest.mark.slow)]  # slow to compile
TOLERANCE = {"float64": (1e-12, 1e-9), "float32": (2e-5, 5e-3)}


def scene(counts=(7, 6, 5), threads=1, **options):
    """A soft block thrown along the ground, gripped above, clamped at a corner, pulled at its end; two moduli."""
    body = block(counts)
    height = float(body.x0[:, 2].max())
    points = np.array([[0.0, 0.0, height], [0.02, 0.0, height]])
    clamp = Clamp((-1.0, -1.0, -1.0), (0.015, 0.015, 0.015))
    load = PointLoad(np.array([len(body.x0) - 1]), np.ones(1), (0.0, 0.002, 0.0))
    config = SimulationConfig(fps=60, **options)
    before = torch.get_num_threads()
    torch.set_num_threads(threads)
    simulator = Simulator(body, config, two_point_grip(body, points, 8), (clamp,), (load,))
    torch.set_num_threads(before)
    time = torch.linspace(0, 1, FRAMES, dtype=torch.float64)[:, None, None]
    controllers = torch.as_tensor(points) + time * torch.tensor([0.01, 0.005, 0.01], dtype=torch.float64)
    return simulator, parameters(simulator), controllers


def parameters(simulator):
    config, count = simulator.config, len(simulator.body.x0)
    generator = torch.Generator().manual_seed(3)

    def random(*shape):
        return torch.randn(shape, generator=generator, dtype=torch.float64)

    values = {
        "youngs_modulus": 2e3 * (1 + 0.2 * torch.rand(count, generator=generator, dtype=torch.float64)),
        "poissons_ratio": torch.full((count,), 0.3, dtype=torch.float64),
        "friction_coefficient": torch.tensor(0.3, dtype=torch.float64),
        "grip_stiffness": torch.tensor(0.3, dtype=torch.float64),
        "grip_damping": torch.tensor(0.005, dtype=torch.float64),
        "plastic": torch.tensor(PLASTIC[config.plastic_law], dtype=torch.float64).expand(count, 2),
        "initial_velocity": torch.tensor((0.5, 0.2, 0.0), dtype=torch.float64).expand(count, 3),
    }
    if config.residual is not None:
        for kind, weights in zip(("elastic", "plastic"), initial_weights(config.residual, 0), strict=True):
            values[f"network_{kind}"] = weights + 0.3 * random(*weights.shape)
            values[f"latent_{kind}"] = random(count, config.residual.latent_size)
    dtype = getattr(torch, config.dtype)
    return Parameters(**{name: value.to(dtype).clone().requires_grad_() for name, value in values.items()})


def states_and_gradients(simulator, given, controllers):
    states = simulator.rollout(given, controllers)
    random_loss([1, FRAMES - 1])(states).backward()
    leaves = {field.name: getattr(given, field.name) for field in fields(given)}
    gradients = {name: leaf.grad for name, leaf in leaves.items() if leaf is not None and leaf.grad is not None}
    return {"x": states.x, "v": states.v, "F": states.F}, gradients


def relative(found, expected):
    """Largest difference over the largest value."""
    return float((found - expected).detach().abs().max() / expected.detach().abs().max().clamp_min(1e-30))


def assert_equal(found, expected, dtype):
    for got, wanted, tolerance in zip(found, expected, TOLERANCE[dtype], strict=True):
        assert got.keys() == wanted.keys()
        errors = {name: relative(got[name], wanted[name]) for name in wanted}
        assert max(errors.values()) <= tolerance, errors


MATERIALS = [{"elastic_law": law} for law in ELASTIC_LAWS]
MATERIALS += [{"elastic_law": "hencky", "plastic_law": law} for law in PLASTIC_LAWS if law != "identity"]
MATERIALS += [{"residual": ResidualConfig(latent_size=2, hidden=6)}]


@pytest.mark.parametrize("dtype", WIDTHS)
@pytest.mark.parametrize("material", MATERIALS, ids=lambda m: " ".join(map(str, m.values()))[:30])
def test_equals_the_fused_form(material, dtype, monkeypatch):
    native = states_and_gradients(*scene(dtype=dtype, **material))
    take_fused(monkeypatch)
    assert_equal(native, states_and_gradients(*scene(dtype=dtype, **material)), dtype)


def test_threads_change_nothing_but_rounding():
    counts = (14, 13, 9)
    assert np.prod(counts) >= 3 * PARTICLES_PER_THREAD
    one = states_and_gradients(*scene(counts, dtype="float64"))
    for threads in (2, 3):
        simulator, *rest = scene(counts, threads, dtype="float64")
        assert simulator._stepper.threads == threads
        assert_equal(states_and_gradients(simulator, *rest), one, "float64")


def test_same_threads_same_bits():
    first, second = (states_and_gradients(*scene((14, 13, 9), 2)) for _ in range(2))
    for got, wanted in zip(first, second, strict=True):
        assert all(torch.equal(got[name], wanted[name]) for name in wanted)


def test_a_failure_is_the_fused_forms(monkeypatch):
    """Frame, substep and particle where an imploding block first has a state without a stress."""
    places = []
    for form in (NATIVE, FUSED):
        if form == FUSED:
            take_fused(monkeypatch)
        simulator, given, controllers = scene(dtype="float64")
        body = simulator.body
        inwards = -1000.0 * torch.as_tensor(body.x0 - body.x0.mean(0))
        with pytest.raises(SimulationError, match="not finite") as raised:
            simulator.rollout(replace(given, initial_velocity=inwards), controllers)
        places.append((raised.value.frame, raised.value.substep, raised.value.particle))
    assert places[0] == places[1]


def test_kept_frames_change_nothing(monkeypatch):
    """With kept grids and without, the gradient has the same bits; what is kept stays within the budget."""

    def run(budget):
        monkeypatch.setattr("physreal_core.simulation.native.stepper.KEPT_BYTES", budget)
        simulator, given, controllers = scene()
        states = simulator.rollout(given, controllers[[0, 1, 2, 2, 1]])
        states.x.square().sum().backward()
        kept = simulator._stepper._kept
        sizes = [grids.numel() * grids.element_size() for grids in kept]
        assert sum(sizes) <= budget
        return len(kept), sum(sizes), given.youngs_modulus.grad

    all_kept, size, gradient = run(2**28)
    assert all_kept == 4
    for budget, expected in ((0, 0), (int(0.7 * size), 2)):
        kept, _, found = run(budget)
        assert kept == expected
        assert torch.equal(found, gradient)
