"""Small bodies and a directional finite-difference check, shared by the simulator's tests."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from physreal_core.simulation import Body, Grip, Parameters, Simulator, States

SPACING = 0.01


def block(
    counts: tuple[int, int, int], spacing: float = SPACING, density: float = 300.0, corner: tuple = (0.0, 0.0, 0.0)
) -> Body:
    """A box of particles on a lattice, half a spacing inside its faces."""
    index = np.stack(np.meshgrid(*[np.arange(n) for n in counts], indexing="ij"), -1).reshape(-1, 3)
    x0 = (index + 0.5) * spacing + np.asarray(corner)
    return Body(x0, np.full(len(x0), spacing**3), np.full(len(x0), density), spacing)


def two_point_grip(body: Body, points: np.ndarray, bonds: int) -> Grip:
    """The first particles of a body bound to two controller points by turns."""
    particles = np.arange(bonds)
    controllers = particles % 2
    lengths = np.linalg.norm(body.x0[particles] - points[controllers], axis=1)
    return Grip(particles, controllers, np.linspace(0.5, 1.5, bonds), lengths)


def random_loss(frames: list[int], seed: int = 0) -> Callable[[States], Tensor]:
    """A loss that weighs every entry of x, v and F of some frames at random."""

    def loss(states: States) -> Tensor:
        generator = torch.Generator().manual_seed(seed)
        total = states.x.new_zeros(())
        for values, scale in ((states.x, 1.0), (states.v, 0.1), (states.F, 0.1)):
            weights = torch.randn(values.shape[1:], generator=generator, dtype=torch.float64).to(values)
            for frame in frames:
                total = total + scale * (values[frame] * weights).sum()
        return total

    return loss


def directional_errors(
    simulator: Simulator, parameters: Parameters, controllers: Tensor, loss: Callable[[States], Tensor], steps: dict
) -> dict[str, tuple[float, float]]:
    """Adjoint and central-difference derivative of a loss along one random direction per parameter in `steps`.

    The loss is linear in the states, so that theirs is taken of the states' difference: two sums would round it away.

    Args:
        steps: half the difference's width by parameter name, in the parameter's unit.
    """
    tensors = {name: getattr(parameters, name).detach().clone().requires_grad_() for name in steps}
    loss(simulator.rollout(replace(parameters, **tensors), controllers)).backward()
    generator = torch.Generator().manual_seed(1)
    results = {}
    for name, step in steps.items():
        value = tensors[name].detach()
        direction = torch.randn(value.shape, generator=generator, dtype=value.dtype)
        with torch.no_grad():
            ahead, behind = (
                simulator.rollout(replace(parameters, **{name: value + sign * step * direction}), controllers)
                for sign in (1, -1)
            )
            moved = loss(States(ahead.x - behind.x, ahead.v - behind.v, ahead.F - behind.F))
        results[name] = (float((tensors[name].grad * direction).sum()), float(moved / (2 * step)))
    return results


def path_derivatives(
    simulator: Simulator, parameters: Parameters, controllers: Tensor, loss: Callable[[States], Tensor], step: float
) -> tuple[float, float]:
    """Adjoint and central-difference derivative of a loss along one random direction of the controller points' path.

    Args:
        step: half the difference's width [m].
    """
    path = controllers.clone().requires_grad_()
    loss(simulator.rollout(parameters, path)).backward()
    direction = torch.randn(path.shape, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    with torch.no_grad():
        ahead, behind = (loss(simulator.rollout(parameters, controllers + s * step * direction)) for s in (1, -1))
    return float((path.grad * direction).sum()), float(ahead - behind) / (2 * step)


def assert_adjoints_agree(results: dict[str, tuple[float, float]]) -> None:
    """Each parameter, by name, has an effect, and its adjoint is its central difference; as of `directional_errors`."""
    for name, (adjoint, difference) in results.items():
        assert difference != 0, f"{name} has no effect in this scene"
        assert adjoint == pytest.approx(difference, rel=1e-5), name


def numbers_of_every_kind(own: Body, points: np.ndarray) -> tuple[Parameters, torch.Tensor]:
    """Numbers of every kind, and a hand's path."""
    count, rng = len(own.x0), np.random.default_rng(0)
    numbers = Parameters(
        torch.tensor(5e4 * (1 + 0.2 * rng.random(count))),
        torch.tensor(0.3 + 0.05 * rng.random(count)),
        torch.tensor(0.3, dtype=torch.float64),
        grip_stiffness=torch.tensor(1.5, dtype=torch.float64),
        grip_damping=torch.tensor(0.01, dtype=torch.float64),
        initial_velocity=torch.tensor([0.5, 0.2, -0.3] + 0.2 * rng.normal(size=(count, 3))),
        gravity=torch.tensor([0.5, 0.0, -9.0], dtype=torch.float64),
        density=torch.tensor(300.0 * (1 + 0.2 * rng.random(count))),
    )
    return numbers, torch.tensor(points)[None] + torch.linspace(0, 0.01, 4, dtype=torch.float64)[:, None, None]


STEPS_OF_NUMBERS = {
    "youngs_modulus": 1e-1,
    "poissons_ratio": 1e-6,
    "friction_coefficient": 1e-5,
    "grip_stiffness": 1e-5,
}
STEPS_OF_NUMBERS |= {"grip_damping": 1e-7, "initial_velocity": 1e-6, "gravity": 1e-5, "density": 1e-4}
