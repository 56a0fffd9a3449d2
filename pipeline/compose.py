"""What `physreal compose` writes: params.yaml out of the Hydra groups in pipeline/conf, every knob with its unit; DVC's files.

The only place that imports Hydra; stages read params.yaml and nothing else.
"""

from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel

from physreal_core.errors import InputError
from pipeline.config import Parameters, read_parameters, validate_parameters
from pipeline.dvc_files import dvc_files
from pipeline.parameters_file import parameters_lock, write_parameters
from pipeline.project import CODE_ROOT, Project
from pipeline.whole_files import write_whole

CONF = Path(__file__).parent / "conf"
HEADER = """\
# Every knob of the pipeline. Written by `{command}` from pipeline/conf and pipeline/config;
# edit it by hand as you like: it is the only truth when a stage runs. `physreal check` validates it.
"""
WIDTH = 120


def compose(overrides: list[str], conf: Path = CONF) -> str:
    """The text of params.yaml for a choice of options.

    Args:
        overrides: Hydra's own form: `group=option` (`fit_global=von_mises`) or `key=value` (`fit_global.iterations=20`).

    Raises:
        InputError: Hydra knows no such option, or the result does not validate.
    """
    raw = _compose_raw(overrides, conf) | {"composed_from": overrides}
    return render(validate_parameters(raw, "the composed parameters"))


def composed_files(overrides: list[str], project: Project) -> dict[Path, str]:
    """Path → text of all that `physreal compose` writes: params.yaml and, where the code lies, DVC's files."""
    files = {project.parameters: compose(overrides)}
    if project.root == CODE_ROOT:
        files |= {project.root / name: text for name, text in dvc_files().items()}
    return files


def stale_files(files: dict[Path, str]) -> dict[Path, str]:
    """Those of `files` that do not lie on the disk as they should be."""
    return {path: text for path, text in files.items() if not path.is_file() or path.read_text() != text}


def write_composed(files: dict[Path, str], project: Project) -> list[str]:
    """Write what is stale of `files`, each whole or not at all. What was done, for the user, in lines."""
    said = []
    with parameters_lock(project):
        for path, text in stale_files(files).items():
            if path == project.parameters:
                said += _names_lost(path, text)
                write_parameters(project, text)
            else:
                path.parent.mkdir(parents=True, exist_ok=True)
                write_whole(path, text)
            said.append(f"wrote {path}")
    return said


def _names_lost(path: Path, text: str) -> list[str]:
    """A warning where sequences stand in params.yaml that the composed text has not."""
    try:
        before, after = read_parameters(path), yaml.safe_load(text)
    except InputError:
        return []  # composing is a way to mend it
    lost = [
        str(name)
        for block in ("sequences", "clips")
        if isinstance(before.get(block), dict)
        for name in before[block].keys() - after[block].keys()
    ]
    remedy = "an option group in pipeline/conf/sequences keeps them; `physreal add` enters one again"
    return [f"warning: no longer in {path.name}: {', '.join(sorted(lost))}; {remedy}"] if lost else []


def render(parameters: Parameters) -> str:
    """The text of params.yaml for validated values: each key with its meaning and unit beside it."""
    given = " ".join(["physreal compose", *parameters.values.composed_from])
    return HEADER.format(command=given) + "\n".join(_lines(parameters)) + "\n"


def options_in(path: Path) -> list[str]:
    """What the params.yaml at `path` was composed from."""
    options = read_parameters(path).get("composed_from") or []
    if not (isinstance(options, list) and all(isinstance(option, str) for option in options)):
        raise InputError(
            f"composed_from = {options!r:.80}",
            where=str(path),
            expected="the options that `physreal compose` was given, a list of text",
            remedy="change composed_from",
        )
    return options


def _compose_raw(overrides: list[str], conf: Path) -> dict[str, Any]:
    from hydra import compose as hydra_compose
    from hydra import initialize_config_dir
    from hydra.errors import HydraException
    from omegaconf import OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    try:
        with initialize_config_dir(str(conf), version_base=None):
            composed = hydra_compose("config", overrides=[_as_hydra(override, conf) for override in overrides])
            return OmegaConf.to_container(composed, resolve=True)
    except (HydraException, OmegaConfBaseException) as error:
        raise InputError(str(error).strip(), where="physreal compose", remedy=f"see the options under {conf}") from None


def _as_hydra(override: str, conf: Path) -> str:
    """A value may be given for any key, named in conf or not: validation, which knows all keys, comes after.

    Hydra takes `++key=value` for a key that may be new, and `+group=option` for a group that config.yaml does not choose.
    """
    key, equals, _ = override.partition("=")
    if not equals or not key[:1].isalpha() or key in _groups_chosen(conf):
        return override
    return f"+{override}" if (conf / key).is_dir() else f"++{override}"


def _groups_chosen(conf: Path) -> set[str]:
    """The groups of which config.yaml takes an option."""
    defaults = yaml.safe_load((conf / "config.yaml").read_text())["defaults"]
    return {group for entry in defaults if isinstance(entry, dict) for group in entry}


def _lines(parameters: Parameters) -> list[str]:
    """The file's lines, a blank one between the blocks."""
    lines: list[str] = []
    values = parameters.values
    for name, field in type(values).model_fields.items():
        value = getattr(values, name)
        if isinstance(value, (BaseModel, dict)):
            lines.append("")
        comment = f"  # {field.description}" if field.description else ""
        lines += _entry(name, value, comment, indent=0)
    return lines


def _entry(name: str, value: Any, comment: str, indent: int) -> list[str]:
    margin = " " * indent
    if isinstance(value, BaseModel) and type(value).model_fields:
        lines = [f"{margin}{name}:{comment}"]
        for key, field in type(value).model_fields.items():
            text = f"  # {_one_line(field.description)}" if field.description else ""
            lines += _entry(key, getattr(value, key), text, indent + 2)
        return lines
    if isinstance(value, dict) and any(isinstance(part, (BaseModel, dict)) for part in value.values()):
        lines = [f"{margin}{name}:{comment}"]
        for key, part in value.items():
            lines += _entry(_flow(key), part, "", indent + 2)
        return lines
    return [f"{margin}{name}: {_flow(value)}{comment}"]


def _flow(value: Any) -> str:
    """A value on one line."""
    text = yaml.dump(
        _plain(value), Dumper=_Quoting, default_flow_style=True, width=10_000, sort_keys=False, allow_unicode=True
    )
    return text.removesuffix("\n").removesuffix("\n...")


class _Quoting(yaml.SafeDumper):
    """Text that begins with a digit stands in quotes: YAML 1.2, which DVC reads, knows more numbers than YAML 1.1."""


def _quoted(dumper: yaml.SafeDumper, text: str) -> yaml.ScalarNode:
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style="'" if text[:1].isdigit() else None)


_Quoting.add_representer(str, _quoted)


def _plain(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return [_plain(part) for part in value]
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    return value


def _one_line(text: str) -> str:
    return " ".join(text.split())
