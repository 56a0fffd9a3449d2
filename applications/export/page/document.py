"""`page.html`: the player, what it needs, and the motion, in one file."""

import base64
import gzip
import json
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from applications.export.moving import Moving
from applications.export.page.packed import Packed
from applications.export.splats import require_splats
from pipeline.models import default_folder, fetch, require
from pipeline.models.catalogue import NETWORKS

FILE = "page.html"
_PARTS = ("three", "spark")
_CORE = ("./three.core.js", "three-core")
_MODULES = {
    "three-core": "three.core.js",
    "three": "three.module.js",
    "three/addons/controls/OrbitControls.js": "OrbitControls.js",
    "three/addons/postprocessing/Pass.js": "Pass.js",
    "@sparkjsdev/spark": "spark.module.min.js",
}
"""Names under which JavaScript imports files of the parts; those of a file come before it."""


def write(moving: Moving, folder: Path) -> list[str]:
    """`page.html`; returns what it does not hold. Spark and three.js are fetched the first time.

    Raises:
        InputError: a motion capture, which has no appearance; no connection, or files that are not as pinned.
    """
    require_splats(moving, "page")
    fetched, packed = _fetched(), Packed.of(moving)
    own = files("applications.export.page")
    parts = {name: fetched[file].read_bytes() for name, file in _MODULES.items()}
    parts["three"] = parts["three"].replace(*(name.encode() for name in _CORE))
    parts |= {"player": own.joinpath("player.js").read_bytes(), "motion": packed.motion, "colours": packed.colours}
    parts["scene"] = json.dumps(packed.scales | _view(moving)).encode()
    page = own.joinpath("player.html").read_text()
    for mark, text in (
        ("TITLE", moving.twin.sequence),
        ("MODULES", json.dumps(list(_MODULES))),
        ("LICENCES", _licences(fetched)),
        ("PARTS", "\n".join(_script(name, content) for name, content in parts.items())),
    ):
        page = page.replace("{{" + mark + "}}", text)
    (folder / FILE).write_text(page)
    size = (folder / FILE).stat().st_size / 2**20
    return [f"{packed.scales['splats']} splats, {size:.1f} MiB; colours are those of frame 0."]


def _fetched() -> dict[str, Path]:
    """Spark's and three.js's files, from data/models, where they are put the first time."""
    folder = default_folder()
    fetch(_PARTS, folder)
    return {file: path for name in _PARTS for file, path in require(name, folder).items()}


def _licences(fetched: dict[str, Path]) -> str:
    """Which foreign code is in the page, and under which licence."""
    told = ["Written by PhysReal. Contains, compressed:"]
    for name in _PARTS:
        part, text = NETWORKS[name], fetched[f"{name}.LICENSE"].read_text().strip()
        told.append(f"{part.package} {part.version} ({part.licence})\n\n{text}")
    return "\n\n".join(told).replace("--", "- -")


def _script(name: str, content: bytes) -> str:
    """A part as an element that no browser runs by itself."""
    packed = base64.b64encode(gzip.compress(content, mtime=0)).decode()
    return f'<script type="text/plain" id="{name}">{packed}</script>'


def _view(moving: Moving) -> dict[str, Any]:
    """The camera that filmed it, turned to the middle of the body."""
    twin, camera = moving.twin, moving.twin.camera
    field = 2 * np.arctan(camera.height / (2 * float(camera.K[1, 1])))
    return {
        "title": twin.sequence,
        "eye": camera.centre.tolist(),
        "target": twin.mesh.vertices.mean(axis=0).tolist(),
        "fov": float(np.degrees(field)),
    }
