"""`python -m benchmarks.gap`: run cases, score them, write results."""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from benchmarks.gap.calibration import calibrate
from benchmarks.gap.cases import SHAPE_OF, benchmark_cases, chosen
from benchmarks.gap.filming import FILMED, PERCEIVED
from benchmarks.gap.results import collect, pool, write_results
from benchmarks.gap.rows import FOLDER
from benchmarks.gap.run import Run, run_cases
from physreal_core.effects import EFFECTS


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command with `arguments`; default: those of the command line."""
    parsed = _parser().parse_args(arguments)
    folder = parsed.out / parsed.variant
    of_video = parsed.variant in SHAPE_OF
    settings = () if parsed.settings is None else (str(parsed.settings.resolve()),)
    arguments = (SHAPE_OF[parsed.variant],) if of_video else settings
    module = "benchmarks.gap.rgbd" if of_video else "benchmarks.gap.case"
    how = Run(folder, parsed.jobs, module, arguments, parsed.cards, parsed.minutes)
    if parsed.pool:
        commit, rows = pool(parsed.rows, parsed.variant, parsed.commit)
        print(f"searched by {commit}\n\n{write_results(parsed.variant, rows, parsed.results)}")
        return
    if parsed.calibrate:
        print(calibrate(parsed.calibrate, parsed.seed, how))
        return
    cases = benchmark_cases(EFFECTS, variant=parsed.variant, seed=parsed.seed)
    if parsed.list:
        print("\n".join(case.name for case in chosen(cases, parsed.cases)))
        return
    if parsed.film:
        filmed = (
            replace(how, arguments=(*arguments, "--perceive"), files=(*FILMED, PERCEIVED))
            if of_video
            else replace(how, module="benchmarks.gap.filming", arguments=(), files=FILMED)
        )
        run_cases(chosen(cases, parsed.cases), filmed)
        return
    of_set = {"folder": folder, "rows": parsed.rows, "variant": parsed.variant, "seed": parsed.seed}
    if not parsed.score:
        run_cases(chosen(cases, parsed.cases), how, lambda case: collect([case], **of_set))
    rows = collect(cases, **of_set)
    print(write_results(parsed.variant, rows, parsed.results, len(cases) - len(rows)))


def _parser() -> argparse.ArgumentParser:
    description = "How often the search is right, on captures with a hidden effect."
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gap", description=description)
    variant = parser.add_mutually_exclusive_group()
    variant.add_argument("--tracks-only", action="store_const", dest="variant", const="tracks_only", help="default")
    variant.add_argument(
        "--rgbd", action="store_const", dest="variant", const="rgbd", help="through the whole pipeline"
    )
    variant.add_argument(
        "--rgbd-seen",
        action="store_const",
        dest="variant",
        const="rgbd_seen",
        help="the same without the object's shape and box, which are found in the video",
    )
    variant.add_argument(
        "--thin", action="store_const", dest="variant", const="thin", help="a rope and a cloth, from tracks alone"
    )
    parser.add_argument("--seed", type=int, default=0, help="of the set of cases")
    parser.add_argument("--jobs", type=int, default=1, help="cases at once; each gets its share of the cores")
    parser.add_argument("--cards", type=int, default=0, help="NVIDIA cards that the cases share; 0: on the CPU")
    parser.add_argument("--out", type=Path, default=Path("data/gap_benchmark"), help="folder of the cases")
    parser.add_argument("--cases", nargs="*", default=[], help="patterns of names, e.g. 'none-*' 'wind-high-*'; all")
    parser.add_argument("--minutes", type=float, help="stop then, to go on the next time")
    parser.add_argument("--settings", type=Path, help="JSON with values laid over the search's settings")
    parser.add_argument("--results", type=Path, default=Path("results"), help="where the score is written")
    parser.add_argument("--score", action="store_true", help="score what is there, run nothing")
    parser.add_argument("--rows", type=Path, default=FOLDER, help="folder of the answers as rows")
    parser.add_argument("--pool", action="store_true", help="score all sets that one commit searched, run nothing")
    parser.add_argument("--commit", help="with --pool: which; the one with the most rows")
    parser.add_argument("--list", action="store_true", help="list the cases and stop")
    parser.add_argument(
        "--film",
        action="store_true",
        help="make what is missing of captures, and of what is seen in their video; search nothing",
    )
    parser.add_argument("--calibrate", type=int, metavar="N", help="run N further captures without an effect instead")
    parser.set_defaults(variant="tracks_only")
    return parser
