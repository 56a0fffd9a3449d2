"""Common to all tests: shapes of arrays checked in the core and in products, real recordings where there are any."""

import importlib.util
import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def _checked_modules() -> list[str]:
    """Modules of core and products without Warp: it compiles the source of functions and must find them undecorated."""
    files = [*(ROOT / "physreal_core").rglob("*.py"), *(ROOT / "pipeline" / "products").rglob("*.py")]
    plain = [file for file in files if file.stem != "__init__" and "import warp" not in file.read_text()]
    return [".".join(file.relative_to(ROOT).with_suffix("").parts) for file in plain]


if all(importlib.util.find_spec(name) for name in ("jaxtyping", "beartype")):  # a bare GPU machine has neither
    from jaxtyping import install_import_hook

    _hook = install_import_hook(_checked_modules(), "beartype.beartype")
    _hook.__enter__()


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real recordings: $PHYSREAL_REAL_DATA, else ../shared/real beside the project."""
    folder = Path(os.environ.get("PHYSREAL_REAL_DATA") or ROOT.parent / "shared" / "real")
    if not folder.is_dir():
        pytest.skip(f"no real recordings at {folder} (set PHYSREAL_REAL_DATA)")
    return folder
