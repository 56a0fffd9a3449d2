"""The dvc.yaml of every stage and of the aggregates, out of the graph and of what the stages' modules import.

`physreal compose` writes them, `physreal compose --check` holds them fresh. pipeline/models/dvc.yaml alone is written by hand.
"""

from collections import defaultdict
from pathlib import Path
from typing import Any

import yaml

from pipeline.graph import AGGREGATES, STAGES, Aggregate, Graph, Stage
from pipeline.project import CODE_ROOT
from pipeline.provenance import project_modules

HEADER = """\
# Written by `physreal compose` from pipeline/graph.py and the imports of {modules}.
# Not to be edited: `physreal compose --check` would fail.
"""

COUNTED_OF_PIPELINE = ("pipeline/capture.py", "pipeline/frames.py", "pipeline/products", "pipeline/reading")
"""What of pipeline/ reads artifacts, files or folders. A change in its other modules alters no result."""

LIGHT = tuple(f"physreal_core/{name}.py" for name in ("errors", "array_types", "evidence", "checkpoints"))
"""Error messages, annotations, refusals and checkpoints, which compute nothing."""

OTHER_SOURCES = (".h", ".cpp", ".cu")
"""Endings of sources that modules read and no import names."""

WHOLE_FROM = 1 / 3
"""Share of a package's modules beyond which a stage depends on the package's folder."""

SEQUENCE = "${key}"
"""What DVC puts a sequence's name in place of."""


def dvc_files(
    graph: Graph = STAGES, aggregates: tuple[Aggregate, ...] = AGGREGATES, root: Path = CODE_ROOT
) -> dict[str, str]:
    """Path from `root` → text, of every dvc.yaml that follows from the graph and from the code in `root`."""
    texts = {f"pipeline/{stage.name}/dvc.yaml": _stage_file(stage, root) for stage in graph.values()}
    return texts | {"dvc.yaml": _aggregates_file(aggregates, root)}


def code_dependencies(module: str, root: Path = CODE_ROOT) -> list[str]:
    """The code that a module runs, as DVC watches it: files and folders.

    A package, which is a folder in physreal_core/ or data/, stands whole where it holds sources that no import names,
    such as C++ headers, and where more than a third of its modules are imported. Of all else stand the files that are
    imported.

    Args:
        module: path of the module from `root`; it comes first.
        root: folder that the code lies in.
    """
    packages: dict[Path, list[Path]] = defaultdict(list)
    for path in project_modules(root / module, (root,)):
        file = path.relative_to(root)
        if _counts(file):
            packages[_package(file)].append(file)
    chosen = [path for package, used in packages.items() for path in _package_or_files(package, used, root)]
    chosen.sort(key=lambda path: (path != Path(module), _FLOORS.index(path.parts[0]), path.parts))
    return [path.as_posix() for path in chosen]


_FLOORS = ("stages", "data", "pipeline", "physreal_core")


def _counts(file: Path) -> bool:
    """Whether a change in an imported file may alter what a stage computes."""
    if file.parts[0] == "pipeline":
        return any(file.is_relative_to(counted) for counted in COUNTED_OF_PIPELINE)
    return file.name != "__init__.py" and file.as_posix() not in LIGHT


def _package(file: Path) -> Path:
    """physreal_core/geometry or data/rig, for a file that lies in one; else the folder that the file lies in."""
    in_package = file.parts[0] in ("physreal_core", "data") and len(file.parts) > 2
    return Path(*file.parts[:2]) if in_package else file.parent


def _package_or_files(package: Path, used: list[Path], root: Path) -> list[Path]:
    if package.parts[0] not in ("physreal_core", "data") or len(package.parts) < 2:
        return used
    files = [file for file in (root / package).rglob("*") if file.is_file()]
    modules = [file for file in files if file.suffix == ".py" and file.name != "__init__.py"]
    whole = any(file.suffix in OTHER_SOURCES for file in files) or len(used) > WHOLE_FROM * len(modules)
    return [package] if whole else used


def _stage_file(stage: Stage, root: Path) -> str:
    module = f"stages/{stage.name}.py"
    code = code_dependencies(module, root)
    stages = {stage.entry(role): _entry(stage, role, code) for role in stage.roles}
    return _text({"vars": ["../../params.yaml"], "stages": stages}, module)


def _entry(stage: Stage, role: str, code: list[str]) -> dict[str, Any]:
    """`foreach` and not `matrix`, because only that gives both a sequence's name and what stands under it.

    Nothing of params.yaml stands in `cmd`: DVC would put the name there before the shell reads the line, so that a name
    could hold a command, and no quotes hold against a name with a quote in it. DVC tells the stage its name in DVC_STAGE.
    """
    home = "clips" if role == "clips" else "sequences"
    told = [f"{role}.{SEQUENCE}"] if stage.of_model or stage.of_companion else []
    told += [f"{home}.{SEQUENCE}.geometry"] if stage.reads_geometry else []
    output = f"data/captures/{SEQUENCE}" if stage.makes_capture else f"data/artifacts/{stage.name}/{SEQUENCE}"
    body = {
        "wdir": "../..",
        "cmd": f"python -m stages.{stage.name}",
        "params": ["seed", stage.name, *told, f"{home}.{SEQUENCE}.{stage.name}"],
        "deps": [*code, *_data(stage, role)],
        # DVC deletes outputs that do not persist before a stage runs, and a capture may be somebody's own.
        "outs": [{output: {"persist": True}} if stage.makes_capture else output],
    }
    return {"foreach": f"${{{role}}}", "do": body}


def _data(stage: Stage, role: str) -> list[str]:
    """Captures, artifacts and other files that the stage reads."""
    capture = [f"data/captures/{SEQUENCE}"] if stage.reads_capture else []
    own = [f"data/artifacts/{name}/{SEQUENCE}" for name in stage.inputs(role)]
    model = [f"data/artifacts/{name}/${{item.model_from}}" for name in stage.of_model]
    companion = [
        f"data/artifacts/{name}/${{item.companion}}/{file}"
        for name, files in stage.of_companion.items()
        for file in files
    ]
    return [*capture, *own, *model, *companion, *stage.files]


def _aggregates_file(aggregates: tuple[Aggregate, ...], root: Path) -> str:
    """The root's dvc.yaml: `dvc repro` there runs every stage that the aggregates depend on."""
    stages = {aggregate.name: _aggregate(aggregate, root) for aggregate in aggregates}
    plots = [{name: plot} for aggregate in aggregates for name, plot in aggregate.plots.items()]
    modules = " and ".join(f"stages/{aggregate.name}.py" for aggregate in aggregates)
    return _text({"stages": stages, **({"plots": plots} if plots else {})}, modules)


def _aggregate(aggregate: Aggregate, root: Path) -> dict[str, Any]:
    code = code_dependencies(f"stages/{aggregate.name}.py", root)
    body = {
        "cmd": f"python -m stages.{aggregate.name}",
        "params": ["sequences", "fits", "predictions"],
        "deps": [*code, *(f"data/artifacts/{name}" for name in aggregate.reads), *aggregate.files],
        "outs": [*aggregate.outputs, *({name: {"cache": False}} for name in aggregate.outputs_in_git)],
        "metrics": [{name: {"cache": False}} for name in aggregate.metrics],
    }
    return {key: value for key, value in body.items() if value}


def _text(content: dict[str, Any], modules: str) -> str:
    body = yaml.dump(content, Dumper=_NoAliases, sort_keys=False, width=120)
    return HEADER.format(modules=modules) + body


class _NoAliases(yaml.SafeDumper):
    """Every entry is written out, though two hold the same list."""

    def ignore_aliases(self, data: Any) -> bool:
        return True
