"""`plain_cpp.cpp`, a plain C++ implementation of the forward step, compiled by the system's g++ when it is asked for."""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.workload import Workload

SOURCE = Path(__file__).with_suffix(".cpp")
FLAGS = ["-std=c++17", "-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math", "-fopenmp", "-shared", "-fPIC"]


def missing() -> str | None:
    """Why this peer cannot run here, or None."""
    return None if shutil.which("g++") else "g++ is not installed"


class Settings(ctypes.Structure):
    """`Settings` of the C++ file."""

    _fields_ = [
        ("particles", ctypes.c_int32), ("substeps", ctypes.c_int32), ("grid_nodes", ctypes.c_int32),
        ("threads", ctypes.c_int32), ("cell", ctypes.c_float), ("time_step", ctypes.c_float),
        ("mass", ctypes.c_float), ("volume", ctypes.c_float), ("mu", ctypes.c_float), ("lambda", ctypes.c_float),
        ("gravity", ctypes.c_float * 3),
    ]  # fmt: skip


class PlainCpp:
    """The compiled library and the scene's arrays."""

    def __init__(self, scene: Workload, threads: int) -> None:
        os.environ.setdefault("GOMP_SPINCOUNT", "20000")  # a thread that waits for a busy core lets it go soon
        self.library = ctypes.CDLL(str(compiled()))
        mu, lam = scene.lame
        self.settings = Settings(
            scene.particles, scene.substeps, scene.grid_nodes, threads, scene.cell, scene.time_step, scene.mass,
            scene.volume, mu, lam, (ctypes.c_float * 3)(*scene.gravity),
        )  # fmt: skip
        self.x0, self.v0 = (np.ascontiguousarray(a, dtype=np.float32) for a in (scene.x0, scene.v0))
        self.x = np.empty_like(self.x0)

    def forward(self) -> None:
        """All substeps from the scene's start."""
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (self.x0, self.v0, self.x)]
        self.library.simulate(ctypes.byref(self.settings), *pointers)

    def positions(self) -> np.ndarray:
        """Positions [m] after the last run, shape [N, 3]."""
        return self.x


def make(scene: Workload, device: str, threads: int) -> PlainCpp:
    """C++ over `scene`, on the CPU whatever `device` says."""
    return PlainCpp(scene, threads)


def compiled() -> Path:
    """The shared library, compiled once for this source, these flags and this machine."""
    made_of = f"{SOURCE.read_text()}{FLAGS}{platform.node()}{os.getuid()}"
    library = Path(tempfile.gettempdir()) / f"plain_cpp_{hashlib.sha256(made_of.encode()).hexdigest()[:16]}.so"
    if not library.exists():
        made = library.with_suffix(f".{os.getpid()}.so")
        subprocess.run(["g++", *FLAGS, str(SOURCE), "-o", str(made)], check=True)
        made.rename(library)
    return library
