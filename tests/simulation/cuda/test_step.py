"""The fused form of the step held to the native one: on the CPU everywhere, on a GPU where there is one."""

import gc
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from benchmarks.agreement import CASES, random_loss, run, scene
from physreal_core.errors import InputError, SimulationError
from physreal_core.simulation import Body, Parameters, PointLoad, SimulationConfig, Simulator, States
from physreal_core.simulation.cuda.launches import FrameLaunches
from physreal_core.simulation.cuda.stepper import CARD_SHARE, kept_bytes_of
from tests.simulation.scenes import block

ALL_FEATURES = CASES["residuals"]  # von Mises, both networks, grip, ground, stiffness by particle


def worst(ours: dict[str, np.ndarray], theirs: dict[str, np.ndarray]) -> float:
    return max(np.linalg.norm(ours[k] - theirs[k]) / np.linalg.norm(theirs[k]) for k in theirs)


SLOW = ("neo-Hookean", "Hencky, von Mises", "Drucker-Prager", "fixed corotated")  # to compile
MATERIALS = [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in CASES]


@pytest.mark.parametrize("name", MATERIALS)
def test_values_and_gradients_are_the_native_forms_to_rounding(name, device, monkeypatch):
    """Both add in another order: 1e-16 a sum, grown over some ninety substeps to 1e-13, and to 1e-11 where the parts cancel. What pairs that touch
    leave in the adjoint are multiples of a unit of about 1e-10."""
    ours = run(CASES[name], device, "float64")
    monkeypatch.undo()
    theirs = run(CASES[name], "cpu", "float64")
    cancelling, touching = "gradient friction_coefficient", CASES[name].touching
    if cancelling in theirs:
        assert worst({cancelling: ours.pop(cancelling)}, {cancelling: theirs.pop(cancelling)}) < 1e-10
    assert worst(ours, theirs) < (1e-9 if touching else 1e-11)


def rollout(simulator: Simulator, leaves: dict, controllers: torch.Tensor) -> dict[str, np.ndarray]:
    """Last states and gradients, by name."""
    fresh = {name: leaf.detach().clone().requires_grad_() for name, leaf in leaves.items()}
    states = simulator.rollout(Parameters(**fresh), controllers)
    random_loss(states).backward()
    numbers = {"x": states.x[-1], "F": states.F[-1]} | {name: leaf.grad for name, leaf in fresh.items()}
    return {name: tensor.detach().cpu().numpy() for name, tensor in numbers.items()}


def test_a_rerun_gives_the_same_bytes_wherever_in_a_batch_a_rollout_is(device):
    """Threads come in any order, sums do not. 120 particles a rollout: its first thread is not one of a multiple of 8 particles."""
    simulator, leaves, controllers = scene(CASES["drag, density"], device, "float32")
    first, again = rollout(simulator, leaves, controllers), rollout(simulator, leaves, controllers)
    for name, values in first.items():
        assert np.array_equal(values, again[name]), name
    batch = leaves | {"youngs_modulus": leaves["youngs_modulus"].expand(3, -1)}
    with torch.no_grad():
        states = simulator.rollout_batch(Parameters(**batch), controllers)
    for own in states.x[:, -1].cpu().numpy():
        assert np.array_equal(own, first["x"])


def test_kept_frames_give_what_recomputed_ones_do(device):
    """With room for no frame, for two of three and for all; memory stays within the budget plus one frame."""
    simulator, leaves, controllers = scene(ALL_FEATURES, device, "float64")
    stepper, found, slots = simulator._stepper, [], []
    for frames in (0, 2, 9):
        stepper.substeps = simulator.substeps(Parameters(**leaves))
        stepper.kept_bytes = frames * stepper.frame_bytes()
        found.append(rollout(simulator, leaves, controllers))
        slots.append(divmod(stepper.slots, stepper.substeps + 1))
    assert slots == [(1, 0), (3, 0), (3, 2)]  # frames and single slots: the working ones stand behind the kept frames
    assert worst(found[1], found[0]) < 1e-11
    assert worst(found[2], found[0]) < 1e-11


def test_a_gradient_survives_other_rollouts_before_it(device):
    """Kept frames belong to one rollout: another one, of more substeps, takes them away, and they are recomputed."""
    simulator, leaves, controllers = scene(ALL_FEATURES, device, "float64")
    simulator._stepper.kept_bytes = 10**9
    expected = rollout(simulator, leaves, controllers)
    fresh = {name: leaf.detach().clone().requires_grad_() for name, leaf in leaves.items()}
    states = simulator.rollout(Parameters(**fresh), controllers)
    faster = fresh | {"initial_velocity": torch.tensor([2.0, 1.0, 1.0]), "youngs_modulus": torch.tensor(9e3)}
    simulator.rollout(Parameters(**faster), controllers)
    with torch.no_grad():
        simulator.rollout(Parameters(**faster), controllers)
    random_loss(states).backward()
    assert worst({n: leaf.grad.cpu().numpy() for n, leaf in fresh.items()}, {n: expected[n] for n in fresh}) < 1e-11


def differing(leaves: dict) -> list[dict]:
    """Three sets of parameters, the first the softest; all need the substeps that the stiffest needs."""
    sets = []
    for scale in (0.7, 1.0, 1.0):
        own = {name: leaf.detach().clone() for name, leaf in leaves.items()}
        own["youngs_modulus"] *= scale
        own["youngs_modulus"][0] = 3e3
        own["friction_coefficient"] = torch.tensor(0.3 * scale, dtype=torch.float64)
        sets.append(own)
    sets[2]["initial_velocity"] = sets[2]["initial_velocity"] * -0.5
    return sets


def test_a_batch_gives_the_single_rollouts(device):
    """Values and gradients, of parameters that differ and of those that are shared, in one pass."""
    simulator, leaves, controllers = scene(ALL_FEATURES, device, "float64")
    sets = differing(leaves)
    own_points = [controllers, controllers + 0.001, controllers]
    gradients, expected = [], []
    for own, points in zip(sets, own_points, strict=True):
        fresh = {name: value.clone().requires_grad_() for name, value in own.items()}
        states = simulator.rollout(Parameters(**fresh), points)
        random_loss(states).backward()
        gradients.append(fresh)
        expected.append(states)
    names = ("youngs_modulus", "friction_coefficient", "initial_velocity")
    batch = {name: torch.stack([own[name] for own in sets]).requires_grad_() for name in names}
    batch |= {name: leaf.detach().clone().requires_grad_() for name, leaf in leaves.items() if name not in names}
    states = simulator.rollout_batch(Parameters(**batch), torch.stack(own_points))
    assert states.x.shape == (3, *expected[0].x.shape)
    assert states.failures == (None, None, None)
    sum(random_loss(States(states.x[r], states.v[r], states.F[r])) for r in range(3)).backward()
    for rollout_number, one in enumerate(expected):
        for ours, theirs in ((states.x, one.x), (states.v, one.v), (states.F, one.F)):
            assert (ours[rollout_number] - theirs).norm() < 1e-12 * theirs.norm()
    for name, leaf in batch.items():
        theirs = torch.stack([own[name].grad for own in gradients])
        theirs = theirs if name in names else theirs.sum(0)
        assert (leaf.grad - theirs).norm() < 1e-11 * theirs.norm(), name


def test_a_failing_rollout_leaves_the_others_alone(device):
    """One inverts in its first frame, one, too soft to stop, in its second: both say so, and what follows has no gradient."""
    body = block((4, 4, 4))
    config = SimulationConfig(fps=60, gravity=(0.0, 0.0, 0.0), ground_height=None, dtype="float64", device=device)
    simulator = Simulator(body, config)
    spin = 5.0 * torch.as_tensor(body.x0 - body.x0.mean(0), device=device).flip(1)
    collapse = torch.zeros_like(spin)
    collapse[:, 0] = -torch.as_tensor(body.x0[:, 0] - body.x0[:, 0].mean())
    rates = 4000.0, 40.0  # 1/s; flat after a fortieth of a second, which is in the second frame
    velocity = torch.stack([spin, *(rate * collapse for rate in rates)]).requires_grad_()
    E = torch.tensor([[2e3], [2e3], [1.0]], dtype=torch.float64, requires_grad=True)
    nu, controllers = torch.tensor(0.3), torch.zeros(4, 0, 3)
    states = simulator.rollout_batch(Parameters(E, nu, initial_velocity=velocity), controllers)
    assert states.failures[0] is None
    for rollout_number, frame in ((1, 0), (2, 1)):
        failure, x = states.failures[rollout_number], states.x[rollout_number]
        assert isinstance(failure, SimulationError) and failure.frame == frame and "not finite" in str(failure)
        assert torch.isfinite(x[: frame + 1]).all() and torch.isnan(x[frame + 1 :]).all()
    with pytest.raises(SimulationError) as caught:
        simulator.rollout(Parameters(E[1, 0], nu, initial_velocity=velocity[1]), controllers)
    assert str(caught.value) == str(states.failures[1])
    alone = simulator.rollout(Parameters(E[0, 0], nu, initial_velocity=velocity[0]), controllers)
    assert torch.allclose(states.x[0], alone.x, rtol=1e-12, atol=0)
    weights = torch.tensor([0.0, 1.0, 1.0, 1.0], device=device)[:, None, None]  # of frames, also behind the failures
    (states.x[0].square().sum() + states.v[1, 0].sum() + (weights * states.x[2]).sum()).backward()
    together, velocity.grad, E.grad = (velocity.grad, E.grad), None, None
    alone.x.square().sum().backward()
    assert torch.allclose(together[1][0], E.grad[0], rtol=1e-10)
    assert torch.allclose(together[0][0], velocity.grad[0], rtol=1e-9, atol=1e-15)
    assert torch.equal(together[0][1], torch.ones_like(spin)) and not together[1][1].any()
    # of the first frame's positions, the sum of which the forces within do not change
    assert torch.allclose(together[0][2], torch.full_like(spin, 1 / 60), rtol=1e-9)


def test_particles_in_any_order_give_the_same_numbers(device):
    """The caller's order is kept although the kernels work cell by cell; failures name the caller's particle."""
    body = block((4, 4, 4))
    shuffled = np.random.default_rng(0).permutation(64)
    config = SimulationConfig(fps=60, dtype="float64", device=device)
    rate = torch.randn(3, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    velocity = torch.as_tensor(body.x0) @ (5.0 * rate)
    found = []
    for order in (np.arange(64), shuffled):
        own = Body(body.x0[order], body.volume[order], body.density[order], body.spacing)
        leaf = velocity[order].clone().requires_grad_()
        parameters = Parameters(torch.tensor(2e3), torch.tensor(0.3), initial_velocity=leaf)
        states = Simulator(own, config).rollout(parameters, torch.zeros(7, 0, 3))
        states.F.square().sum().backward()
        found.append((states.x.detach().cpu(), leaf.grad))
    for a, b in zip(*found, strict=True):
        assert torch.allclose(a[..., shuffled, :], b, rtol=1e-10, atol=1e-14)


def test_rollouts_that_part(device):
    """One is pulled from rest over many cells, another one against its flight: both go by the closed form."""
    body = block((3, 3, 3))
    config = SimulationConfig(fps=10, gravity=(0.0, 0.0, 0.0), ground_height=None, dtype="float64", device=device)
    load = PointLoad(np.arange(27), np.ones(27), (30.0 * body.mass.sum(), 0.0, 0.0))  # 0.15 m in a frame, seven cells
    simulator = Simulator(body, config, loads=(load,))
    speed = torch.tensor([[[0.0, 0.0, 0.0]], [[-3.0, 0.0, 0.0]]])
    parameters = Parameters(torch.tensor(2e3), torch.tensor(0.3), initial_velocity=speed)
    states = simulator.rollout_batch(parameters, torch.zeros(4, 0, 3))
    assert states.failures == (None, None)
    substeps, time = simulator.substeps(Parameters(torch.tensor(2e3), torch.tensor(0.3))), torch.arange(4) / 10
    for v0, x in zip((0.0, -3.0), states.x.cpu(), strict=True):
        expected = 0.015 + v0 * time + 15.0 * time * (time + 0.1 / substeps)
        assert torch.allclose(x[..., 0].mean(1), expected.double(), atol=1e-6)


def flying(device: str) -> tuple[Simulator, Parameters]:
    """A small block without weight, at 10 frames a second, of 216 nodes."""
    body = block((3, 3, 3))
    config = SimulationConfig(fps=10, gravity=(0.0, 0.0, 0.0), ground_height=None, dtype="float64", device=device)
    return Simulator(body, config), Parameters(torch.tensor(2e3), torch.tensor(0.3))


def test_more_rollouts_than_can_be_counted_are_refused(device, monkeypatch):
    """And fewer go on after that."""
    simulator, parameters = flying(device)
    monkeypatch.setattr("physreal_core.simulation.cuda.stepper.MOST_NUMBERS", 4000)
    with pytest.raises(InputError, match="rollout_batch.*3 rollouts of 27 particles and 216 nodes.*fewer"):
        simulator.rollout_batch(parameters, torch.zeros(3, 2, 0, 3))
    assert simulator.rollout_batch(parameters, torch.zeros(2, 2, 0, 3)).failures == (None, None)


def test_a_simulator_outlives_others_on_the_same_stream(device):
    """Torch hands out the same 32 streams over and over; graphs are captured on one when first needed."""
    if device == "cpu":
        pytest.skip("streams are a GPU's")
    simulators = [flying(device) for _ in range(40)]
    survivor, parameters = simulators[-1]
    del simulators
    gc.collect()
    assert torch.isfinite(survivor.rollout(parameters, torch.zeros(3, 0, 3)).x).all()


def test_memory_that_others_have_taken(device, monkeypatch):
    """Where kept frames do not fit, fewer are kept; where not even the working slots do, that is an error until they do."""
    simulator, leaves, controllers = scene(ALL_FEATURES, device, "float64")
    simulator._stepper.kept_bytes = 10**9
    expected = rollout(simulator, leaves, controllers)
    frame = simulator._stepper.substeps + 1  # slots
    assert simulator._stepper.slots == 3 * frame + 2

    class Scarce(FrameLaunches):
        def __init__(self, model, wanted, *arguments):
            if wanted > slots:
                raise torch.OutOfMemoryError("others")
            super().__init__(model, wanted, *arguments)

    monkeypatch.setattr("physreal_core.simulation.cuda.stepper.FrameLaunches", Scarce)
    simulator, *_ = scene(ALL_FEATURES, device, "float64")
    simulator._stepper.kept_bytes = 10**9
    slots = 1
    with pytest.raises(torch.OutOfMemoryError):
        rollout(simulator, leaves, controllers)
    slots = 2.5 * frame
    assert worst(rollout(simulator, leaves, controllers), expected) < 1e-11
    assert simulator._stepper.slots == 2 * frame


def test_the_share_of_a_card(monkeypatch):
    """A quarter of the card for kept frames, half of what this process may use if that is less."""
    monkeypatch.setattr(torch.cuda, "get_device_properties", lambda device: SimpleNamespace(total_memory=8_000))
    for given, expected in ((None, 2_000), ("1", 2_000), ("0.1", 400)):
        monkeypatch.delenv(CARD_SHARE, raising=False) if given is None else monkeypatch.setenv(CARD_SHARE, given)
        assert kept_bytes_of("cuda:0") == expected
    for wrong in ("0", "1.5", "half"):
        monkeypatch.setenv(CARD_SHARE, wrong)
        with pytest.raises(InputError, match=f"{CARD_SHARE}.*share of a GPU"):
            kept_bytes_of("cuda:0")


def test_play_goes_where_a_rollout_goes(device):
    simulator, leaves, controllers = scene(ALL_FEATURES, device, "float64")
    parameters = Parameters(**{name: leaf.detach() for name, leaf in leaves.items()})
    states = simulator.rollout(parameters, controllers)
    player = simulator.play(parameters, controllers[0])
    for frame in range(1, len(controllers)):
        state = player.step(controllers[frame])
        assert player.frame == frame
        assert torch.allclose(state.x, states.x[frame], rtol=1e-12)
        assert torch.allclose(state.F, states.F[frame], rtol=1e-11, atol=1e-13)
    with pytest.raises(InputError, match="controllers"):
        player.step(controllers[0, :1])
