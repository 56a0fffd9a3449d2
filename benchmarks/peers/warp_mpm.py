"""The public warp-mpm solver (zeshunzong/warp-mpm, `MPM_Simulator_WARP`) from a checkout of it, on our scene.

Forward only. Its material "jelly" is the fixed corotated law by `wp.svd3`; internal forces and F use the gradients of the
weights, which the MLS-MPM peers' do not. Its grid stays in space, as theirs does.
"""

from __future__ import annotations

import contextlib
import io
import sys
from pathlib import Path

import numpy as np
import torch
import warp as wp

from benchmarks.workload import Workload

SOLVER = "mpm_solver_warp.py"


def missing(path: str = "") -> str | None:
    """Why this peer cannot run here, or None; `path` is the checkout's folder."""
    if not path:
        return "no checkout given (--warp-mpm PATH)"
    return None if (Path(path) / SOLVER).is_file() else f"no {SOLVER} in {path}"


class WarpMpm:
    """The solver with the scene's particles."""

    def __init__(self, scene: Workload, device: str, path: str) -> None:
        if path not in sys.path:
            sys.path.insert(0, path)
        from mpm_solver_warp import MPM_Simulator_WARP

        self.scene, self.device = scene, device
        with contextlib.redirect_stdout(io.StringIO()):  # it tells what it loads
            self.solver = MPM_Simulator_WARP(10, device=device)
        self._load()

    def _load(self) -> None:
        scene, device, solver = self.scene, self.device, self.solver
        edge = scene.grid_nodes
        x0 = torch.as_tensor(scene.x0, dtype=torch.float32, device=device)
        volume = torch.full((scene.particles,), scene.volume, device=device)
        with contextlib.redirect_stdout(io.StringIO()):
            solver.load_initial_data_from_torch(
                x0, volume, n_grid=edge, grid_lim=edge * scene.cell, device=device
            )  # the cell is grid_lim / n_grid
        material = {
            "material": "jelly", "E": scene.youngs_modulus, "nu": scene.poissons_ratio, "density": scene.density,
            "g": list(scene.gravity), "n_grid": edge, "grid_lim": edge * scene.cell,
        }  # fmt: skip
        solver.set_parameters_dict(material, device=device)
        solver.finalize_mu_lam(device=device)
        v0 = torch.as_tensor(scene.v0, dtype=torch.float32, device=device)
        solver.import_particle_v_from_torch(v0, device=device)

    def forward(self) -> None:
        """All substeps from the scene's start, the solver's arrays made anew, which costs about one substep."""
        self._load()
        for substep in range(self.scene.substeps):
            self.solver.p2g2p(substep, self.scene.time_step, device=self.device)
        wp.synchronize_device(self.device)

    def positions(self) -> np.ndarray:
        """Positions [m] after the last run, shape [N, 3]."""
        return self.solver.export_particle_x_to_torch().cpu().numpy()


def make(scene: Workload, device: str, threads: int, path: str = "") -> WarpMpm:
    """warp-mpm over `scene`; Warp launches on the CPU are serial whatever `threads` says."""
    return WarpMpm(scene, device, path)
