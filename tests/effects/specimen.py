"""A small bar in a hand on the ground, and rollouts of it with effects; shared by the effects' tests."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from physreal_core.effects import EFFECTS, Inputs, Setting, configured
from physreal_core.simulation import Body, Clamp, Grip, Parameters, SimulationConfig, Simulator, States

VIEW = np.array([[1.0, 0, 0, 0.05], [0, 0, 1, -0.6], [0, -1, 0, 0.05], [0, 0, 0, 1]])
"""A camera 0.6 m before the scene, looking along +y."""


def lattice_body(
    counts: tuple[int, int, int], spacing: float = 0.01, density: float = 500.0, corner=(0.0, 0.0, 0.0)
) -> Body:
    """Particles on a lattice, half a spacing inside the faces of a box that begins at `corner`."""
    index = np.stack(np.meshgrid(*[np.arange(n) for n in counts], indexing="ij"), -1).reshape(-1, 3)
    x0 = (index + 0.5) * spacing + np.asarray(corner)
    return Body(x0, np.full(len(x0), spacing**3), np.full(len(x0), density), spacing)


@dataclass(frozen=True)
class Specimen:
    """One body with its hand, and a uniform material; float64 throughout.

    Args:
        body, grip, clamps, controllers, fps: of the rollout.
        material: parameters that are not those of an effect.
        ground_height, gravity: of the configuration.
        T_world_camera: None for motion capture.
    """

    body: Body
    controllers: Tensor
    fps: float
    material: Parameters
    grip: Grip | None = None
    clamps: tuple[Clamp, ...] = ()
    ground_height: float | None = 0.0
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    T_world_camera: np.ndarray | None = None

    @property
    def setting(self) -> Setting:
        return Setting(
            self.body, self.grip, self.clamps, self.fps, self.gravity, self.ground_height, self.controllers,
            self.T_world_camera,
        )  # fmt: skip

    def inputs(self, values: dict[str, dict[str, Tensor]]) -> Inputs:
        inputs = Inputs(self.material, self.controllers)
        for name, own in values.items():
            inputs = EFFECTS[name].act(inputs, own, self.setting)
        return inputs

    def config(self, *names: str) -> SimulationConfig:
        plain = SimulationConfig(self.fps, ground_height=self.ground_height, gravity=self.gravity, dtype="float64")
        return configured(plain, tuple(EFFECTS[name] for name in names), self.body)

    def simulator(self, *names: str) -> Simulator:
        return Simulator(self.body, self.config(*names), self.grip, self.clamps)

    def rollout(self, **values: dict[str, float | Tensor]) -> States:
        """States with effects, points as they are observed; coefficients that are not named are dormant."""
        own = {name: complete(name, given) for name, given in values.items()}
        inputs = self.inputs(own)
        simulator = self.simulator(*values)
        states = simulator.rollout(inputs.parameters, inputs.controllers)
        seen = states.x
        for name, given in own.items():
            seen = EFFECTS[name].observe(seen, given, self.setting)
        return replace(states, x=seen)


def complete(name: str, values: dict[str, float | Tensor]) -> dict[str, Tensor]:
    """All coefficients of an effect in float64."""
    given = {**EFFECTS[name].dormant, **values}
    return {key: torch.as_tensor(value, dtype=torch.float64) for key, value in given.items()}


def material(body: Body, E: float = 2e4, nu: float = 0.3, **others: float | list) -> Parameters:
    """A uniform material, per particle as a fit gives it."""
    full = {"youngs_modulus": E, "poissons_ratio": nu}
    tensors = {name: torch.full((len(body.x0),), value, dtype=torch.float64) for name, value in full.items()}
    rest = {name: torch.as_tensor(value, dtype=torch.float64) for name, value in others.items()}
    return Parameters(**tensors, **rest)


def held_specimen(frames: int = 6, fps: float = 60.0) -> Specimen:
    """A bar that lies on the ground and is dragged along and up by one end, seen by a camera."""
    body = lattice_body((8, 3, 3))
    points = np.array([[0.08, 0.0, 0.04], [0.08, 0.03, 0.04]])
    held = np.flatnonzero(body.x0[:, 0] > 0.06)
    lengths = np.linalg.norm(body.x0[held] - points[held % 2], axis=1)
    time = torch.arange(frames, dtype=torch.float64)[:, None, None] / fps
    way = torch.tensor([0.5, 0.3, 0.6], dtype=torch.float64) * time + torch.tensor([0.0, 8.0, 0.0]) * time**2
    return Specimen(
        body,
        torch.as_tensor(points) + way,
        fps,
        material(body, friction_coefficient=0.4, grip_stiffness=2.0, grip_damping=0.01),
        Grip(held, held % 2, np.full(len(held), 0.5), lengths),
        T_world_camera=VIEW,
    )
