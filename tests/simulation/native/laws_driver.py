"""The native material as numpy functions of many particles: values and adjoints, in either precision and any width."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import warp as wp
from physreal_core.simulation.constitutive import ResidualConfig

from physreal_core.native import native_module
from physreal_core.simulation import native

HEADER = Path(__file__).with_name("laws_driver.h")
HEADERS = Path(native.__file__).parent
ELASTIC = {"neo_hookean": "NeoHookean", "fixed_corotated": "FixedCorotated", "hencky": "Hencky"}
PLASTIC = {"identity": "Identity", "von_mises": "VonMises", "drucker_prager": "DruckerPrager"}
MOST_LANES = 16
MACHINES = {"host": None, "avx2": "-target-cpu haswell", "sse": "-U__AVX__"}
"""Machine flags of the compiler."""
TYPES = {"float32": (np.float32, wp.float32, "float"), "float64": (np.float64, wp.float64, "double")}
LANES = {"avx2": 8, "sse": 4}


@cache
def material(
    elastic: str, plastic: str, residual: ResidualConfig | None, dtype: str, machine: str = "host"
) -> Callable:
    """`evaluate(F, seed, E, nu, flow=False, backward=True, **parameters)` with the fields of `_outputs`.

    residual: the networks of both residuals, none where None. The kernel runs in `dtype`, on arrays of float64.
    """
    number, scalar, c_type = TYPES[dtype]
    network = "NoNetwork" if residual is None else f"Network<{residual.latent_size}, {residual.hidden}>"
    tag = "expert" if residual is None else f"{residual.latent_size}_{residual.hidden}"
    module = native_module(
        f"physreal_test_{elastic}_{plastic}_{tag}_{machine}_{dtype}", HEADER, HEADERS, machine=MACHINES[machine]
    )
    laws = f"physreal::{ELASTIC[elastic]}, physreal::{PLASTIC[plastic]}, physreal::{network}, physreal::{network}"
    call = (
        f"physreal::evaluate<{c_type}, {laws}>((unsigned long long*)rows.data, numbers.data, stride, flow, backward);"
    )

    @wp.func_native(call)
    def evaluate_all(
        rows: wp.array(dtype=wp.uint64), numbers: wp.array(dtype=scalar), stride: int, flow: bool, backward: bool
    ): ...

    @wp.func_native(f"physreal::sizes<{c_type}, physreal::{network}, physreal::{network}>(out.data);")
    def sizes_of(out: wp.array(dtype=wp.int32)): ...

    @wp.kernel(module=module)
    def run(rows: wp.array(dtype=wp.uint64), numbers: wp.array(dtype=scalar), stride: int, flow: bool, backward: bool):
        evaluate_all(rows, numbers, stride, flow, backward)

    @wp.kernel(module=module)
    def measure(out: wp.array(dtype=wp.int32)):
        sizes_of(out)

    sizes = wp.zeros(2, dtype=wp.int32, device="cpu")
    wp.launch(measure, 1, inputs=[sizes], device="cpu")
    workspace, lanes = (int(n) for n in sizes.numpy())
    assert lanes == LANES.get(machine, lanes)

    def evaluate(F, seed, E, nu, y=None, latent=None, weights=None, dt=1e-4, share=0.1, flow=False, backward=True):
        arrays = _arrays(residual, number, F, seed, E, nu, y, latent, weights, workspace)
        config = residual or ResidualConfig()
        numbers = np.array([dt, share, config.beta_elastic, config.beta_plastic, config.strain_scale], number)
        addresses = np.array([0 if a is None else a.ctypes.data for a in arrays.values()], np.uint64)
        inputs = [
            wp.array(addresses, dtype=wp.uint64, device="cpu"),
            wp.array(numbers, dtype=scalar, device="cpu"),
            arrays["F"].shape[1],
            flow,
            backward,
        ]
        wp.launch(run, 1, inputs=inputs, device="cpu")
        return _outputs(arrays, len(F))

    return evaluate


def elementary(x: np.ndarray, dtype: str) -> np.ndarray:
    """log, exp, sine and cosine of x [N], and in all lanes of a block of `LANES` numbers their sum: [5, N] in `dtype`."""
    number, scalar, c_type = TYPES[dtype]

    @wp.func_native(f"physreal::elementary<{c_type}>(x.data, out.data, x.shape[0]);")
    def elementary_of(x: wp.array(dtype=scalar), out: wp.array2d(dtype=scalar)): ...

    @wp.kernel(module=native_module(f"physreal_test_elementary_{dtype}", HEADER, HEADERS))
    def run(x: wp.array(dtype=scalar), out: wp.array2d(dtype=scalar)):
        elementary_of(x, out)

    out = wp.zeros((5, len(x)), dtype=scalar, device="cpu")
    wp.launch(run, 1, inputs=[wp.array(x.astype(number), dtype=scalar, device="cpu"), out], device="cpu")
    return out.numpy()


def _arrays(residual, number, F, seed, E, nu, y, latent, weights, workspace) -> dict[str, np.ndarray | None]:
    """The driver's rows in order, padded to whole blocks as `MaterialArrays` asks."""
    count = len(F)
    padded = -(-count // MOST_LANES) * MOST_LANES

    def rows(values, fill):
        values = np.asarray(values, number).reshape(count, -1).T
        fill = np.broadcast_to(np.reshape(fill, (-1, 1)), (len(values), padded - count))
        return np.concatenate([values, fill], axis=1, dtype=number).copy()

    made = {"E": rows(E, 1.0), "nu": rows(nu, 0.3)}
    made["plastic"] = rows(np.ones((count, 2)) if y is None else y, 1.0)
    for kind in ("elastic", "plastic"):
        made[f"latent_{kind}"] = None if residual is None else rows(latent, 0.0)
        made[f"network_{kind}"] = None if residual is None else np.array(weights, number)
    bars = {f"{name}_bar": None if a is None else np.zeros_like(a) for name, a in made.items()}
    identity, zero = np.eye(3).ravel(), 0.0
    return {
        **made,
        **bars,
        "workspace": np.full(workspace, np.nan, number),
        "F": rows(F, identity),
        "seed": rows(seed, zero),
        "out": np.full((9, padded), np.nan, number),
        "F_bar": np.zeros((9, padded), number),
    }


def _outputs(arrays, count) -> SimpleNamespace:
    """`out` (stress or F), `F_bar` [N, 3, 3]; `E_bar`, `nu_bar` [N]; `y_bar` [N, 2]; of both networks, elastic first,
    `latent_bar` [2, N, L] and `weights_bar` [2, W]; and `padding`, all adjoints of the lanes beyond the last particle.
    """

    def particles(name):
        return None if arrays[name] is None else arrays[name].T[:count].astype(np.float64)

    bars = ["E_bar", "nu_bar", "plastic_bar", "F_bar"]
    networks = arrays["network_elastic"] is not None
    if networks:
        bars += ["latent_elastic_bar", "latent_plastic_bar"]
    return SimpleNamespace(
        out=particles("out").reshape(-1, 3, 3),
        F_bar=particles("F_bar").reshape(-1, 3, 3),
        E_bar=particles("E_bar")[:, 0],
        nu_bar=particles("nu_bar")[:, 0],
        y_bar=particles("plastic_bar"),
        latent_bar=np.stack([particles(f"latent_{k}_bar") for k in ("elastic", "plastic")]) if networks else None,
        weights_bar=np.stack([arrays[f"network_{k}_bar"] for k in ("elastic", "plastic")]) if networks else None,
        padding=np.concatenate([arrays[name][:, count:].ravel() for name in bars]),
    )
