"""Shells and ropes beside closed forms, and bodies that touch themselves beside what they must come to: `python -m benchmarks.thin.closed_forms [--out FOLDER]`

Writes `closed_forms` (relative errors of the finest mesh by name) into thin.json, and thin_closed_forms.md.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch

from benchmarks.thin import dynamics, statics, touching
from benchmarks.thin.results import RESULTS, write_part


@dataclass(frozen=True)
class Case:
    """A closed form.

    Args:
        form: gives (found, expected) for a number of cells or segments.
        cells: coarse and fine.
        within: relative error that the finest must not exceed.
    """

    form: Callable[[int], tuple[float, float]]
    cells: tuple[int, ...]
    within: float

    def errors(self, finest: bool = True) -> list[float]:
        """Relative error with each number of cells; without the finest if asked."""
        found = [self.form(cells) for cells in self.cells[: None if finest else -1]]
        return [value / expected - 1.0 for value, expected in found]


_S, _D, _T = statics, dynamics, touching
CASES = {
    "cantilever_small": Case(_S.cantilever_small, (5, 10, 16), 0.01),
    "cantilever_large": Case(_S.cantilever_large, (5, 10, 20), 0.01),
    "cantilever_irregular": Case(_S.cantilever_irregular, (6, 10, 16), 0.03),
    "cantilever_poisson": Case(_S.cantilever_poisson, (5, 10, 20), 0.01),
    "cantilever_rope": Case(_S.cantilever_rope, (5, 10, 20), 0.01),
    "drape": Case(_S.drape, (5, 10, 14), 0.03),
    "catenary_strip": Case(_S.catenary_strip, (10, 20, 30), 0.01),
    "catenary_rope": Case(_S.catenary_rope, (10, 20, 30), 0.01),
    "stretch_strip": Case(_S.stretch_strip, (5, 10, 16), 0.01),
    "stretch_rope": Case(_S.stretch_rope, (5, 10, 20), 0.001),
    "plate_twist": Case(_S.plate_twist, (4, 6, 10), 0.01),
    "plate_bent": Case(_S.plate_bent, (4, 6, 12), 0.01),
    "plate_anticlastic": Case(_S.plate_anticlastic, (4, 6, 12), 0.05),
    "frequency_strip": Case(_D.frequency_strip, (6, 10, 16), 0.01),
    "frequency_rope": Case(_D.frequency_rope, (6, 10, 16), 0.01),
    "torsion_rope": Case(_D.torsion_rope, (10, 20, 40), 0.01),
    "swing_of_chain": Case(_D.swing_of_chain, (6, 10, 16), 0.01),
    "decay_strip": Case(_D.decay_strip, (5, 6, 10), 0.01),
    "return_strip": Case(_D.return_strip, (5, 6, 10), 0.01),
    "rigid_motion": Case(_D.rigid_motion_sheet, (4, 6, 10), 1e-9),
    "energy_sheet": Case(_D.energy_sheet, (6, 10, 16), 0.01),
    "energy_rope": Case(_D.energy_rope, (6, 10, 20), 0.01),
    "slabs_part": Case(_T.slabs_part, (2, 3, 4), 1e-9),
    "slide_strip": Case(_T.slide_strip, (12, 20, 30), 0.03),
    "slide_block": Case(_T.slide_block, (2, 3, 4), 0.03),
    "rest_fold": Case(_T.rest_fold, (10, 20, 30), 0.1),
    "rest_block": Case(_T.rest_block, (3, 4, 5), 0.1),
    "cloth_opens": Case(_T.cloth_opens, (12, 20, 30), 0.02),
    "loop_pulled": Case(_T.loop_pulled, (40, 60, 90), 0.5),
}
"""By name; the functions say what is compared."""


def markdown(errors: dict[str, list[float]]) -> str:
    """The table."""
    lines = [
        "# Shells and ropes beside closed forms, and bodies that touch themselves",
        "`python -m benchmarks.thin.closed_forms` (one thread; float64, but float32 where bodies slide, fold and open)",
        "",
        "Relative error of three meshes, coarse to fine; cells or segments in brackets. Energies are those gained in a second over what the body",
        "falls from. A clamp acts half way between the last two held rows of vertices. From `slabs_part` on bodies touch themselves: what slides",
        "has a friction of 0.3 on a slope of 0.5 rad, and numbers in brackets are particles across a volume's thickness there. Strands of the rope",
        "that is pulled sink into each other where they cross, by less than half a diameter: they do not pass through.",
        "",
        "| case | what is compared | coarse | middle | fine |",
        "|---|---|--:|--:|--:|",
    ]
    for name, values in errors.items():
        shown = [f"{100.0 * value:+.2f} % ({cells})" for value, cells in zip(values, CASES[name].cells, strict=True)]
        what = (CASES[name].form.__doc__ or "").split("\n")[0].rstrip(".")
        lines.append(f"| `{name}` | {what} | {' | '.join(shown)} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=RESULTS)
    out = parser.parse_args().out
    torch.set_num_threads(1)
    errors = {}
    for name, case in CASES.items():
        begun = time.perf_counter()
        errors[name] = case.errors()
        print(f"{name}: {errors[name]} in {time.perf_counter() - begun:.1f} s", flush=True)
    write_part("closed_forms", {name: abs(values[-1]) for name, values in errors.items()}, out)
    (out / "thin_closed_forms.md").write_text(markdown(errors))
    print(markdown(errors))


if __name__ == "__main__":
    main()
