"""Does the step on CUDA give the states and gradients of that on the CPU? `python -m benchmarks.agreement`

Prints relative differences and exits with 1 above the tolerances. The CPU's numbers are computed on the spot with
`--live`, or come from a file, so that a GPU machine needs no CPU compiler; `--write` makes that file anew, of the scenes
that are named, and leaves the others as they are. With `--device cpu` it is the CPU of now that is compared with the file.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from benchmarks.thin.touching import two_blocks
from benchmarks.thin_scenes import crossing_ropes, stacked_sheets, wavy_ropes, wavy_sheet
from physreal_core.simulation import (
    Body,
    Clamp,
    Grip,
    Parameters,
    PointLoad,
    SimulationConfig,
    Simulator,
    Solids,
    States,
)
from physreal_core.simulation.laws import ResidualConfig, initial_weights
from physreal_core.simulation.terms import BRANCH_TERMS, STRESS_TERMS, TERMS, THIN_TERMS, term_shapes
from physreal_core.simulation.thin import Shell

REFERENCE = Path(__file__).parent / "results" / "agreement_cpu.npz"
# Sums over threads come in another order on a GPU: rounding (1e-16, 6e-8) grows over some fifty substeps, and float32
# nodes may change from sticking to slipping a substep earlier or later.
TOLERANCES = {"float64": 1e-8, "float32": 5e-3}
FRAMES = 4
VOLUME_TERMS = tuple(term for term in TERMS if term not in (*THIN_TERMS, "solids"))
"""Those of volumes; solids have cases of their own."""
_COMMON = tuple(term for term in VOLUME_TERMS if term not in (*STRESS_TERMS, "initial_deformation"))
SHELL_TERMS, ROD_TERMS = (*_COMMON, *Shell.terms), (*_COMMON, "bending", "surface_drag")
"""Those of shells, and of rods without frames."""


def soft_block() -> Body:
    """120 particles on the ground."""
    index = np.stack(np.meshgrid(np.arange(5), np.arange(6), np.arange(4), indexing="ij"), -1).reshape(-1, 3)
    return Body((index + 0.5) * 0.01, np.full(len(index), 1e-6), np.full(len(index), 300.0), 0.01)


def fork() -> Body:
    """A base and two prongs of 96 particles with two spacings of air between them: limbs that share no node of the grid."""
    index = np.stack(np.meshgrid(np.arange(6), np.arange(6), np.arange(3), indexing="ij"), -1).reshape(-1, 3)
    index = index[(index[:, 1] > 3) | (index[:, 0] < 2) | (index[:, 0] > 3)]
    return Body((index + 0.5) * 0.01, np.full(len(index), 1e-6), np.full(len(index), 300.0), 0.01)


def blocks() -> Body:
    """A block of 32 particles that lies on another of 50."""
    return two_blocks(0.01, (5, 5, 2), (4, 4, 2), (0.003, 0.004), 0.001)


BODIES = {
    "block": soft_block,
    "blocks": blocks,
    "fork": fork,
    "shell": wavy_sheet,
    "rod": wavy_ropes,
    "sheets": stacked_sheets,
    "ropes": crossing_ropes,
}
MODULI = dict.fromkeys(("block", "blocks", "fork"), 2e3) | dict.fromkeys(("shell", "rod", "sheets", "ropes"), 3e4)  # Pa
THIN_RESIDUAL = ResidualConfig(latent_size=2, hidden=4, strain_scale=0.01, thin=True)


@dataclass(frozen=True)
class Case:
    """A body and its material in the little scene."""

    elastic_law: str = "fixed_corotated"
    plastic_law: str = "identity"
    residual: ResidualConfig | None = None
    held: bool = False  # by a clamp at one side, pulled by a load at another
    terms: tuple[str, ...] = ()
    led: bool = False  # whether the controller points have a gradient, too
    touching: bool = False  # whether the body touches itself
    walled: bool = False  # whether it runs into a solid wall
    body: str = "block"


CASES = {
    "fixed corotated": Case(),
    "neo-Hookean": Case("neo_hookean"),
    "St. Venant-Kirchhoff": Case("saint_venant_kirchhoff"),
    "clamp and load": Case(held=True),
    "Hencky, von Mises": Case("hencky", "von_mises"),
    "Drucker-Prager": Case(plastic_law="drucker_prager"),
    "residuals": Case(plastic_law="von_mises", residual=ResidualConfig(latent_size=2, hidden=4)),
    "all terms": Case(terms=tuple(term for term in VOLUME_TERMS if term not in BRANCH_TERMS), led=True),
    "all terms, branches": Case(terms=VOLUME_TERMS, led=True),
    "drag, density": Case(terms=("drag", "density")),
    "shell": Case(body="shell", held=True, terms=SHELL_TERMS, led=True),
    "rod": Case(body="rod", held=True, terms=ROD_TERMS, led=True),
    "limbs": Case(body="fork", held=True, terms=("drag", "density"), led=True),
    "blocks that touch": Case(terms=("drag", "density"), body="blocks", touching=True),
    "block and wall": Case(terms=("drag", "density"), walled=True),
    "shell and wall": Case(body="shell", held=True, terms=("bending",), walled=True),
    "sheets that touch": Case(body="sheets", terms=("bending",), touching=True),
    "ropes that touch": Case(body="ropes", terms=("bending",), touching=True),
    "shell, residual": Case(body="shell", residual=THIN_RESIDUAL, held=True, terms=SHELL_TERMS),
    "rod, residual": Case(body="rod", residual=THIN_RESIDUAL, held=True, terms=ROD_TERMS),
}
PLASTIC = {"identity": (0.0, 0.0), "von_mises": (20.0, 1.0), "drucker_prager": (0.4, 5.0)}


def scene(case: Case, device: str, dtype: str) -> tuple[Simulator, dict, torch.Tensor]:
    """A soft body thrown over the ground and pulled at: simulator, parameters' leaves by name, controller points."""
    body = BODIES[case.body]()
    x0, count = body.x0, len(body.x0)
    points = np.array([[0.0, 0.0, 0.06], [0.02, 0.0, 0.06]])
    particles = np.arange(min(10, count // 3))
    lengths = np.linalg.norm(x0[particles] - points[particles % 2], axis=1)
    config = SimulationConfig(
        fps=60.0, elastic_law=case.elastic_law, plastic_law=case.plastic_law, residual=case.residual, terms=case.terms,
        dtype=dtype, device=device, self_contact=case.touching,
    )  # fmt: skip
    clamps, loads = (), ()
    if case.held:
        clamps = (Clamp((-1.0, 0.045, -1.0), (1.0, 1.0, 1.0)),)
        tip = np.flatnonzero(x0[:, 0] > 0.04)
        loads = (PointLoad(tip, np.ones(len(tip)), (0.001, 0.0, 0.002)),)
    grip = Grip(particles, particles % 2, np.ones(len(particles)), lengths)
    simulator = Simulator(body, config, grip, clamps, loads, solids=wall(body) if case.walled else None)
    generator = torch.Generator().manual_seed(0)

    def leaf(value) -> torch.Tensor:
        return torch.as_tensor(value, dtype=torch.float64).clone().requires_grad_()

    leaves = {
        "youngs_modulus": leaf(
            MODULI[case.body] * (1 + 0.2 * torch.rand(count, generator=generator, dtype=torch.float64))
        ),
        "poissons_ratio": leaf(torch.full((count,), 0.3)),
        "friction_coefficient": leaf(0.3),
        "grip_stiffness": leaf(0.3),
        "grip_damping": leaf(0.005),
        "initial_velocity": leaf(torch.tensor([0.5, 0.2, 0.0]).expand(count, 3)),
    }
    if case.plastic_law != "identity":
        leaves["plastic"] = leaf(torch.tensor(PLASTIC[case.plastic_law]).expand(count, 2))
    if case.residual is not None:
        names = ("elastic",) if case.residual.thin else ("elastic", "plastic")
        for name, weights in zip(names, initial_weights(case.residual, 0), strict=False):
            noise = torch.randn(weights.shape, generator=generator, dtype=torch.float64)
            leaves[f"network_{name}"] = leaf(weights + 0.3 * noise)
            leaves[f"latent_{name}"] = leaf(torch.randn(count, 2, generator=generator, dtype=torch.float64))
    if case.touching:
        leaves["layer_friction"] = leaf(0.4)
        leaves["friction_coefficient"].requires_grad_(case.body == "blocks")  # the others are above the ground
        upper = x0[:, 2:] > x0[:, 2].mean()
        leaves["initial_velocity"] = leaf([0.5, 0.2, 0.0] + np.where(upper, -0.2, 0.2) * [1.0, 0.5, 1.0])
    if case.body in ("rod", "ropes"):
        leaves["poissons_ratio"].requires_grad_(False)  # a rod does not feel it
    if case.walled:
        leaves |= {"solid_reach": leaf(0.9 * body.reach), "solid_stiffness": leaf(1e5), "solid_friction": leaf(0.4)}
    given = term_values(x0)
    leaves |= {name: leaf(given[name]) for term in case.terms for name in TERMS[term]}
    time = torch.linspace(0, 1, FRAMES, dtype=torch.float64)[:, None, None]
    return simulator, leaves, torch.as_tensor(points) + time * torch.tensor([0.01, 0.005, 0.01])


def wall(body: Body) -> Solids:
    """A ball before the body, towards which it is thrown."""
    cell, radius, middle = 0.004, 0.05, body.x0.max(0) * [1.0, 0.5, 0.5] + [0.051 + body.reach.max(), 0.0, 0.0]
    places = np.stack(np.meshgrid(*[cell * np.arange(-20, 21)] * 3, indexing="ij"), -1)
    return Solids(np.linalg.norm(places, axis=-1) - radius, middle - 20 * cell, cell)


def term_values(x0: np.ndarray) -> dict[str, torch.Tensor]:
    """Parameters of all optional terms for a body that starts at x0 [N, 3] and runs into a post."""
    count, generator = len(x0), torch.Generator().manual_seed(3)

    def random(*shape: int) -> torch.Tensor:
        return 0.5 + torch.rand(shape, generator=generator, dtype=torch.float64)

    direction = random(count, 3)
    own = {
        "gravity": torch.tensor([1.0, 0.5, -9.0], dtype=torch.float64),
        "density": 300.0 * random(count),
        "force": 1e-4 * random(count, 3),
        "initial_position": torch.as_tensor(x0) + 1e-4 * random(count, 3),
        "initial_deformation": torch.eye(3, dtype=torch.float64) + 0.02 * random(count, 3, 3),
        "adhesion_range": torch.tensor(1e-3, dtype=torch.float64),
        "obstacle": torch.tensor([0.07, 0.03, 0.01, 0.0, 0.01, 0.01, 0.02, 1e4], dtype=torch.float64),
        "fibre_direction": direction / direction.norm(dim=1, keepdim=True),
        "friction_law": torch.tensor([0.2, 0.3, 0.1], dtype=torch.float64),
    }
    named = {name: field for term in VOLUME_TERMS for name, field in TERMS[term].items()}
    fields = {name: field for name, field in named.items() if name not in own}
    shapes = term_shapes(VOLUME_TERMS, count)
    own |= {name: field.visible * random(*shapes[name]) for name, field in fields.items()}
    thin = {name: field for term in ("bending", "fabric", "surface_drag") for name, field in TERMS[term].items()}
    return own | {name: (field.visible or 1.0) * random(count) for name, field in thin.items()}


def run(case: Case, device: str, dtype: str) -> dict[str, np.ndarray]:
    """States at the last frame and gradients of a random loss, by name."""
    simulator, leaves, controllers = scene(case, device, dtype)
    points = controllers.clone().requires_grad_(case.led)
    states = simulator.rollout(Parameters(**leaves), points)
    random_loss(states).backward()
    leaves |= {"controllers": points} if case.led else {}
    numbers = {"x": states.x[-1], "v": states.v[-1], "F": states.F[-1]}
    numbers |= {f"gradient {name}": tensor.grad for name, tensor in leaves.items() if tensor.requires_grad}
    return {name: tensor.detach().double().cpu().numpy() for name, tensor in numbers.items()}


def random_loss(states: States) -> torch.Tensor:
    """Every entry of x, v and F of all frames, weighed at random."""
    generator = torch.Generator().manual_seed(1)
    loss = 0.0
    for values, scale in ((states.x, 1.0), (states.v, 0.1), (states.F, 0.1)):
        loss = loss + scale * (values * torch.randn(values.shape, generator=generator).to(values)).sum()
    return loss


def reference(name: str, dtype: str, live: bool) -> dict[str, np.ndarray]:
    """The CPU's numbers: computed now, or as `--write` left them (float64, for both widths)."""
    if live:
        return run(CASES[name], "cpu", dtype)
    with np.load(REFERENCE) as stored:
        return {key.split("/")[1]: stored[key].astype(float) for key in stored.files if key.split("/")[0] == name}


def differences(name: str, device: str, dtype: str, live: bool) -> dict[str, float]:
    """Relative difference of every number (Euclidean norm of the difference over that of the reference)."""
    ours, theirs = run(CASES[name], device, dtype), reference(name, dtype, live)
    return {key: float(np.linalg.norm(ours[key] - theirs[key]) / np.linalg.norm(theirs[key])) for key in theirs}


def write(names: list[str]) -> None:
    """Store the CPU's float64 numbers of some scenes; those of the others stay as they are."""
    arrays = {}
    if REFERENCE.is_file():
        with np.load(REFERENCE) as stored:
            arrays = {key: stored[key] for key in stored.files if key.split("/")[0] in CASES.keys() - set(names)}
    arrays |= {f"{name}/{key}": value for name in names for key, value in run(CASES[name], "cpu", "float64").items()}
    REFERENCE.parent.mkdir(exist_ok=True)
    np.savez_compressed(REFERENCE, **arrays)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cuda:0")
    parser.add_argument("--live", action="store_true", help="compute the CPU's numbers here instead of reading them")
    parser.add_argument("--write", action="store_true", help="store the CPU's numbers and stop")
    parser.add_argument("--scenes", nargs="+", choices=CASES, default=list(CASES))
    args = parser.parse_args()
    if args.write:
        write(args.scenes)
        return
    card = torch.cuda.get_device_name(args.device) if args.device.startswith("cuda") else "CPU"
    print(f"{card} against the CPU, relative differences\n")
    print("| scene | width | states | gradients | worst |\n|---|---|--:|--:|---|")
    failed = False
    for dtype, tolerance in TOLERANCES.items():
        for name in args.scenes:
            found = differences(name, args.device, dtype, args.live)
            worst = max(found, key=found.get)
            states, gradients = (
                max(v for k, v in found.items() if k.startswith("gradient") == g) for g in (False, True)
            )
            failed |= not max(states, gradients) <= tolerance
            print(f"| {name} | {dtype} | {states:.1e} | {gradients:.1e} | {worst} |", flush=True)
    print("\nAbove the tolerances" if failed else "\nWithin the tolerances", TOLERANCES)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
