"""The laws' headers as numpy functions of many particles: values and adjoints, in both number types and precisions.

Every evaluator takes float64 arrays and returns a namespace of float64 arrays; inside, the header runs in `dtype`.
`form` is "lanes", vectors of particles as the CPU takes them, or "one", a particle at a time as a GPU's thread takes it.
"""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import warp as wp

from physreal_core.native import native_module
from physreal_core.simulation.laws import PLASTIC_LAWS, ResidualConfig
from physreal_core.simulation.layout import Structure
from physreal_core.simulation.particle_rows import NUMBERS, TERM_ROWS
from physreal_core.simulation.solids import Solids
from physreal_core.simulation.step_layout import LAWS_FOLDER, class_name, layout_text, term_bits
from physreal_core.simulation.terms import FORCE_TERMS, branch_count

HEADER = Path(__file__).with_name("driver.h")
FORMS = ("lanes", "one")
DTYPES = ("float32", "float64")
PAIRS = {"neo_hookean": "von_mises", "fixed_corotated": "drucker_prager", "hencky": "identity"}
CONFIG = ResidualConfig(latent_size=3, hidden=8, beta_elastic=0.5, beta_plastic=0.2)
MOST_LANES = 16
MACHINES = {"host": None, "avx2": "-target-cpu haswell", "sse": "-U__AVX__"}
"""Machine flags of the compiler."""
LANES = {"avx2": 8, "sse": 4}
Evaluate = Callable[..., SimpleNamespace]

POINTS = Structure(
    "Points",
    """
    Index stride  particles, and what fills the last block
    Index flow  whether plastic flow is asked for, else stress
    Index* width  [1] particles of a block
    S dt
    S share
    S beta_elastic
    S beta_plastic
    S strain_scale
    S* F  [9, stride]
    S* expert  [9, stride] the expert's result, for a residual alone
    S* seed  [9, stride] adjoint of the result
    S* E
    S* nu
    S* plastic  [2, stride]
    S* latent  [latent size, stride] of both residuals
    S* weights  of both networks
    S* value  [9, stride] the result: stress or F
    S* F_bar
    S* expert_bar
    S* E_bar
    S* nu_bar
    S* plastic_bar
    S* latent_elastic_bar
    S* latent_plastic_bar
    S* network_elastic_bar
    S* network_plastic_bar
    """,
)
TERM_POINTS = Structure(
    "TermPoints",
    """
    Index stride
    Index terms  bits of those in use
    S* x  [3, stride]
    S* v
    S* mass
    S* rate  [9, stride] mean rate of deformation
    S* branches  [9 B, stride] of Maxwell branches
    S* F
    S* values  [TERM_ROWS, stride]
    S* numbers  [NUMBERS]
    Index solid_count:3
    S solid_origin:3
    S solid_cell
    S* solid_distance
    S* force_seed
    S* stress_seed
    S* force
    S* stress
    S* x_bar
    S* v_bar
    S* mass_bar
    S* rate_bar
    S* branches_bar
    S* F_bar
    S* value_bars
    S* number_bars  [NUMBERS, stride]
    """,
)


BRANCH_POINTS = Structure(
    "BranchPoints",
    """
    Index stride
    S dt
    S time  of relaxation
    S* branches  [9, stride] of one branch
    S* step  [9, stride] dt grad v
    S* seed
    S* value
    S* branches_bar
    S* step_bar
    S* time_bar
    """,
)


def partner(law: str) -> str:
    """The plastic law that is compiled together with an elastic one, or the other way; each is tried alone."""
    if law in PLASTIC_LAWS:
        return {plastic: elastic for elastic, plastic in PAIRS.items()}.get(law, "neo_hookean")
    return PAIRS.get(law, "identity")


@cache
def material(
    elastic: str,
    plastic: str,
    residual: ResidualConfig | None,
    form: str,
    dtype: str,
    device: str = "cpu",
    machine: str = "host",
    folder: Path | None = None,
) -> Evaluate:
    """`evaluate(F, seed, E, nu, y, latent, weights, dt, share, flow)`.

    It gives `out` (stress or F) and `F_bar` [N, 3, 3]; `E_bar`, `nu_bar` [N]; `y_bar` [N, 2]; of both networks, elastic
    first, `latent_bar` [2, N, L] and `weights_bar` [2, W]; `padding`, all adjoints of the lanes beyond the last
    particle; and `width`, the particles of a block.

    residual: the networks of both residuals, none where None.
    folder: where else to look for laws.
    """
    network, tag = "NoNetwork", "expert"
    if residual is not None:
        tag = f"{residual.latent_size}_{residual.hidden}"
        network = f"Network<{residual.latent_size}, {residual.hidden}>"
    names = (class_name(elastic), class_name(plastic), network, network)
    launch = _launcher(
        "_".join([elastic, plastic, tag, machine, *([] if folder is None else [folder.name])]),
        form,
        dtype,
        f"drive_material<V, {', '.join(f'physreal::{name}' for name in names)}>",
        f'#include "elastic/{elastic}.h"\n#include "plastic/{plastic}.h"\n',
        machine,
        folder,
    )

    def evaluate(F, seed, E, nu, y=None, latent=None, weights=None, dt=1e-4, share=0.1, flow=False) -> SimpleNamespace:
        given = {"F": F, "seed": seed, "E": E, "nu": nu, "plastic": np.ones((len(F), 2)) if y is None else y}
        return _evaluate(launch, residual, dtype, device, given, latent, weights, dt=dt, share=share, flow=flow)

    return evaluate


def elastic(law: str, form: str, dtype: str = "float64", device: str = "cpu", folder: Path | None = None) -> Evaluate:
    """`(F, E, nu, tau_bar) -> tau, F_bar, E_bar, nu_bar`, of an expert alone."""
    of_material = material(law, partner(law), None, form, dtype, device, folder=folder)

    def evaluate(F, E, nu, seed) -> SimpleNamespace:
        found = of_material(F, seed, E, nu)
        return SimpleNamespace(tau=found.out, F_bar=found.F_bar, E_bar=found.E_bar, nu_bar=found.nu_bar)

    return evaluate


def plastic(law: str, form: str, dtype: str = "float64", device: str = "cpu") -> Evaluate:
    """`(F, E, nu, y, dt, F_new_bar) -> F_new, F_bar, E_bar, nu_bar, y_bar`; dt [N] is the same for all."""
    of_material = material(partner(law), law, None, form, dtype, device)

    def evaluate(F, E, nu, y, dt, seed) -> SimpleNamespace:
        found = of_material(F, seed, E, nu, y=y, dt=_common(dt), flow=True)
        names = ("F_bar", "E_bar", "nu_bar", "y_bar")
        return SimpleNamespace(F_new=found.out, **{name: getattr(found, name) for name in names})

    return evaluate


@cache
def residual(kind: str, form: str, dtype: str = "float64", device: str = "cpu") -> Evaluate:
    """`(F, expert's result, E or share, latent, weights, seed)` to `delta` and `F_bar`, `expert_bar`, `latent_bar`,
    `weights_bar` [W], and that of E for kind "stress"; of "plastic" the share [N] is the same for all."""
    flow = kind == "plastic"
    call = f"drive_residual<V, physreal::Network<{CONFIG.latent_size}, {CONFIG.hidden}>>"
    launch = _launcher("residuals", form, dtype, call)

    def evaluate(F, expert, third, latent, weights, seed) -> SimpleNamespace:
        n = len(F)
        given = {"F": F, "seed": seed, "E": np.ones(n) if flow else third, "nu": np.full(n, 0.3), "expert": expert}
        given["plastic"] = np.ones((n, 2))
        share = _common(third) if flow else 0.1
        found = _evaluate(launch, CONFIG, dtype, device, given, latent, weights, share=share, flow=flow)
        of_kind = int(flow)
        out = SimpleNamespace(
            delta=found.out,
            F_bar=found.F_bar,
            expert_bar=found.expert_bar,
            latent_bar=found.latent_bar[of_kind],
            weights_bar=found.weights_bar[of_kind],
        )
        if not flow:
            out.E_bar = found.E_bar
        return out

    return evaluate


def term(name: str, form: str, dtype: str = "float64", device: str = "cpu", solids: Solids | None = None) -> Evaluate:
    """`evaluate(seed, **inputs) -> value, bars` of the optional law `name`: a force [N, 3] or a stress [N, 3, 3].

    Inputs are the state `x`, `v`, `mass`, `rate`, `F`, `branches` of the law, and the rows and the numbers of `particle_rows` by their names, each
    [N, ...] but the numbers [...]. What is not given is zero, or one for mass and F. `bars` are the adjoints of all, of
    those that were given in their shapes.
    """
    launch = _launcher("terms", form, dtype, "drive_terms<V>", points=TERM_POINTS)
    rows, numbers = TERM_ROWS.places(), NUMBERS.places()
    kind = "force" if name in FORCE_TERMS else "stress"

    def evaluate(seed, **inputs) -> SimpleNamespace:
        n = len(seed)
        vectors, matrices = np.zeros((n, 3)), np.zeros((n, 3, 3))
        state = {"x": vectors, "v": vectors, "mass": np.ones(n), "rate": matrices, "F": matrices + np.eye(3)}
        state["branches"] = np.zeros((n, branch_count((name,)), 3, 3))
        state |= {"force_seed": vectors, "stress_seed": matrices}
        values, shared = np.zeros((n, TERM_ROWS.count)), np.zeros(NUMBERS.count)
        for key, value in inputs.items():
            if key in rows:
                values[:, rows[key]] = np.reshape(value, (n, -1))
            elif key in numbers:
                shared[numbers[key]] = value
            else:
                state[key] = value
        state[f"{kind}_seed"] = seed
        arrays = {key: _rows(value, dtype, 1.0 if key == "mass" else 0.0) for key, value in state.items()}
        arrays["F"] = _rows(state["F"], dtype, np.eye(3).ravel())
        arrays["values"], arrays["numbers"] = _rows(values, dtype, 1.0), shared.astype(dtype)
        arrays |= {f"{key}_bar": np.zeros_like(arrays[key]) for key in ("x", "v", "mass", "rate", "branches")}
        arrays["F_bar"] = np.ones_like(arrays["F"])  # a law's own sum: it adds
        stride = arrays["F"].shape[1]
        arrays["value_bars"] = np.zeros_like(arrays["values"])
        arrays["number_bars"] = np.zeros((NUMBERS.count, stride), dtype)
        arrays |= {"force": np.full((3, stride), np.nan, dtype), "stress": np.full((9, stride), np.nan, dtype)}
        lattice = {} if solids is None else solids.lattice
        if solids is not None:
            arrays["solid_distance"] = solids.distance.astype(dtype)
        arrays = launch(arrays, device, stride=stride, terms=term_bits((name,)), **lattice)

        def particles(key: str) -> np.ndarray:
            return arrays[key].T[:n].astype(np.float64)

        bars = {key: particles(f"{key}_bar") for key in ("x", "v", "mass", "rate", "branches", "F")}
        bars["F"] -= 1.0
        bars |= {key: particles("value_bars")[:, place] for key, place in rows.items()}
        bars |= {key: particles("number_bars")[:, place].sum(0) for key, place in numbers.items()}
        bars |= {key: bars[key].reshape(np.shape(value)) for key, value in inputs.items()}
        return SimpleNamespace(value=particles(kind).reshape(seed.shape), bars=bars)

    return evaluate


@cache
def branch(form: str, dtype: str = "float64", device: str = "cpu") -> Evaluate:
    """`(A [N, 3, 3], step [N, 3, 3], dt, time, seed) -> value, A_bar, step_bar, time_bar`, of a substep of one branch."""
    launch = _launcher("branches", form, dtype, "drive_branch<V>", points=BRANCH_POINTS)

    def evaluate(A, step, dt, time, seed) -> SimpleNamespace:
        given = {"branches": A, "step": step, "seed": seed}
        arrays = {key: _rows(value, dtype, 0.0) for key, value in given.items()}
        blank = arrays["branches"]
        arrays |= {key: np.full_like(blank, np.nan) for key in ("value", "branches_bar", "step_bar")}
        arrays["time_bar"] = np.full_like(blank[:1], np.nan)
        arrays = launch(arrays, device, stride=blank.shape[1], dt=dt, time=time)
        matrices = {
            key: arrays[key].T[: len(A)].astype(np.float64).reshape(-1, 3, 3)
            for key in ("value", "branches_bar", "step_bar")
        }
        time_bar = arrays["time_bar"][0, : len(A)].astype(np.float64).sum()
        return SimpleNamespace(
            value=matrices["value"], A_bar=matrices["branches_bar"], step_bar=matrices["step_bar"], time_bar=time_bar
        )

    return evaluate


@cache
def friction(dtype: str, device: str = "cpu") -> Evaluate:
    """`(dynamic, law [3], speed [N], seed [N]) -> value, speed_bar [N], dynamic_bar, law_bar [3]`, node by node."""
    scalar, c_type = getattr(wp, dtype), _C_TYPES[dtype]
    arguments = "(dynamic, law.data, speed.data, seed.data, out.data, speed.shape[0], node)"
    array, array2 = wp.array(dtype=scalar), wp.array2d(dtype=scalar)

    @wp.func_native(f"physreal::drive_friction<{c_type}>{arguments};")
    def drive(dynamic: scalar, law: array, speed: array, seed: array, out: array2, node: int): ...

    @wp.kernel(module=_module("friction", "one", dtype))
    def run(dynamic: scalar, law: array, speed: array, seed: array, out: array2):
        drive(dynamic, law, speed, seed, out, wp.tid())

    def evaluate(dynamic, law, speed, seed) -> SimpleNamespace:
        given = [wp.array(np.asarray(a, dtype), dtype=scalar, device=device) for a in (law, speed, seed)]
        out = wp.zeros((6, len(speed)), dtype=scalar, device=device)
        wp.launch(run, len(speed), inputs=[scalar(dynamic), *given, out], device=device)
        value, speed_bar, dynamic_bar, *law_bar = out.numpy().astype(np.float64)
        return SimpleNamespace(
            value=value, speed_bar=speed_bar, dynamic_bar=dynamic_bar.sum(), law_bar=np.sum(law_bar, axis=1)
        )

    return evaluate


ELEMENTARY = ("log", "exp", "sin", "cos", "sqrt", "inverse_sqrt", "abs", "sum")


@cache
def elementary(form: str, dtype: str) -> Evaluate:
    """`evaluate(x)`: the functions `ELEMENTARY` of x [N], [N] in `dtype`; sum: that of a block, in all its lanes."""
    scalar, number = getattr(wp, dtype), _number(form, dtype)
    array, array2 = wp.array(dtype=scalar), wp.array2d(dtype=scalar)

    @wp.func_native(f"physreal::elementary<{number}>(x.data, out.data, x.shape[0]);")
    def drive(x: array, out: array2): ...

    @wp.kernel(module=_module("elementary", form, dtype))
    def run(x: array, out: array2):
        drive(x, out)

    def evaluate(x) -> SimpleNamespace:
        out = wp.zeros((len(ELEMENTARY), len(x)), dtype=scalar, device="cpu")
        wp.launch(run, 1, inputs=[wp.array(x.astype(dtype), dtype=scalar, device="cpu"), out], device="cpu")
        return SimpleNamespace(**dict(zip(ELEMENTARY, out.numpy(), strict=True)))

    return evaluate


_C_TYPES = {"float32": "float", "float64": "double"}


def _number(form: str, dtype: str) -> str:
    """V."""
    return f"physreal::Lanes<{_C_TYPES[dtype]}>" if form == "lanes" else _C_TYPES[dtype]


def _module(name: str, form: str, dtype: str, laws: str = "", machine: str = "host", folder: Path | None = None):
    wp.init()
    text = f'#include "{"lanes.h" if form == "lanes" else "number.h"}"\n{layout_text(POINTS, TERM_POINTS, BRANCH_POINTS)}{laws}'
    return native_module(
        f"physreal_test_{name}_{form}_{dtype}",
        HEADER,
        LAWS_FOLDER,
        *([] if folder is None else [folder]),
        preamble=text,
        cuda=form == "one",
        machine=MACHINES[machine],
    )


@cache
def _launcher(
    name: str,
    form: str,
    dtype: str,
    call: str,
    laws: str = "",
    machine: str = "host",
    folder: Path | None = None,
    points: Structure = POINTS,
) -> Callable:
    """`launch(arrays by name, device, **numbers)` gives the arrays as `call` leaves them, for points first to last."""
    of_points = f"*(const physreal::{points.name}<{_C_TYPES[dtype]}>*)record.data"
    call = call.replace("<V", f"<{_number(form, dtype)}", 1)

    @wp.func_native(f"physreal::{call}({of_points}, first, last);")
    def drive(record: wp.array(dtype=wp.uint64), first: int, last: int): ...

    @wp.kernel(module=_module(name, form, dtype, laws, machine, folder))
    def run(record: wp.array(dtype=wp.uint64), count: int):
        drive(record, wp.tid() * count, (wp.tid() + 1) * count)

    def launch(arrays: dict[str, np.ndarray], device: str, stride: int, **numbers: float) -> dict[str, np.ndarray]:
        held = {key: wp.array(value, device=device) for key, value in arrays.items()}
        record = np.zeros((), points.dtype(dtype))
        for key, value in ({key: array.ptr or 0 for key, array in held.items()} | numbers | {"stride": stride}).items():
            record[key] = value
        as_array = wp.array(np.frombuffer(record.tobytes(), np.uint64), dtype=wp.uint64, device=device)
        # on a GPU each thread has one particle; on the CPU one object has them all, as a thread's of the simulator has
        threads = stride if device != "cpu" else 1
        wp.launch(run, threads, inputs=[as_array, stride // threads], device=device)
        return {key: array.numpy() for key, array in held.items()}

    return launch


def _rows(values: np.ndarray, dtype: str, fill: float | np.ndarray) -> np.ndarray:
    """[N, ...] as rows [numbers, N], filled up to whole blocks."""
    values = np.asarray(values, dtype)
    values = values.reshape(len(values), int(np.prod(values.shape[1:]))).T
    padding = -values.shape[1] % MOST_LANES
    fill = np.broadcast_to(np.reshape(fill, (-1, 1)), (len(values), padding))
    return np.concatenate([values, fill], axis=1, dtype=dtype).copy()


def _common(values: np.ndarray) -> float:
    assert (values == values[0]).all()
    return float(values[0])


def _evaluate(
    launch: Callable,
    residual: ResidualConfig | None,
    dtype: str,
    device: str,
    given: dict[str, np.ndarray],
    latent: np.ndarray | None,
    weights: np.ndarray | None,
    **numbers: float,
) -> SimpleNamespace:
    count = len(given["F"])
    fills = {"F": np.eye(3).ravel(), "expert": np.eye(3).ravel(), "E": 1.0, "nu": 0.3, "plastic": 1.0}
    arrays = {name: _rows(value, dtype, fills.get(name, 0.0)) for name, value in given.items()}
    bars = [name for name in arrays if name != "seed"]
    arrays |= {f"{name}_bar": np.zeros_like(arrays[name]) for name in bars}
    if residual is not None:
        arrays["weights"] = np.asarray(weights, dtype)
        arrays["latent"] = _rows(latent, dtype, 0.0)
        for kind in ("elastic", "plastic"):
            arrays[f"latent_{kind}_bar"] = np.zeros_like(arrays["latent"])
            arrays[f"network_{kind}_bar"] = np.zeros_like(arrays["weights"])
    config = residual or ResidualConfig()
    numbers |= {name: getattr(config, name) for name in ("beta_elastic", "beta_plastic", "strain_scale")}
    arrays |= {"value": np.full_like(arrays["F"], np.nan), "width": np.zeros(1, np.int64)}
    arrays = launch(arrays, device, stride=arrays["F"].shape[1], **numbers)

    def particles(name: str) -> np.ndarray:
        return arrays[name].T[:count].astype(np.float64)

    padded = [f"{name}_bar" for name in bars]
    found = SimpleNamespace(
        out=particles("value").reshape(-1, 3, 3),
        F_bar=particles("F_bar").reshape(-1, 3, 3),
        E_bar=particles("E_bar")[:, 0],
        nu_bar=particles("nu_bar")[:, 0],
        y_bar=particles("plastic_bar"),
        width=int(arrays["width"][0]),
    )
    if "expert" in given:
        found.expert_bar = particles("expert_bar").reshape(-1, 3, 3)
    if residual is not None:
        kinds = ("elastic", "plastic")
        padded += [f"latent_{kind}_bar" for kind in kinds]
        found.latent_bar = np.stack([particles(f"latent_{kind}_bar") for kind in kinds])
        found.weights_bar = np.stack([arrays[f"network_{kind}_bar"].astype(np.float64) for kind in kinds])
    found.padding = np.concatenate([arrays[name][:, count:].ravel() for name in padded])
    return found
