"""`physreal import` and `physreal add`: recordings into data/captures, and the names of captures into params.yaml."""

import importlib
import inspect
import pkgutil
import shutil
import types
import typing
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import ModuleType
from typing import Any

from physreal_core.errors import InputError
from pipeline.config import Parameters, check_name, load_parameters, unknown_key
from pipeline.faults import writing_to
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
    """Write data/captures/<name> and enter it in params.yaml: both, or nothing.

    The capture is written to a draft, which is checked as a whole before it takes its place.

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
        InputError: the name is none or is taken, there is no such kind or keyword, or the recording cannot be used.
    """
    if kind not in kinds():
        raise unknown_key(kind, kind, list(kinds()), "physreal import")
    check_name(name, "physreal import")
    importer = importlib.import_module(f"{PACKAGE}.{kind}")
    keywords = _keywords(importer, options)
    if not source.exists():
        raise InputError("there is no such file or folder", where=str(source), remedy="name the recording's place")
    _refuse_taken(name, role, project)
    with _draft(name, project) as draft:
        try:
            with writing_to(draft):
                importer.import_capture(source, draft, **keywords)
            found = _check(draft, role, project, called=f"{name} as imported from {source}")
        except InputError as error:
            raise _about(error, draft, f"{name} as imported from {source}") from error
        said = _put_in_place(draft, name, role, project)
    return f"wrote {project.capture(name)}\n{_told(name, role, found, said)}"


def add_sequence(name: str, role: str, project: Project) -> str:
    """Enter a capture folder in params.yaml, all other values and the comments as they were.

    A sequence that is there without the role gets the role; its own values stay.

    Args:
        name: a folder in data/captures.
        role: `fits` (become an object and be fitted) or `clips` (perception only).
        project: where.

    Returns:
        What was done and what comes next, for the user.

    Raises:
        InputError: the name is none, is entered with this role already or with one that excludes it, or the capture
            cannot be used.
    """
    check_name(name, "physreal add")
    _entry(load_parameters(project.parameters), name, role)
    if not project.capture(name).is_dir():
        raise InputError(
            f"there is no folder {project.capture(name)}",
            where="physreal add",
            remedy="put the capture there, or bring a recording in with `physreal import`",
        )
    found = _check(project.capture(name), role, project, called=str(project.capture(name)))
    return _told(name, role, found, _enter(name, role, project))


def _check(folder: Path, role: str, project: Project, called: str) -> str:
    """What the capture in `folder` holds, in a line; warnings about it name it as it is `called`."""
    from pipeline.check import Purpose, examine, tell

    values = load_parameters(project.parameters).values
    depth_range = (values.parse_video.min_depth, values.parse_video.max_depth)
    summary, found = examine(folder, Purpose(role == "clips", depth_range, values.build_object.close_holes))
    found.require_none()
    tell(_about(warning, folder, called) for warning in found.warnings)
    return summary


def _told(name: str, role: str, found: str, entered: str) -> str:
    last = [stage for stage in STAGES.values() if role in stage.roles][-1]
    return f"{entered}: {found}\nnext: dvc repro {last.target(role, name)}"


def _enter(name: str, role: str, project: Project) -> str:
    from pipeline.capture import read_capture
    from pipeline.parameters_file import enter_names, parameters_lock

    geometry = read_capture(project.capture(name)).geometry
    with parameters_lock(project):
        enter_names(project, _entry(load_parameters(project.parameters), name, role, geometry))
    return f"entered {name} in params.yaml under {role}"


def _entry(
    parameters: Parameters, name: str, role: str, geometry: str = "volumetric"
) -> dict[str, dict[str, dict[str, Any]]]:
    """What params.yaml lacks for `name` to have the role: block → name → what is to stand there; a new sequence has the capture's geometry.

    Raises:
        InputError: it lacks nothing, or the name has a role that excludes this one.
    """
    values, home = parameters.values, "clips" if role == "clips" else "sequences"
    having = [block for block in ("sequences", "clips", "fits", "predictions") if name in getattr(values, block)]
    if role in having:
        raise InputError(
            f"{name} is entered already, under {role}",
            where=parameters.file,
            remedy=f"change its values there, or take {name} out of every block of {parameters.file} and add it anew",
        )
    excluded = {"clips": ("sequences",), "fits": ("clips", "predictions")}[role]
    if hindrance := [block for block in excluded if block in having]:
        raise InputError(
            f"{name} is under {hindrance[0]}",
            where=parameters.file,
            expected=f"no name under {hindrance[0]} that is to be under {role}",
            remedy=f"take {name} out of {hindrance[0]} in {parameters.file}, then add it",
        )
    model = typing.get_args(type(values).model_fields[home].annotation)[1]
    own = {} if home == "clips" else {"geometry": geometry}
    missing = {} if home in having else {home: {name: model(**own).model_dump(mode="json")}}
    return missing if role == home else missing | {role: {name: {"companion": name}}}


def _refuse_taken(name: str, role: str, project: Project) -> None:
    """A capture that is there is its owner's."""
    if project.capture(name).exists():
        raise InputError(
            f"{project.capture(name)} exists",
            where="physreal import",
            remedy=f"choose another name, or enter that capture with `physreal add {name}`",
        )
    _entry(load_parameters(project.parameters), name, role)


@contextmanager
def _draft(name: str, project: Project) -> Iterator[Path]:
    """A place for a capture that is not whole yet, beside the others and hidden. What is left there at the end is removed.

    Raises:
        InputError: another process is importing under this name.
    """
    from filelock import FileLock, Timeout

    path = project.import_lock(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        lock = FileLock(path).acquire(timeout=0)
    except Timeout:
        raise InputError(f"{name} is being imported by another process", where="physreal import") from None
    draft = project.capture_draft(name)
    with lock:
        try:
            shutil.rmtree(draft.parent, ignore_errors=True)
            draft.parent.mkdir(parents=True)
            yield draft
        finally:
            shutil.rmtree(draft.parent, ignore_errors=True)


def _about(error: InputError, draft: Path, name: str) -> InputError:
    """The same of what the draft was made from: nobody will find the draft."""
    parts = {key: getattr(error, key).replace(str(draft), name) for key in ("what", "where", "expected", "remedy")}
    return InputError(parts.pop("what"), **parts)


def _put_in_place(draft: Path, name: str, role: str, project: Project) -> str:
    """The draft under its name, and that in params.yaml; where the latter fails, the capture goes as well."""
    _refuse_taken(name, role, project)
    place = project.capture(name)
    draft.rename(place)
    try:
        return _enter(name, role, project)
    except BaseException:
        with suppress(OSError):
            place.rename(draft)
        raise


def _keywords(importer: ModuleType, options: list[str]) -> dict[str, Any]:
    """The importer's keyword arguments out of `key=value`, each read as the type that the importer gives it."""
    where = f"physreal import {importer.__name__.rpartition('.')[2]}"
    signature, hints = (
        inspect.signature(importer.import_capture),
        typing.get_type_hints(importer.import_capture, include_extras=True),
    )
    known = [p.name for p in signature.parameters.values() if p.kind is inspect.Parameter.KEYWORD_ONLY]
    keywords: dict[str, Any] = {}
    for option in options:
        key, equals, text = option.partition("=")
        if key not in known:
            raise unknown_key(key, key, known, where)
        if not equals:
            raise InputError(
                f"{option} has no value", where=where, expected=f"{key}=value", remedy=f"write {key}=value"
            )
        if key in keywords:
            raise InputError(f"{key} is given twice", where=where, remedy="give it once")
        keywords[key] = _value(text, hints[key], f"{where}, option {key}")
    return keywords


def _value(text: str, annotation: Any, where: str) -> Any:
    from pydantic import ConfigDict, TypeAdapter, ValidationError

    if (
        isinstance(annotation, types.UnionType)
        and type(None) in typing.get_args(annotation)
        and text in ("null", "none")
    ):
        return None
    try:
        return TypeAdapter(annotation, config=ConfigDict(allow_inf_nan=False)).validate_python(text)
    except ValidationError as error:
        expected = error.errors()[0]["msg"].removeprefix("Input should be ").removeprefix("a valid ")
        raise InputError(f"{text[:80]!r}", where=where, expected=expected, remedy="change the option") from None


def _first_line(module: ModuleType) -> str:
    return (module.__doc__ or "").strip().partition("\n")[0]
