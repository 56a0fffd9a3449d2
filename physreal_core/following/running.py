"""A model that is simulated frame by frame while forces pull at it and its material changes."""

from collections.abc import Sequence
from dataclasses import fields as names_of
from dataclasses import replace

import numpy as np
import torch

from physreal_core.array_types import Array, Float
from physreal_core.effects import EFFECTS
from physreal_core.fitting.rollouts import Fields, Rollouts, frame_since_start
from physreal_core.rendering import carry_points
from physreal_core.simulation import Parameters
from physreal_core.simulation.play import FrameState


class Running:
    """One run of a model.

    Args:
        rollouts: of the problem, which has tracks, with a model; its simulator takes forces.
        fields: of the model, as they are at first.
        calm: retardation time of a viscosity beside the model's [s]; None for none.
    """

    def __init__(self, rollouts: Rollouts, fields: Fields, calm: float | None = None) -> None:
        self._rollouts, self._tracks, self._calm = rollouts, rollouts.problem.tracks, calm
        self._x0 = torch.as_tensor(rollouts.problem.body.x0, device=rollouts.device).to(rollouts.dtype)
        self._parameters = self._with(fields)
        self._player = rollouts.play(fields)
        self._player.change(self._parameters)
        self._state: FrameState | None = None

    def go_on(self, controllers: Float[Array, "controllers 3"]) -> FrameState:
        """The next frame, in which the hand's points come to these places [m]; F is the motion since frame 0.

        Raises:
            SimulationError: as of `Player.step`.
        """
        self._state = frame_since_start(self._player.step(torch.from_numpy(controllers)), self._parameters)
        return self._state

    def forecast(self) -> Float[Array, "tracks 3"]:
        """Where the tracked points are now [m]."""
        points0 = self._tracks.points0.to(self._state.x)
        found = carry_points(self._tracks.binding, points0, self._x0, self._state.x, self._state.F)
        return found.cpu().double().numpy()

    def change(self, force: Float[Array, "particles 3"], fields: Fields | None = None) -> None:
        """From here on these forces [N] act on the particles beside the model's own, and the model has these fields; None for those it has."""
        if fields is not None:
            self._parameters = self._with(fields)
        known, own = self._parameters.force, torch.as_tensor(np.asarray(force)).to(self._x0)
        self._player.change(replace(self._parameters, force=own if known is None else known + own))

    @torch.no_grad()
    def _with(self, fields: Fields) -> Parameters:
        """Parameters of the simulation with these fields of the model."""
        inputs, kelvin_voigt = self._rollouts.inputs(fields), EFFECTS["kelvin_voigt"]
        if self._calm is not None:
            inputs = kelvin_voigt.act(inputs, {"time": torch.tensor(self._calm)}, self._rollouts.setting)
        return inputs.parameters


def mean_state(states: Sequence[FrameState]) -> FrameState:
    """The mean of several runs at one time."""
    if len(states) == 1:
        return states[0]
    every = {own.name: [getattr(state, own.name) for state in states] for own in names_of(FrameState)}
    return FrameState(
        **{name: None if parts[0] is None else torch.stack(parts).mean(0) for name, parts in every.items()}
    )
