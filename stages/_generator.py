"""A shape from one picture, by somebody else's generator: a command, or a network in an .onnx file.

It sees frame 0 and the object's mask, and leaves the whole object in any pose and size, as a shape prior would show it.
"""

import shlex
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from physreal_core.errors import InputError
from physreal_core.geometry import Mesh, Observation, load_mesh
from physreal_core.rendering import Gaussians, load_gaussians

KEY = "build_object.generator"
IMAGE, MASK, OUTPUT = "{image}", "{mask}", "{output}"
MARGIN = 0.15
"""Of the longer side of the object's box, left free on every side of the square that a network sees."""

USUAL_SIDE = 512
"""Side of that square where the network takes any [px]."""


def generated(generator: str, seen: Observation) -> tuple[Mesh | None, Gaussians | None]:
    """Mesh, Gaussians, or both in one frame, of the object that is seen.

    Args:
        generator: of `build_object`.
        seen: frame 0.

    Raises:
        InputError: the generator is not there or fails, or leaves no shape.
    """
    if generator.endswith(".onnx"):
        return _by_network(Path(generator), seen), None
    return _by_command(generator, seen)


def _by_command(command: str, seen: Observation) -> tuple[Mesh | None, Gaussians | None]:
    """What the command leaves in its folder: shape.glb, shape.ply (Gaussians), or both."""
    import cv2

    if missing := [place for place in (IMAGE, MASK, OUTPUT) if place not in command]:
        raise InputError(f"no {missing[0]} in the command", where=KEY, expected=f"{IMAGE}, {MASK} and {OUTPUT} in it")
    with tempfile.TemporaryDirectory() as folder:
        places = {IMAGE: Path(folder) / "image.png", MASK: Path(folder) / "mask.png", OUTPUT: Path(folder) / "out"}
        places[OUTPUT].mkdir()
        cv2.imwrite(str(places[IMAGE]), (255.0 * seen.rgb[..., ::-1]).round().astype(np.uint8))
        cv2.imwrite(str(places[MASK]), 255 * seen.mask.astype(np.uint8))
        _run([_filled(word, places) for word in shlex.split(command)])
        glb, ply = places[OUTPUT] / "shape.glb", places[OUTPUT] / "shape.ply"
        mesh = load_mesh(glb) if glb.exists() else None
        gaussians = load_gaussians(ply) if ply.exists() else None
    if mesh is None and gaussians is None:
        raise InputError("the command left no shape", where=KEY, expected=f"shape.glb or shape.ply in {OUTPUT}")
    return mesh, gaussians


def _filled(word: str, places: dict[str, Path]) -> str:
    for name, path in places.items():
        word = word.replace(name, str(path))
    return word


def _run(words: list[str]) -> None:
    try:
        ended = subprocess.run(words, check=False, capture_output=True, text=True)
    except OSError as error:
        raise InputError(f"{words[0]!r} cannot be started ({error})", where=KEY, expected="a command") from error
    if ended.returncode:
        said = "\n".join(ended.stderr.strip().splitlines()[-5:])
        raise InputError(f"the command ended with {ended.returncode}:\n{said}", where=KEY, expected="a shape and 0")


def _by_network(path: Path, seen: Observation) -> Mesh:
    """By a network from `image` [1, 3, S, S], RGB in 0 to 1, and `mask` [1, 1, S, S] to `vertices` [V, 3], `faces` [F, 3] and perhaps
    `colours` [V, 3] in 0 to 1; the object fills the square."""
    from physreal_core.perception.session import open_session

    session = open_session(path, inputs=2, outputs=2)
    side = session.get_inputs()[0].shape[-1]
    image, mask = _square(seen, side if isinstance(side, int) else USUAL_SIDE)
    names = [own.name for own in session.get_inputs()]
    if sorted(names) != ["image", "mask"]:
        raise InputError(f"the network has the inputs {names}", where=str(path), expected="image and mask")
    vertices, faces, *colours = session.run(None, {"image": image, "mask": mask})[:3]
    if faces.ndim != 2 or faces.shape[1] != 3 or vertices.ndim != 2 or vertices.shape[1] != 3 or not len(faces):
        shapes = f"vertices {vertices.shape} and faces {faces.shape}"
        raise InputError(f"the network gives {shapes}", where=str(path), expected="vertices [V, 3] and faces [F, 3]")
    return Mesh(vertices.astype(np.float64), faces.astype(np.int64), *(own.astype(np.float64) for own in colours))


def _square(seen: Observation, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Picture and mask of the object alone, in the middle of a square of `side` pixels, black around it."""
    import cv2

    rows, columns = np.nonzero(seen.mask)
    if not len(rows):
        raise InputError("nothing is seen of the object in frame 0", where=KEY, expected="a mask that is not empty")
    centre = np.array([columns.min() + columns.max(), rows.min() + rows.max()]) / 2.0
    reach = (0.5 + MARGIN) * max(np.ptp(columns), np.ptp(rows), 1)
    scale = side / (2.0 * reach)
    moved = np.array([[scale, 0.0, side / 2.0 - scale * centre[0]], [0.0, scale, side / 2.0 - scale * centre[1]]])
    picture = np.dstack([seen.rgb * seen.mask[..., None], seen.mask]).astype(np.float32)
    cut = cv2.warpAffine(picture, moved, (side, side), flags=cv2.INTER_AREA)
    return cut[None, ..., :3].transpose(0, 3, 1, 2).copy(), cut[None, None, ..., 3].copy()
