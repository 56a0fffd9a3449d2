"""What another simulator can be told of a twin's material, and in words what it cannot."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch

from applications.twin import Twin
from physreal_core.array_types import Array, Float
from physreal_core.effects import EFFECTS, Inputs, Setting
from physreal_core.effects.paths import prolonged
from physreal_core.fitting.model import Model, particle_parameters
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.simulation import Parameters
from physreal_core.simulation.parameters import PARAMETER_NAMES


@dataclass(frozen=True)
class Simulator:
    """Another simulator.

    Args:
        name: of it.
        law: its elastic law, by our name; None where we have no such one.
        law_words: the same in words.
        told: parameters that go into its model. An effect that changes these alone, or the hand's way, is in it.
    """

    name: str
    law: str | None
    law_words: str
    told: tuple[str, ...]


_ELASTIC = (
    "youngs_modulus",
    "poissons_ratio",
    "friction_coefficient",
    "density",
    "gravity",
    "bending_ratio",
    "twisting_ratio",
)
MUJOCO = Simulator(
    "MuJoCo", "saint_venant_kirchhoff", "St. Venant-Kirchhoff", (*_ELASTIC, "viscosity", "retardation_time")
)
NEWTON = Simulator("Newton", None, "the stable Neo-Hookean one of Smith et al. 2018", _ELASTIC)


@dataclass(frozen=True)
class Material:
    """The means over the body's volume.

    Attributes:
        youngs_modulus: [Pa]; of a thin body that of stretching.
        poissons_ratio: of all.
        friction_coefficient: of the table; 0 where the model has none.
        retardation: Kelvin-Voigt's time [s].
        bending_ratio, twisting_ratio: stiffness of a thin body over that of a homogeneous one.
        density: of every particle [kg/m3], shape [N].
        gravity: [m/s2], shape [3].
        hand: the way of its points, effects included [m], shape [T, C, 3].
        lost: sentences, each of which names something that the simulator is not told.
    """

    youngs_modulus: float
    poissons_ratio: float
    friction_coefficient: float
    retardation: float
    bending_ratio: float
    twisting_ratio: float
    density: Float[Array, " N"]
    gravity: Float[Array, "3"]
    hand: Float[Array, "T C 3"]
    lost: tuple[str, ...]

    @classmethod
    def of(cls, twin: Twin, simulator: Simulator) -> "Material":
        """Of a twin, with its effects, for a simulator."""
        problem, model = twin.problem, twin.model
        rollouts = Rollouts(problem, model)
        inputs = rollouts.inputs(model.fields, frames=problem.frame_count)
        given, setting = inputs.parameters, rollouts.setting
        density = setting.body.density if given.density is None else _numbers(given.density)
        gravity = setting.gravity if given.gravity is None else _numbers(given.gravity)

        def mean(name: str, default: float) -> float:
            value = getattr(given, name)
            return default if value is None else _mean(value, problem)

        return cls(
            **{name: mean(name, np.nan) for name in ("youngs_modulus", "poissons_ratio")},
            friction_coefficient=mean("friction_coefficient", 0.0),
            retardation=_retardation(given, problem),
            **{name: mean(name, 1.0) for name in ("bending_ratio", "twisting_ratio")},
            density=np.broadcast_to(density, len(problem.body.x0)),
            gravity=np.asarray(gravity, dtype=float),
            hand=_numbers(inputs.controllers)[: problem.frame_count],
            lost=(
                *_lost_of_field(given, problem),
                *_lost_of_law(model, simulator),
                *_lost_effects(rollouts, model, simulator),
                *_lost_hold(twin),
            ),
        )


def _numbers(tensor: torch.Tensor) -> Array:
    return tensor.detach().cpu().double().numpy()


def _mean(value: torch.Tensor, problem: Problem) -> float:
    """Over the volume; a plain number stays as it is."""
    value = _numbers(value)
    return float(np.average(np.broadcast_to(value, len(problem.body.x0)), weights=problem.body.volume))


def _retardation(given: Parameters, problem: Problem) -> float:
    """Kelvin-Voigt's time [s] from the shear viscosity [Pa s], or of a rod from that of its bending."""
    if given.retardation_time is not None:
        return _mean(given.retardation_time[..., 0], problem)
    if given.viscosity is None:
        return 0.0
    shear_modulus = given.youngs_modulus / (2 * (1 + given.poissons_ratio))
    return _mean(given.viscosity[..., 0], problem) / _mean(shear_modulus, problem)


def _lost_of_field(given: Parameters, problem: Problem) -> Iterator[str]:
    modulus = np.broadcast_to(_numbers(given.youngs_modulus), len(problem.body.x0))
    if np.ptp(modulus) > 1e-3 * modulus.mean():
        yield (
            f"Young's modulus goes from {modulus.min():.3g} to {modulus.max():.3g} Pa over the body; there it has one, "
            f"its mean by volume, {_mean(given.youngs_modulus, problem):.3g} Pa."
        )


def _lost_of_law(model: Model, simulator: Simulator) -> Iterator[str]:
    if model.elastic_law != simulator.law:
        yield (
            f"The elastic law is {model.elastic_law}; {simulator.name}'s is {simulator.law_words}, which is the same at small strain."
        )
    if model.plastic_law != "identity":
        yield f"The plastic law {model.plastic_law} is left out."
    if model.residual is not None:
        yield "The neural residual is left out."
    unlike = [name for name in ("weft_ratio", "shear_ratio") if name in model.fields and _differs(model.fields[name])]
    if unlike:
        yield f"The fabric's {' and '.join(unlike)} are left out: there a cloth has the same stiffness in all directions."


def _differs(ratio: torch.Tensor) -> bool:
    return bool((ratio - 1).abs().max() > 1e-3)


def _lost_effects(rollouts: Rollouts, model: Model, simulator: Simulator) -> Iterator[str]:
    """Effects that change more than what the model is told. Those of the measurement are none of the body's."""
    near = rollouts.problem.patch_neighbours, rollouts.problem.patch_weights
    parameters = particle_parameters(model.fields, *near, dtype=rollouts.dtype, device="cpu")
    plain = Inputs(parameters, prolonged(rollouts.setting.controllers, rollouts.problem.frame_count + 1))
    for name, values in rollouts.values.items():
        if EFFECTS[name].family != "measurement" and not _told(plain, name, values, rollouts.setting, simulator):
            yield f"The effect {name} is left out: {simulator.name} has no such thing in a model's file."


def _told(plain: Inputs, name: str, values: dict, setting: Setting, simulator: Simulator) -> bool:
    after = EFFECTS[name].act(plain, values, setting)
    changed = [n for n in PARAMETER_NAMES if getattr(after.parameters, n) is not getattr(plain.parameters, n)]
    return set(changed) <= set(simulator.told) and (bool(changed) or after.controllers is not plain.controllers)


def _lost_hold(twin: Twin) -> Iterator[str]:
    grip = twin.problem.grip
    if grip is not None and len(grip.particles):
        yield "The twin's hand holds by springs; here the held nodes are fixed to it."
        if not grip.steady:
            yield "The hand comes late or lets go; here it holds all the time what it held in frame 0."
    if twin.problem.loads:
        yield "The capture's loads are left out."
