"""The fused form of the step of shells and rods held to the native one and to single rollouts; as `test_step`, which has their values
and gradients in float64."""

import numpy as np
import pytest
import torch

from benchmarks.agreement import CASES, TOLERANCES, Case, random_loss, run, scene
from benchmarks.thin_scenes import wavy_sheet
from physreal_core.errors import SimulationError
from physreal_core.simulation import Clamp, Parameters, SimulationConfig, Simulator, States
from physreal_core.simulation.thin.incidence import Incidence
from tests.simulation.cuda.test_step import worst


@pytest.fixture(params=["shell", "rod"])
def case(request) -> Case:
    return CASES[request.param]


def rollout(simulator: Simulator, leaves: dict, controllers: torch.Tensor) -> dict[str, np.ndarray]:
    """All states, and gradients of a random loss, by name."""
    fresh = {name: leaf.detach().clone().requires_grad_(leaf.requires_grad) for name, leaf in leaves.items()}
    states = simulator.rollout(Parameters(**fresh), controllers)
    random_loss(states).backward()
    numbers = {name: getattr(states, name) for name in ("x", "v", "F")}
    numbers |= {name: leaf.grad for name, leaf in fresh.items() if leaf.requires_grad}
    return {name: tensor.detach().cpu().numpy() for name, tensor in numbers.items()}


def test_single_precision_gives_the_native_forms_doubles(case, device, monkeypatch):
    """To the tolerance that a GPU is held to: rounding of 6e-8 grows over some ninety substeps."""
    ours = run(case, device, "float32")
    monkeypatch.undo()
    assert worst(ours, run(case, "cpu", "float64")) < TOLERANCES["float32"]


def test_without_terms_it_is_the_native_form(case, device, monkeypatch):
    """Compiled without any optional law or input. Both add in another order: 1e-16 a sum."""
    bare = Case(body=case.body)
    ours = run(bare, device, "float64")
    monkeypatch.undo()
    assert worst(ours, run(bare, "cpu", "float64")) < 1e-11


def differing(leaves: dict) -> dict[str, torch.Tensor]:
    """Three sets of parameters in one, whose stiffest elements are the same, so that all need the same substeps."""
    first = {name: leaf.detach().clone() for name, leaf in leaves.items()}
    count = len(first["youngs_modulus"])
    stiff = torch.arange(count) < count // 2
    first["youngs_modulus"][stiff] *= 4.0
    batch = {}
    for name in ("youngs_modulus", "linear_drag", "friction_coefficient", "initial_velocity"):
        rows = [first[name] * scale for scale in (1.0, 0.9, 0.7)]
        if name == "youngs_modulus":
            rows = [torch.where(stiff, first[name], row) for row in rows]
        batch[name] = torch.stack(rows).requires_grad_()
    others = {
        name: leaf.requires_grad_(leaves[name].requires_grad) for name, leaf in first.items() if name not in batch
    }
    return batch | others


@pytest.mark.parametrize("dtype", ["float64", "float32"])
def test_rows_of_a_batch_are_single_rollouts_byte_for_byte(case, dtype, device):
    """States, and gradients of what each vertex or the body as a whole has; those of the moduli pass through torch."""
    simulator, leaves, controllers = scene(case, device, dtype)
    batch = differing(leaves)
    own = {"youngs_modulus", "linear_drag", "friction_coefficient", "initial_velocity"}
    states = simulator.rollout_batch(Parameters(**batch), controllers)
    assert states.failures == (None, None, None)
    sum(random_loss(States(states.x[r], states.v[r], states.F[r])) for r in range(3)).backward()
    for r in range(3):
        row = {name: leaf.detach()[r] if name in own else leaf.detach() for name, leaf in batch.items()}
        row = {name: value.clone().requires_grad_(batch[name].requires_grad) for name, value in row.items()}
        alone = rollout(simulator, row, controllers)
        assert simulator._stepper.substeps == simulator._batch.stepper.substeps
        for name in ("x", "v", "F"):
            assert np.array_equal(getattr(states, name)[r].detach().cpu().numpy(), alone[name]), name
        for name in own - {"youngs_modulus"}:
            assert np.array_equal(batch[name].grad[r].numpy(), alone[name]), name
        error = np.linalg.norm(batch["youngs_modulus"].grad[r].numpy() - alone["youngs_modulus"])
        rounding = 1e-12 if dtype == "float64" else 1e-5
        assert error < rounding * np.linalg.norm(alone["youngs_modulus"])
    assert not np.array_equal(states.x[0].detach().cpu().numpy(), states.x[1].detach().cpu().numpy())


def test_a_rerun_gives_the_same_bytes(case, device):
    simulator, leaves, controllers = scene(case, device, "float32")
    first, again = rollout(simulator, leaves, controllers), rollout(simulator, leaves, controllers)
    for name, values in first.items():
        assert np.array_equal(values, again[name]), name


def test_kept_frames_give_what_recomputed_ones_do(case, device):
    """With room for no frame, for two of three and for all."""
    simulator, leaves, controllers = scene(case, device, "float64")
    stepper, found, slots = simulator._stepper, [], []
    for frames in (0, 2, 9):
        stepper.substeps = simulator.substeps(Parameters(**leaves))
        stepper.kept_bytes = frames * stepper.frame_bytes()
        found.append(rollout(simulator, leaves, controllers))
        slots.append(divmod(stepper.slots, stepper.substeps + 1))
    assert slots == [(1, 0), (3, 0), (3, 2)]  # frames and single slots, as of volumes
    for name, values in found[0].items():
        assert np.array_equal(found[1][name], values) and np.array_equal(found[2][name], values), name


def test_play_goes_where_a_rollout_goes(case, device):
    simulator, leaves, controllers = scene(case, device, "float64")
    parameters = Parameters(**{name: leaf.detach() for name, leaf in leaves.items()})
    states = simulator.rollout(parameters, controllers)
    player = simulator.play(parameters, controllers[0])
    assert torch.equal(player.state.F, states.F[0])
    for frame in range(1, len(controllers)):
        state = player.step(controllers[frame])
        assert torch.allclose(state.x, states.x[frame], rtol=1e-12)
        assert torch.allclose(state.v, states.v[frame], rtol=1e-11, atol=1e-13)
        assert torch.allclose(state.F, states.F[frame], rtol=1e-11, atol=1e-13)


def test_what_a_clamp_holds_stays(case, device):
    simulator, leaves, controllers = scene(case, device, "float64")
    held = torch.as_tensor(simulator.body.x0[:, 1] >= 0.045)
    assert 0 < held.sum() < len(held)
    with torch.no_grad():
        x = simulator.rollout(Parameters(**leaves), controllers).x.cpu()
    assert torch.equal(x[-1, held], x[0, held])
    assert (x[-1, ~held] != x[0, ~held]).any(-1).all()


def test_a_failing_rollout_leaves_the_others_alone(device, monkeypatch):
    """One tears in its first frame: it says so with the vertex and the substep of the native form, and has no gradient."""
    body = wavy_sheet()
    clamp = Clamp((-1.0, 0.055, -1.0), (1.0, 1.0, 1.0))
    config = SimulationConfig(fps=60, dtype="float64", device=device)
    calm = 0.1 * torch.randn(len(body.x0), 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    velocity = torch.stack([calm, 1e7 * calm, 0.5 * calm]).requires_grad_()
    parameters = Parameters(torch.tensor(3e4), torch.tensor(0.3), torch.tensor(0.3), initial_velocity=velocity)
    controllers = torch.zeros(4, 0, 3)
    simulator = Simulator(body, config, clamps=(clamp,))
    states = simulator.rollout_batch(parameters, controllers)
    states.x.nan_to_num().sum().backward()
    failure = states.failures[1]
    assert [f is None for f in states.failures] == [True, False, True]
    assert isinstance(failure, SimulationError) and failure.frame == 0 and "not finite" in str(failure)
    assert torch.isnan(states.x[1, 1:]).all() and torch.isfinite(states.x[[0, 2]]).all()
    assert torch.isfinite(velocity.grad).all() and not velocity.grad[1].any() and velocity.grad[[0, 2]].any()
    with pytest.raises(SimulationError) as caught:
        simulator.rollout(Parameters(torch.tensor(3e4), torch.tensor(0.3), initial_velocity=velocity[1]), controllers)
    assert str(caught.value) == str(failure)
    monkeypatch.undo()
    native = Simulator(body, SimulationConfig(fps=60, dtype="float64"), clamps=(clamp,))
    expected = native.rollout_batch(parameters, controllers)
    assert str(expected.failures[1]) == str(failure)
    assert torch.allclose(expected.x[0], states.x[0].cpu(), rtol=1e-10, atol=1e-12)


def test_sums_over_elements_are_those_by_index():
    """Values and gradients against torch's own; an element more or less at a vertex."""
    body, generator = wavy_sheet(), torch.Generator().manual_seed(0)
    corners = body.elements.triangles
    incidence, at = Incidence(corners, len(body.x0)), torch.as_tensor(corners)
    x = torch.randn(len(body.x0), 2, generator=generator, dtype=torch.float64).requires_grad_()
    values = torch.randn(len(corners), 2, generator=generator, dtype=torch.float64).requires_grad_()
    expected = x.new_zeros(len(body.x0), 2).index_add(0, at.T.ravel(), values.repeat(3, 1))
    assert torch.equal(incidence.at_corners(x), x[at.T])
    assert torch.allclose(incidence.around(values), expected, rtol=1e-14)
    assert torch.autograd.gradcheck(incidence.at_corners, (x,))
    assert torch.autograd.gradcheck(incidence.around, (values,))
