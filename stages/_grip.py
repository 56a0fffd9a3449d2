"""The hand's bonds, to and from `particles.npz`, where -1 stands for a bond that is never released."""

import numpy as np

from physreal_core.simulation import Grip
from physreal_core.simulation.body import NEVER
from pipeline.products.particles import Particles


def fields_of(grip: Grip) -> dict[str, np.ndarray]:
    """The bonds as `Particles` has them; without times where all act all the time."""
    bonds = {
        "grip_particles": grip.particles,
        "grip_controllers": grip.controllers,
        "grip_weights": grip.weights,
        "grip_rest_lengths": grip.rest_lengths,
    }
    if grip.steady:
        return bonds
    return bonds | {"grip_taken": grip.taken, "grip_released": np.where(grip.released == NEVER, -1, grip.released)}


def grip_of(particles: Particles) -> Grip | None:
    """The bonds that were saved, None where there are none."""
    if len(particles.grip_particles) == 0:
        return None
    released = particles.grip_released
    if released is not None:
        released = np.where(released < 0, NEVER, released.astype(np.int64))
    return Grip(
        particles.grip_particles,
        particles.grip_controllers,
        particles.grip_weights,
        rest_lengths=particles.grip_rest_lengths,
        taken=particles.grip_taken,
        released=released,
    )
