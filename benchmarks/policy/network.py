"""The policy: a picture with heights and what is known of the hand, to a mixture of ways that the hand may take next."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import nn

from physreal_core.array_types import Float, Int, Tensor, UInt8

AHEAD = 8
"""Steps of a way."""

WAYS = 6
"""Of the mixture. Episodes take the body at many places, and their mean may be no place to take it."""

_CHANNELS, _WIDTH, _HAND = 48, 256, 6
SCALE = 0.1
"""Length [m] that counts as 1 in the network."""

_LEAST, _LARGEST = math.log(0.1), math.log(3.0)
"""Natural logarithms of the least and the largest standard deviation of a step's place, in that unit: 1 cm, below which a hand need not be known."""


@dataclass(frozen=True)
class Ways:
    """A mixture of normal distributions over the next `AHEAD` steps.

    Attributes:
        weights: logarithms, not normalised.
        places: of the hand from where it is, in units of `SCALE`.
        spread: natural logarithms of standard deviations, in the same unit.
        closed: logits that the hand is closed in each step, as of each way.
    """

    weights: Float[Tensor, "batch ways"]
    places: Float[Tensor, "batch ways ahead 3"]
    spread: Float[Tensor, "batch ways ahead"]
    closed: Float[Tensor, "batch ways ahead"]

    def surprise(
        self, places: Float[Tensor, "batch ahead 3"], closed: Float[Tensor, "batch ahead"]
    ) -> Float[Tensor, " batch"]:
        """Negative logarithm of the likelihood of what the hand did, but for a constant."""
        off = (places[:, None] - self.places) / self.spread.exp()[..., None]
        moved = -0.5 * off.square().sum((-1, -2)) - 3.0 * self.spread.sum(-1)
        said = closed[:, None].expand_as(self.closed)
        shut = -nn.functional.binary_cross_entropy_with_logits(self.closed, said, reduction="none").sum(-1)
        return -torch.logsumexp(self.weights.log_softmax(-1) + moved + shut, -1)

    def likeliest(self) -> tuple[Float[Tensor, "batch ahead 3"], Float[Tensor, "batch ahead"]]:
        """Places [m] and the probability of a closed hand of the way with the most weight."""
        best: Int[Tensor, " batch"] = self.weights.argmax(-1)
        row = torch.arange(len(best), device=best.device)
        return SCALE * self.places[row, best], self.closed[row, best].sigmoid()


class Policy(nn.Module):
    """Features of the picture are places: of each channel the mean pixel under a softmax, and the height there (Finn et al. 2016)."""

    def __init__(self) -> None:
        super().__init__()
        sizes = [(4, 32, 5, 2), (32, _CHANNELS, 3, 1), (_CHANNELS, _CHANNELS, 3, 2), (_CHANNELS, _CHANNELS, 3, 1)]
        layers = [(nn.Conv2d(n, m, k, s, k // 2), nn.GroupNorm(4, m), nn.ReLU()) for n, m, k, s in sizes]
        self.picture = nn.Sequential(
            *(layer for block in layers for layer in block), nn.Conv2d(_CHANNELS, _CHANNELS, 1)
        )
        width, out = _WIDTH, WAYS * (1 + AHEAD * 5)
        self.head = nn.Sequential(
            nn.Linear(3 * _CHANNELS + _HAND, width),
            nn.ReLU(),
            nn.Linear(width, width),
            nn.ReLU(),
            nn.Linear(width, out),
        )

    def forward(
        self,
        colour: UInt8[Tensor, "batch h w 3"],
        heights: UInt8[Tensor, "batch h w"],
        hand: Float[Tensor, "batch 6"],
    ) -> Ways:
        """What the hand may do next; `hand` as of `View.hand`."""
        above = heights[:, None].float() / 100.0
        seen = torch.cat([colour.permute(0, 3, 1, 2).float() / 127.5 - 1.0, above], 1)
        shares = self.picture(seen).flatten(2).softmax(-1)
        rows, columns = -(-above.shape[2] // 4), -(-above.shape[3] // 4)
        v, u = torch.meshgrid(
            torch.linspace(-1, 1, rows, device=seen.device),
            torch.linspace(-1, 1, columns, device=seen.device),
            indexing="ij",
        )
        low = nn.functional.interpolate(above, (rows, columns), mode="area").flatten(1)
        features = [shares @ u.flatten(), shares @ v.flatten(), torch.einsum("bcp,bp->bc", shares, low)]
        told = torch.cat([hand[:, :3] / SCALE, hand[:, 3:]], 1)
        out = self.head(torch.cat([*features, told], 1))
        weights, rest = out[:, :WAYS], out[:, WAYS:].reshape(-1, WAYS, AHEAD, 5)
        spread = _LEAST + (_LARGEST - _LEAST) * rest[..., 3].sigmoid()
        return Ways(weights, rest[..., :3], spread, rest[..., 4])
