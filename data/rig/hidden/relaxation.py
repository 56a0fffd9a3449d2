"""Hidden effects in the material that remember: over-stresses beside MuJoCo's elastic stress, each of which fades.

Linear viscoelasticity in Green's strain E, element by element. A branch has its own viscous strain V, which follows the
deviator of E within the branch's time, and adds the second Piola-Kirchhoff stress 2 m (dev E - V). MuJoCo's own modulus is
that of slow motion. Before frame 0 the body has been at rest for long: nothing is left to fade.
"""

from dataclasses import dataclass

import numpy as np

from data.rig.hidden.effect import Act, Hidden
from data.rig.hidden.elements import EnergyForces
from data.rig.rig_scene import RigScene
from data.rig.world import World
from physreal_core.array_types import Array, Float

SLOWEST, FASTEST = 4.0, 3e-4
"""Relaxation times [s] between which hysteretic damping has its branches: a decade beyond what swings at 0.5 to 50 Hz."""
PER_DECADE = 2
"""Branches in a decade of relaxation times; with more the loss factor is the same to 1 %."""


class Branches:
    """Over-stresses of a world's elements.

    Args:
        world: the scene.
        shares: shear moduli over the one of slow motion, [B].
        times: relaxation times [s], [B].
    """

    def __init__(self, world: World, shares: Float[Array, " B"], times: Float[Array, " B"]) -> None:
        material = world.scene.material
        shear = material.youngs_modulus / (2 * (1 + material.poissons_ratio))
        self._world, self._forces = world, EnergyForces(world)
        self._moduli = 2 * shear * np.asarray(shares)
        self._follows = 1 - np.exp(-world.timestep / np.asarray(times))
        self._viscous: Float[Array, "B M 3 3"] = np.zeros((len(shares), len(world.mesh.tets), 3, 3))

    def act(self, time: float) -> None:
        """Pushes the nodes, and lets the viscous strains follow; all the way before frame 0."""
        F = self._forces.deformation(self._world.positions)
        strain = 0.5 * (F.transpose(0, 2, 1) @ F - np.eye(3))
        strain -= np.trace(strain, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
        if time <= 0:
            self._viscous[:] = strain
            return
        over = strain - self._viscous
        self._world.push(self._forces.of(F @ np.tensordot(self._moduli, over, axes=1)))
        self._viscous += self._follows[:, None, None, None] * over


@dataclass(frozen=True)
class StandardLinearSolid(Hidden):
    """One branch: `share` of the shear modulus of slow motion comes on top of it, and fades within `time` [s]."""

    share: float
    time: float

    def hardening(self, scene: RigScene) -> float:
        return 1 + self.share

    def prepare(self, world: World) -> Act:
        return Branches(world, np.array([self.share]), np.array([self.time])).act


@dataclass(frozen=True)
class HystereticDamping(Hidden):
    """The loss factor of shear is `loss_factor` at all frequencies that show: a spectrum of relaxation times.

    Branches as dense as t^-a in the logarithm of their time t give a modulus in proportion to (i w)^a, whose phase is pi a / 2
    everywhere (Kramers and Kronig). All times beyond the slowest together are the modulus of slow motion, t^-a / a of it.
    """

    loss_factor: float

    def spectrum(self) -> tuple[Float[Array, " B"], Float[Array, " B"]]:
        """Shares and times [s] of the branches, each the middle of a bin of the logarithm."""
        exponent = 2 / np.pi * np.arctan(self.loss_factor)
        count = round(PER_DECADE * np.log10(SLOWEST / FASTEST))
        edges = np.geomspace(SLOWEST, FASTEST, count + 1)
        shares = np.diff((edges / SLOWEST) ** -exponent)
        return shares, np.sqrt(edges[1:] * edges[:-1])

    def hardening(self, scene: RigScene) -> float:
        return 1 + float(self.spectrum()[0].sum())

    def prepare(self, world: World) -> Act:
        return Branches(world, *self.spectrum()).act
