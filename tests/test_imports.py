"""Imports run one way, and nothing leads back to itself; the core's ground stands on four packages alone."""

import ast
import subprocess
import sys
from collections.abc import Iterable
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.conftest import ROOT

HEAVY = {"cv2", "open3d", "onnxruntime", "hydra", "omegaconf", "dvc"}
HEAVY_AT_HOME = ("physreal_core/perception", "physreal_core/geometry", "stages", "tests")

# Everything that is installed beside numpy, scipy, torch and warp (pyproject.toml), and the project's upper floors.
BLOCKED = {
    *HEAVY, "beartype", "filelock", "imageio_ffmpeg", "jaxtyping", "jinja2", "manifold3d", "matplotlib", "mujoco",
    "onnx", "PIL", "plyfile", "pydantic", "pytest", "rich", "safetensors", "skimage", "sklearn", "tflite", "tokenizers", "trimesh",
    "yaml",
    "applications", "data", "pipeline", "stages", "tests",
}  # fmt: skip
# These run the pipeline's stages or importers, so they need what those need.
ABOVE = {
    "benchmarks.gap.reruns",
    "benchmarks.gap.rgbd",
    "benchmarks.gap.track_noise",
    *(
        f"benchmarks.baselines.{name}"
        for name in ("__main__", "graph_network", "methods", "one_material", "ours", "report", "row", "scene")
    ),
    "benchmarks.baselines.spring_mass",
    "benchmarks.modulus",
    "benchmarks.modulus_seen",
    "benchmarks.kills",
    "benchmarks.beam",
    "benchmarks.beam_report",
    "benchmarks.beam_scene",
    "benchmarks.colour_only",
    "benchmarks.filmed",
    "benchmarks.rendered",
    "benchmarks.perception",
    "benchmarks.planning.__main__",
    "benchmarks.planning.cases",
    "benchmarks.planning.measuring",
    "benchmarks.planning.report",
    "benchmarks.planning.scenes",
    "benchmarks.planning.twins",
    "benchmarks.generating",
    "benchmarks.policy.__main__",
    "benchmarks.policy.lifting",
    "benchmarks.policy.report",
    "benchmarks.policy.rig",
    "benchmarks.following",
    "benchmarks.playing",
    "benchmarks.perception_report",
    "benchmarks.perception_runs",
    "benchmarks.pushed",
    "benchmarks.taken",
    "benchmarks.thin.lifted",
    "benchmarks.thin.rigged",
    "benchmarks.two_parts",
    "benchmarks.hold_seen",
    "benchmarks.shape_seen",
}
BARE = f"""
import importlib, pkgutil, sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {BLOCKED!r}:
            raise ImportError(f"{{name}} is not on a bare GPU machine")

sys.meta_path.insert(0, Refuse())
package = importlib.import_module(sys.argv[1])
for module in pkgutil.walk_packages(package.__path__, sys.argv[1] + "."):
    if module.name not in {ABOVE!r}:
        importlib.import_module(module.name)
    print(module.name)
"""


@pytest.mark.parametrize(
    "package",
    [
        "physreal_core.simulation",
        "physreal_core.rendering",
        "physreal_core.effects",
        "physreal_core.fitting",
        "physreal_core.gap",
        "physreal_core.following",
        "physreal_core.planning",
        "physreal_core.geometry",
        "physreal_core.evaluation",
        "benchmarks",
    ],
)
def test_imports_with_numpy_scipy_torch_and_warp_alone(package):
    command = [sys.executable, "-c", BARE, package]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert len(result.stdout.splitlines()) >= 4  # every module was seen


def modules(folder: str) -> list[Path]:
    return sorted((ROOT / folder).rglob("*.py"))


def imported(path: Path, *, anywhere: bool) -> set[str]:
    """Top-level packages that a file imports: at module level only, or also inside functions."""
    tree = ast.parse(path.read_text())
    nodes = ast.walk(tree) if anywhere else _at_module_level(tree)
    found = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            found.add(node.module.partition(".")[0])
    return found


def _at_module_level(node: ast.AST):
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield child
            yield from _at_module_level(child)


FLOORS = ("benchmarks", "applications", "stages", "data", "pipeline", "physreal_core")
"""From the top floor down: each imports from those after it alone."""


def dotted(path: Path) -> str:
    """The name of a module, or of the package whose __init__ it is."""
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


FILES = {dotted(path): path for floor in FLOORS for path in modules(floor)}


def modules_imported(module: str) -> set[str]:
    """The project's own modules that a module imports, at module level or inside a function."""
    found = set()
    for node in ast.walk(ast.parse(FILES[module].read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: an import from {'.' * node.level}, which would not be seen here"
            full = [f"{node.module}.{alias.name}" for alias in node.names]
            found |= {name if name in FILES else node.module for name in full}
    return found & FILES.keys() - {module}


IMPORTS = {module: modules_imported(module) for module in FILES}


def rises(module: str, imported: str) -> bool:
    """Whether an import goes to a floor above the module's own."""
    own, other = (FLOORS.index(name.partition(".")[0]) for name in (module, imported))
    return other < own


def test_floors_import_from_those_below():
    pairs = {(module, name) for module, names in IMPORTS.items() for name in names}
    assert len(pairs) > 1000
    assert not {pair for pair in pairs if rises(*pair)}


def room(module: str) -> str:
    """The package that a module stands in: a floor, or a package of the core."""
    parts = module.split(".")
    in_core = parts[0] == "physreal_core" and any(name.startswith(f"{'.'.join(parts[:2])}.") for name in FILES)
    return ".".join(parts[:2]) if in_core else parts[0]


def assert_no_circle(pairs: Iterable[tuple[str, str]]) -> None:
    graph = TopologicalSorter()
    for one, other in pairs:
        graph.add(one, other)
    graph.prepare()  # CycleError, naming the circle


def test_no_package_leads_back_to_itself():
    rooms = {(room(module), room(name)) for module, names in IMPORTS.items() for name in names}
    assert ("physreal_core.gap", "physreal_core.fitting") in rooms
    assert_no_circle((one, other) for one, other in rooms if one != other)


def test_no_module_leads_back_to_itself():
    pairs = ((module, name) for module, names in IMPORTS.items() for name in names)
    assert_no_circle(pairs)


def test_the_core_imports_no_upper_floor():
    upper = {"pipeline", "stages", "data", "benchmarks", "tests"}
    for path in modules("physreal_core"):
        assert not imported(path, anywhere=True) & upper, path


def test_heavy_packages_are_imported_where_they_are_used():
    homes = tuple(ROOT / home for home in HEAVY_AT_HOME)
    for folder in ("physreal_core", "pipeline", "stages", "data", "benchmarks"):
        for path in modules(folder):
            if not any(path.is_relative_to(home) for home in homes):
                assert not imported(path, anywhere=False) & HEAVY, path
