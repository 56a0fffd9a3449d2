"""`physreal import`: other people's recordings into data/captures, and their names into params.yaml."""

import importlib
import inspect
import pkgutil
from pathlib import Path
from types import ModuleType
from typing import Any

import yaml

from physreal_core.errors import InputError
from pipeline.config import read_parameters, unknown_key, validate_parameters
from pipeline.graph import STAGES
from pipeline.project import Project

PACKAGE = "data.importers"


def kinds() -> dict[str, str]:
    """Kind → what it reads, in a line; one per public module of data/importers."""
    package = importlib.import_module(PACKAGE)
    names = [module.name for module in pkgutil.iter_modules(package.__path__) if not module.name.startswith("_")]
    modules = {name: importlib.import_module(f"{PACKAGE}.{name}") for name in names}
    return {name: _first_line(module) for name, module in modules.items() if hasattr(module, "import_capture")}


def import_capture(kind: str, source: Path, name: str, options: list[str], role: str, project: Project) -> str:
    """Write data/captures/<name> and enter it in params.yaml.

    Args:
        kind: a name of `kinds`.
        source: the recording.
        name: the new sequence's.
        options: `key=value` for the importer's own keywords.
        role: `fits` (become an object and be fitted) or `clips` (perception only).
        project: where.

    Returns:
        What was done, for the user.

    Raises:
        InputError: no such kind or keyword, the name is taken, or the recording cannot be used.
    """
    if kind not in kinds():
        raise unknown_key(kind, kind, list(kinds()), "physreal import")
    if project.capture(name).exists():
        raise InputError(f"{project.capture(name)} exists", where="physreal import", remedy="choose another name")
    importer = importlib.import_module(f"{PACKAGE}.{kind}")
    keywords = _keywords(importer, options)
    project.capture(name).parent.mkdir(parents=True, exist_ok=True)
    importer.import_capture(source, project.capture(name), **keywords)
    return f"wrote {project.capture(name)}\n{add_sequence(name, role, project)}"


def add_sequence(name: str, role: str, project: Project) -> str:
    """Enter a capture folder in params.yaml, all other values as they were.

    Args:
        name: a folder in data/captures.
        role: `fits` (become an object and be fitted) or `clips` (perception only).
        project: where.

    Returns:
        What was done and what comes next, for the user.
    """
    from pipeline.check import Purpose, check_capture
    from pipeline.compose import render

    found = check_capture(project.capture(name), Purpose(clip=role == "clips"))
    raw = read_parameters(project.parameters)
    home = "clips" if role == "clips" else "sequences"
    raw[home] = {**(raw.get(home) or {}), name: {}}
    raw[role] = {**(raw.get(role) or {}), name: {}}
    project.parameters.write_text(render(validate_parameters(raw, project.parameters.name)))
    last = [stage for stage in STAGES.values() if role in stage.roles][-1]
    return f"entered {name} in params.yaml under {role}: {found}\nnext: dvc repro {last.target(role, name)}"


def _keywords(importer: ModuleType, options: list[str]) -> dict[str, Any]:
    parameters = inspect.signature(importer.import_capture).parameters.values()
    known = [parameter.name for parameter in parameters if parameter.kind is inspect.Parameter.KEYWORD_ONLY]
    keywords = {}
    for option in options:
        key, equals, value = option.partition("=")
        if not equals or key not in known:
            raise unknown_key(key, key, known, f"physreal import {importer.__name__.rpartition('.')[2]}")
        keywords[key] = yaml.safe_load(value)
    return keywords


def _first_line(module: ModuleType) -> str:
    return (module.__doc__ or "").strip().partition("\n")[0]
