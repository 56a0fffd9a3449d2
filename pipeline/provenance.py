"""What an output was made from: digests of folders, of code, and the record each artifact carries in provenance.json."""

import ast
import hashlib
import json
from functools import lru_cache
from pathlib import Path
from typing import Any

from pipeline.project import CODE_ROOT
from pipeline.reading.text import read_record

FILE = "provenance.json"
DESCRIPTION = "capture.json"
LIBRARIES = ("numpy", "scipy", "torch", "warp-lang", "opencv-python-headless", "opencv-python", "onnxruntime")


def digest_of(value: Any) -> str:
    """Digest of anything that JSON can hold, independent of the order of keys."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:16]


def digest_folder(folder: Path) -> str:
    """Digest of the names and bytes of every file below `folder`; one character more in any file changes it."""
    total = hashlib.sha256()
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        total.update(path.relative_to(folder).as_posix().encode() + b"\0")
        total.update(_digest_file(path, path.stat().st_mtime_ns, path.stat().st_size))
    return total.hexdigest()[:16]


def digest_but_for(folder: Path, keys: tuple[str, ...]) -> str:
    """Digest of a folder but for its provenance, and for these keys of the capture.json in it."""
    told: dict[str, Any] = {}
    for path in sorted(path for path in folder.rglob("*") if path.is_file() and path.name != FILE):
        name = path.relative_to(folder).as_posix()
        if name == DESCRIPTION:
            told[name] = {key: value for key, value in read_record(path).items() if key not in keys}
        else:
            told[name] = digest_file(path)
    return digest_of(told)


def versions() -> dict[str, str]:
    """Of the libraries that compute."""
    found = {name: _version(name) for name in LIBRARIES}
    return {name: version for name, version in found.items() if version}


def _version(name: str) -> str | None:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(name)
    except PackageNotFoundError:
        return None


def digest_file(path: Path) -> str:
    """Digest of a file's bytes."""
    return _digest_file(path, path.stat().st_mtime_ns, path.stat().st_size).hex()[:16]


@lru_cache(maxsize=100_000)
def _digest_file(path: Path, _modified: int, _size: int) -> bytes:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").digest()


def project_modules(source: Path, roots: tuple[Path, ...] = (CODE_ROOT,)) -> list[Path]:
    """`source` and every project file that it imports, directly or through others.

    What a package's __init__ imports counts where names are taken from the package itself, and not where one of its
    modules is named: `from a.b import c` follows a/b.py, not a/__init__.py.
    """
    found: set[Path] = set()
    waiting = [source.resolve()]
    while waiting:
        path = waiting.pop()
        if path in found:
            continue
        found.add(path)
        waiting += [file for name in _imported_names(path, roots) if (file := _file_of(name, roots))]
    return sorted(found)


def digest_code(source: Path, roots: tuple[Path, ...] = (CODE_ROOT,)) -> str:
    """Digest of the code that `source` runs within the project; comments, docstrings and layout do not count."""
    trees = [_without_docstrings(ast.parse(path.read_text())) for path in project_modules(source, roots)]
    return hashlib.sha256("\n".join(trees).encode()).hexdigest()[:16]


def write_provenance(folder: Path, record: dict[str, Any]) -> None:
    (folder / FILE).write_text(json.dumps(record, indent=1, sort_keys=True) + "\n")


def read_provenance(folder: Path) -> dict[str, Any]:
    """The record in an artifact's folder, InputError where there is none."""
    return read_record(
        folder / FILE, ("stage", "inputs", "parameters", "seed"), "delete the folder and run `dvc repro`"
    )


def _imported_names(path: Path, roots: tuple[Path, ...]) -> list[str]:
    package = next((path.relative_to(root).parent.parts for root in roots if path.is_relative_to(root)), ())
    names: list[str] = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(part for part in (base, node.module or "") if part)
            names += [module, *(f"{module}.{alias.name}" for alias in node.names)]
    return names


def _file_of(name: str, roots: tuple[Path, ...]) -> Path | None:
    """The file of a module or package; None if the project has none of that name."""
    for root in roots:
        plain = root.joinpath(*name.split("."))
        for path in (plain.with_suffix(".py"), plain / "__init__.py"):
            if path.is_file():
                return path
    return None


def _without_docstrings(tree: ast.Module) -> str:
    for node in ast.walk(tree):
        if isinstance(node, (ast.Module, ast.FunctionDef, ast.ClassDef, ast.AsyncFunctionDef)) and ast.get_docstring(
            node
        ):
            node.body = node.body[1:] or [ast.Pass()]
    return ast.dump(tree)
