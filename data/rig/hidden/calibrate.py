"""`python -m data.rig.hidden.calibrate [effect ...]`: finds the amplitudes of `strengths.py` and prints its table.

The size of an effect is how far it takes the tracks from the nearest purely elastic bar: the same bar without the effect, at
the Young's modulus that comes nearest, because a fit of the baseline is free to choose that. Root mean square over points and
frames, of the motion that shows it more, averaged over seeds.
"""

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

from data.rig.hidden.effect import NOTHING
from data.rig.hidden.library import LIBRARY, Staging
from data.rig.hidden.strengths import AMPLITUDES, LARGEST, TARGETS
from data.rig.session import PLAIN
from data.rig.specimen import specimen
from data.rig.visibility import Yardstick

TRIALS = 2


YARDSTICKS: dict[int, Yardstick] = {}
"""By seed: what effects in a bar are held against, in the plain session."""


def know_yardsticks(seeds: int) -> None:
    """Fill `YARDSTICKS` with such as have simulated the bars without an effect."""
    for seed in range(seeds):
        YARDSTICKS[seed] = Yardstick(specimen("bar", seed), PLAIN)
        YARDSTICKS[seed].seen(NOTHING)


def size(name: str, amplitude: float, seed: int) -> float:
    """Distance [m] of the effect's tracks from the nearest elastic bar's."""
    bar = specimen("bar", seed)
    staging = Staging(bar.body, bar.scene("lift_swing"))
    return YARDSTICKS[seed].seen(LIBRARY[name](amplitude, staging, np.random.default_rng([seed, 10])))


def amplitudes(name: str, seeds: int) -> tuple[float, ...]:
    """Of one effect, at each of `TARGETS`, averaged over so many seeds: secants in the logarithms of amplitude and size."""
    known: dict[float, float] = {}

    def measure(amplitude: float) -> None:
        known[amplitude] = max(float(np.mean([size(name, amplitude, seed) for seed in range(seeds)])), 1e-5)

    measure(AMPLITUDES[name][1])
    for target in TARGETS:
        for _ in range(TRIALS):
            amplitude = _guess(name, known, target)
            if any(abs(np.log(amplitude / tried)) < 0.05 for tried in known):
                break
            measure(amplitude)
    found = [_guess(name, known, target) for target in TARGETS]
    if found[-1] >= LARGEST.get(name, np.inf):
        found[1:] = [min(found[1], (found[0] * found[2]) ** 0.5), found[2]]
    print(f'    "{name}": ({", ".join(f"{a:.3g}" for a in found)}),  # {_listed(known)}', flush=True)
    return tuple(found)


def _guess(name: str, known: dict[float, float], target: float) -> float:
    """Where a line through the two points nearest to the target meets it; at most four times beyond what was tried."""
    near = sorted(known, key=lambda amplitude: abs(np.log(known[amplitude] / target)))[:2]
    slope = 1.0
    if len(near) == 2:
        slope = np.log(known[near[1]] / known[near[0]]) / np.log(near[1] / near[0])
    step = np.log(target / known[near[0]]) / np.clip(slope, 0.3, 4.0)
    return min(float(near[0] * np.exp(np.clip(step, -np.log(4), np.log(4)))), LARGEST.get(name, np.inf))


def _listed(known: dict[float, float]) -> str:
    return ", ".join(f"{amplitude:.3g}: {1000 * known[amplitude]:.2f} mm" for amplitude in sorted(known))


def main() -> None:
    """Reads the command line."""
    parser = argparse.ArgumentParser(prog="python -m data.rig.hidden.calibrate", description=__doc__)
    parser.add_argument("effects", nargs="*", default=list(LIBRARY))
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seeds", type=int, default=2, help="how many objects to average over")
    arguments = parser.parse_args()
    know_yardsticks(arguments.seeds)
    with ProcessPoolExecutor(arguments.jobs) as pool:  # forked from here, so that they share it
        list(pool.map(partial(amplitudes, seeds=arguments.seeds), arguments.effects))


if __name__ == "__main__":
    main()
