"""`physreal export`: writes the folder as a whole, or nothing."""

import argparse
import importlib.util

from applications.export import gltf, mjcf, newton, page, splats, usd
from applications.export.moving import Moving
from applications.twin import Twin
from physreal_core.errors import InputError
from pipeline.graph import FIT_STAGES
from pipeline.project import Project
from pipeline.whole_folder import as_a_whole, require_new

FORMATS = {
    "splats": splats.write,
    "gltf": gltf.write,
    "usd": usd.write,
    "mjcf": mjcf.write,
    "newton": newton.write,
    "page": page.write,
}
_PACKAGES = {"gltf": "pygltflib", "usd": "pxr", "mjcf": "mujoco", "newton": "pxr"}


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
    require_new(folder, "physreal export")
    with as_a_whole(folder) as draft:
        told = FORMATS[parsed.format](moving, draft)
    for line in told or ():
        print(line)
    print(f"wrote {len(list(folder.iterdir()))} files, {len(moving.rollout.x)} frames: {folder}")
