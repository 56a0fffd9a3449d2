"""The constitutive Warp functions as numpy functions of many points, one kernel a law: values and adjoints together.

Every evaluator takes float64 arrays and returns a namespace of float64 arrays; inside, the kernel runs in `dtype`.
"""

from collections.abc import Callable
from functools import cache
from types import SimpleNamespace

import numpy as np
import warp as wp
from physreal_core.simulation.constitutive import (
    ResidualConfig,
    elastic_functions,
    plastic_functions,
    residual_functions,
)

wp.config.quiet = True

CONFIG = ResidualConfig(latent_size=3, hidden=8, beta_elastic=0.5, beta_plastic=0.2)
ROWS = 2
Evaluate = Callable[..., SimpleNamespace]


def warp_types(dtype: str) -> tuple:
    """Scalar, vec2, mat33 and numpy type of "float32" or "float64"."""
    if dtype == "float32":
        return wp.float32, wp.vec2f, wp.mat33f, np.float32
    return wp.float64, wp.vec2d, wp.mat33d, np.float64


def evaluator(kernel: wp.Kernel, input_count: int, dtype: str, device: str) -> Evaluate:
    """Makes the arrays that `kernel` is annotated with, launches it, and returns its outputs by name."""
    numpy_type = warp_types(dtype)[3]
    arguments = [(a.label, a.type) for a in kernel.adj.args]

    def evaluate(*values: np.ndarray) -> SimpleNamespace:
        count = len(values[0])
        arrays = [
            wp.array(np.ascontiguousarray(value, numpy_type), dtype=a.dtype, device=device)
            for value, (_, a) in zip(values, arguments[:input_count], strict=True)
        ]
        shapes = {"weights_bar": (ROWS, CONFIG.weight_count), "latent_bar": (count, CONFIG.latent_size)}
        made = {
            name: wp.zeros(shapes.get(name, count), dtype=a.dtype, device=device) for name, a in arguments[input_count:]
        }
        wp.launch(kernel, count, inputs=[*arrays, *made.values()], device=device)
        return SimpleNamespace(**{name: array.numpy().astype(np.float64) for name, array in made.items()})

    return evaluate


@cache
def elastic(law: str, dtype: str = "float64", device: str = "cpu") -> Evaluate:
    """`(F, E, nu, tau_bar) -> tau, tau_again, F_bar, E_bar, nu_bar`."""
    scalar, _, mat33, _ = warp_types(dtype)
    stress, stress_adjoint = elastic_functions(law, scalar)

    @wp.kernel(enable_backward=False, module=f"test_{law}_{dtype}")
    def kernel(
        F: wp.array(dtype=mat33),
        E: wp.array(dtype=scalar),
        nu: wp.array(dtype=scalar),
        seed: wp.array(dtype=mat33),
        tau: wp.array(dtype=mat33),
        tau_again: wp.array(dtype=mat33),
        F_bar: wp.array(dtype=mat33),
        E_bar: wp.array(dtype=scalar),
        nu_bar: wp.array(dtype=scalar),
    ):
        i = wp.tid()
        tau[i] = stress(F[i], E[i], nu[i])
        bar = stress_adjoint(F[i], E[i], nu[i], seed[i])
        tau_again[i] = bar.tau
        F_bar[i] = bar.F
        E_bar[i] = bar.E
        nu_bar[i] = bar.nu

    return evaluator(kernel, 4, dtype, device)


@cache
def plastic(law: str, dtype: str = "float64", device: str = "cpu") -> Evaluate:
    """`(F, E, nu, y, dt, F_new_bar) -> F_new, F_bar, E_bar, nu_bar, y_bar`."""
    scalar, vec2, mat33, _ = warp_types(dtype)
    return_map, return_map_adjoint = plastic_functions(law, scalar)

    @wp.kernel(enable_backward=False, module=f"test_{law}_{dtype}")
    def kernel(
        F: wp.array(dtype=mat33),
        E: wp.array(dtype=scalar),
        nu: wp.array(dtype=scalar),
        y: wp.array(dtype=vec2),
        dt: wp.array(dtype=scalar),
        seed: wp.array(dtype=mat33),
        F_new: wp.array(dtype=mat33),
        F_bar: wp.array(dtype=mat33),
        E_bar: wp.array(dtype=scalar),
        nu_bar: wp.array(dtype=scalar),
        y_bar: wp.array(dtype=vec2),
    ):
        i = wp.tid()
        F_new[i] = return_map(F[i], E[i], nu[i], y[i], dt[i])
        bar = return_map_adjoint(F[i], E[i], nu[i], y[i], dt[i], seed[i])
        F_bar[i] = bar.F
        E_bar[i] = bar.E
        nu_bar[i] = bar.nu
        y_bar[i] = bar.y

    return evaluator(kernel, 6, dtype, device)


@cache
def stress_residual(dtype: str = "float64", device: str = "cpu") -> Evaluate:
    """`(F, tau_exp, E, latent, weights, seed) -> delta, F_bar, tau_exp_bar, E_bar, latent_bar, weights_bar`."""
    scalar, _, mat33, _ = warp_types(dtype)
    functions = residual_functions(CONFIG, scalar)
    forward, backward = functions.stress, functions.stress_adjoint

    @wp.kernel(enable_backward=False, module=f"test_stress_residual_{dtype}")
    def kernel(
        F: wp.array(dtype=mat33),
        tau_exp: wp.array(dtype=mat33),
        E: wp.array(dtype=scalar),
        latent: wp.array2d(dtype=scalar),
        weights: wp.array(dtype=scalar),
        seed: wp.array(dtype=mat33),
        delta: wp.array(dtype=mat33),
        F_bar: wp.array(dtype=mat33),
        tau_exp_bar: wp.array(dtype=mat33),
        E_bar: wp.array(dtype=scalar),
        latent_bar: wp.array2d(dtype=scalar),
        weights_bar: wp.array2d(dtype=scalar),
    ):
        i = wp.tid()
        delta[i] = forward(F[i], tau_exp[i], E[i], i, latent, weights)
        bar = backward(F[i], tau_exp[i], E[i], i, latent, weights, seed[i], latent_bar, weights_bar, i % ROWS)
        F_bar[i] = bar.F
        tau_exp_bar[i] = bar.tau_exp
        E_bar[i] = bar.E

    return evaluator(kernel, 6, dtype, device)


@cache
def plastic_residual(dtype: str = "float64", device: str = "cpu") -> Evaluate:
    """`(F_trial, F_exp, share, latent, weights, seed) -> delta, F_trial_bar, F_exp_bar, latent_bar, weights_bar`."""
    scalar, _, mat33, _ = warp_types(dtype)
    functions = residual_functions(CONFIG, scalar)
    forward, backward = functions.plastic, functions.plastic_adjoint

    @wp.kernel(enable_backward=False, module=f"test_plastic_residual_{dtype}")
    def kernel(
        F_trial: wp.array(dtype=mat33),
        F_exp: wp.array(dtype=mat33),
        share: wp.array(dtype=scalar),
        latent: wp.array2d(dtype=scalar),
        weights: wp.array(dtype=scalar),
        seed: wp.array(dtype=mat33),
        delta: wp.array(dtype=mat33),
        F_trial_bar: wp.array(dtype=mat33),
        F_exp_bar: wp.array(dtype=mat33),
        latent_bar: wp.array2d(dtype=scalar),
        weights_bar: wp.array2d(dtype=scalar),
    ):
        i = wp.tid()
        delta[i] = forward(F_trial[i], F_exp[i], share[i], i, latent, weights)
        bar = backward(F_trial[i], F_exp[i], share[i], i, latent, weights, seed[i], latent_bar, weights_bar, i % ROWS)
        F_trial_bar[i] = bar.F_trial
        F_exp_bar[i] = bar.F_exp

    return evaluator(kernel, 6, dtype, device)
