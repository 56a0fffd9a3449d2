"""What each effect of the library does to a rope, a cloth and a volume: `python -m benchmarks.thin.effects [--captures FOLDER] [--out FOLDER]`

The rig's rope, cloth and bar are lifted and swung, and swept over the table. Each effect acts with the size that `Coefficient.scale` calls plainly
visible, at the place or in the direction of its starts where it does most. Written is how far it takes the points that are tracked from
where they are without it: the root mean square over points and frames, in the motion that shows it more. Writes thin_effects.md and `effects`
of thin.json.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
import torch

from benchmarks.gap.problems import baseline_model, problems_of
from benchmarks.thin.results import RESULTS, write_part
from physreal_core.array_types import Array
from physreal_core.effects import EFFECTS, Effect, lacking
from physreal_core.gap import Experiment, Trial

BODIES = {"rope": "a rope", "cloth": "a cloth", "bar": "a volume"}
SEED = 1


def captured(body: str, folder: Path) -> None:
    """Captures of a body with nothing hidden, in the two motions of a plain session, where they are not there yet."""
    from data.rig.case import Case, make_case

    if not folder.is_dir():
        make_case(Case("none", "middle", SEED, body), folder, video=False)


def moved(effect: Effect, experiments: list[Experiment]) -> float | str:
    """How far an effect takes the tracked points [m], or why it does not act."""
    if reason := lacking(effect, experiments[0].setting.body):
        return reason
    return max(_moved(effect, experiment) for experiment in experiments)


def _moved(effect: Effect, experiment: Experiment) -> float:
    plain = Trial(experiment.model.fields)
    starts = effect.starts(experiment.setting, experiment.motion(plain))
    trials = [Trial(plain.fields, {effect.name: _acting(effect, start)}) for start in starts]
    first, *others = experiment.predict([plain, *trials])
    ended = [other for other in others if np.isfinite(other).all()]
    if trials and not ended:
        raise ArithmeticError(f"no rollout with {effect.name} ends")
    return max((_apart(other, first) for other in ended), default=0.0)


def _acting(effect: Effect, start: dict[str, float]) -> dict[str, float]:
    """The start's coefficients, and of those that it leaves dormant the amplitudes at their scale."""
    values = effect.dormant | start
    for c in effect.coefficients:
        if c.kind == "amplitude" and values[c.name] == c.dormant:
            sign = -1.0 if c.upper <= c.dormant else 1.0
            values[c.name] = float(np.clip(c.dormant + sign * c.scale, c.lower, c.upper))
    return values


def _apart(one: Array, other: Array) -> float:
    """Root mean square distance [m]."""
    return float(np.sqrt(((one - other) ** 2).sum(-1).mean()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--captures", type=Path, help="folder of the captures; one that is thrown away by default")
    parser.add_argument("--out", type=Path, default=RESULTS)
    parsed = parser.parse_args()
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as scratch:
        found = {body: _of_body(body, (parsed.captures or Path(scratch)) / body) for body in BODIES}
    write_part("effects", found, parsed.out)
    (parsed.out / "thin_effects.md").write_text("\n".join(_page(found)) + "\n")


def _of_body(body: str, folder: Path) -> dict[str, float | str]:
    captured(body, folder)
    problems = list(problems_of(folder).values())
    model = baseline_model(problems[0])
    experiments = [Experiment(problem, model) for problem in problems]
    found = {}
    for name, effect in EFFECTS.items():
        found[name] = moved(effect, experiments)
        print(body, name, found[name], flush=True)
    return found


def _page(found: dict[str, dict[str, float | str]]) -> list[str]:
    lines = [
        "# What each effect does to a rope, a cloth and a volume",
        "",
        "`python -m benchmarks.thin.effects` (one thread, float32). Root mean square distance [mm] by which an effect of the size that the library",
        "calls plainly visible takes tracked points from where they are without it, in the motion that shows it more: lifted and swung, or swept",
        "over the table. The rig's rope of 0.3 m, mat of felt of 0.24 m and foam bar of 0.24 m, at the material from which a search starts.",
        "",
        f"| effect | {' | '.join(BODIES.values())} |",
        "|---|" + "--:|" * len(BODIES),
    ]
    return lines + [f"| `{name}` | {' | '.join(_cell(found[body][name]) for body in BODIES)} |" for name in EFFECTS]


def _cell(value: float | str) -> str:
    return value if isinstance(value, str) else f"{1e3 * value:.1f}"


if __name__ == "__main__":
    main()
