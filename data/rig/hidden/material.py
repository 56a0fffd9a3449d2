"""Hidden effects in the material."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from data.rig.hidden.effect import Act, Hidden
from data.rig.hidden.elements import PLASTIC, Elements, EnergyForces, deviator
from data.rig.rig_scene import RigScene
from data.rig.shapes import Block
from data.rig.thin import Cloth
from data.rig.thin_body import ThinBody, scale_stiffness, stiffen_along
from data.rig.world import World
from physreal_core.array_types import Array, Float


@dataclass(frozen=True)
class KelvinVoigt(Hidden):
    """Stress of strain rate beside that of strain, `time` [s] times the stiffness: MuJoCo's flex damping.

    Takes the implicit integrator, whose step of dt damps a mode like a retardation time of dt by itself (backward Euler:
    amplitude lost at the rate omega^2 dt / 2), so that much is left out.
    """

    time: float

    def implicit_step(self) -> float:
        return float(np.clip(self.time / 1.5, 3e-4, 1e-3))

    def prepare(self, world: World) -> Act:
        world.model.flex_damping[0] = max(self.time - world.timestep, 0.0)
        return super().prepare(world)


@dataclass(frozen=True)
class MaxwellCreep(Hidden):
    """The rest shape follows: the deviatoric part of the elastic strain decays at `rate` [1/s]."""

    rate: float

    def elasticity(self, scene: RigScene) -> str:
        return PLASTIC

    def prepare(self, world: World) -> Act:
        elements = Elements(world)

        def act(time: float) -> None:
            if time > 0:
                elements.flow(self.rate * world.timestep * deviator(elements.elastic_strain()))

        return act


@dataclass(frozen=True)
class PlasticYield(Hidden):
    """Von Mises plasticity without hardening, MuJoCo's own; it yields at the stress E / `inverse_yield_strain`."""

    inverse_yield_strain: float

    def elasticity(self, scene: RigScene) -> str:
        # MuJoCo's yield strain is sqrt(2/3) |dev E|, at which the von Mises stress is 3 mu times as much.
        return f'yield="{2 * (1 + scene.material.poissons_ratio) / (3 * self.inverse_yield_strain)}"'


@dataclass(frozen=True)
class StrainStiffening(Hidden):
    """A further energy a E (I1 J^(-2/3) - 3)^2, a = `ratio`."""

    ratio: float

    def hardening(self, scene: RigScene) -> float:
        """The second term's modulus over the first's is 12 a (I1 - 3), and bends and presses take I1 - 3 to about 0.08."""
        return 1 + self.ratio

    def prepare(self, world: World) -> Act:
        energy, modulus = EnergyForces(world), self.ratio * world.scene.material.youngs_modulus

        def act(time: float) -> None:
            F = energy.deformation(world.positions)
            cofactors = np.stack([np.cross(F[:, i - 2], F[:, i - 1]) for i in range(3)], axis=1)
            J = (F[:, 0] * cofactors[:, 0]).sum(axis=1)[:, None, None]
            shrunk, I1 = J ** (-2 / 3), (F**2).sum(axis=(1, 2), keepdims=True)
            slope = shrunk * (2 * F - 2 / 3 * I1 * cofactors / J)
            world.push(energy.of(2 * modulus * (shrunk * I1 - 3) * slope))

        return act


@dataclass(frozen=True)
class Fibres(Hidden):
    """Straight fibres at `azimuth` and `elevation` [rad], energy k/2 (a . E a)^2 of Green's strain E, k = `ratio` of Young's.

    A cloth's go through its thickness and bend with it (`stiffen_along`).
    """

    ratio: float
    azimuth: float
    elevation: float

    def hardening(self, scene: RigScene) -> float:
        return 1 + self.ratio

    def prepare(self, world: World) -> Act:
        flat = np.cos(self.elevation)
        a, b, c = flat * np.cos(self.azimuth), flat * np.sin(self.azimuth), np.sin(self.elevation)
        if isinstance(world.scene.body, Cloth):
            stiffen_along(world.model, world.mesh, world.scene.body, np.array([a, b]), self.ratio)
            return super().prepare(world)
        elements, along = Elements(world), np.array([a * a, b * b, c * c, b * c, a * c, a * b])  # shears are doubled
        modulus = self.ratio * world.scene.material.youngs_modulus
        count = len(elements.edges)
        elements.add_stiffness(np.broadcast_to(along, (count, 6)), np.full(count, modulus))
        return super().prepare(world)


@dataclass(frozen=True)
class SoftSpot(Hidden):
    """Young's modulus is lower by the share `loss` exp(-d^2 / 2 radius^2), d the distance [m] from (x, y, z) [m]."""

    loss: float
    x: float
    y: float
    z: float
    radius: float

    def prepare(self, world: World) -> Act:
        soften(world, self._left)
        return super().prepare(world)

    def _left(self, places: Float[Array, "P 3"]) -> Float[Array, " P"]:
        """Share of the modulus that is left at places [m]."""
        distance = np.linalg.norm(places - [self.x, self.y, self.z], axis=1)
        return 1 - self.loss * np.exp(-(distance**2) / (2 * self.radius**2))


def soften(world: World, left: Callable[[Float[Array, "P 3"]], Float[Array, " P"]]) -> None:
    """Leaves a share of the stiffness that depends on the place [m]."""
    if isinstance(world.scene.body, ThinBody):
        scale_stiffness(world.model, world.mesh, left)
    else:
        elements = Elements(world)
        elements.stiffness[:] *= left(elements.centres)[:, None]


@dataclass(frozen=True)
class RestShape(Hidden):
    """At frame 0 the body is let go stretched by the share `stretch` along its longest axis, and bent by `curvature_1` towards its
    second and `curvature_2` towards its third [1/m], as by a pull and moments at its ends, against its rest shape."""

    stretch: float
    curvature_1: float
    curvature_2: float

    def elasticity(self, scene: RigScene) -> str:
        return PLASTIC

    def prepare(self, world: World) -> Act:
        return self.let_go(world)

    def let_go(self, world: World, uneven: float = 0.0) -> Act:
        """What is done before each step; the curvature may grow along the body, by the share `uneven` from its middle to its end."""
        elements, rest = Elements(world), self._rest_displacement(world, uneven)
        waiting = [rest]

        def act(time: float) -> None:
            if time > 0 and waiting:
                elements.displace_rest(waiting.pop())

        return act

    def _rest_displacement(self, world: World, uneven: float) -> Float[Array, "V 3"]:
        """Pure tension and bending of a bar (Saint-Venant), the other way round: where its nodes would rest [m]."""
        frame, middle = body_axes(world)
        x, y, z = frame @ (world.mesh.vertices - middle).T
        s, k, q, nu = self.stretch, self.curvature_1, self.curvature_2, world.scene.material.poissons_ratio
        growth = 2 * uneven / np.ptp(x)
        turned, risen = x + growth * x**2 / 2, x**2 / 2 + growth * x**3 / 6  # integrals of the curvature over its mean
        along = -(s * x + (k * y + q * z) * turned)
        sideways = k * risen + nu * (s * y + (1 + growth * x) * (k * (y**2 - z**2) / 2 + q * y * z))
        upwards = q * risen + nu * (s * z + (1 + growth * x) * (k * y * z + q * (z**2 - y**2) / 2))
        return np.stack([along, sideways, upwards], axis=1) @ frame


def body_axes(world: World) -> tuple[Float[Array, "3 3"], Float[Array, "3"]]:
    """Principal axes of the body as rows, the longest first, each with its largest component positive; and its centre of volume [m].

    Of a box they are its edges, also where two of them are equally long.
    """
    volumes, centres = world.mesh.volumes(), world.mesh.vertices[world.mesh.tets].mean(axis=1)
    middle = np.average(centres, axis=0, weights=volumes)
    if isinstance(world.scene.body, Block):
        order = np.argsort(-np.ptp(world.scene.body.bounds(), axis=0).round(6), kind="stable")
        return np.eye(3)[order], middle
    moment = ((centres - middle) * volumes[:, None]).T @ (centres - middle)
    rows = np.linalg.eigh(moment)[1].T[::-1]
    return rows * np.sign(rows[np.arange(3), np.abs(rows).argmax(axis=1)])[:, None], middle
