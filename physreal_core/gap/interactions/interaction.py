"""What the search needs of one interaction: rollouts of a model with trial effects, and the measurement beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

from physreal_core.array_types import Array, Bool, Float, Tensor
from physreal_core.effects import Setting
from physreal_core.fitting.model import Model
from physreal_core.gap.interactions.discretisation import Discretisation
from physreal_core.simulation import SimulationConfig, States

EffectValues = dict[str, dict[str, float]]
"""Coefficients by effect and name, in SI units; the effects act in this order."""

Placement = tuple[Float[Array, "3 3"], Float[Array, " 3"]]
"""Rotation R and translation t [m]: what is at x in the first interaction is at R x + t in this one."""


@dataclass(frozen=True)
class Trial:
    """One rollout to make.

    Args:
        fields: material of the baseline, as of `Model.fields`.
        effects: coefficients of the effects that act beside those of the model.
        hand: displacement of the hand from its record [m], shape [T, 3]; None: there is none.
        elastic_law: in place of the model's; None for the model's own.
    """

    fields: dict[str, Tensor]
    effects: EffectValues = field(default_factory=dict)
    hand: Float[Array, "frames 3"] | None = None
    elastic_law: str | None = None

    def told(self) -> tuple[Any, ...]:
        """All of it as plain values and arrays, for the name of a checkpoint."""
        return (
            *(value for name in sorted(self.fields) for value in (name, self.fields[name])),
            self.effects,
            self.hand,
            self.elastic_law,
        )


@runtime_checkable
class Interaction(Protocol):
    """One interaction with the object.

    Attributes:
        measured: tracked points [m], shape [T, J, 3], zero where not valid.
        valid: entries with a measurement, shape [T, J].
        sensor: standard deviation of the sensor along each axis [m], shape [T, J].
        sigma: with which a measurement counts [m], shape [T, J].
        correlation: of the sensor's noise from one frame to the next.
        points0: the tracked points at frame 0 [m], shape [J, 3].
        frames: number of frames of the whole interval.
        train: number of leading frames that a fit may see; the others are held out.
        model: material from which a fit starts, known effects and laws.
        config: of its simulator.
        setting: what effects may look at.
        device: where it rolls out, and where large matrix products run.
        placement: where the object lies; None where it lies as in the first interaction.
        hand_modes: leading modes of what is not known of the hand's displacement along an axis [m], shape [modes, T].
    """

    measured: Float[Array, "frames tracks 3"]
    valid: Bool[Array, "frames tracks"]
    sensor: Float[Array, "frames tracks"]
    sigma: Float[Array, "frames tracks"]
    correlation: float
    model: Model
    config: SimulationConfig
    setting: Setting
    device: str
    placement: Placement | None
    hand_modes: Float[Array, "modes frames"]

    @property
    def points0(self) -> Float[Array, "tracks 3"]: ...

    @property
    def frames(self) -> int: ...

    @property
    def train(self) -> int: ...

    def predict(
        self, trials: Sequence[Trial], frames: int | None = None, discretisation: Discretisation | None = None
    ) -> Float[Array, "trials frames tracks 3"]:
        """Where the measurement would see the tracks under each trial [m]; not a number where a rollout failed."""

    def predict_with_start_sensitivity(
        self, trials: Sequence[Trial], frames: int | None = None
    ) -> list[tuple[Float[Array, "frames tracks 3"], Float[Array, "3 frames tracks 3"]]]:
        """For each trial, where the measurement would see the tracks [m], and its derivative by the points' start along x, y, z."""

    def motion(self, trial: Trial) -> States | None:
        """The whole rollout of one trial, for effects that look where the body goes; None where there is no body."""

    def coarsened(self, factor: float) -> tuple[Interaction, dict[str, float]] | None:
        """The same with particles `factor` times as far apart, and the factors on fields of the model that go with it; None
        where there is no such form."""
