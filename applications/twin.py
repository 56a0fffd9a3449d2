"""A fitted twin as its uses need it: what is simulated, and what is seen of it."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from applications.backdrop import Backdrop
from applications.scene import Scene
from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError
from physreal_core.fitting.model import Model, load_model
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.spread import scaled, spread_of
from physreal_core.fitting.thin import bind_to_body
from physreal_core.geometry.mesh import Mesh
from physreal_core.playing import Session
from physreal_core.rendering import Binding, Camera, Gaussians, carry_gaussians, carry_points
from physreal_core.simulation.play import FrameState
from pipeline.config import load_parameters, unknown_key
from pipeline.graph import FIT_STAGES
from pipeline.products.particles import Particles
from pipeline.products.placed_object import PlacedObject
from pipeline.project import Project
from stages._problem import load_problem

_INPUTS = ("parse_video", "segment_and_track", "fit_pose", "sample_particles")


@dataclass(frozen=True)
class Splats:
    """Gaussians as they are now: centres [G, 3] m, covariances [G, 3, 3] m2."""

    centres: Float[Array, "G 3"]
    covariances: Float[Array, "G 3 3"]


@dataclass(frozen=True)
class Twin:
    """A fitted sequence.

    Attributes:
        sequence, stage: which model of which sequence.
        problem: body, hand and path.
        model: fitted.
        folder: where the model lies, with its rollout over the filmed frames.
        mesh: surface of the object in frame 0 [m], world frame.
        mesh_binding: of its vertices to the particles.
        gaussians: appearance; None of motion capture.
        gaussian_binding: of these; None of motion capture.
        camera: that filmed it; None of motion capture.
        scene: solids around it; None without.
        backdrop: what is seen behind it; None without.
    """

    sequence: str
    stage: str
    problem: Problem
    model: Model
    folder: Path
    mesh: Mesh
    mesh_binding: Binding
    gaussians: Gaussians | None
    gaussian_binding: Binding | None
    camera: Camera | None
    scene: Scene | None = None
    backdrop: Backdrop | None = None

    @classmethod
    def load(
        cls,
        project: Project,
        sequence: str,
        stage: str = FIT_STAGES[-1],
        scene: Path | None = None,
        backdrop: str | None = None,
    ) -> "Twin":
        """The model that a fit stage found, where the object lies in a sequence.

        Args:
            project: where.
            sequence: under `fits` or `predictions` in params.yaml.
            stage: one of `FIT_STAGES`.
            scene: mesh file of solids around it (`Scene.read`).
            backdrop: what is seen behind it, `filmed` or a file of splats (`Backdrop.read`).

        Raises:
            InputError: no such sequence or stage, the stages have not run, or as of `Scene.read` and `Backdrop.read`.
        """
        fitted, read = _folder_of_model(project, sequence, stage), lambda name: project.artifact(name, sequence)
        for name, folder in (*((name, read(name)) for name in _INPUTS), (stage, fitted)):
            if not folder.is_dir():
                raise InputError(
                    f"{name} has not run on {sequence}",
                    where=str(folder),
                    expected="a fitted sequence",
                    remedy="run `dvc repro`",
                )
        problem, placed = load_problem(read), PlacedObject.load(read("fit_pose"))
        around = None if scene is None else Scene.read(scene, problem.body)
        if around is not None:
            problem = replace(problem, solids=around.solids)
        behind = None
        if backdrop is not None:
            seen = read("parse_video"), read("segment_and_track"), problem.camera
            behind = Backdrop.read(backdrop, sequence, *seen)
        particles, filmed = Particles.load(read("sample_particles")), problem.camera is not None
        return cls(
            sequence=sequence,
            stage=stage,
            problem=problem,
            model=load_model(fitted),
            folder=fitted,
            mesh=placed.mesh,
            mesh_binding=bind_to_body(placed.mesh.vertices, problem.body),
            gaussians=placed.gaussians if filmed else None,
            gaussian_binding=Binding(particles.gaussian_neighbours, particles.gaussian_weights) if filmed else None,
            camera=problem.camera,
            scene=around,
            backdrop=behind,
        )

    def session(self, device: str = "cpu", *, effects: bool = True, ball: float | None = None) -> Session:
        """A session with it, or with it but for its named effects; with a ball of a radius [m] to push it."""
        return Session(self.problem, self.model if effects else replace(self.model, effects=[]), device, ball)

    def ends(self, device: str = "cpu") -> tuple[Model, Model]:
        """The model with its softest and its stiffest body of what the fit leaves open: the ends of the 90 % interval of Young's modulus.

        Raises:
            InputError: as of `spread_of`.
        """
        spread = spread_of(self.problem, self.model, device)
        soft, stiff = (scaled(self.model.fields, spread.names, row) for row in spread.along("youngs_modulus"))
        return replace(self.model, fields=soft), replace(self.model, fields=stiff)

    @property
    def density(self) -> float:
        """Of the body, its mass over its volume [kg/m3]."""
        return float(self.problem.body.mass.sum() / self.problem.body.volume.sum())

    def surface(self, state: FrameState) -> Float[Array, "V 3"]:
        """Vertices of the mesh now [m]."""
        return self.carried(self.mesh.vertices, self.mesh_binding, state)

    def carried(self, points0: Float[Array, "P 3"], binding: Binding, state: FrameState) -> Float[Array, "P 3"]:
        """Points of frame 0 [m] where they are now."""
        x, F = state.x.cpu().double(), state.F.cpu().double()
        points0, x0 = (torch.as_tensor(np.asarray(a), dtype=torch.float64) for a in (points0, self.problem.body.x0))
        return carry_points(binding, points0, x0, x, F).numpy()

    def splats(self, state: FrameState) -> Splats:
        """Gaussians now."""
        x, F = state.x.cpu().float(), state.F.cpu().float()
        x0 = torch.as_tensor(self.problem.body.x0, dtype=torch.float32)
        centres, covariances = carry_gaussians(self.gaussian_binding, self.gaussians, x0, x, F)
        return Splats(centres.numpy(), covariances.numpy())

    def colours(self) -> Float[Array, "G 3"]:
        """Of the Gaussians, as the filmed camera sees them in frame 0, 0 to 1."""
        return self.gaussians.colours(self.camera.centre).clamp(0, 1).detach().cpu().float().numpy()

    def opacities(self) -> Float[Array, "G 1"]:
        """Of the Gaussians, 0 to 1."""
        return self.gaussians.opacities().detach().cpu().float().numpy().reshape(-1, 1)


def _folder_of_model(project: Project, sequence: str, stage: str) -> Path:
    """Where the model of a stage lies for a sequence that was fitted or predicted."""
    values = load_parameters(project.parameters).values
    known = [*values.fits, *values.predictions]
    if sequence not in known:
        raise unknown_key(f"fits.{sequence}", sequence, known, "params.yaml")
    if stage not in FIT_STAGES:
        raise unknown_key(stage, stage, list(FIT_STAGES), "--model")
    predicted = sequence in values.predictions
    return project.artifact("predict", sequence) / stage if predicted else project.artifact(stage, sequence)
