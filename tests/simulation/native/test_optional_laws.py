"""The native form of the optional laws against the fused one, all of them at once, values and gradients."""

from dataclasses import fields, replace

import pytest
import torch

from physreal_core.simulation import Parameters
from physreal_core.simulation.native import NativeStepper
from tests.simulation.conftest import FUSED, NATIVE, take_fused
from tests.simulation.native.test_frame import FRAMES, WIDTHS, assert_equal, scene, states_and_gradients

TERMS = (
    "drag", "adhesion", "obstacle", "viscosity", "stiffening", "fibres", "friction_law", "relaxation", "hysteresis",
)  # fmt: skip


def with_laws(given: Parameters, count: int) -> Parameters:
    """Random parameters of all laws beside the given ones: the block runs into a post, its lifted end sticks."""
    generator = torch.Generator().manual_seed(5)
    dtype = given.youngs_modulus.dtype

    def random(*shape):
        return 0.5 + torch.rand(shape, generator=generator, dtype=torch.float64)

    direction = random(count, 3)
    values = {
        "linear_drag": 1e-3 * random(count),
        "quadratic_drag": 2e-3 * random(count),
        "adhesion": 5e-3 * random(count),
        "adhesion_range": torch.tensor(1e-3),
        "obstacle": torch.tensor([0.09, 0.03, 0.01, 0.0, 0.01, 0.01, 0.02, 1e4]),
        "viscosity": random(count, 2),
        "stiffening": 500.0 * random(count),
        "fibre_modulus": 1e3 * random(count),
        "fibre_direction": direction / direction.norm(dim=1, keepdim=True),
        "friction_law": torch.tensor([0.2, 0.3, 0.1]),
        "relaxation_modulus": 500.0 * random(count),
        "relaxation_time": torch.tensor(0.03),
        "hysteresis_modulus": 300.0 * random(count, 3),
        "hysteresis_time": torch.tensor([0.005, 0.02, 0.08]),
    }
    return replace(given, **{name: value.to(dtype).clone().requires_grad_() for name, value in values.items()})


@pytest.mark.parametrize("dtype", WIDTHS)
@pytest.mark.parametrize("material", [{}, {"elastic_law": "hencky", "plastic_law": "von_mises"}])
def test_native_is_fused(dtype, material, monkeypatch):
    results = []
    for form in (NATIVE, FUSED):
        if form == FUSED:
            take_fused(monkeypatch)
        simulator, given, controllers = scene(dtype=dtype, terms=TERMS, **material)
        assert isinstance(simulator._stepper, NativeStepper) == (form == NATIVE)
        given = with_laws(given, len(simulator.body.x0))
        results.append(states_and_gradients(simulator, given, controllers))
    assert all(bool(gradient.any()) for gradient in results[1][1].values())
    assert {field.name for field in fields(Parameters)} & set(results[0][1]) > {"viscosity", "obstacle", "friction_law"}
    assert_equal(*results, dtype)


def test_threads_agree():
    counts = (14, 13, 9)
    results = []
    for threads in (1, 2):
        simulator, given, controllers = scene(counts, threads, dtype="float64", terms=TERMS)
        assert simulator._stepper.threads == threads
        results.append(states_and_gradients(simulator, with_laws(given, len(simulator.body.x0)), controllers))
    assert_equal(*results, "float64")


def test_a_batch_and_a_played_rollout_are_the_rollout():
    """Also mean rate of deformation and Maxwell branches go on from frame to frame; rollouts differ in laws' parameters."""
    simulator, given, controllers = scene(terms=TERMS)
    given = with_laws(given, len(simulator.body.x0))
    strengths = torch.tensor([[[1.0]], [[0.2]]])
    batched = replace(
        given,
        viscosity=strengths * given.viscosity.detach(),
        hysteresis_modulus=strengths * given.hysteresis_modulus.detach(),
        relaxation_time=torch.tensor([0.03, 0.01]),
    )
    own = ("viscosity", "hysteresis_modulus", "relaxation_time")
    with torch.no_grad():
        states = simulator.rollout_batch(batched, controllers)
        for r in range(2):
            alone = simulator.rollout(replace(given, **{k: getattr(batched, k)[r] for k in own}), controllers)
            assert torch.equal(states.x[r], alone.x) and torch.equal(states.F[r], alone.F)
    assert not torch.equal(states.x[0], states.x[1])
    player = simulator.play(replace(given, **{k: getattr(batched, k)[1] for k in own}), controllers[0])
    for frame in range(1, FRAMES):
        # the hand's velocity is constant, but for rounding
        torch.testing.assert_close(player.step(controllers[frame]).x, alone.x[frame], rtol=0, atol=1e-6)
