"""docs/api.md names what the library exports, with the first sentence of its docstring."""

import importlib
import inspect
import pkgutil
import re
from pathlib import Path

import physreal_core

PAGE = (Path(__file__).parents[1] / "docs" / "api.md").read_text()
REMEDY = "run: python scripts/api_page.py"


def exported():
    """(package, name, object) of every public name."""
    for module in pkgutil.iter_modules(physreal_core.__path__):
        if module.ispkg:
            package = importlib.import_module(f"physreal_core.{module.name}")
            for name in getattr(package, "__all__", ()):
                yield module.name, name, getattr(package, name)


def test_the_page_has_every_public_name_and_no_other():
    sections = re.split(r"^## `physreal_core\.(\w+)`$", PAGE, flags=re.MULTILINE)[1:]
    shown = {
        (package, name)
        for package, text in zip(sections[::2], sections[1::2], strict=True)
        for name in re.findall(r"^### `(\w+)`$", text, flags=re.MULTILINE)
    }
    assert shown == {(package, name) for package, name, _ in exported()}, REMEDY


def test_the_page_says_what_the_docstrings_say():
    for package, name, thing in exported():
        if inspect.isclass(thing) or inspect.isfunction(thing):
            summary = inspect.getdoc(thing).splitlines()[0]
            assert summary in PAGE, f"{package}.{name}: {REMEDY}"
