"""Where the numbers of the optional laws stand in the arrays of the C++ step (terms.h), and what goes in and out there."""

import torch

from physreal_core.simulation.parameters import Parameters

LAWS = ("drag", "adhesion", "obstacle", "viscosity", "stiffening", "fibres", "friction_law")
"""Terms by their bits in `Frame.terms`; other terms only replace what the step is given."""
_ROWS = {
    "linear_drag": (0, 1),
    "quadratic_drag": (1, 1),
    "adhesion": (2, 1),
    "viscosity": (4, 2),
    "stiffening": (6, 1),
    "fibre_modulus": (7, 1),
    "fibre_direction": (8, 3),
}  # first column and how many, of parameters that each particle has
_START_HEIGHT = 3
_NUMBERS = {"adhesion_range": (0, 1), "obstacle": (1, 8), "friction_law": (9, 3)}  # that all particles share
TERM_ROWS, TERM_NUMBERS = 11, 12
INPUT_BARS = 1 + 3 + TERM_ROWS  # mass, force, laws
SUMS = 6 + TERM_NUMBERS  # friction, grip stiffness and damping, gravity, laws


def law_bits(terms: tuple[str, ...]) -> int:
    """`Frame.terms` of a configuration."""
    return sum(1 << bit for bit, law in enumerate(LAWS) if law in terms)


def fill(values: torch.Tensor, parameters: Parameters, heights: torch.Tensor) -> list[float]:
    """Put the laws' parameters into `Frame.term_values`; returns `Frame.term_numbers`.

    Args:
        values: shape [N, TERM_ROWS].
        parameters: of a rollout, complete.
        heights: z of the particles at the rollout's start [m], shape [N].
    """
    for name, (first, size) in _ROWS.items():
        value = getattr(parameters, name)
        if value is not None:
            values[:, first : first + size] = value.detach().view(-1, size)
    values[:, _START_HEIGHT] = heights
    numbers = torch.zeros(TERM_NUMBERS, dtype=torch.float64)
    for name, (first, size) in _NUMBERS.items():
        value = getattr(parameters, name)
        if value is not None:
            numbers[first : first + size] = value.detach().view(size)
    return numbers.tolist()


def gradients(shapes: dict[str, tuple[int, ...]], bars: torch.Tensor, sums: torch.Tensor) -> dict[str, torch.Tensor]:
    """Adjoints of the laws' parameters that are in use.

    Args:
        shapes: of all parameters in use, by name.
        bars: `Frame.term_bar`, shape [N, TERM_ROWS].
        sums: of the numbers that all particles share, shape [TERM_NUMBERS].
    """
    result = {}
    for table, source in ((_ROWS, bars), (_NUMBERS, sums)):
        for name, (first, size) in table.items():
            if name in shapes:
                result[name] = source[..., first : first + size].reshape(shapes[name]).clone()
    return result


def start_height_adjoint(bars: torch.Tensor) -> torch.Tensor:
    """Adjoint of the particles' heights at the rollout's start [N], from `Frame.term_bar`."""
    return bars[:, _START_HEIGHT]
