"""Taichi's own `mpm3d` example (taichi.examples.ggui_examples.mpm3d_ggui), its elastic material alone, on our scene.

Forward only. As in the example, a substep moves F by the C of the substep before, so F ends one update behind;
positions are those of the other MLS-MPM peers. Stress from the whole `ti.svd`, dense grid, atomic scatter.
"""

import os
from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np

from benchmarks.workload import Workload

BOUND = 3  # nodes at the grid's faces where nothing leaves


def missing() -> str | None:
    """Why this peer cannot run here, or None."""
    return None if find_spec("taichi") else "taichi is not installed (pip install taichi)"


class TaichiMpm3d:
    """Fields and the substep of the example."""

    def __init__(self, scene: Workload, device: str, threads: int) -> None:
        os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
        import taichi as ti

        arch = ti.cpu if device == "cpu" else ti.cuda
        ti.init(arch=arch, cpu_max_num_threads=threads, default_fp=ti.f32, log_level=ti.ERROR)
        self.scene = scene
        self.fields = _fields(scene)
        self._substep = _substep(scene, self.fields)
        self._synchronise = ti.sync
        F0 = np.tile(np.eye(3), (scene.particles, 1, 1))
        self._start = [a.astype(np.float32) for a in (scene.x0, scene.v0, F0, np.zeros_like(F0))]

    def forward(self) -> None:
        """All substeps from the scene's start."""
        fields = self.fields
        for field, value in zip((fields.x, fields.v, fields.F, fields.C), self._start, strict=True):
            field.from_numpy(value)
        for _ in range(self.scene.substeps):
            self._substep()
        self._synchronise()

    def positions(self) -> np.ndarray:
        """Positions [m] after the last run, shape [N, 3]."""
        return self.fields.x.to_numpy()


def make(scene: Workload, device: str, threads: int) -> TaichiMpm3d:
    """Taichi over `scene`; one such object lives in a process, since `ti.init` forgets the fields of the one before."""
    return TaichiMpm3d(scene, device, threads)


def _fields(scene: Workload) -> SimpleNamespace:
    import taichi as ti

    n, edge = scene.particles, (scene.grid_nodes,) * 3
    return SimpleNamespace(
        x=ti.Vector.field(3, float, n),
        v=ti.Vector.field(3, float, n),
        C=ti.Matrix.field(3, 3, float, n),
        F=ti.Matrix.field(3, 3, float, n),
        grid_v=ti.Vector.field(3, float, edge),
        grid_m=ti.field(float, edge),
    )


def _substep(scene: Workload, fields: SimpleNamespace):
    import taichi as ti

    F_x, F_v, F_C, F_dg = fields.x, fields.v, fields.C, fields.F
    grid_v, grid_m = fields.grid_v, fields.grid_m
    n_grid, dx, dt = scene.grid_nodes, scene.cell, scene.time_step
    mass, volume = scene.mass, scene.volume
    mu, lam = scene.lame
    gravity = ti.Vector(scene.gravity)

    @ti.kernel
    def substep():
        for I in ti.grouped(grid_m):
            grid_v[I] = ti.zero(grid_v[I])
            grid_m[I] = 0
        for p in F_x:
            Xp = F_x[p] / dx
            base = int(Xp - 0.5)
            fx = Xp - base
            w = [0.5 * (1.5 - fx) ** 2, 0.75 - (fx - 1) ** 2, 0.5 * (fx - 0.5) ** 2]
            F_dg[p] = (ti.Matrix.identity(float, 3) + dt * F_C[p]) @ F_dg[p]
            U, sig, V = ti.svd(F_dg[p])
            J = sig[0, 0] * sig[1, 1] * sig[2, 2]
            stress = 2 * mu * (F_dg[p] - U @ V.transpose()) @ F_dg[p].transpose()
            stress += ti.Matrix.identity(float, 3) * lam * J * (J - 1)
            affine = (-dt * volume * 4 / dx**2) * stress + mass * F_C[p]
            for offset in ti.static(ti.grouped(ti.ndrange(3, 3, 3))):
                dpos = (offset - fx) * dx
                weight = 1.0
                for i in ti.static(range(3)):
                    weight *= w[offset[i]][i]
                grid_v[base + offset] += weight * (mass * F_v[p] + affine @ dpos)
                grid_m[base + offset] += weight * mass
        for I in ti.grouped(grid_m):
            if grid_m[I] > 0:
                grid_v[I] /= grid_m[I]
            grid_v[I] += dt * gravity
            cond = (I < BOUND) & (grid_v[I] < 0) | (I > n_grid - BOUND) & (grid_v[I] > 0)
            grid_v[I] = ti.select(cond, 0, grid_v[I])
        for p in F_x:
            Xp = F_x[p] / dx
            base = int(Xp - 0.5)
            fx = Xp - base
            w = [0.5 * (1.5 - fx) ** 2, 0.75 - (fx - 1) ** 2, 0.5 * (fx - 0.5) ** 2]
            new_v = ti.zero(F_v[p])
            new_C = ti.zero(F_C[p])
            for offset in ti.static(ti.grouped(ti.ndrange(3, 3, 3))):
                dpos = (offset - fx) * dx
                weight = 1.0
                for i in ti.static(range(3)):
                    weight *= w[offset[i]][i]
                g_v = grid_v[base + offset]
                new_v += weight * g_v
                new_C += 4 * weight * g_v.outer_product(dpos) / dx**2
            F_v[p] = new_v
            F_x[p] += dt * F_v[p]
            F_C[p] = new_C

    return substep
