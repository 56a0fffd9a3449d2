"""MLS-MPM in straightforward Warp kernels, differentiated by Warp: one `wp.Tape` over all substeps, every state kept.

This is what one writes without an adjoint of one's own. It is as strong as its kind gets: the grid covers only the nodes
that the block can reach, the stress is computed inside the scatter instead of being stored, and the rotation of the
singular value decomposition has its exact derivative (Warp's own for `svd3` loses it where singular values meet).
"""

from functools import cache
from types import SimpleNamespace

import numpy as np
import warp as wp

from benchmarks.workload import Workload

wp.config.log_level = wp.LOG_WARNING


def missing() -> str | None:
    """Why this peer cannot run here; it always can."""
    return None


class WarpTape:
    """Arrays of all substeps and the launches over them.

    Args:
        scene: what is simulated.
        device: "cpu" or "cuda:0".
        rotation: "svd", by `wp.svd3` as public codes have it, or "newton", by an iteration that Warp differentiates.
    """

    def __init__(self, scene: Workload, device: str, rotation: str = "svd") -> None:
        self.scene, self.device, self.kernels = scene, device, kernels(rotation)
        slots, n = scene.substeps + 1, scene.particles
        first, count = scene.reach()
        self.first, self.count = wp.vec3i(*map(int, first)), wp.vec3i(*map(int, count))
        self.nodes = int(np.prod(count))

        def arrays(length: int, dtype: type, number: int) -> list[wp.array]:
            return [wp.zeros(length, dtype=dtype, device=device, requires_grad=True) for _ in range(number)]

        self.x, self.v = arrays(n, wp.vec3, slots), arrays(n, wp.vec3, slots)
        self.F, self.C = arrays(n, wp.mat33, slots), arrays(n, wp.mat33, slots)
        self.momentum = arrays(self.nodes, wp.vec4, scene.substeps)
        self.velocity = arrays(self.nodes, wp.vec3, scene.substeps)
        (self.loss,) = arrays(1, wp.float32, 1)
        self._tape = wp.Tape()
        self.E = wp.full(n, scene.youngs_modulus, dtype=float, device=device, requires_grad=True)
        self.nu = wp.full(n, scene.poissons_ratio, dtype=float, device=device, requires_grad=True)
        self.x[0].assign(scene.x0.astype(np.float32))
        self.v[0].assign(scene.v0.astype(np.float32))
        self.F[0].assign(np.tile(np.eye(3, dtype=np.float32), (n, 1, 1)))

    def forward(self) -> None:
        """All substeps, nothing recorded."""
        self._launch()

    def forward_backward(self) -> None:
        """Sum of x^2 and 0.01 F^2 at the end, and its gradient by every state and parameter."""
        self.loss.zero_()
        self._tape.zero()  # gradients of the run before; a tape knows them only once it has gone backward
        with wp.Tape() as self._tape:
            self._launch()
            end = [self.x[-1], self.F[-1]]
            wp.launch(self.kernels.loss, self.scene.particles, inputs=end, outputs=[self.loss], device=self.device)
        self._tape.backward(loss=self.loss)

    def _launch(self) -> None:
        scene, n = self.scene, self.scene.particles
        place = [1.0 / scene.cell, scene.time_step, self.first, self.count]
        for s in range(scene.substeps):
            x, v, F, C = self.x[s], self.v[s], self.F[s], self.C[s]
            momentum, velocity = self.momentum[s], self.velocity[s]
            momentum.zero_()
            model = [self.E, self.nu, scene.mass, scene.volume]
            wp.launch(self.kernels.p2g, n, inputs=[*place, *model, x, v, F, C], outputs=[momentum], device=self.device)
            step = [scene.time_step, wp.vec3(*scene.gravity)]
            wp.launch(self.kernels.update, self.nodes, inputs=[*step, momentum], outputs=[velocity], device=self.device)
            after = [self.x[s + 1], self.v[s + 1], self.F[s + 1], self.C[s + 1]]
            wp.launch(self.kernels.g2p, n, inputs=[*place, velocity, x, F], outputs=after, device=self.device)

    def positions(self) -> np.ndarray:
        """Positions [m] after the last run, shape [N, 3]."""
        return self.x[-1].numpy()

    def gradients(self) -> dict[str, np.ndarray]:
        """Derivatives of the loss by Young's modulus [N], Poisson's ratio [N] and initial velocity [N, 3]."""
        return {
            "youngs_modulus": self.E.grad.numpy(),
            "poissons_ratio": self.nu.grad.numpy(),
            "initial_velocity": self.v[0].grad.numpy(),
        }


def make(scene: Workload, device: str, threads: int, rotation: str = "svd") -> WarpTape:
    """The tape over `scene`; Warp launches on the CPU are serial whatever `threads` says."""
    return WarpTape(scene, device, rotation)


@wp.func
def rotation_svd(F: wp.mat33):
    U = wp.mat33()
    V = wp.mat33()
    s = wp.vec3()
    wp.svd3(F, U, s, V)
    return U * wp.transpose(V)


@wp.func_grad(rotation_svd)
def rotation_svd_adjoint(F: wp.mat33, R_bar: wp.mat33):
    # With F = U s V^T: dR = U [(U^T dF V - its transpose) / (s_i + s_j)] V^T, finite where singular values meet.
    U = wp.mat33()
    V = wp.mat33()
    s = wp.vec3()
    wp.svd3(F, U, s, V)
    K = wp.transpose(U) * R_bar * V
    a = (K[0, 1] - K[1, 0]) / (s[0] + s[1])
    b = (K[0, 2] - K[2, 0]) / (s[0] + s[2])
    c = (K[1, 2] - K[2, 1]) / (s[1] + s[2])
    wp.adjoint[F] += U * wp.mat33(0.0, a, b, -a, 0.0, c, -b, -c, 0.0) * wp.transpose(V)


@wp.func
def rotation_newton(F: wp.mat33):
    R = F
    for _ in range(4):  # enough for strains below a half
        R = 0.5 * (R + wp.transpose(wp.inverse(R)))
    return R


@wp.func
def weights(f: wp.vec3):
    """Row o, column d: quadratic B-spline weight of node base + o along axis d, f cells from the base."""
    a = wp.vec3(1.5) - f
    b = f - wp.vec3(1.0)
    c = f - wp.vec3(0.5)
    return wp.matrix_from_rows(0.5 * wp.cw_mul(a, a), wp.vec3(0.75) - wp.cw_mul(b, b), 0.5 * wp.cw_mul(c, c))


@wp.func
def base_node(x: wp.vec3):
    """First of the three nodes that a position in cells touches along each axis."""
    return wp.vec3i(int(x[0] - 0.5), int(x[1] - 0.5), int(x[2] - 0.5))


@wp.func
def index_of(i: int, j: int, k: int, first: wp.vec3i, count: wp.vec3i):
    return ((i - first[0]) * count[1] + j - first[1]) * count[2] + k - first[2]


@wp.func
def fraction(x: wp.vec3, base: wp.vec3i):
    return x - wp.vec3(float(base[0]), float(base[1]), float(base[2]))


@wp.kernel
def update(
    dt: float,
    gravity: wp.vec3,
    # Data in:
    momentum: wp.array(dtype=wp.vec4),
    # Data out:
    velocity: wp.array(dtype=wp.vec3),
):
    n = wp.tid()
    p = momentum[n]
    if p[3] > 0.0:
        velocity[n] = wp.vec3(p[0], p[1], p[2]) / p[3] + dt * gravity


@wp.kernel
def g2p(
    cells_per_metre: float,
    dt: float,
    first: wp.vec3i,
    count: wp.vec3i,
    # Data in:
    velocity: wp.array(dtype=wp.vec3),
    x: wp.array(dtype=wp.vec3),
    F: wp.array(dtype=wp.mat33),
    # Data out:
    x_out: wp.array(dtype=wp.vec3),
    v_out: wp.array(dtype=wp.vec3),
    F_out: wp.array(dtype=wp.mat33),
    C_out: wp.array(dtype=wp.mat33),
):
    p = wp.tid()
    X = x[p] * cells_per_metre
    base = base_node(X)
    f = fraction(X, base)
    w = weights(f)
    v1 = wp.vec3()
    C1 = wp.mat33()
    for i in range(3):
        for j in range(3):
            for k in range(3):
                weight = w[i, 0] * w[j, 1] * w[k, 2]
                offset = wp.vec3(float(i), float(j), float(k)) - f
                g = velocity[index_of(base[0] + i, base[1] + j, base[2] + k, first, count)]
                v1 += weight * g
                C1 += (4.0 * weight * cells_per_metre) * wp.outer(g, offset)
    x_out[p] = x[p] + dt * v1
    v_out[p] = v1
    F_out[p] = F[p] + dt * C1 * F[p]
    C_out[p] = C1


@wp.kernel
def loss(x: wp.array(dtype=wp.vec3), F: wp.array(dtype=wp.mat33), total: wp.array(dtype=float)):
    p = wp.tid()
    wp.atomic_add(total, 0, wp.dot(x[p], x[p]) + 0.01 * wp.ddot(F[p], F[p]))


@cache
def kernels(rotation_name: str) -> SimpleNamespace:
    """The kernels `p2g`, `update`, `g2p`, `loss`; only the first depends on how the rotation is found."""
    rotation = {"svd": rotation_svd, "newton": rotation_newton}[rotation_name]

    @wp.kernel(module=wp.get_module(f"benchmarks_tape_{rotation_name}"))
    def p2g(
        cells_per_metre: float,
        dt: float,
        first: wp.vec3i,
        count: wp.vec3i,
        # Model:
        E: wp.array(dtype=float),
        nu: wp.array(dtype=float),
        mass: float,
        volume: float,
        # Data in:
        x: wp.array(dtype=wp.vec3),
        v: wp.array(dtype=wp.vec3),
        F: wp.array(dtype=wp.mat33),
        C: wp.array(dtype=wp.mat33),
        # Data out:
        momentum: wp.array(dtype=wp.vec4),
    ):
        p = wp.tid()
        mu = E[p] / (2.0 * (1.0 + nu[p]))
        lam = E[p] * nu[p] / ((1.0 + nu[p]) * (1.0 - 2.0 * nu[p]))
        J = wp.determinant(F[p])
        pressure = lam * J * (J - 1.0)
        tau = 2.0 * mu * (F[p] - rotation(F[p])) * wp.transpose(F[p])
        tau += wp.diag(wp.vec3(pressure, pressure, pressure))
        affine = mass * C[p] - (4.0 * dt * volume * cells_per_metre * cells_per_metre) * tau
        X = x[p] * cells_per_metre
        base = base_node(X)
        f = fraction(X, base)
        w = weights(f)
        for i in range(3):
            for j in range(3):
                for k in range(3):
                    weight = w[i, 0] * w[j, 1] * w[k, 2]
                    offset = (wp.vec3(float(i), float(j), float(k)) - f) / cells_per_metre
                    q = mass * v[p] + affine * offset
                    n = index_of(base[0] + i, base[1] + j, base[2] + k, first, count)
                    wp.atomic_add(momentum, n, weight * wp.vec4(q[0], q[1], q[2], mass))

    return SimpleNamespace(p2g=p2g, update=update, g2p=g2p, loss=loss)
