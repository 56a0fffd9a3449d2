"""Writes docs/api.md from the docstrings of the library's public names: `pip install -e ".[docs]"; python scripts/api_page.py`.

Public are the names in `__all__` of the packages of `physreal_core`. The code is read, not imported.
"""

import logging
import re
from pathlib import Path

import griffe
from griffe2md import render_object_docs

ROOT = Path(__file__).resolve().parents[1]
HEAD = """# API of `physreal_core`

This page is written from the docstrings by `python scripts/api_page.py`. All units are SI. Shapes stand in brackets: [T, N, 3]
is T frames of N points in three coordinates. Import names from their package: `from physreal_core.simulation import Simulator`.
The parts of `physreal_core.perception` are imported from its modules ([perception](perception.md)).
"""
SHOWN = {
    "docstring_section_style": "list",
    "heading_level": 2,
    "line_length": 120,
    "show_docstring_attributes": False,
    "show_if_no_docstring": False,
    "show_object_full_path": False,
    "show_root_full_path": True,
    "show_root_members_full_path": False,
    "show_signature_annotations": False,
    "show_submodules": False,
    "signature_crossrefs": False,
    "summary": False,
}


def api_page() -> str:
    """The page as Markdown."""
    logging.getLogger("griffe").setLevel(logging.ERROR)
    loader = griffe.GriffeLoader(search_paths=[str(ROOT)], docstring_parser="google")
    library = loader.load("physreal_core")
    loader.resolve_aliases()
    packages = [package for _, package in sorted(library.modules.items()) if package.is_init_module and package.exports]
    return re.sub(r"\n{3,}", "\n\n", "\n".join([HEAD, *map(_section, packages)]))


def _section(package: griffe.Module) -> str:
    members = [str(name) for name in package.exports]
    text = render_object_docs(package, {**SHOWN, "members": members})
    # long values of constants, on one line or on indented ones
    long = re.compile(r"^(\w+: [^=\n]+) = (?:.{80,}|[\[{(]\n(?:[ ].*\n|\n)*[\]})])\n*$", re.MULTILINE)
    text = long.sub(r"\1", text)
    return re.sub(r"<code>(.*?)</code>", lambda match: f"`{_plain(match[1])}`", text)


def _plain(annotation: str) -> str:
    """An annotation without the links of its parts: `[Float](#...)[[Array](#...), 'particles 3']`."""
    return re.sub(r"\[([^\[\]]+)\]\(#[^)]*\)", r"\1", annotation)


if __name__ == "__main__":
    (ROOT / "docs" / "api.md").write_text(api_page())
