"""Where the fit of a baseline begins, and what happens where it cannot."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physreal_core.gap.fits.baseline import _from_a_guess, _limits, local_minima
from physreal_core.gap.fits.least_squares import Data, fit, together
from physreal_core.gap.fits.unknowns import Priors, Unknowns
from physreal_core.gap.settings import GapSettings
from tests.gap import linear
from tests.gap.linear import ANSWERS, LinearExperiment, baseline
from tests.gap.test_predictions import experiment


def test_valleys_are_the_places_without_a_deeper_neighbour():
    stiffness, friction = np.meshgrid(np.arange(6.0), np.arange(5.0), indexing="ij")
    energies = np.minimum((stiffness - 1) ** 2 + friction**2, 2 + (stiffness - 4) ** 2 + (friction - 4) ** 2)
    assert local_minima(energies) == [(1, 0), (4, 4)]
    energies[1, 0] = np.inf  # a rollout that failed
    assert local_minima(energies)[0] != (1, 0)


def test_a_fit_that_cannot_begin_is_never_the_best():
    experiment = LinearExperiment(ANSWERS, {})
    data = Data([experiment], [experiment.noise()])
    whole = baseline(experiment, data)
    experiment.predict = lambda trials, frames=None, discretisation=None: np.full(
        (len(trials), frames or experiment.frames, len(experiment.points0), 3), np.nan
    )
    (failed,) = together([fit(whole.unknowns, data, whole.vector[None], 3)])
    assert failed.energy == np.inf and np.isfinite(failed.vector).all()
    assert min([whole, failed], key=lambda found: found.energy) is whole


class Swinging(LinearExperiment):
    """Twelve swings, faster by the root of the modulus: off by 9 % in that, the last one is half a swing late."""

    def _one(self, trial):
        modulus = float(trial.fields["youngs_modulus"].double().log().mean().exp())
        phase = 24 * np.pi * np.sqrt(modulus / 1e5) * np.linspace(0, 1, linear.FRAMES)
        return np.broadcast_to(self.points0, (linear.FRAMES, linear.TRACKS, 3)) + 0.02 * np.sin(phase)[:, None, None]


def test_the_right_one_of_many_narrow_minima_is_found_between_the_moduli_of_the_grid(monkeypatch):
    """The grid's steps are twice as wide as a well."""
    for name, value in (("FRAMES", 120), ("TRAIN", 110)):
        monkeypatch.setattr(linear, name, value)
    experiment = Swinging({}, {})
    settings = GapSettings(scan=tuple(0.95 * 1.2**step for step in range(-5, 6)), elastic_laws=())
    unknowns = Unknowns(experiment.model.fields, (), Priors(), scalars=())
    found, _ = _from_a_guess([experiment], unknowns, settings, lambda message: None)
    best = min(found, key=lambda own: own.energy)
    np.testing.assert_allclose(
        np.exp(best.vector[: unknowns.patches]).prod() ** 0.5, 1e5 * np.sqrt(1.2 * 0.9), rtol=5e-3
    )


def test_a_place_is_bounded_where_the_object_lies_in_the_first_interaction():
    own = experiment()
    first = _limits(own)["payload"]
    rotation, translation = Rotation.from_rotvec([0.3, -0.2, 1.0]).as_matrix(), np.array([0.2, -0.1, 0.05])
    body = own.setting.body
    there = replace(body, x0=body.x0 @ rotation.T + translation)
    own.setting, own.placement = replace(own.setting, body=there), (rotation, translation)
    second = _limits(own)["payload"]
    assert first.keys() == second.keys() == set("xyz")
    for axis in "xyz":
        assert second[axis] == pytest.approx(first[axis])
