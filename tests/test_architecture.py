"""The drawing of the packages in docs/architecture.md against the imports in the code."""

import ast
import re

from tests.conftest import ROOT

UPPER = ("applications", "stages", "pipeline", "data", "benchmarks")
CORE = sorted(folder.parent.name for folder in (ROOT / "physreal_core").glob("*/__init__.py"))


def drawn() -> set[tuple[str, str]]:
    """The arrows of the first drawing."""
    page = (ROOT / "docs" / "architecture.md").read_text()
    drawing = re.search(r"```mermaid\n(.*?)```", page, re.DOTALL)[1]
    return set(re.findall(r"^ *(\w+) --> (\w+)$", drawing, re.MULTILINE))


def package_of(module: str) -> str | None:
    first, _, rest = module.partition(".")
    if first == "physreal_core":
        return rest.partition(".")[0] if rest.partition(".")[0] in CORE else None
    return first if first in UPPER else None


def imports() -> set[tuple[str, str]]:
    """Every pair of packages of which one imports the other, at module level or within a function."""
    pairs = set()
    for top in (*UPPER, "physreal_core"):
        for path in (ROOT / top).rglob("*.py"):
            package = package_of(".".join(path.relative_to(ROOT).with_suffix("").parts))
            for node in ast.walk(ast.parse(path.read_text())):
                names = []
                if isinstance(node, ast.Import):
                    names = [alias.name for alias in node.names]
                elif isinstance(node, ast.ImportFrom) and node.module:
                    names = [f"{node.module}.{alias.name}" for alias in node.names]
                pairs |= {(package, package_of(name)) for name in names}
    return {(a, b) for a, b in pairs if a and b and a != b}


def reachable(arrows: set[tuple[str, str]]) -> set[tuple[str, str]]:
    closure = set(arrows)
    while grown := {(a, d) for a, b in closure for c, d in closure if b == c} - closure:
        closure |= grown
    return closure


def test_every_import_follows_the_arrows_and_every_arrow_is_an_import():
    assert not imports() - reachable(drawn()), "imports that docs/architecture.md does not draw"
    assert not drawn() - imports(), "arrows in docs/architecture.md without an import"


def test_nothing_stands_on_itself():
    assert not {(a, b) for a, b in reachable(drawn()) if a == b}
