"""Settings of the search for a missing effect."""

from dataclasses import dataclass, field

from physreal_core.gap.fits.unknowns import Priors
from physreal_core.gap.noise.model import ModelError


@dataclass(frozen=True)
class GapSettings:
    """Settings of the search; the numbers that stand for honesty are calibrated on captures of known truth.

    Args:
        candidates: names in the registry; all by default.
        shortlist: candidates that the score test hands on to a fit, at most: those that promise more than chance.
        firsts: effects beside which a second one is looked for.
        seconds: candidates tried beside each of them, and pairs that go on.
        exchanges: candidates that each of the best two is then exchanged for.
        iterations: of a candidate's fit, at most, before the best ones go on.
        finalists: candidates that go on.
        settling: iterations of these, and of the whole baseline, at most.
        baseline_iterations: of the baseline's, per horizon.
        grip_fitted: whether the grip's stiffness is a number that was fitted. Then it is an unknown of the baseline too, and a
            hand that gives way, which is the same, is no candidate.
        scan: factors on the moduli of a model that is only guessed, among which the fit looks for its start.
        model_error: size and smoothness of the simulator's own error.
        priors: widths, in free coordinates.
        prior_none: probability that nothing is missing, before looking.
        prior_pair: probability of two effects, given that something is missing.
        temperature: by which gains are divided before they become probabilities, at least.
        interval_temperature: times the temperature, by which the likelihood behind the intervals is divided.
        misfit: share of the best gain that the temperature is at least, for the simulator's answer to an effect is some per cent
            off, and a wrong one gains as much by imitating what is off.
        remainder: share of its gain that a right effect may leave. A second one is looked for where the best leaves more; and
            what two gain beyond one of them is divided by this share of the best gain, at least, so that some times what a right
            effect leaves is needed to outweigh the prior.
        confirmed: share of what two effects gain beyond the better of them alone that they must gain on held-out frames, too, for
            all of it to count.
        held_out_share: share that counts of what an answer gains on held-out frames, as far as that is not more than its
            training evidence.
        held_out_loss: share of its training evidence that an answer may lose there: a right effect whose numbers are a little
            off loses much where it acts hard, as in a contact.
        class_ratio: an answer belongs to the reported class if it is at least this times as probable as the best one.
        class_size: members at most.
        false_alarms: share of captures without a missing effect in which one may be named.
        unexplained: an answer that closes less of the significant gap than this is `unknown`.
        seed: of the bootstrap.
    """

    candidates: tuple[str, ...] = ()
    shortlist: int = 8
    firsts: int = 3
    seconds: int = 5
    exchanges: int = 3
    iterations: int = 5
    finalists: int = 4
    settling: int = 10
    baseline_iterations: int = 3
    grip_fitted: bool = False
    scan: tuple[float, ...] = (1.0,)
    model_error: ModelError = field(default_factory=ModelError)
    priors: Priors = field(default_factory=Priors)
    prior_none: float = 0.5
    prior_pair: float = 0.1
    temperature: float = 9.0
    interval_temperature: float = 1.0
    misfit: float = 0.1
    remainder: float = 0.01
    confirmed: float = 0.1
    held_out_share: float = 0.5
    held_out_loss: float = 0.5
    class_ratio: float = 0.1
    class_size: int = 3
    false_alarms: float = 0.05
    unexplained: float = 0.8
    seed: int = 0
