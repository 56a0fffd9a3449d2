"""What the hand does, to and from `particles.npz`: its bonds, where -1 stands for one that is never released, and the capsules that push."""

import numpy as np

from physreal_core.simulation import Grip, Tool
from physreal_core.simulation.body import NEVER
from pipeline.products.particles import Particles


def fields_of(grip: Grip, tool: Tool | None = None) -> dict[str, np.ndarray]:
    """Bonds and capsules as `Particles` has them; bonds without times where all act all the time."""
    return _bonds(grip) | ({} if tool is None else _capsules(tool))


def _capsules(tool: Tool) -> dict[str, np.ndarray]:
    spared = {"tool_spared": tool.spared} if len(tool.spared) else {}
    return {"tool_ends": tool.ends, "tool_radius": tool.radius} | spared


def _bonds(grip: Grip) -> dict[str, np.ndarray]:
    bonds = {
        "grip_particles": grip.particles,
        "grip_controllers": grip.controllers,
        "grip_weights": grip.weights,
        "grip_rest_lengths": grip.rest_lengths,
        "grip_reach": grip.reach,
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
        reach=particles.grip_reach,
    )


def tool_of(particles: Particles) -> Tool | None:
    """The capsules that were saved, None where the hand does not push."""
    if not particles.pushed:
        return None
    return Tool(particles.tool_ends, particles.tool_radius, particles.tool_spared)
