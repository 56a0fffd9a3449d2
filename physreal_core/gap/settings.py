"""Settings of the search for a missing effect."""

from dataclasses import dataclass, field, replace

from physreal_core.gap.fits.unknowns import Priors
from physreal_core.gap.noise.discrepancy import ErrorPrior
from physreal_core.gap.noise.model import ModelError


@dataclass(frozen=True)
class GapSettings:
    """Settings of the search for a missing effect.

    The numbers that decide how sure an answer is are calibrated on captures of known truth (docs/gap_benchmark.md). A
    gain is a gain in log evidence over the baseline, in nat. Coordinates are those of `Unknowns`: logarithms, and
    multiples of scales.

    Args:
        candidates: names of effects in the registry; all by default.
        shortlist: largest number of candidates that the score test passes on to a fit. Their predicted gain must be
            above chance.
        firsts: number of effects beside which a second one is tried.
        seconds: number of second effects that are tried at a time, and number of pairs whose fits go on until they
            converge.
        exchanges: number of candidates for which each effect of the best pair is exchanged.
        elastic_laws: among which every answer has the one that leaves it least, beside the model's own. A model with plastic
            flow or a neural residual keeps its own.
        coarsening: factor on the particles' spacing in the rollouts in which candidates are screened and their fits begin;
            1 for none.
        iterations: largest number of steps of a candidate's fit, before the best fits go on.
        finalists: number of fits that go on until they converge.
        settling: largest number of steps of those, and of the whole baseline.
        baseline_iterations: largest number of steps of the baseline per horizon.
        grip_fitted: whether the grip's stiffness was fitted. If so, it stays an unknown of the baseline, and a
            compliant grip, which does the same, is no candidate.
        scan: factors on the moduli of a guessed model, among which its fit looks for a start; (1.0,) for a fitted
            model.
        model_error: smoothness of the simulator's own error, and its usual size.
        error_prior: of its size in a capture, as a factor on that.
        priors: standard deviations of the priors.
        prior_none: prior probability that nothing is missing.
        prior_pair: prior probability of two effects, given that something is missing.
        temperature: gains are divided by it before they become probabilities, and so is the likelihood behind intervals.
        temperature_seen: the same where a camera has seen body and hand: shape, pose and hold are then off by more than the model's error
            knows.
        interval_scale: factor on the intervals that come of it, so that in earlier sets nine of ten held the truth.
        class_ratio: least probability of a member of the reported class, relative to the best answer.
        class_size: largest number of members of the class.
        false_alarms: allowed share of captures without a missing effect in which one is named.
        unexplained: least share of the disagreement beyond noise and numerical error that an answer must explain; below
            it, and where the answer leaves such a disagreement itself, the effect is `unknown`.
        seed: of the bootstrap.
    """

    candidates: tuple[str, ...] = ()
    shortlist: int = 8
    firsts: int = 3
    seconds: int = 5
    exchanges: int = 3
    elastic_laws: tuple[str, ...] = ("neo_hookean", "fixed_corotated", "saint_venant_kirchhoff")
    coarsening: float = 1.5
    iterations: int = 8
    finalists: int = 4
    settling: int = 20
    baseline_iterations: int = 3
    grip_fitted: bool = False
    scan: tuple[float, ...] = (1.0,)
    model_error: ModelError = field(default_factory=ModelError)
    error_prior: ErrorPrior = field(default_factory=ErrorPrior)
    priors: Priors = field(default_factory=Priors)
    prior_none: float = 0.5
    prior_pair: float = 0.1
    temperature: float = 25.0
    temperature_seen: float = 40.0
    interval_scale: float = 2.6
    class_ratio: float = 0.1
    class_size: int = 3
    false_alarms: float = 0.05
    unexplained: float = 0.8
    seed: int = 0

    def on(self, *, seen: bool) -> "GapSettings":
        """The settings for interactions whose body and hand a camera has seen, or not."""
        return replace(self, temperature=self.temperature_seen) if seen else self
