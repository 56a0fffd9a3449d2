"""The vector of unknowns of a fit: the baseline's material and the coefficients of effects, with their priors.

All coordinates are of order one: the logarithm of moduli and friction, the logit of Poisson's ratio within its range,
and an effect's coefficients in units of their scales. The priors make each further unknown cost evidence (Occam's
factor).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Float, Tensor
from physreal_core.effects import EFFECTS, Limits
from physreal_core.gap.interactions.interaction import EffectValues, Trial

POISSON_RANGE = (0.05, 0.48)
NO_CONTRAST = 1e-3
"""Standard deviation of log E from patch to patch that stands for one modulus everywhere."""

STEP = 0.25
"""Step of the secant by which an effect's tangent is taken, in the coefficient's scale."""


@dataclass(frozen=True)
class Priors:
    """Standard deviations of the Gaussian priors, in the coordinates of the vector.

    Args:
        modulus: of log E as a whole. The data determine it well, so this prior hardly matters.
        contrast: of log E from patch to patch.
        poisson: of the logit of Poisson's ratio.
        friction: of log mu_f.
        grip: of log k_f.
        bending: of the logarithm of a thin body's bending ratio.
        coefficient: of an effect's coefficients, in units of their scales.
    """

    modulus: float = 1.0
    contrast: float = 0.2
    poisson: float = 0.7
    friction: float = 0.7
    grip: float = 0.7
    bending: float = 0.7
    coefficient: float = 1.0


@dataclass(frozen=True)
class Scalar:
    """A positive number of the whole baseline, whose logarithm is an unknown.

    Args:
        prior: name of its standard deviation in `Priors`.
        step: of the secant, in the logarithm.
        lower, upper: bounds of the number.
        factor: by which it may change from where it starts.
    """

    prior: str
    step: float
    lower: float = 0.0
    upper: float = np.inf
    factor: float = np.inf


SCALARS = {
    "friction_coefficient": Scalar("friction", 0.15, lower=1e-3, upper=3.0),
    "grip_stiffness": Scalar("grip", 0.15, factor=5.0),
    "bending_ratio": Scalar("bending", 0.08, factor=20.0),
    "tool_friction": Scalar("friction", 0.15, lower=1e-3, upper=1.5),
}
"""Fields of the model that may be unknown beside the moduli and Poisson's ratio; of one with a value for every patch it is the geometric mean,
which scales them all."""


@dataclass(frozen=True)
class Block:
    """Consecutive unknowns with a Gaussian prior.

    Args:
        mean, precision: of the prior, shapes [P] and [P, P].
        lower, upper: bounds, shape [P].
        steps: of the secants, shape [P]; the sign gives the side.
        one_sided: amplitudes whose sign physics fixes, shape [P]. Their prior is half a Gaussian.
    """

    mean: Float[Array, " unknowns"]
    precision: Float[Array, "unknowns unknowns"]
    lower: Float[Array, " unknowns"]
    upper: Float[Array, " unknowns"]
    steps: Float[Array, " unknowns"]
    one_sided: Bool[Array, " unknowns"]

    def __len__(self) -> int:
        return len(self.mean)


class Unknowns:
    """The unknowns of the baseline and of some effects, as one vector.

    Args:
        fields: of the baseline. The fit starts there, and its priors are centred there.
        effects: names, in the order in which they act.
        priors: standard deviations.
        at: coefficients of the effects where a fit starts; dormant by default. The priors of shapes are centred there.
        scalars: names in `SCALARS` of the numbers that are unknown and act.
        elastic_law: in place of the model's; None for the model's own.
        limits: of coefficients by effect, narrower than their own bounds (`Effect.limits`).

    Attributes:
        baseline: number of unknowns of the baseline; they come first.
        patches: number of moduli; they are the first of those.
        places: slice of each effect's coefficients in the vector.
        block: priors, bounds and steps of all unknowns.
    """

    def __init__(
        self,
        fields: dict[str, Tensor],
        effects: Sequence[str] = (),
        priors: Priors | None = None,
        at: EffectValues | None = None,
        scalars: Sequence[str] = ("friction_coefficient",),
        elastic_law: str | None = None,
        limits: Mapping[str, Limits] | None = None,
    ) -> None:
        self.fields, self.effects, self.priors = fields, tuple(effects), priors or Priors()
        self.patches, self.scalars = len(fields["youngs_modulus"]), tuple(scalars)
        self.at, self.elastic_law, self.limits = at or {}, elastic_law, limits or {}
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
        scalar, value = SCALARS[name], _mean(self.fields[name])
        lower, upper = max(scalar.lower, value / scalar.factor), min(scalar.upper, value * scalar.factor)
        mean = np.log(np.clip(value, lower, upper))
        return float(mean), getattr(self.priors, scalar.prior), np.log(lower), np.log(upper), scalar.step

    def _effect(self, name: str) -> Block:
        coefficients = EFFECTS[name].coefficients
        scale = np.array([c.scale for c in coefficients])
        dormant = np.array([c.dormant for c in coefficients])
        start = np.array([self.at.get(name, {}).get(c.name, c.dormant) for c in coefficients])
        amplitude = np.array([c.kind == "amplitude" for c in coefficients])
        limits = self.limits.get(name, {})
        lower, upper = np.array([limits.get(c.name, (c.lower, c.upper)) for c in coefficients]).T
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
        """Index of a scalar in the vector."""
        return self.patches + 1 + self.scalars.index(scalar)

    # --- vectors and values -------------------------------------------------------------------------------------

    def start(self) -> Float[Array, " unknowns"]:
        """The vector of the given baseline, with every effect as `at` says."""
        vector = self.block.mean.copy()
        vector[: self.patches] = self.fields["youngs_modulus"].log().numpy()
        return self.with_effects(vector, self.at)

    def vector_of(self, fields: Mapping[str, Tensor]) -> Float[Array, " unknowns"]:
        """The vector of another material, with every effect as `at` says; within the bounds."""
        there = Unknowns(dict(fields), (), self.priors, scalars=self.scalars).start()
        vector = np.concatenate([there, self.start()[self.baseline :]])
        return np.clip(vector, self.block.lower, self.block.upper)

    def without_contrast(self) -> Unknowns:
        """The same unknowns under a prior that admits one modulus for all patches only."""
        return self._with(priors=replace(self.priors, contrast=NO_CONTRAST))

    def under(self, elastic_law: str | None) -> Unknowns:
        """The same unknowns under another elastic law, or under the model's own."""
        return self._with(elastic_law=elastic_law)

    def beside(self, effects: Sequence[str], at: EffectValues) -> Unknowns:
        """The unknowns of this baseline and of other effects, in the order in which they act.

        Args:
            effects: their names.
            at: coefficients where a fit starts.
        """
        return self._with(effects=effects, at=at)

    def _with(self, **changes: Any) -> Unknowns:
        own = ("fields", "effects", "priors", "at", "scalars", "elastic_law", "limits")
        return Unknowns(**{name: getattr(self, name) for name in own} | changes)

    def with_uniform_modulus(self, vector: Float[Array, " unknowns"]) -> Float[Array, " unknowns"]:
        """The vector with the mean of log E in all patches."""
        vector = vector.copy()
        vector[: self.patches] = vector[: self.patches].mean()
        return vector

    def with_moduli(
        self, vector: Float[Array, " unknowns"], factors: Sequence[float]
    ) -> Float[Array, "factors unknowns"]:
        """The vector with all moduli times each of some factors, within the bounds."""
        found = np.tile(vector, (len(factors), 1))
        found[:, : self.patches] += np.log(factors)[:, None]
        return np.clip(found, self.block.lower, self.block.upper)

    def with_effects(self, vector: Float[Array, " unknowns"], values: EffectValues) -> Float[Array, " unknowns"]:
        """The vector with these coefficients [SI] put in."""
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
        """The material at a vector, as of `Model.fields`."""
        K = self.patches
        fields = dict(self.fields)
        fields["youngs_modulus"] = torch.from_numpy(np.exp(vector[:K]))
        fields["poissons_ratio"] = torch.full((K,), _ratio(vector[K]), dtype=torch.float64)
        for name in self.scalars:
            fields[name] = _with_mean(self.fields[name], float(np.exp(vector[self.place(name)])))
        return fields

    def trial(self, vector: Float[Array, " unknowns"]) -> Trial:
        """The rollout to make at a vector."""
        return Trial(self.baseline_fields(vector), self.values(vector), elastic_law=self.elastic_law)

    def prior_energy(self, vector: Float[Array, " unknowns"]) -> float:
        """Minus the logarithm of the prior, up to its normalisation [nat]."""
        d = vector - self.block.mean
        return 0.5 * float(d @ self.block.precision @ d)


def _mean(values: Tensor) -> float:
    """The geometric one, of a number itself."""
    return values.log().mean().exp().item() if values.ndim else values.item()


def _with_mean(values: Tensor, mean: float) -> Tensor:
    return values * (mean / _mean(values)) if values.ndim else torch.tensor(mean, dtype=torch.float64)


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

    return Block(joined("mean"), precision, *(joined(name) for name in ("lower", "upper", "steps", "one_sided")))
