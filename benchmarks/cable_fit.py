"""The fit of a held cable to one recording: unknowns about their guesses, and L-BFGS with the simulator's gradients."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import torch
from scipy.optimize import minimize

from benchmarks.cable_scene import DENSITY, MARKERS, PREDICTED, RADIUS, HeldCable, Model
from physreal_core.array_types import Array, Float, Tensor

SHEATH = 9.4e6
"""Young's modulus of soft PVC, Shore A 80, by Gent's relation (Trans. Inst. Rubber Ind. 34, 1958) [Pa]."""
DEFAULT_STIFFNESS = SHEATH * RADIUS**2 / 4.0 / DENSITY
AIR_DRAG = 0.5 * 1.2 * 1.2 * 2.0 * RADIUS / (DENSITY * math.pi * RADIUS**2)
"""Of a cylinder across the wind per mass [1/m]: C_d = 1.2 (Hoerner, Fluid-Dynamic Drag, 1965), air of 1.2 kg/m3."""
NOISE = 0.005
"""Error of a marker [m] against which the guesses' widths count."""
UNKNOWNS = {
    # logarithms of the stiffness over its default, of twisting, of linear drag and of lag; curvatures [1/m]; roll [rad]
    "stiffness": (1, 0.0, 1.0),
    "twisting": (1, 0.0, 0.7),
    "drag": (1, math.log(0.5), 1.0),
    "lag": (1, math.log(0.02), 1.0),
    "curvature": (2 * MARKERS, 0.0, 5.0),
    "roll": (1, 0.0, 1.0),
}
"""How many numbers, their guess, and its width."""


def default_model() -> Model:
    """A straight homogeneous cable of soft PVC in air, without losses of its own and without twist between the hands."""
    number = lambda value: torch.tensor(value, dtype=torch.float64)
    zero = number(0.0)
    return Model(
        number(DEFAULT_STIFFNESS),
        number(1.0),
        zero,
        number(AIR_DRAG),
        zero,
        torch.zeros(MARKERS, 2, dtype=torch.float64),
        zero,
    )


def model_of(z: Float[Tensor, " unknowns"]) -> Model:
    """The model at unknowns in units of their widths about their guesses."""
    values, first = {}, 0
    for name, (count, guess, width) in UNKNOWNS.items():
        values[name] = guess + width * z[first : first + count]
        first += count
    stiffness, twisting, drag, lag = (values[n][0].exp() for n in ("stiffness", "twisting", "drag", "lag"))
    return Model(
        DEFAULT_STIFFNESS * stiffness,
        twisting,
        drag,
        torch.full_like(drag, AIR_DRAG).detach(),
        lag,
        values["curvature"].reshape(MARKERS, 2),
        values["roll"][0],
    )


def fit(
    stages: Sequence[tuple[HeldCable, int]], tell: Callable[[str], None] = lambda _: None
) -> tuple[Float[Array, " unknowns"], list[float]]:
    """The unknowns of largest posterior density, given each marker off by NOISE in every half second.

    Args:
        stages: parts of one recording, each longer than the one before, and iterations on each.
        tell: called with a line of text now and then.

    Returns:
        The unknowns, and root mean square errors [m] of the last stage's evaluations.
    """
    z = np.zeros(sum(count for count, _, _ in UNKNOWNS.values()))
    errors: list[float] = []
    for held, iterations in stages:
        errors.clear()
        # markers' errors last: half a second counts as one sample
        weight = held.frames / 50.0 * 9.0 / (2.0 * NOISE**2)

        def density(z: np.ndarray, held: HeldCable = held, weight: float = weight) -> tuple[float, np.ndarray]:
            unknowns = torch.tensor(z, requires_grad=True)
            squared = held.errors(model_of(unknowns))[:, PREDICTED].square().mean()
            value = weight * squared + 0.5 * unknowns.square().sum()
            value.backward()
            errors.append(float(squared.detach()) ** 0.5)
            if len(errors) % 5 == 1:
                tell(f"{held.frames} frames, evaluation {len(errors)}: {1e3 * errors[-1]:.2f} mm")
            return float(value.detach()), unknowns.grad.numpy()

        z = minimize(density, z, jac=True, method="L-BFGS-B", options={"maxiter": iterations, "maxcor": 30}).x
    return z, errors
