"""`physreal export`: writes the folder as a whole, or nothing."""

import argparse
import importlib.util
import shutil

from applications.export import gltf, mjcf, page, splats, usd
from applications.export.moving import Moving
from applications.twin import Twin
from physreal_core.errors import InputError
from pipeline.graph import FIT_STAGES
from pipeline.project import Project

FORMATS = {"splats": splats.write, "gltf": gltf.write, "usd": usd.write, "mjcf": mjcf.write, "page": page.write}
_PACKAGES = {"gltf": "pygltflib", "usd": "pxr", "mjcf": "mujoco"}


def export(parsed: argparse.Namespace) -> None:
    """Does what the command line asks for.

    Raises:
        InputError: as of `Twin.load`; a package is missing, the folder is there already, or the format does not fit the sequence.
    """
    package = _PACKAGES.get(parsed.format)
    if package is not None and importlib.util.find_spec(package) is None:
        raise InputError(
            f"--format {parsed.format} needs {package}, which is not installed",
            where="physreal export",
            remedy='run `pip install "physreal[export]"`, in a checkout `pip install -e ".[export]"`',
        )
    project = Project.find()
    moving = Moving.of(Twin.load(project, parsed.sequence, parsed.model or FIT_STAGES[-1]))
    folder = parsed.to or project.root / "data" / "exported" / parsed.sequence / parsed.format
    if folder.exists():
        raise InputError(
            f"{folder} is there already", where="physreal export --to", remedy="name another, or delete it"
        )
    draft = folder.with_name(f".{folder.name}.partial")
    shutil.rmtree(draft, ignore_errors=True)
    draft.mkdir(parents=True)
    try:
        told = FORMATS[parsed.format](moving, draft)
        draft.rename(folder)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    for line in told or ():
        print(line)
    print(f"wrote {len(list(folder.iterdir()))} files, {len(moving.rollout.x)} frames: {folder}")
