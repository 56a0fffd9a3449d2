"""The simulator's numerical error, from reruns of the same model in other discretisations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.gap.interactions.discretisation import Discretisation
from physreal_core.gap.interactions.interaction import Interaction, Trial

RERUNS = (
    Discretisation("half the time step", courant=0.5),
    Discretisation("a coarser grid", cell=1.2, error=1.0 / (1.2**2 - 1.0)),
    Discretisation("a finer grid", cell=0.85, error=1.0 / (1.0 - 0.85**2)),
    Discretisation("a turned and shifted grid", turn=0.5, shift=(0.37, 0.21)),
    Discretisation("another law of the same stiffness", elastic_law="hencky"),
    Discretisation("contact at another height", ground=0.3, error=1.5),
)
"""Each changes one thing that a converged solution does not depend on (the law: at small strain).

The scheme is of second order in space, so the difference between two grids gives the distance to the limit
(Richardson's extrapolation). Transfers damp once a substep, so half the step damps twice as much, and the difference is
the damping itself. Contact through nodes leaves a gap of a sixth of a cell after a fall (`simulation.touch`), and
neither the plane nor the body's underside is known better.
"""


def rerun_differences(
    experiment: Interaction,
    trial: Trial,
    predicted: Float[Array, "frames tracks 3"],
    reruns: Sequence[Discretisation] = RERUNS,
) -> Float[Array, "modes frames tracks 3"]:
    """Estimates of the numerical error of a trial's tracks [m], one per rerun.

    A rerun that fails is left out. So is one that changes nothing: the model's own law, or the height of a ground that
    is not there. Known effects with a direction of their own do not turn with the body, and clamps stay in place; with
    either, the turned grid is left out.

    Args:
        experiment: the interaction.
        trial: the model.
        predicted: its tracks in its own discretisation [m].
        reruns: the discretisations that are tried.
    """
    stays = bool(experiment.model.effects or trial.effects or experiment.setting.clamps)
    usable = [rerun for rerun in reruns if not stays or rerun.turn == 0.0]
    own_law, has_ground = experiment.model.elastic_law, experiment.setting.ground_height is not None
    usable = [rerun for rerun in usable if rerun.elastic_law != own_law and (has_ground or rerun.ground == 0.0)]
    found = [rerun.error * (experiment.predict([trial], discretisation=rerun)[0] - predicted) for rerun in usable]
    finite = [difference for difference in found if np.isfinite(difference).all()]
    return np.stack(finite) if finite else np.zeros((0, *predicted.shape))
