"""Where the fit of a baseline begins, and what happens where it cannot."""

import numpy as np

from physreal_core.gap.fits.baseline import local_minima
from physreal_core.gap.fits.least_squares import Data, fit, together
from tests.gap.linear import ANSWERS, LinearExperiment, baseline


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
