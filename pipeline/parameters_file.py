"""The one way to write params.yaml: one writer at a time, the file whole at every moment, its comments kept."""

import io
from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from physreal_core.errors import InputError
from pipeline.config import read_parameters, validate_parameters
from pipeline.project import Project
from pipeline.whole_files import write_lock, write_whole

if TYPE_CHECKING:
    from ruamel.yaml import YAML
    from ruamel.yaml.comments import CommentedMap

Blocks = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""Block of params.yaml → name of a sequence → what stands there."""


def parameters_lock(project: Project) -> AbstractContextManager[None]:
    """Holds the lock on params.yaml; see `write_lock`."""
    return write_lock(project.parameters_lock, project.parameters)


def write_parameters(project: Project, text: str) -> None:
    """Put `text` in place of params.yaml; only inside `parameters_lock`."""
    write_whole(project.parameters, text)


def enter_names(project: Project, blocks: Blocks) -> None:
    """Write new names of sequences into params.yaml, all else as it is, comments too; only inside `parameters_lock`.

    Raises:
        InputError: params.yaml would not be valid with them.
    """
    path = project.parameters
    wanted = read_parameters(path)
    for block, names in blocks.items():
        wanted[block] = {**(wanted.get(block) or {}), **{name: dict(value) for name, value in names.items()}}
    validate_parameters(wanted, path.name)
    text = _with_names(path.read_text(encoding="utf-8"), blocks, path)
    if yaml.safe_load(text) != wanted:
        raise InputError(
            "its layout cannot be extended without changing what it says",
            where=str(path),
            remedy=f"enter {', '.join(sorted({name for names in blocks.values() for name in names}))} by hand",
        )
    write_parameters(project, text)


def _with_names(text: str, blocks: Blocks, path: Path) -> str:
    from ruamel.yaml.error import YAMLError

    editor = _editor()
    try:
        values = editor.load(text)
    except YAMLError as error:
        raise InputError(f"not readable as YAML: {error}", where=str(path), remedy="mend it at that place") from None
    for block, names in blocks.items():
        if not values.get(block):
            _open(values, block)
        after = _take_comment_after(values, block)
        for name, value in names.items():
            values[block][_scalar(name)] = _editable(value)
        _put_comment_after(values, block, after)
    stream = io.StringIO()
    editor.dump(values, stream)
    return stream.getvalue()


def _editor() -> "YAML":
    """Reads YAML with its comments, and writes it with them, the rest as it was."""
    from ruamel.yaml import YAML
    from ruamel.yaml.representer import RoundTripRepresenter

    class Representer(RoundTripRepresenter):
        """Writes None as null, not as nothing."""

    Representer.add_representer(
        type(None), lambda representer, _: representer.represent_scalar("tag:yaml.org,2002:null", "null")
    )
    editor = YAML()
    editor.Representer = Representer
    editor.preserve_quotes = True
    editor.width = 1_000_000
    return editor


def _scalar(value: Any) -> Any:
    """Text in quotes where a YAML reader could take it for a number, a date, a truth value or nothing.

    DVC reads YAML 1.2, the stages YAML 1.1; what begins with a digit is a number to one of them more often than one knows.
    """
    from ruamel.yaml.scalarstring import SingleQuotedScalarString

    if isinstance(value, str) and (not value[:1].isalpha() or yaml.safe_load(value) != value):
        return SingleQuotedScalarString(value)
    return value


def _editable(value: Mapping[str, Any]) -> "CommentedMap":
    from ruamel.yaml.comments import CommentedMap

    parts = {key: _editable(part) if isinstance(part, dict) else _scalar(part) for key, part in value.items()}
    made = CommentedMap(parts)
    if not made:
        made.fa.set_flow_style()
    return made


def _open(values: "CommentedMap", block: str) -> None:
    """Make a block that is absent or `{}` one that names can be put under, a line each."""
    from ruamel.yaml.comments import CommentedMap

    if values.get(block) is None:
        values[block] = CommentedMap()
    values[block].fa.set_block_style()


def _take_comment_after(values: "CommentedMap", block: str) -> str:
    """Cut off the lines between a block and the next, which the reader counts to the comment of the block's last line."""
    holder, key = _last_line(values, block)
    comment = (holder.ca.items.get(key) or [None] * 4)[2]
    if comment is None:
        return ""
    own, newline, after = comment.value.partition("\n")
    comment.value = own + newline
    return after


def _put_comment_after(values: "CommentedMap", block: str, after: str) -> None:
    from ruamel.yaml.error import CommentMark
    from ruamel.yaml.tokens import CommentToken

    if not after:
        return
    holder, key = _last_line(values, block)
    comments = holder.ca.items.setdefault(key, [None] * 4)
    if comments[2] is None:
        comments[2] = CommentToken("\n", CommentMark(0), None)
    comments[2].value += after


def _last_line(values: "CommentedMap", key: str) -> "tuple[CommentedMap, str]":
    """The mapping and its key that stand on the last line of what `values` has under `key`."""
    holder = values
    while isinstance(holder[key], dict) and holder[key] and not holder[key].fa.flow_style():
        holder = holder[key]
        key = next(reversed(holder))
    return holder, key
