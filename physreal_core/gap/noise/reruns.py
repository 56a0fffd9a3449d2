"""The simulator's own error, from the same model run in other discretisations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.gap.interactions.discretisation import Discretisation
from physreal_core.gap.interactions.interaction import Interaction, Trial

VARIANTS = (
    Discretisation("half the time step", courant=0.5),
    Discretisation("a coarser grid", cell=1.2, error=1.0 / (1.2**2 - 1.0)),
    Discretisation("a finer grid", cell=0.85, error=1.0 / (1.0 - 0.85**2)),
    Discretisation("a turned and shifted grid", turn=0.5, shift=(0.37, 0.21)),
    Discretisation("another law of the same stiffness", elastic_law="hencky"),
    Discretisation("contact at another height", ground=0.3, error=1.5),
)
"""Each changes one thing that a converged answer would not depend on (the law: at small strain).

Space is of second order, so how far a rerun on another grid moves says how far the limit is (Richardson's extrapolation).
Transfers damp once a substep, so half the step damps twice as much: the difference is the damping itself. Contact through
nodes leaves a gap of a sixth of a cell after a fall (`simulation.touch`), and neither the plane nor the body's underside is known better.
"""


def rerun_differences(
    experiment: Interaction,
    trial: Trial,
    predicted: Float[Array, "frames tracks 3"],
    variants: Sequence[Discretisation] = VARIANTS,
) -> Float[Array, "modes frames tracks 3"]:
    """How far the tracks are [m] from `predicted`, the trial's own, in the limits that reruns in other discretisations point to.

    Failed reruns are left out, and those that would change nothing: the model's own law, the height of no ground.

    Known effects with a direction of their own are not turned with the body, and what clamps a body stays where it is; with
    any of these the turned grid is left out.
    """
    stays = bool(experiment.model.effects or trial.effects or experiment.setting.clamps)
    usable = [v for v in variants if not stays or v.turn == 0.0]
    own_law, has_ground = experiment.model.elastic_law, experiment.setting.ground_height is not None
    usable = [v for v in usable if v.elastic_law != own_law and (has_ground or v.ground == 0.0)]
    found = [v.error * (experiment.predict([trial], discretisation=v)[0] - predicted) for v in usable]
    finite = [difference for difference in found if np.isfinite(difference).all()]
    return np.stack(finite) if finite else np.zeros((0, *predicted.shape))
