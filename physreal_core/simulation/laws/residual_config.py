"""Sizes, bounds and flat weight layout of the neural residuals: one network each for elasticity and plasticity."""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from physreal_core.array_types import Float
from physreal_core.errors import InputError

STRAIN_FEATURES = 10
OUTPUTS = 6
THIN_OUTPUTS = 8
"""Coefficients of a thin body's elements (thin/residual.py)."""
_INVARIANTS = 3
"""Features before the entries of F^T F - I (residual.h)."""
_ENTRIES = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


@dataclass(frozen=True)
class ResidualConfig:
    """Both residual networks: two hidden layers, shared by all particles, told apart by their latent codes.

    Attributes:
        latent_size: length L of a particle's latent code, 0 for none.
        hidden: units in each of the two hidden layers.
        beta_elastic: |delta tau| <= beta_elastic |tau_exp|.
        beta_plastic: |delta F| <= beta_plastic |F_exp| per frame, the share of a substep in proportion.
        strain_scale: strain that counts as one at the networks' input.
        thin: of a thin body, whose one network takes the latent code alone (thin/residual.py); `beta_plastic` is not used.

    Raises:
        InputError: for a size or bound out of range.
    """

    latent_size: int = 4
    hidden: int = 16
    beta_elastic: float = 0.5
    beta_plastic: float = 0.1
    strain_scale: float = 0.1
    thin: bool = False

    def __post_init__(self) -> None:
        for name, value, valid, expected in (
            ("latent_size", self.latent_size, self.latent_size >= self.thin, f"{int(self.thin)} or more"),
            ("hidden", self.hidden, self.hidden >= 1, "1 or more"),
            ("beta_elastic", self.beta_elastic, 0 <= self.beta_elastic < 1, "in [0, 1)"),
            ("beta_plastic", self.beta_plastic, 0 <= self.beta_plastic < 1, "in [0, 1)"),
            ("strain_scale", self.strain_scale, self.strain_scale > 0, "positive"),
        ):
            if not valid:
                raise InputError(f"{name} = {value}", where="residual", expected=expected)

    @property
    def input_size(self) -> int:
        """Strain features and latent code; of a thin body the code alone."""
        return self.latent_size + (0 if self.thin else STRAIN_FEATURES)

    @property
    def output_size(self) -> int:
        """Entries of a symmetric matrix, or coefficients of a thin body's element."""
        return THIN_OUTPUTS if self.thin else OUTPUTS

    @property
    def weight_shapes(self) -> dict[str, tuple[int, ...]]:
        """Shapes by name, in the order of the flat vector; y = x weight for 1 and 2, y = weight x for 3."""
        inputs, hidden = self.input_size, self.hidden
        return {
            "weight_1": (inputs, hidden),
            "bias_1": (hidden,),
            "weight_2": (hidden, hidden),
            "bias_2": (hidden,),
            "weight_3": (self.output_size, hidden),
            "bias_3": (self.output_size,),
        }

    @property
    def weight_count(self) -> int:
        """Length W of the flat vector."""
        return sum(math.prod(shape) for shape in self.weight_shapes.values())


def split_weights(config: ResidualConfig, weights: Float[Tensor, "*rollouts weights"]) -> dict[str, Tensor]:
    """Views of flat weight vectors by the names of `config.weight_shapes`."""
    parts = weights.split([math.prod(shape) for shape in config.weight_shapes.values()], dim=-1)
    named = zip(config.weight_shapes.items(), parts, strict=True)
    return {name: part.unflatten(-1, shape) for (name, shape), part in named}


def turned_weights(
    config: ResidualConfig, weights: Float[Tensor, " weights"], rotation: Float[Tensor, "3 3"]
) -> Float[Tensor, " weights"]:
    """Weights of the same material in a body that lies turned, so that its residual turns with it.

    Six features are entries of F^T F - I in the axes of the undeformed body, the six outputs entries of a symmetric matrix there. What was C is
    R C R^T in the turned body. Both maps are linear, so the first layer takes the features back and the last one turns the outputs; their
    norm, which bounds the residual, stays. The weights of a thin body stay as they are: no axes are among its features.

    Args:
        config: of the network.
        weights: flat, of one network.
        rotation: R, from the body as it lay to the body as it lies now.
    """
    if config.thin:
        return weights.clone()
    R = rotation.to(weights)
    scales = torch.ones(6, dtype=weights.dtype), torch.tensor([1.0, 1.0, 1.0, *3 * [0.5**0.5]], dtype=weights.dtype)
    back, on = (_turn_of_entries(turn, scale) for turn, scale in zip((R.mT, R), scales, strict=True))
    turned = weights.clone()
    parts = split_weights(config, turned)
    entries = slice(_INVARIANTS, _INVARIANTS + 6)
    parts["weight_1"][entries] = back.mT @ parts["weight_1"][entries]
    parts["weight_3"].copy_(on @ parts["weight_3"])
    parts["bias_3"].copy_(on @ parts["bias_3"])
    return turned


def _turn_of_entries(turn: Float[Tensor, "3 3"], scale: Float[Tensor, "6"]) -> Float[Tensor, "6 6"]:
    """How the entries 00, 11, 22, 01, 02, 12 of a symmetric matrix, those off the diagonal over `scale`, follow as it turns."""
    columns = []
    for (i, j), own in zip(_ENTRIES, scale, strict=True):
        basis = torch.zeros(3, 3, dtype=turn.dtype)
        basis[i, j] = basis[j, i] = own
        there = turn @ basis @ turn.mT
        columns.append(torch.stack([there[k, m] for k, m in _ENTRIES]) / scale)
    return torch.stack(columns, 1)


def initial_weights(config: ResidualConfig, seed: int) -> tuple[Float[Tensor, " weights"], Float[Tensor, " weights"]]:
    """Flat weights [W] of the elastic and the plastic network, float64 on the CPU; output layers exactly zero."""
    generator = torch.Generator().manual_seed(seed)
    return _one_network(config, generator), _one_network(config, generator)


def _one_network(config: ResidualConfig, generator: torch.Generator) -> Float[Tensor, " weights"]:
    weights = torch.zeros(config.weight_count, dtype=torch.float64)
    for name, part in split_weights(config, weights).items():
        if not name.endswith("_3"):
            scale = part.shape[0] ** -0.5 if part.dim() == 2 else 0.5
            part.copy_(scale * torch.randn(part.shape, generator=generator, dtype=torch.float64))
    return weights
