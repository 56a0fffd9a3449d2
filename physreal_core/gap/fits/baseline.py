"""The baseline: the model without a missing effect, fitted to all interactions at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.checkpoints import remembered
from physreal_core.effects import EFFECTS, Limits
from physreal_core.errors import InputError
from physreal_core.gap.fits.evidence import Evidences
from physreal_core.gap.fits.finishing import RULED_OUT, continued
from physreal_core.gap.fits.least_squares import Data, Fit, fit, together
from physreal_core.gap.fits.unknowns import Unknowns
from physreal_core.gap.fits.whitening import rewhitened
from physreal_core.gap.interactions.interaction import Interaction, Trial
from physreal_core.gap.interactions.quick import quick_around
from physreal_core.gap.noise.measurements import Measurements, possible_laws
from physreal_core.gap.settings import GapSettings

Progress = Callable[[str], None]
"""Called with a line of text now and then."""

Fields = Mapping[str, Tensor]
"""A material, as of `Model.fields`."""

HORIZONS = (0.35, 0.65)
"""Shares of the training frames over which a fitted model is refitted first.

A swing whose frequency is a little wrong has other minima once it is half a period late."""

FRICTIONS = (0.4, 1.0, 2.5)
"""Factors on a guessed coefficient of friction, among which the fit of a guessed model looks for its start."""

LIKE, ROUNDS = 0.2, 3
"""Difference of the logarithms of two sizes of the model's error that does not matter, and how often the size is learnt anew from what the
baseline leaves."""

MINIMA = 2
"""Local minima on the grid of modulus and friction, from which a guessed model is fitted."""

EARLY = 0.35
"""Share of the training frames over which the grid is judged, too: a body that swings many times has a narrow minimum for each swing that it is
ahead or behind, and over a few swings the right one is wide."""

NEARER = tuple(1.2 ** (step / 6) for step in range(-5, 6))
"""Factors on the modulus of a minimum on the grid, among which it is looked for again: its well may be narrower than the grid."""


def fit_baseline(
    experiments: Sequence[Interaction],
    settings: GapSettings,
    progress: Progress = lambda message: None,
    begun: Fields | None = None,
) -> tuple[Fit, Measurements]:
    """Fit the baseline to all interactions at once, and build the noise models around it.

    Patches that adapt to a disagreement too early lead into poor minima. So a baseline with one modulus for all patches
    is fitted first, and the patches are set free at the end. The noise models need a baseline to be built around; until
    there is one, the smooth model error stands for the reruns. Then they are built around the baseline under each elastic law that
    it does not rule out. Its own is the one that fits best.

    Args:
        experiments: the interactions.
        settings: of the search.
        progress: called with a line of text now and then.
        begun: the material where the fit begins; by default it looks for a start. Priors stay centred on the model's.

    Raises:
        InputError: no start can be simulated, or the fitted model cannot be simulated to the last frame.
    """
    first, laws = experiments[0], possible_laws(experiments[0], settings)
    scalars = unknown_scalars(first, settings)
    unknowns = Unknowns(first.model.fields, (), settings.priors, scalars=scalars, limits=_limits(first))
    found = remembered(
        "baseline",
        lambda: Trial(unknowns.fields if begun is None else begun).told(),
        {"vector": (len(unknowns),), "law": ()},
        lambda: _without_reruns(experiments, unknowns, laws, settings, progress, begun),
    )
    start, unknowns = found["vector"], unknowns.under(laws[int(found["law"])])
    progress("baseline with the numerical error of reruns")
    quick = quick_around(experiments, unknowns.trial(start), settings.coarsening)
    rough = Measurements.around(experiments, [unknowns.trial(start)], settings, quick=quick)
    (begun,) = together([fit(unknowns, rough.train, start[None], 0)])
    known, under = _gone_on(begun, rough, laws, settings, thorough=False)
    converged = min(under, key=lambda fit: fit.energy)
    near = [found for found in under if found.energy - converged.energy < RULED_OUT]
    trials = [found.unknowns.trial(found.vector) for found in near]
    measurements = Measurements.around(experiments, trials, settings, quick=quick, known=rough)
    measurements = measurements.beside_error(known.size)
    converged = rewhitened(converged, known.train, measurements.train)
    for _ in range(ROUNDS):
        known = measurements
        measurements, (converged,) = _gone_on(
            converged, known, [converged.unknowns.elastic_law], settings, thorough=True
        )
        if abs(np.log(measurements.size / known.size)) < LIKE:
            break
    if not np.isfinite(converged.energy):
        raise InputError(
            "the baseline's rollout fails",
            where="the fitted model",
            expected="one that can be simulated to the last frame",
        )
    return converged, measurements


def _gone_on(
    found: Fit, known: Measurements, laws: Sequence[str | None], settings: GapSettings, *, thorough: bool
) -> tuple[Measurements, list[Fit]]:
    """A fit gone on beside an error as large as it leaves, under some elastic laws, and the measurements with that error.

    Only with reruns are all patches free, and under a wrong law they may be far behind.
    """
    beside = known.beside_error(Evidences(known, settings).of(found).size)
    asked = [continued(found, known.train, beside.train, settings.settling, law, thorough) for law in laws]
    return beside, together(asked)


def unknown_scalars(experiment: Interaction, settings: GapSettings) -> tuple[str, ...]:
    """Numbers of the model that act in an interaction and are not known."""
    acting = {
        "friction_coefficient": experiment.setting.ground_height is not None,
        "grip_stiffness": settings.grip_fitted and experiment.setting.grip is not None,
        "bending_ratio": "bending_ratio" in experiment.model.fields,
        "tool_friction": experiment.setting.tool is not None,
    }
    return tuple(name for name, acts in acting.items() if acts)


def _limits(experiment: Interaction) -> dict[str, Limits]:
    """Of all effects' coefficients, which belong to where the object lies in the first of all interactions."""
    setting = experiment.setting
    if experiment.placement is not None:
        rotation, translation = experiment.placement
        setting = replace(setting, body=replace(setting.body, x0=(setting.body.x0 - translation) @ rotation))
    return {name: effect.limits(setting) for name, effect in EFFECTS.items()}


def _without_reruns(
    experiments: Sequence[Interaction],
    unknowns: Unknowns,
    laws: Sequence[str],
    settings: GapSettings,
    progress: Progress,
    begun: Fields | None,
) -> dict[str, Array]:
    """Where the fit of the baseline starts once the simulator's numerical error is known, and the number of its elastic law.

    A guessed model starts with one modulus for all patches: how far they may part is only known with the size of the error.
    """
    if begun is None:
        begin = _from_a_guess if len(settings.scan) > 1 else _from_a_fit
        found, data = begin(experiments, unknowns, settings, progress)
    else:
        found, data = _from_there(experiments, unknowns, settings, begun)
    own = min(found, key=lambda fit: fit.energy)
    if len(laws) > 1:
        progress("baseline under " + ", ".join(laws))
    others = [own.unknowns.under(law) for law in laws[1:]]
    under = [own, *together([fit(u, data, own.vector[None], settings.settling, [own.jacobian]) for u in others])]
    number = int(np.argmin([fit.energy for fit in under]))
    return {"vector": under[number].vector, "law": np.array(number)}


def _from_a_fit(
    experiments: Sequence[Interaction], unknowns: Unknowns, settings: GapSettings, progress: Progress
) -> tuple[list[Fit], Data]:
    """Refits of a fitted model over a growing horizon, from its own patches and from one modulus for all."""
    free, uniform = unknowns.start(), unknowns.with_uniform_modulus(unknowns.start())
    without_contrast = unknowns.without_contrast()
    quick = quick_around(experiments, unknowns.trial(free), settings.coarsening)
    for share in (*HORIZONS, 1.0):
        progress(f"baseline over {100 * share:.0f} % of the training frames")
        data = Measurements.around(experiments, [unknowns.trial(free)], settings, share, False, quick).train
        pair = (unknowns, free), (without_contrast, uniform)
        found = together([fit(u, data, v[None], settings.baseline_iterations) for u, v in pair])
        free, uniform = (fit.vector for fit in found)
    progress("baseline with contrast between its patches")
    parted = fit(unknowns, data, uniform[None], settings.settling, [found[1].jacobian])
    return [found[0], *together([parted])], data


def _from_there(
    experiments: Sequence[Interaction], unknowns: Unknowns, settings: GapSettings, begun: Fields
) -> tuple[list[Fit], Data]:
    """The fit that begins at a material, or at one modulus for all of its patches, whichever is better."""
    start = unknowns.vector_of(begun)
    quick = quick_around(experiments, unknowns.trial(start), settings.coarsening)
    data = Measurements.around(experiments, [unknowns.trial(start)], settings, reruns=False, quick=quick).train
    starts = np.stack([start, unknowns.with_uniform_modulus(start)])
    return together([fit(unknowns, data, starts, settings.settling)]), data


def _from_a_guess(
    experiments: Sequence[Interaction], unknowns: Unknowns, settings: GapSettings, progress: Progress
) -> tuple[list[Fit], Data]:
    """Fits with one modulus for all patches, from the lowest minima on a grid of modulus and friction.

    All training frames count. Frames in which a grip presses say little about friction, and those in which the body slides say little about the
    modulus, so the best fit to the first frames may lie in another minimum than the best to all; but where the modulus has many, the first
    frames tell which are worth a closer look.
    """
    slides = "friction_coefficient" in unknowns.scalars
    moduli, frictions = np.log(settings.scan), np.log(FRICTIONS) if slides else np.zeros(1)
    progress(f"baseline at {len(moduli) * len(frictions)} pairs of modulus and friction")
    start = unknowns.with_uniform_modulus(unknowns.start())
    vectors = np.tile(start, (len(moduli), len(frictions), 1))
    vectors[..., : unknowns.patches] += moduli[:, None, None]
    if slides:
        vectors[..., unknowns.place("friction_coefficient")] += frictions
    horizons = [
        Measurements.around(experiments, [unknowns.trial(start)], settings, share, reruns=False).train
        for share in (1.0, EARLY)
    ]
    on_grid = _energies(vectors.reshape(-1, len(start)), unknowns, horizons)
    places = (place for found in on_grid for place in local_minima(found.reshape(vectors.shape[:2]))[:MINIMA])
    minima = np.array([vectors[place] for place in dict.fromkeys(places)])
    if not len(minima):
        raise InputError(
            "no rollout ends",
            where="the guessed model",
            expected=f"one of moduli times {settings.scan} that can be simulated",
        )
    nearest = _nearest(minima, unknowns, horizons[:1])[:MINIMA]
    trial = unknowns.trial(nearest[0])
    quick = quick_around(experiments, trial, settings.coarsening)
    data = Measurements.around(experiments, [trial], settings, reruns=False, quick=quick).train
    without_contrast = unknowns.without_contrast()
    return together([fit(without_contrast, data, own[None], settings.settling) for own in nearest]), data


def _energies(
    vectors: Float[Array, "starts unknowns"], unknowns: Unknowns, horizons: Sequence[Data]
) -> list[Float[Array, " starts"]]:
    """Energies [nat] of the same rollouts over some horizons, the longest first; infinite where one fails."""
    predictions, found = horizons[0].predict([unknowns.trial(vector) for vector in vectors]), []
    for data in horizons:
        seen = [own[:, :frames] for own, frames in zip(predictions, data.frames, strict=True)]
        found.append(np.nan_to_num(0.5 * (data.residuals(seen) ** 2).sum(0), nan=np.inf))
    return found


def _nearest(
    minima: Float[Array, "minima unknowns"], unknowns: Unknowns, horizons: Sequence[Data]
) -> Float[Array, "minima unknowns"]:
    """Minima on the grid, each at the best modulus near it, the best one first."""
    near = np.stack([unknowns.with_moduli(own, NEARER) for own in minima])
    (energies,) = _energies(near.reshape(-1, near.shape[-1]), unknowns, horizons)
    energies = energies.reshape(near.shape[:2])
    return near[np.arange(len(near)), energies.argmin(1)][np.argsort(energies.min(1), kind="stable")]


def local_minima(energies: Float[Array, "moduli frictions"]) -> list[tuple[int, int]]:
    """Places on a grid that are no higher than any of their neighbours, the lowest first."""
    padded = np.pad(energies, 1, constant_values=np.inf)
    around = np.lib.stride_tricks.sliding_window_view(padded, (3, 3)).min((2, 3))
    found = [(int(i), int(j)) for i, j in np.argwhere((energies <= around) & np.isfinite(energies))]
    return sorted(found, key=lambda place: energies[place])
