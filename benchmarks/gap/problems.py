"""From the captures of one object, tracks alone, to the problems that the search is given.

What the stages do in several steps and files, with their numbers, in memory and without their packages: a case may run on a
machine that has numpy, scipy, torch, warp, mujoco and trimesh alone. The truth beside a capture is not read here.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Float, Int
from physreal_core.errors import InputError
from physreal_core.fitting import Model, Problem, TrackObservations, uniform_model
from physreal_core.fitting.grip import bind_within
from physreal_core.fitting.hand_record import estimate_hand
from physreal_core.fitting.thin import bind_to_body, cells_of, ways_along
from physreal_core.geometry import (
    Mesh,
    farthest_points,
    fill_mesh,
    load_centre_line,
    load_mesh,
    load_middle_surface,
    patch_weights,
    remesh,
    resampled,
    sample_surface,
)
from physreal_core.geometry.thin_files import MIDDLES
from physreal_core.rendering import Camera
from physreal_core.simulation import Body, rod_body, shell_body

BINDING_NEIGHBOURS, TRACK_DISTANCE = 8, 0.01  # of `sample_particles`; the latter in [m]
GUESS = {
    "youngs_modulus": 1e5,
    "poissons_ratio": 0.3,
    "friction_coefficient": 0.4,
    "grip_stiffness": 4000.0,  # of a particle's bonds together [N]: a hand that holds a bar as a vice does, see `hold`
    "grip_damping": 0.01,
}
THIN = {
    "linear": {"youngs_modulus": 5e6, "bending_ratio": 0.2, "grip_stiffness": 1000.0},
    "planar": {"youngs_modulus": 1e6, "bending_ratio": 1.0, "grip_stiffness": 1000.0},
}
"""Guesses of a rope and of a felt that differ; a rope bends far more easily than a solid bar (docs/materials.md). A soft hold would let
what sticks out of it hang at a slant."""


@dataclass(frozen=True)
class Discretisation:
    """How finely an object is cut.

    Args:
        particles: cells that a volume fills; those that its surface cuts make some more material points.
        patches: places of the material field.
        segment, edge: lengths of the segments of a rope and of the edges of a cloth's triangles [m].
    """

    particles: int = 1000
    patches: int = 6
    segment: float = 0.006
    edge: float = 0.0125


def problems_of(
    folder: Path, cut: Discretisation = Discretisation(), further: Sequence[Path] = ()
) -> dict[str, Problem]:
    """One problem per capture in `folder`, by the capture's name.

    All have the same patches in the same order: those of the first, found again in the others by place, so that one model
    holds for all. They must therefore show the object where it lies in the first.

    Args:
        folder: holds one capture folder per interaction with the same object (docs/captures.md, kind "tracks").
        cut: particles and patches.
        further: capture folders of the same object that come after those, with other names.

    Raises:
        InputError: there is no capture, a file is missing, or the captures show the object in different places.
    """
    captures = sorted(path.parent for path in Path(folder).glob("*/capture.json"))
    if not captures:
        raise InputError("no capture in it", where=str(folder), expected="folders with a capture.json")
    problems: dict[str, Problem] = {}
    places: Float[Array, "patches 3"] | None = None
    for capture in [*captures, *further]:
        facts, mesh = _facts(capture), load_mesh(capture / "shape_prior.glb")
        body = _body(capture, facts, mesh, cut)
        chosen = _patches(body, cut.patches) if places is None else _found_again(places, body, capture)
        places = body.x0[chosen] if places is None else places
        problems[capture.name] = _problem(capture, facts, mesh, body, chosen)
    return problems


def baseline_model(problem: Problem, guess: dict[str, float] | None = None) -> Model:
    """An elastic body of one guessed material lying on the ground: where a fit of `problem` begins.

    Args:
        problem: its patches carry the material.
        guess: as `uniform_model` takes it; by default what is usual for its kind of body.
    """
    cells = cells_of(problem.body)
    own = {} if cells is None else THIN["linear" if cells.shape[1] == 2 else "planar"]
    return uniform_model(
        torch.from_numpy(problem.body.x0[patch_particles(problem)]),
        GUESS | own if guess is None else guess,
        elastic_law="fixed_corotated",
        simulation={"ground_height": 0.0, "courant": 0.7, "dtype": "float32"},
    )


def patch_particles(problem: Problem) -> Int[Array, " patches"]:
    """The particle in the middle of each patch: the one that takes its material from that patch alone."""
    neighbours, weights = problem.patch_neighbours.numpy(), problem.patch_weights.numpy()
    dense = np.zeros((len(neighbours), int(neighbours.max()) + 1))
    np.put_along_axis(dense, neighbours, weights, axis=1)
    return dense.argmax(axis=0)


def tracks_on(mesh: Mesh, points0: Float[Array, "tracks 3"], known: Bool[Array, " tracks"]) -> Int[Array, " kept"]:
    """The tracks seen in frame 0 that lie on the object there, chosen as `sample_particles` does.

    Args:
        mesh: the object at frame 0 [m].
        points0: where the tracks are at frame 0 [m]; anything where `known` is false.
    """
    from scipy.spatial import cKDTree

    surface = np.concatenate([mesh.vertices, sample_surface(mesh, 2000, oversampling=1).points])
    seen = np.flatnonzero(known)
    distance, _ = cKDTree(surface).query(points0[seen])
    return seen[distance < TRACK_DISTANCE]


def _body(capture: Path, facts: dict, mesh: Mesh, cut: Discretisation) -> Body:
    """What the simulator moves: a volume of particles, the segments of a rope or the triangles of a cloth."""
    geometry, density = facts.get("geometry", "volumetric"), facts["density"]
    if geometry == "linear":
        line = resampled(load_centre_line(capture / MIDDLES[geometry]), cut.segment)
        return rod_body(line, facts["thickness"] / 2.0, density)
    if geometry == "planar":
        vertices, triangles = remesh(*load_middle_surface(capture / MIDDLES[geometry]), cut.edge)
        return shell_body(vertices, triangles, facts["thickness"], density)
    spacing = (mesh.volume / cut.particles) ** (1 / 3)
    x0, volume = fill_mesh(mesh, spacing)
    return Body(x0, volume, np.full(len(x0), density), spacing)


def _patches(body: Body, count: int) -> Int[Array, " patches"]:
    return farthest_points(body.x0, count, ways=ways_along(body))


def _problem(capture: Path, facts: dict, mesh: Mesh, body: Body, patches: Array) -> Problem:
    """The measurements of one capture, bound to the particles."""
    # Not at the top: the benchmarks' modules can be imported where there is no pipeline; these two need numpy alone.
    from pipeline.products.controllers import Controllers
    from pipeline.products.given_tracks import GivenTracks3d

    measured, controllers = GivenTracks3d.load(capture), Controllers.load(capture).points.astype(np.float32)
    if measured.valid3d is None or measured.sigma3d is None:
        raise InputError(
            "not all of its arrays are there", where=str(capture / measured.FILE), expected="valid3d, sigma3d"
        )
    neighbours, weights = patch_weights(body.x0, patches, ways=ways_along(body))
    grip = bind_within(body.x0, controllers[0], spacing=body.spacing)
    hand = estimate_hand(controllers, facts["fps"])
    return Problem(
        body=body,
        fps=facts["fps"],
        controllers=torch.from_numpy(hand.controllers),
        observed=facts["split"]["train"][1],
        patch_neighbours=torch.from_numpy(neighbours),
        patch_weights=torch.from_numpy(weights),
        grip=grip,
        tracks=_observations(measured.points3d, measured.valid3d, measured.sigma3d, mesh, body),
        camera=Camera(*map(np.asarray, (facts["K"], facts["T_world_camera"])), facts["width"], facts["height"]),
        hand_seen=False,
        hand_modes=hand.modes,
    )


def _observations(points: Array, valid: Array, sigma: Array, mesh: Mesh, body: Body) -> TrackObservations:
    """The tracks that lie on the object, carried by the particles near them."""
    points = points.astype(np.float32)
    ids = tracks_on(mesh, points[0], valid[0])
    points0 = torch.from_numpy(points[0, ids])
    chosen = (points[:, ids], valid[:, ids], sigma[:, ids].astype(np.float32))
    binding = bind_to_body(points[0, ids], body, BINDING_NEIGHBOURS)
    return TrackObservations(points0, binding, *map(torch.from_numpy, chosen))


def _found_again(places: Array, body: Body, capture: Path) -> Array:
    """The particles [patches] nearest to `places` [patches, 3] m."""
    from scipy.spatial import cKDTree

    distance, nearest = cKDTree(body.x0).query(places)
    if distance.max() > body.spacing or len(np.unique(nearest)) < len(nearest):
        raise InputError(
            f"a patch of the first capture lies {distance.max():.4f} m from any particle",
            where=str(capture),
            expected=f"captures that show the object in one place at frame 0, to within {body.spacing:.4f} m",
        )
    return nearest


def _facts(capture: Path) -> dict:
    """capture.json, without the pipeline's check of it (which needs its packages), but for what is used here."""
    facts = json.loads((capture / "capture.json").read_text())
    needed = ("fps", "density", "split", "K", "width", "height", "T_world_camera")
    lacking = [key for key in needed if key not in facts]
    ignored = [key for key in ("clamps", "payloads") if facts.get(key)]
    if lacking or ignored:
        raise InputError(
            f"keys missing: {lacking}, keys that are not handled here: {ignored}",
            where=str(capture / "capture.json"),
            expected=f"{', '.join(needed)} of an object that is gripped and lies on the ground",
        )
    return facts
