"""The vector of unknowns of a fit: the baseline's material and, beside it, the coefficients of effects; with priors.

Free coordinates are of order one: the logarithm of moduli and friction, the logit of Poisson's ratio within its range, an
effect's coefficients in units of their scales. The priors are what makes freedom cost something.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Float, Tensor
from physreal_core.effects import EFFECTS
from physreal_core.gap.interactions.interaction import EffectValues, Trial

POISSON_RANGE = (0.05, 0.48)
LEVEL_CONTRAST = 1e-3
"""Standard deviation of log E from patch to patch that stands for none."""

STEP = 0.25
"""Of an effect's tangent, in its coefficient's scale."""


@dataclass(frozen=True)
class Priors:
    """Standard deviations in free coordinates.

    Args:
        modulus: of log E as a whole; the data know it well, so it hardly matters.
        contrast: of log E from patch to patch.
        poisson: of the logit of Poisson's ratio.
        friction: of log mu_f.
        grip: of log k_f.
        coefficient: of an effect's coefficients, in their scales.
    """

    modulus: float = 1.0
    contrast: float = 0.2
    poisson: float = 0.7
    friction: float = 0.7
    grip: float = 0.7
    coefficient: float = 1.0


@dataclass(frozen=True)
class Scalar:
    """A positive number of the whole baseline, by its logarithm.

    Args:
        prior: name of its width in `Priors`.
        step: of the tangent.
        lower, upper: bounds.
        factor: by which it may change.
    """

    prior: str
    step: float
    lower: float = 0.0
    upper: float = np.inf
    factor: float = np.inf


SCALARS = {
    "friction_coefficient": Scalar("friction", 0.15, lower=1e-3, upper=3.0),
    "grip_stiffness": Scalar("grip", 0.15, factor=5.0),
}
"""Of the model's fields, beside the material."""


@dataclass(frozen=True)
class Block:
    """A run of unknowns with a Gaussian prior.

    Args:
        mean, precision: of the prior, shapes [P] and [P, P].
        lower, upper: bounds, shape [P].
        steps: of the tangents, shape [P]; the sign says to which side.
        half: amplitudes whose sign physics fixes, shape [P]: their prior is half a Gaussian.
    """

    mean: Float[Array, " unknowns"]
    precision: Float[Array, "unknowns unknowns"]
    lower: Float[Array, " unknowns"]
    upper: Float[Array, " unknowns"]
    steps: Float[Array, " unknowns"]
    half: Bool[Array, " unknowns"]

    def __len__(self) -> int:
        return len(self.mean)


class Unknowns:
    """Baseline unknowns and those of some effects as one vector.

    Args:
        fields: of the fitted baseline; where the fit starts and where the priors are centred.
        effects: names, in the order in which they act.
        priors: their widths.
        at: values of the effects' coefficients around which the prior of shapes is centred; dormant by default.
        scalars: of `SCALARS`, those that are unknown and act.

    Attributes:
        places: where each effect's coefficients stand in the vector.
    """

    def __init__(
        self,
        fields: dict[str, Tensor],
        effects: Sequence[str] = (),
        priors: Priors | None = None,
        at: EffectValues | None = None,
        scalars: Sequence[str] = ("friction_coefficient",),
    ) -> None:
        self.fields, self.effects, self.priors = fields, tuple(effects), priors or Priors()
        self.patches, self.scalars = len(fields["youngs_modulus"]), tuple(scalars)
        self.at = at or {}
        blocks = [self._baseline(), *(self._effect(name) for name in self.effects)]
        self.baseline = len(blocks[0])
        ends = np.cumsum([len(block) for block in blocks])
        self.places = {n: slice(*ends[i : i + 2].tolist()) for i, n in enumerate(self.effects)}
        self.block = _joined(blocks)

    def __len__(self) -> int:
        return len(self.block)

    def _baseline(self) -> Block:
        p, K = self.priors, self.patches
        common = np.full((K, K), 1.0 / K)
        moduli = (np.eye(K) - common) / p.contrast**2 + common / (K * p.modulus**2)
        log_E = self.fields["youngs_modulus"].log().mean().item()
        rest = [(_logit(self.fields["poissons_ratio"].mean().item()), p.poisson, -4.0, 4.0, -0.25)]
        rest += [self._scalar(name) for name in self.scalars]
        mean, sd, lower, upper, step = (np.array(column) for column in zip(*rest, strict=True))
        precision = np.zeros((K + len(rest),) * 2)
        precision[:K, :K] = moduli
        precision[K:, K:] = np.diag(sd**-2.0)
        return Block(
            np.concatenate([np.full(K, log_E), mean]),
            precision,
            np.concatenate([np.full(K, log_E - 3.0), lower]),
            np.concatenate([np.full(K, log_E + 3.0), upper]),
            np.concatenate([np.full(K, 0.08), step]),
            np.zeros(K + len(rest), dtype=bool),
        )

    def _scalar(self, name: str) -> tuple[float, ...]:
        """Mean, standard deviation, bounds and step of the logarithm."""
        scalar, value = SCALARS[name], self.fields[name].item()
        lower, upper = max(scalar.lower, value / scalar.factor), min(scalar.upper, value * scalar.factor)
        mean = np.log(np.clip(value, lower, upper))
        return float(mean), getattr(self.priors, scalar.prior), np.log(lower), np.log(upper), scalar.step

    def _effect(self, name: str) -> Block:
        coefficients = EFFECTS[name].coefficients
        scale = np.array([c.scale for c in coefficients])
        dormant = np.array([c.dormant for c in coefficients])
        start = np.array([self.at.get(name, {}).get(c.name, c.dormant) for c in coefficients])
        amplitude = np.array([c.kind == "amplitude" for c in coefficients])
        lower, upper = (np.array([getattr(c, side) for c in coefficients]) for side in ("lower", "upper"))
        one_sided = amplitude & ((lower >= dormant) | (upper <= dormant))
        sign = np.where(upper <= dormant, -1.0, 1.0)
        return Block(
            np.where(amplitude, dormant, start) / scale,
            np.eye(len(scale)) / self.priors.coefficient**2,
            lower / scale,
            upper / scale,
            STEP * sign,
            one_sided,
        )

    def place(self, scalar: str) -> int:
        """Where a scalar stands in the vector."""
        return self.patches + 1 + self.scalars.index(scalar)

    # --- vectors and values -------------------------------------------------------------------------------------

    def start(self) -> Float[Array, " unknowns"]:
        """The baseline as it is given, every effect as `at` says."""
        vector = self.block.mean.copy()
        vector[: self.patches] = self.fields["youngs_modulus"].log().numpy()
        return self.with_effects(vector, self.at)

    def levelled(self) -> Unknowns:
        """The same without contrast from patch to patch."""
        priors = replace(self.priors, contrast=LEVEL_CONTRAST)
        return Unknowns(self.fields, self.effects, priors, self.at, self.scalars)

    def level(self, vector: Float[Array, " unknowns"]) -> Float[Array, " unknowns"]:
        """The vector with the mean of log E in all patches."""
        vector = vector.copy()
        vector[: self.patches] = vector[: self.patches].mean()
        return vector

    def with_effects(self, vector: Float[Array, " unknowns"], values: EffectValues) -> Float[Array, " unknowns"]:
        """The vector with these coefficients put in."""
        vector = vector.copy()
        for name, place in self.places.items():
            for position, c in enumerate(EFFECTS[name].coefficients, place.start):
                if c.name in values.get(name, {}):
                    vector[position] = values[name][c.name] / c.scale
        return vector

    def values(self, vector: Float[Array, " unknowns"]) -> EffectValues:
        """Coefficients by effect, in SI units."""
        return self._scaled(vector)

    def deviations(self, covariance: Float[Array, "unknowns unknowns"]) -> EffectValues:
        """Standard deviations of the coefficients by effect, in SI units."""
        return self._scaled(np.sqrt(np.diag(covariance)))

    def _scaled(self, vector: Float[Array, " unknowns"]) -> EffectValues:
        return {
            name: {c.name: float(z * c.scale) for c, z in zip(EFFECTS[name].coefficients, vector[place], strict=True)}
            for name, place in self.places.items()
        }

    def baseline_fields(self, vector: Float[Array, " unknowns"]) -> dict[str, Tensor]:
        """The model's fields."""
        K = self.patches
        fields = dict(self.fields)
        fields["youngs_modulus"] = torch.from_numpy(np.exp(vector[:K]))
        fields["poissons_ratio"] = torch.full((K,), _ratio(vector[K]), dtype=torch.float64)
        for name in self.scalars:
            fields[name] = torch.tensor(float(np.exp(vector[self.place(name)])), dtype=torch.float64)
        return fields

    def trial(self, vector: Float[Array, " unknowns"]) -> Trial:
        """The rollout at a vector."""
        return Trial(self.baseline_fields(vector), self.values(vector))

    def prior_energy(self, vector: Float[Array, " unknowns"]) -> float:
        """Minus the logarithm of the prior, up to its norm."""
        d = vector - self.block.mean
        return 0.5 * float(d @ self.block.precision @ d)


def _logit(ratio: float) -> float:
    low, high = POISSON_RANGE
    share = np.clip((ratio - low) / (high - low), 1e-3, 1.0 - 1e-3)
    return float(np.log(share / (1.0 - share)))


def _ratio(free: float) -> float:
    low, high = POISSON_RANGE
    return low + (high - low) / (1.0 + float(np.exp(-free)))


def _joined(blocks: list[Block]) -> Block:
    size = sum(map(len, blocks))
    precision, first = np.zeros((size, size)), 0
    for block in blocks:
        precision[first : first + len(block), first : first + len(block)] = block.precision
        first += len(block)

    def joined(name: str) -> Array:
        return np.concatenate([getattr(block, name) for block in blocks])

    return Block(joined("mean"), precision, *(joined(name) for name in ("lower", "upper", "steps", "half")))
