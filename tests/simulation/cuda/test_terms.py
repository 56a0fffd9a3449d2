"""The optional terms in the fused form of the step, held to the plain one and to single rollouts; as `test_step`."""

import pytest
import torch

from benchmarks.agreement import CASES, VOLUME_TERMS, Case, random_loss, scene
from physreal_core.simulation import Parameters, Simulator, States
from physreal_core.simulation.cuda.stepper import CudaStepper
from physreal_core.simulation.terms import TERM_OF

ALL = CASES["all terms, branches"]


def rollout(simulator: Simulator, leaves: dict, controllers: torch.Tensor) -> tuple[dict, dict]:
    """Last states, and gradients of a random loss by all leaves and the controller points, by name."""
    fresh = {name: leaf.detach().clone().requires_grad_() for name, leaf in leaves.items()}
    points = controllers.clone().requires_grad_()
    states = simulator.rollout(Parameters(**fresh), points)
    random_loss(states).backward()
    last = {name: getattr(states, name)[-1].detach().cpu() for name in ("x", "v", "F")}
    return last, {name: leaf.grad for name, leaf in (*fresh.items(), ("controllers", points))}


def worst(ours: dict[str, torch.Tensor], theirs: dict[str, torch.Tensor]) -> float:
    return max(float((ours[name] - theirs[name]).norm() / theirs[name].norm()) for name in theirs)


@pytest.mark.parametrize("term", [*VOLUME_TERMS, "all"])
def test_a_term_is_the_native_forms(term, device, monkeypatch):
    """Compiled with all terms, of which the others are left out, against the native form of this one alone.

    Both add in another order: 1e-16 a sum.
    """
    terms = VOLUME_TERMS if term == "all" else (term,)
    simulator, leaves, controllers = scene(ALL, device, "float64")
    assert isinstance(simulator._stepper, CudaStepper)
    given = {name: leaf for name, leaf in leaves.items() if TERM_OF.get(name, terms[0]) in terms}
    states, gradients = rollout(simulator, given, controllers)
    monkeypatch.undo()
    native, *_ = scene(Case(terms=terms), "cpu", "float64")
    assert native.substeps(Parameters(**given)) == simulator.substeps(Parameters(**given)) > 1
    expected, expected_gradients = rollout(native, given, controllers)
    assert worst(states, expected) < 1e-12
    assert worst(gradients, expected_gradients) < 1e-11

    bare, *_ = scene(Case(), "cpu", "float64")
    without, _ = rollout(bare, {name: leaf for name, leaf in given.items() if name not in TERM_OF}, controllers)
    assert worst(states, without) > 1e-5, "the term has no effect in this scene"


def differing(leaves: dict) -> list[dict]:
    """Three sets of parameters; particle 0, the same in all, makes the step and viscosity's memory the same."""
    leaves = {name: leaf.detach().clone() for name, leaf in leaves.items()}
    for name, value in (("youngs_modulus", 6e3), ("density", 150.0), ("viscosity", 2.0)):
        leaves[name][0] = value
    sets = []
    for scale in (1.0, 0.9, 0.7):
        own = {name: leaf.clone() for name, leaf in leaves.items()}
        for name in (
            "youngs_modulus",
            *(name for name in TERM_OF if name in own and not name.startswith(("initial", "fibre_d"))),
        ):
            values = own[name]
            kept = values[:1].clone() if values.shape[:1] == leaves["density"].shape else None
            values *= 2.0 - scale if name == "density" else scale
            if kept is not None:
                values[:1] = kept
        own["initial_position"] += 0.01 * (1.0 - scale)
        own["initial_deformation"][1:] += 0.05 * (1.0 - scale)
        sets.append(own)
    return sets


def test_a_batch_gives_the_single_rollouts(device):
    """Values and gradients of rollouts that differ in every term's parameters."""
    simulator, leaves, controllers = scene(ALL, device, "float64")
    sets = differing(leaves)
    assert len({simulator.substeps(Parameters(**own)) for own in sets}) == 1
    points = [controllers, controllers + 0.001, controllers]
    alone = [rollout(simulator, *one) for one in zip(sets, points, strict=True)]
    batch = {name: torch.stack([own[name] for own in sets]).requires_grad_() for name in leaves}
    led = torch.stack(points).requires_grad_()
    states = simulator.rollout_batch(Parameters(**batch), led)
    assert isinstance(simulator._batch.stepper, CudaStepper)
    assert states.failures == (None, None, None)
    sum(random_loss(States(states.x[r], states.v[r], states.F[r])) for r in range(3)).backward()
    for r, (last, gradients) in enumerate(alone):
        assert worst({name: getattr(states, name)[r, -1].detach().cpu() for name in last}, last) < 1e-12
        assert worst({name: leaf.grad[r] for name, leaf in (batch | {"controllers": led}).items()}, gradients) < 1e-11
    assert worst(alone[1][0], alone[0][0]) > 1e-3


def test_play_goes_where_a_rollout_goes(device):
    """From the given start, and mean rate of deformation and Maxwell branches go on from frame to frame."""
    simulator, leaves, controllers = scene(ALL, device, "float64")
    parameters = Parameters(**{name: leaf.detach() for name, leaf in leaves.items()})
    states = simulator.rollout(parameters, controllers)
    player = simulator.play(parameters, controllers[0])
    assert torch.equal(player.state.F.cpu(), leaves["initial_deformation"])
    for frame in range(1, len(controllers)):
        state = player.step(controllers[frame])
        assert torch.allclose(state.x, states.x[frame], rtol=1e-12)
        assert torch.allclose(state.F, states.F[frame], rtol=1e-11, atol=1e-13)


def test_kept_frames_give_what_recomputed_ones_do(device):
    """With room for no frame and for all; the body's own shape, mean rate of deformation and Maxwell branches are kept, too."""
    simulator, leaves, controllers = scene(ALL, device, "float64")
    stepper, found = simulator._stepper, []
    for frames in (0, 9):
        stepper.substeps = simulator.substeps(Parameters(**leaves))
        stepper.kept_bytes = frames * stepper.frame_bytes()
        found.append(rollout(simulator, leaves, controllers)[1])
    assert stepper.slots // (stepper.substeps + 1) == 3
    assert worst(found[1], found[0]) < 1e-11


def test_an_adjoint_is_compiled_when_it_is_needed(device):
    simulator, leaves, controllers = scene(CASES["drag, density"], device, "float64")
    with torch.no_grad():
        simulator.rollout(Parameters(**leaves), controllers)
    assert not simulator._stepper._launches._backward
    random_loss(simulator.rollout(Parameters(**leaves), controllers)).backward()
    assert list(simulator._stepper._launches._backward) == [
        False
    ]  # and that of the controller points only where they ask for it
