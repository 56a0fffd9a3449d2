"""Writes a capture of known truth: simulate, film, and lay the files out as data/captures/<name>/ wants them."""

import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np

from data.rig import recording, texture
from data.rig.hidden.effect import NOTHING, Hidden
from data.rig.mesh import TetMesh
from data.rig.render import HAND, OBJECT, Picture, Stage
from data.rig.rig_scene import Look, RigScene
from data.rig.sensor import read_colour, read_depth
from data.rig.sequences import SEQUENCES, SETTLE, TIMESTEP
from data.rig.simulate import simulate
from data.rig.thin_body import ThinBody
from data.rig.thin_files import material_truth, middle_truth, stated, write_middle
from data.rig.thin_simulate import run
from data.rig.trajectory import Trajectory
from physreal_core.array_types import Array, Float
from physreal_core.checkpoints import remembered
from pipeline.products.truth import CaptureTruth

_MOMENTS = 6  # at which a picture with an open shutter is taken
_PRIOR_SHADE = 0.8  # vertex colours of the prior: the surface under a soft light


def make_capture(
    scene: RigScene,
    destination: Path,
    *,
    seed: int = 0,
    timestep: float = 0.001,
    shape: Literal["given", "seen"] = "given",
) -> None:
    """Simulates and films `scene` into `destination`, which is replaced as a whole.

    Args:
        scene: what to film.
        destination: capture folder.
        seed: seeds sensor noise and the prior's pose; the same seed gives the same files.
        timestep: largest step of the simulation of a solid body [s]; a thin one has its own (`thin_simulate.run`).
        shape: whether the capture has the stress-free shape, a thin body's thickness and clicks on object and hand.
    """
    trajectory = run(scene) if isinstance(scene.body, ThinBody) else simulate(scene, timestep=timestep)
    film(scene, trajectory, destination, seed=seed, shape=shape)


def film(
    scene: RigScene,
    trajectory: Trajectory,
    destination: Path,
    *,
    seed: int | Sequence[int] = 0,
    hidden: Hidden = NOTHING,
    further_truth: Mapping[str, Array | str] = MappingProxyType({}),
    hint: Literal["point", "box"] | None = "point",
    shape: Literal["given", "seen"] = "given",
) -> None:
    """Films what happened into `destination`, which is replaced as a whole.

    Args:
        scene: what the capture says it shows.
        trajectory: what truly happened.
        destination: capture folder.
        seed: seeds sensor noise and the prior's pose.
        hidden: what the capture does not say of camera and table.
        further_truth: more of the truth, as of `CaptureTruth`.
        hint: how the object is named in frame 0. A click on a pattern may be taken to mean a part of it; a box is not.
            None names the hand alone.
        shape: whether the capture has the stress-free shape and a thin body's thickness; where it is seen, nothing is named, either.
    """
    destination = Path(destination)
    draft = destination.with_name(destination.name + ".partial")
    shutil.rmtree(draft, ignore_errors=True)
    for folder in ("color", "depth"):
        (draft / folder).mkdir(parents=True)
    stage = Stage(scene, trajectory, hidden.placed)
    random = np.random.default_rng(seed)
    for frame in range(scene.frames):
        pose = hidden.camera(scene.view.pose(), frame / scene.fps)
        picture = _remembered_picture(stage, trajectory, frame, pose, scene.look.shutter)
        if frame == 0:
            hints = _hints(picture, hint) if shape == "given" else {}
        _write_frame(draft, frame, replace(picture, depth=hidden.depth(picture.depth)), scene, random)
    described, T_world_prior = describe(scene, hints), random_similarity(random)
    if shape == "given":
        _write_prior(draft / "shape_prior.glb", trajectory, T_world_prior, scene.look)
        write_middle(draft, trajectory, scene.body, T_world_prior)
    else:
        described.pop("thickness", None)
    (draft / "capture.json").write_text(json.dumps(described, indent=1) + "\n")
    if scene.push_friction is not None:
        recording.pushing(scene, trajectory).save(draft)
    truth = simulated_truth(scene, trajectory, stage.hand, T_world_prior)
    replace(truth, **_further_hands(stage, trajectory), **further_truth).save(draft)
    shutil.rmtree(destination, ignore_errors=True)
    draft.rename(destination)


def make_sequence(name: str, seed: int, destination: Path) -> None:
    """Simulates and films one of `sequences.SEQUENCES` into `destination`, which is replaced as a whole.

    It has no hint for the object, and one click on the first hand.

    Args:
        name: of the sequence.
        seed: of the scene and of the sensor's noise.
        destination: capture folder.
    """
    scene = SEQUENCES[name](seed)
    film(scene, simulate(scene, timestep=TIMESTEP, settle=SETTLE), destination, seed=seed, hint=None)


def parts_truth(scene: RigScene, trajectory: Trajectory) -> dict[str, Array | None]:
    """Of a body with a soft part, the moduli of its elements in place of one modulus, as of `CaptureTruth`."""
    if scene.soft_part is None:
        return {}
    centres = trajectory.mesh.vertices[trajectory.mesh.tets].mean(1)
    return {"moduli": scene.material.youngs_modulus * scene.soft_part.left(centres)}


def _hints(picture: Picture, kind: Literal["point", "box"] | None) -> dict[str, dict[str, list[int]]]:
    """What a person would say of frame 0."""
    hand = {"controller": {"point": _click(picture, HAND)}}
    if kind is None:
        return hand
    named = {"point": _click, "box": _box}[kind]
    return {"object": {kind: named(picture, OBJECT)}, **hand}


def _remembered_picture(stage: Stage, trajectory: Trajectory, frame: int, pose: Array, shutter: float) -> Picture:
    """`_exposed`, from its checkpoint where there is one."""
    size = stage.view.height, stage.view.width
    shapes = {"rgb": (*size, 3), "depth": size, "label": size, "slope": size}
    seen = [trajectory.vertices[frame], trajectory.hand[frame], pose, trajectory.others_at(frame), np.array(shutter)]
    found = remembered("picture", lambda: seen, shapes, lambda: vars(_exposed(stage, trajectory, frame, pose, shutter)))
    return Picture(**found)


def _exposed(stage: Stage, trajectory: Trajectory, frame: int, pose: Array, shutter: float) -> Picture:
    """The picture of a frame; with an open shutter its colour is the mean over moments around the frame's own."""
    vertices, hand, others = trajectory.vertices[frame], trajectory.hand[frame], trajectory.others_at(frame)
    sharp = stage.picture(vertices, hand, pose=pose, others=others)
    if shutter == 0:
        return sharp
    moments = frame + shutter * ((np.arange(_MOMENTS) + 0.5) / _MOMENTS - 0.5)
    light = 0.0
    for vertices, hand, others in map(trajectory.between, moments):
        picture = stage.picture(vertices, hand, 1, pose, others)
        light = light + picture.rgb ** (1 / texture.GAMMA) / _MOMENTS
    return replace(sharp, rgb=light**texture.GAMMA)


def _further_hands(stage: Stage, trajectory: Trajectory) -> dict[str, Array]:
    """Surfaces of the further hands in every frame, as of `CaptureTruth`; nothing where there are none."""
    if not stage.others:
        return {}
    offsets = np.cumsum([0] + [len(hand.vertices) for hand in stage.others[:-1]])
    moved = [hand.vertices + trajectory.others[:, i, None] for i, hand in enumerate(stage.others)]
    faces = [hand.faces + offset for hand, offset in zip(stage.others, offsets, strict=True)]
    return {
        "further_hands": np.concatenate(moved, axis=1).astype(np.float32),
        "further_hand_faces": np.concatenate(faces).astype(np.int32),
    }


def describe(scene: RigScene, hints: dict) -> dict:
    """The contents of capture.json."""
    view = scene.view
    return {
        "description": scene.description,
        "controller": "hand",
        "fps": scene.fps,
        "width": view.width,
        "height": view.height,
        "K": view.intrinsics().tolist(),
        "T_world_camera": view.pose().tolist(),
        "density": scene.material.density,
        **stated(scene.body),
        "hints": hints,
        "split": {"train": [0, scene.observed], "test": [scene.observed, scene.frames]},
    }


def random_similarity(random: np.random.Generator) -> Float[Array, "4 4"]:
    """Any rotation, a shift within half a metre, a scale between 1/2 and 2."""
    from scipy.spatial.transform import Rotation

    similarity = np.eye(4)
    scale = np.exp(random.uniform(-np.log(2), np.log(2)))
    similarity[:3, :3] = scale * Rotation.random(rng=random).as_matrix()
    similarity[:3, 3] = random.uniform(-0.5, 0.5, 3)
    return similarity


def _write_frame(folder: Path, frame: int, picture: Picture, scene: RigScene, random: np.random.Generator) -> None:
    import cv2

    cv2.imwrite(str(folder / "color" / f"{frame:06d}.png"), read_colour(picture, scene.noise, random)[..., ::-1])
    cv2.imwrite(str(folder / "depth" / f"{frame:06d}.png"), read_depth(picture, scene.noise, random))


def _click(picture: Picture, label: int) -> list[int]:
    """Where a person would click to name a thing: the pixel (u, v) farthest inside its visible part."""
    from scipy.ndimage import distance_transform_edt

    inside = distance_transform_edt(np.pad(picture.label == label, 1))[1:-1, 1:-1]
    v, u = np.unravel_index(inside.argmax(), inside.shape)
    return [int(u), int(v)]


def _box(picture: Picture, label: int) -> list[int]:
    """Where a person would draw a box around a thing: the edges (u0, v0, u1, v1) of its visible part."""
    v, u = np.nonzero(picture.label == label)
    return [int(u.min()), int(v.min()), int(u.max()), int(v.max())]


def _write_prior(path: Path, trajectory: Trajectory, T_world_prior: Float[Array, "4 4"], look: Look) -> None:
    """The stress-free surface with vertex colours, in a frame of its own; once subdivided for the colours' sake."""
    import trimesh

    surface = trimesh.Trimesh(trajectory.mesh.vertices, trajectory.mesh.faces, process=False)
    surface.remove_unreferenced_vertices()
    surface = surface.subdivide()
    colours = texture.paint(look.body, np.asarray(surface.vertices), look.seed)
    colours = np.clip(colours * _PRIOR_SHADE, 0, 1) ** texture.GAMMA
    surface.apply_transform(np.linalg.inv(T_world_prior))
    surface.visual = trimesh.visual.ColorVisuals(surface, vertex_colors=np.round(colours * 255).astype(np.uint8))
    surface.export(path)


def simulated_truth(
    scene: RigScene, trajectory: Trajectory, hand: TetMesh, T_world_prior: Float[Array, "4 4"]
) -> CaptureTruth:
    """What the simulation knows; `hand` is the hand's mesh at frame 0."""
    return CaptureTruth(
        **material_truth(scene),
        **parts_truth(scene, trajectory),
        **middle_truth(trajectory),
        friction_coefficient=scene.material.friction_coefficient,
        rest_vertices=trajectory.mesh.vertices.astype(np.float32),
        tets=trajectory.mesh.tets.astype(np.int32),
        faces=trajectory.mesh.faces.astype(np.int32),
        vertices=trajectory.vertices.astype(np.float32),
        gripped=trajectory.gripped.astype(np.int32),
        hand=trajectory.hand.astype(np.float32),
        hand_vertices=hand.vertices.astype(np.float32),
        hand_faces=hand.faces.astype(np.int32),
        T_world_prior=T_world_prior,
        fps=scene.fps,
    )
