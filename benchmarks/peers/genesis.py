"""Genesis' MPM solver (genesis-world, material `MPM.Elastic`, corotated by the whole svd) on our scene.

Forward only. As in Taichi's example F lags by one update and positions do not. Boundaries are off the block.
"""

from __future__ import annotations

import os
from importlib.util import find_spec

import numpy as np

from benchmarks.workload import Workload, lattice

SUBSTEPS = (10, 5, 2, 1)  # within one of its steps, all of whose grids it holds: the first that divides the scene's


def missing() -> str | None:
    """Why this peer cannot run here, or None."""
    return None if find_spec("genesis") else "genesis is not installed (pip install genesis-world)"


class Genesis:
    """A Genesis scene with one box of particles, moved to where ours are."""

    def __init__(self, scene: Workload, device: str, threads: int) -> None:
        os.environ["QD_NUM_THREADS"] = str(threads)  # read by gs.init
        import genesis as gs
        import torch

        if not gs._initialized:
            gs.init(backend=gs.cpu if device == "cpu" else gs.cuda, precision="32", logging_level="error")
        self.scene = scene
        self.substeps = next(n for n in SUBSTEPS if scene.substeps % n == 0)
        edge = scene.grid_nodes * scene.cell
        steps = gs.options.SimOptions(dt=self.substeps * scene.time_step, substeps=self.substeps, gravity=scene.gravity)
        grid = gs.options.MPMOptions(
            grid_density=1 / scene.cell, particle_size=0.5 * scene.cell, lower_bound=(0, 0, 0), upper_bound=(edge,) * 3
        )
        self._world = gs.Scene(sim_options=steps, mpm_options=grid, show_viewer=False)
        box = gs.morphs.Box(pos=(0.5 * edge,) * 3, size=tuple(0.5 * scene.cell * np.array(lattice(scene.particles))))
        material = gs.materials.MPM.Elastic(
            E=scene.youngs_modulus, nu=scene.poissons_ratio, rho=scene.density, sampler="regular"
        )
        self._body = self._world.add_entity(material=material, morph=box)
        self._world.build()
        if self._body.n_particles != scene.particles:
            raise RuntimeError(f"Genesis made {self._body.n_particles} particles of {scene.particles}")
        self._start = [torch.as_tensor(a, dtype=torch.float32, device=gs.device) for a in (scene.x0, scene.v0)]

    def forward(self) -> None:
        """All substeps from the scene's start."""
        self._world.reset()
        self._body.set_particles_pos(self._start[0])
        self._body.set_particles_vel(self._start[1])
        for _ in range(self.scene.substeps // self.substeps):
            self._world.step()
        self.positions()  # waits for the device

    def positions(self) -> np.ndarray:
        """Positions [m] after the last run, shape [N, 3]."""
        return self._body.get_particles_pos().cpu().numpy().reshape(-1, 3)


def make(scene: Workload, device: str, threads: int) -> Genesis:
    """Genesis over `scene`."""
    return Genesis(scene, device, threads)
