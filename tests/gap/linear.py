"""A made-up world that is linear in its unknowns: the closed form of every fit is known."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import torch

from physreal_core.effects import EFFECTS, Coefficient, Effect, Setting
from physreal_core.fitting.model import Model
from physreal_core.gap.fits.least_squares import Data, Fit, fit, together
from physreal_core.gap.fits.unknowns import Priors, Unknowns
from physreal_core.gap.noise.model import ModelError, Noise
from physreal_core.simulation import Body, SimulationConfig

FRAMES, TRAIN, TRACKS, SIGMA = 10, 7, 6, 1e-3
FIELDS = {
    "youngs_modulus": torch.full((2,), 1e5, dtype=torch.float64),
    "poissons_ratio": torch.full((2,), 0.3, dtype=torch.float64),
}


@dataclass
class MadeUp(Effect):
    """An effect of one or two coefficients, the first of fixed sign."""

    name: str
    coefficients: tuple[Coefficient, ...]
    family: str
    distinguished_by = "a longer recording"


def register(monkeypatch) -> None:
    """Puts `sink`, of one coefficient of fixed sign, and `drift`, of two, each a family of its own, into the registry for a test."""
    one = Coefficient("amount", "m", "sinking", 0.0, 0.0, 10.0, 1.0)
    two = tuple(Coefficient(name, "m", "drift", 0.0, -10.0, 10.0, 1.0) for name in ("east", "north"))
    for effect in (MadeUp("sink", (one,), "sink"), MadeUp("drift", two, "drift")):
        monkeypatch.setitem(EFFECTS, effect.name, effect)


def ramp(direction, power: float) -> np.ndarray:
    time = np.linspace(0, 1, FRAMES)[:, None, None] ** power
    return np.broadcast_to(1e-2 * time * np.asarray(direction, float), (FRAMES, TRACKS, 3))


ANSWERS = {
    "sink": {"amount": ramp((0, 0, -1), 1.0)},
    "drift": {"east": ramp((1, 0, 0), 2.0), "north": ramp((0, 1, 0), 2.0)},
}


def baseline(experiment: "LinearExperiment", data: Data, iterations: int = 8) -> Fit:
    """The fit without effects."""
    unknowns = Unknowns(experiment.model.fields, (), Priors(), scalars=())
    (found,) = together([fit(unknowns, data, unknowns.start()[None], iterations)])
    return found


class LinearExperiment:
    """Tracks answer linearly to the logarithms of two moduli and to the coefficients of named effects.

    Args:
        answers: by effect and coefficient, the tracks' change per SI unit, shape [T, J, 3].
        truth: coefficients by effect.
    """

    def __init__(self, answers: dict, truth: dict, seed: int = 0) -> None:
        random = np.random.default_rng(seed)
        self.points0 = random.uniform(-0.1, 0.1, (TRACKS, 3))
        time = np.linspace(0, 1, FRAMES)[:, None, None]
        self._to_E = [2e-2 * time * random.standard_normal((1, TRACKS, 3)) for _ in range(2)]
        self._answers, self.train, self.frames = answers, TRAIN, FRAMES
        self.valid = random.random((FRAMES, TRACKS)) > 0.1
        self.valid[0] = False
        self.sensor = self.sigma = np.full(self.valid.shape, SIGMA)
        self.correlation = 0.0
        self.model = Model(elastic_law="hencky", plastic_law="identity", fields=FIELDS)
        body = Body(self.points0, np.ones(TRACKS), np.ones(TRACKS), 0.01)
        still = torch.zeros(FRAMES, 0, 3)
        self.setting = Setting(body, None, (), 30.0, (0.0, 0.0, -9.81), None, still)
        self.placement, self.config = None, SimulationConfig(fps=30)
        self.hand_modes = np.zeros((0, FRAMES))
        self.device = "cpu"
        fields = {**FIELDS, "youngs_modulus": FIELDS["youngs_modulus"] * torch.tensor([1.2, 0.9], dtype=torch.float64)}
        exact = self.predict([SimpleNamespace(fields=fields, effects=truth)])[0]
        self.measured = exact + SIGMA * random.standard_normal(exact.shape)

    def predict(self, trials, frames=None, discretisation=None) -> np.ndarray:
        return np.stack([self._one(trial)[: frames or FRAMES] for trial in trials])

    def _one(self, trial) -> np.ndarray:
        points = np.broadcast_to(self.points0, (FRAMES, TRACKS, 3)).copy()
        for change, E in zip(self._to_E, trial.fields["youngs_modulus"].tolist(), strict=True):
            points += change * np.log(E / 1e5)
        for name, values in trial.effects.items():
            for key, value in values.items():
                points += self._answers[name][key] * value
        return points

    def predict_with_start_sensitivity(self, trials, frames=None) -> list[tuple[np.ndarray, np.ndarray]]:
        return [(tracks, np.zeros((3, frames or FRAMES, TRACKS, 3))) for tracks in self.predict(trials, frames)]

    def motion(self, trial):
        return None

    def coarsened(self, factor):
        return None

    def noise(self) -> Noise:
        sigma, valid = self.sigma[:TRAIN], self.valid[:TRAIN]
        motion = np.broadcast_to(self.points0, (TRAIN, TRACKS, 3))
        error = ModelError(rms=1e-4)
        carried = np.zeros((3, TRAIN, TRACKS, 3))
        return Noise(sigma, valid, self.points0, motion, np.zeros((0, TRAIN, TRACKS, 3)), carried, 30.0, error)
