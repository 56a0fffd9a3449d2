"""A made-up sequence for the benchmark of fits: a soft toy, stiff at one end, lifted off the ground by a hand at the other.

A camera of 848x480 pixels sees it. Tracks and silhouettes come from our own simulator with a material that the fits are
not told: a stiffness that varies along the toy, another elastic law than the one fitted, noise on the tracks.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.spatial import ConvexHull

from physreal_core.array_types import Array
from physreal_core.fitting import MaskObservations, Model, Problem, TrackObservations, reduce_masks, uniform_model
from physreal_core.fitting.grip import bind_grip
from physreal_core.geometry import (
    Mesh,
    edge_inset,
    farthest_points,
    fill_mesh,
    patch_weights,
    sample_surface,
    scatter,
    surface_gaussians,
)
from physreal_core.rendering import Binding, Camera, bind, carry_points, render_carried
from physreal_core.simulation import Body, Parameters, SimulationConfig, Simulator, States

FPS, DENSITY = 30.0, 300.0
HALF_SIZE = np.array([0.12, 0.05, 0.025])  # m
SOFT, STIFF = 2e4, 8e4  # Young's modulus at the two ends [Pa]
TRUTH = {"poissons_ratio": 0.3, "friction_coefficient": 0.5, "grip_damping": 0.01}
GUESS = {"youngs_modulus": 1e5, "poissons_ratio": 0.25, "friction_coefficient": 0.4, "grip_damping": 0.01}
GRIP_STIFFNESS = 6e3  # of all bonds together, whatever their number [N]
TRACKS, GAUSSIANS, PATCHES, HAND_POINTS, MASKS, REDUCTION = 400, 4000, 12, 30, 8, 2
NOISE_3D, NOISE_2D, LOST = 0.001, 0.3, 0.1  # m, px, share of the entries without a reading


@dataclass(frozen=True)
class FitCase:
    """What a fit is given, and what it is not.

    Args:
        problem: the measurements, on the CPU.
        start: a material to start from, uniform.
        youngs_modulus: true, of every particle [Pa], shape [N].
        tracks: positions of the tracked points without noise, all frames [m], shape [T, J, 3].
    """

    problem: Problem
    start: Model
    youngs_modulus: Array
    tracks: torch.Tensor


def make_case(particles: int, frames: int, device: str, seed: int = 0) -> FitCase:
    """The sequence with about `particles` particles, simulated and rendered on `device`."""
    mesh = rounded_block()
    spacing = (mesh.volume / particles) ** (1 / 3)
    x0, volume = fill_mesh(mesh, spacing)
    body = Body(x0, volume, np.full(len(x0), DENSITY), spacing)
    controllers = _hand(frames, seed)
    grip = bind_grip(x0, controllers, radius=0.025, spacing=spacing)
    stiffness = GRIP_STIFFNESS / len(grip.weights)
    patches = farthest_points(x0, PATCHES)
    neighbours, weights = patch_weights(x0, patches)
    binding, points0 = _tracked(mesh, x0, seed)
    observed = round(0.7 * frames)
    blank = torch.zeros(frames, TRACKS)
    problem = Problem(
        body=body,
        fps=FPS,
        controllers=torch.from_numpy(controllers),
        observed=observed,
        patch_neighbours=torch.from_numpy(neighbours),
        patch_weights=torch.from_numpy(weights),
        grip=grip,
        tracks=TrackObservations(points0, binding, torch.zeros(frames, TRACKS, 3), blank > 0, blank),
        camera=_camera(),
    )
    along = (x0[:, 0] + HALF_SIZE[0]) / (2 * HALF_SIZE[0])
    youngs_modulus = SOFT * (STIFF / SOFT) ** along
    states = _simulate(problem, youngs_modulus, stiffness, device)
    moved = carry_points(binding.to(device), points0.to(states.x), _on(states.x, x0), states.x, states.F).cpu()
    problem = replace(problem, tracks=_measured(problem, moved, seed), masks=_silhouettes(problem, mesh, states, seed))
    start = uniform_model(
        torch.from_numpy(x0[patches]),
        GUESS | {"grip_stiffness": stiffness},
        elastic_law="fixed_corotated",
        simulation={"ground_height": 0.0, "courant": 0.4, "dtype": "float32"},
    )
    return FitCase(problem, start, youngs_modulus, moved)


def rounded_block(vertices: int = 3000) -> Mesh:
    """|x/a|^4 + |y/b|^4 + |z/c|^4 = 1 on the ground, a closed mesh [m]."""
    turn = np.arange(vertices) * np.pi * (3.0 - np.sqrt(5.0))
    height = 1.0 - 2.0 * (np.arange(vertices) + 0.5) / vertices
    ring = np.sqrt(1.0 - height**2)
    sphere = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], 1)
    faces = ConvexHull(sphere).simplices
    a, b, c = np.moveaxis(sphere[faces], 1, 0)
    inwards = np.einsum("fi,fi->f", np.cross(b - a, c - a), a) < 0
    faces[inwards] = faces[inwards, ::-1]
    radius = (np.abs(sphere) ** 4).sum(1) ** -0.25
    return Mesh((sphere * radius[:, None] + [0.0, 0.0, 1.0]) * HALF_SIZE, faces.astype(np.int64))


def _hand(frames: int, seed: int) -> Array:
    """Controller points around the soft end [m], shape [T, C, 3]: raised by 12 cm within two thirds of the time, then still."""
    random = np.random.default_rng(seed)
    points = random.uniform([-0.125, -0.03, 0.03], [-0.095, 0.03, 0.06], (HAND_POINTS, 3))
    share = np.clip(np.arange(frames) / (2 * frames / 3), 0.0, 1.0)
    risen = share**2 * (3.0 - 2.0 * share)
    return points + risen[:, None, None] * np.array([0.02, 0.01, 0.12])


def _camera() -> Camera:
    """From the side and a little above, 0.55 m away; x right, y down, z forward."""
    eye, target = np.array([0.05, -0.5, 0.22]), np.array([0.0, 0.0, 0.08])
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(forward, right), forward], 1)
    T[:3, 3] = eye
    return Camera(np.array([[620.0, 0.0, 423.5], [0.0, 620.0, 239.5], [0.0, 0.0, 1.0]]), T, 848, 480)


def _on(like: torch.Tensor, array: Array) -> torch.Tensor:
    return torch.as_tensor(array, dtype=like.dtype, device=like.device)


def _tracked(mesh: Mesh, x0: Array, seed: int) -> tuple[Binding, torch.Tensor]:
    """Points of the surface on the camera's side [m], and the particles that carry them."""
    face, weights = scatter(mesh, 8 * TRACKS, seed=seed)
    points = np.einsum("pck,pc->pk", mesh.corners[face], weights)
    seen = (mesh.area_vectors[face] * (_camera().centre.numpy() - points)).sum(1) > 0
    points = points[seen][:TRACKS]
    return bind(points, x0, 8), torch.from_numpy(points)


def _simulate(problem: Problem, youngs_modulus: Array, stiffness: float, device: str) -> States:
    config = SimulationConfig(fps=FPS, elastic_law="neo_hookean", device=device)
    material = {name: torch.tensor(value) for name, value in TRUTH.items()}
    parameters = Parameters(torch.from_numpy(youngs_modulus), grip_stiffness=torch.tensor(stiffness), **material)
    with torch.no_grad():
        return Simulator(problem.body, config, problem.grip).rollout(parameters, problem.controllers)


def _measured(problem: Problem, moved: torch.Tensor, seed: int) -> TrackObservations:
    random = torch.Generator().manual_seed(seed)
    known = torch.rand(moved.shape[:2], generator=random) > LOST
    pixels = problem.camera.project(moved)[0]
    return replace(
        problem.tracks,
        points3d=moved + NOISE_3D * torch.randn(moved.shape, generator=random),
        valid3d=known,
        sigma3d=torch.full(known.shape, NOISE_3D),
        points2d=pixels + NOISE_2D * torch.randn(pixels.shape, generator=random),
        visible=known,
    )


def _silhouettes(problem: Problem, mesh: Mesh, states: States, seed: int) -> MaskObservations:
    """Masks of some observed frames, rendered at full resolution and reduced as the stages reduce them."""
    camera, x0 = problem.camera, problem.body.x0
    surface = sample_surface(mesh, GAUSSIANS, seed=seed, oversampling=3)
    pixel = 0.55 / camera.intrinsics[0]
    gaussians = surface_gaussians(surface, inset=edge_inset(surface.spacing, pixel, alpha=0.5))
    binding = bind(surface.points, x0, 8)
    frames = np.unique(np.linspace(0, problem.observed - 1, MASKS + 1).round().astype(int)[1:])
    there, at0 = str(states.x.device), _on(states.x, x0)
    drawn = [
        render_carried(gaussians.to(there), binding.to(there), at0, states.x[t], states.F[t], camera).alpha.cpu() > 0.5
        for t in frames
    ]
    masks = torch.stack(drawn)
    coverage, known = reduce_masks(masks, torch.zeros_like(masks), REDUCTION)
    reduced = camera.scaled(1.0 / REDUCTION)
    return MaskObservations(torch.from_numpy(frames), coverage, known, reduced, gaussians, binding)
