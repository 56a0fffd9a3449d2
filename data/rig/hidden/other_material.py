"""Effects in the material by laws of another form than the library's."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from data.rig.hidden.effect import Act, Other
from data.rig.hidden.elements import PLASTIC, Elements, EnergyForces, deviator, size
from data.rig.hidden.material import RestShape, soften
from data.rig.rig_scene import RigScene
from data.rig.world import World
from physreal_core.array_types import Array, Float

_BRANCH = 2.0  # stiffness of the spring in series with a dashpot, over the material's own in shear
_TIMES = (1 / 3, 3.0)  # of a creep with two times: rates over the stated one
_HARDENING = 0.15  # modulus of hardening over three times that of shear
_STEEP = 6.0  # exponent of the exponential stiffening, per unit of I1 - 3


@dataclass(frozen=True)
class ShearZener(Other):
    """A dashpot in shear alone, with a spring in series: slow strains are damped as by a retardation time `time` [s], fast ones
    are stiffened (Zener's standard solid)."""

    time: float

    def hardening(self, scene: RigScene) -> float:
        return 1 + _BRANCH

    def elasticity(self, scene: RigScene) -> str:
        return PLASTIC

    def prepare(self, world: World) -> Act:
        elements = Elements(world)
        elements.add_moduli(_BRANCH * shear_moduli(world.scene))
        flowed = np.zeros((len(elements.edges), 6))
        share = _BRANCH / (1 + _BRANCH)  # of the branch in the stiffness against shear
        rate = _BRANCH / self.time

        def act(time: float) -> None:
            step = deviator(elements.elastic_strain()) - (1 - share) * flowed  # total strain less what has flowed
            moved = (1 - np.exp(-rate * world.timestep)) * step
            flowed[:] += moved
            elements.flow(share * moved)

        return act


@dataclass(frozen=True)
class TwoTimesCreep(Other):
    """Two halves of the shear stress relax, one at a third of `rate` [1/s], one at three times it."""

    rate: float

    def elasticity(self, scene: RigScene) -> str:
        return PLASTIC

    def prepare(self, world: World) -> Act:
        elements = Elements(world)
        flowed = np.zeros((len(_TIMES), len(elements.edges), 6))

        def act(time: float) -> None:
            if time > 0:
                strain = deviator(elements.elastic_strain()) + flowed.mean(axis=0)
                for share, own in zip(_TIMES, flowed, strict=True):
                    moved = share * self.rate * world.timestep * (strain - own)
                    own += moved
                    elements.flow(moved / len(_TIMES))

        return act


@dataclass(frozen=True)
class HardeningYield(Other):
    """Von Mises plasticity that yields first at the stress E / `inverse_yield_strain` and hardens in proportion to what has
    flowed."""

    inverse_yield_strain: float

    def elasticity(self, scene: RigScene) -> str:
        return PLASTIC

    def prepare(self, world: World) -> Act:
        elements = Elements(world)
        first = 2 * (1 + world.scene.material.poissons_ratio) / (3 * self.inverse_yield_strain) * np.sqrt(1.5)
        flowed = np.zeros(len(elements.edges))

        def act(time: float) -> None:
            strain = deviator(elements.elastic_strain())
            amount = size(strain)
            beyond = np.maximum(amount - first - _HARDENING * flowed, 0.0) / (1 + _HARDENING)
            if beyond.any():
                flowed[:] += beyond
                elements.flow((beyond / np.maximum(amount, 1e-12))[:, None] * strain)

        return act


@dataclass(frozen=True)
class ExponentialStiffening(Other):
    """A further energy 2 a E (exp(b J) - 1 - b J) / b^2 of J = I1 J^(-2/3) - 3, a = `ratio`, b = 6 (Fung's); for small strains it is
    the library's."""

    ratio: float

    def hardening(self, scene: RigScene) -> float:
        return 1 + 1.3 * self.ratio

    def prepare(self, world: World) -> Act:
        energy, modulus = EnergyForces(world), self.ratio * world.scene.material.youngs_modulus

        def act(time: float) -> None:
            F = energy.deformation(world.positions)
            cofactors = np.stack([np.cross(F[:, i - 2], F[:, i - 1]) for i in range(3)], axis=1)
            J = (F[:, 0] * cofactors[:, 0]).sum(axis=1)[:, None, None]
            shrunk, I1 = J ** (-2 / 3), (F**2).sum(axis=(1, 2), keepdims=True)
            slope = shrunk * (2 * F - 2 / 3 * I1 * cofactors / J)
            world.push(energy.of(2 * modulus * np.expm1(_STEEP * (shrunk * I1 - 3)) / _STEEP * slope))

        return act


@dataclass(frozen=True)
class TensionFibres(Other):
    """Straight fibres at `azimuth` and `elevation` [rad] that pull and do not push: energy k/2 <a . E a>^2, k = `ratio` of Young's."""

    ratio: float
    azimuth: float
    elevation: float

    def hardening(self, scene: RigScene) -> float:
        return 1 + self.ratio

    def prepare(self, world: World) -> Act:
        flat = np.cos(self.elevation)
        a = np.array([flat * np.cos(self.azimuth), flat * np.sin(self.azimuth), np.sin(self.elevation)])
        energy, modulus = EnergyForces(world), self.ratio * world.scene.material.youngs_modulus

        def act(time: float) -> None:
            fibre = energy.deformation(world.positions) @ a
            strain = np.maximum(((fibre**2).sum(axis=1) - 1) / 2, 0.0)
            world.push(energy.of(modulus * strain[:, None, None] * fibre[:, :, None] * a))

        return act


@dataclass(frozen=True)
class SoftEllipsoid(Other):
    """Young's modulus is lower by the share `loss` inside an ellipsoid about (x, y, z) that is long along x: semi-axes 1.1, 0.8 and
    0.8 times `radius` [m]."""

    KNOWN: ClassVar = ("x", "y", "z")
    loss: float
    x: float
    y: float
    z: float
    radius: float

    def prepare(self, world: World) -> Act:
        soften(world, self._left)
        return super().prepare(world)

    def _left(self, places: Float[Array, "P 3"]) -> Float[Array, " P"]:
        away = (places - [self.x, self.y, self.z]) / (self.radius * np.array([1.1, 0.8, 0.8]))
        return np.where(np.linalg.norm(away, axis=1) < 1, 1 - self.loss, 1.0)


@dataclass(frozen=True)
class UnevenlyBent(Other):
    """As a rest shape that is bent evenly, but bent by nothing at the free end and by twice the curvature at the hand, as by a weight
    that has hung there."""

    stretch: float
    curvature_1: float
    curvature_2: float

    def elasticity(self, scene: RigScene) -> str:
        return PLASTIC

    def prepare(self, world: World) -> Act:
        even = RestShape(self.stretch, self.curvature_1, self.curvature_2)
        return even.let_go(world, uneven=1.0)


def shear_moduli(scene: RigScene) -> Float[Array, "6 6"]:
    """What of an isotropic stiffness [Pa] acts on the deviator of a strain (Voigt, shears doubled)."""
    shear = scene.material.youngs_modulus / (2 * (1 + scene.material.poissons_ratio))
    normal = 2 * shear * (np.eye(3) - 1 / 3)
    return np.block([[normal, np.zeros((3, 3))], [np.zeros((3, 3)), shear * np.eye(3)]])
