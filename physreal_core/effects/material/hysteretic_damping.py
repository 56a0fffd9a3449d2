"""Hysteretic damping: the share of its energy that a swing loses does not depend on its frequency."""

import math

import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import added, changed, lame

BAND = (0.3, 30.0)
"""Frequencies [Hz] between which the loss factor is what is said, to RIPPLE; a capture of 30 to 100 Hz shows no others."""
RIPPLE = 0.06
"""Largest deviation of the loss factor from its value within the band, as a share of it, up to a value of 0.3; 0.07 at 0.4."""
MATCHED, LIFT = 0.88, 1.03
"""Where between the band's middle and its ends (0 and 1, of the logarithm), besides in the middle, the loss factor is LIFT times
its value. Between these three frequencies it is lower; so the deviations upwards and downwards are about as large."""


class HystereticDamping(Effect):
    """Three Maxwell branches, whose times belong to the ends and the middle of the band.

    Their moduli are those at which the loss factor of shear is about the given one at three frequencies. A material with the same
    loss at all frequencies is stiffer the faster it moves (Kramers and Kronig), by about w^(2 eta / pi). The elastic law
    has the modulus of slow motion, below the band.
    """

    name = "hysteretic_damping"
    family = "material"
    words = "The material loses the same share of a swing's energy at any frequency, as filled rubber does."
    formula = (
        "tau = tau_elastic + sum_k g_k(eta) mu dev(b_k), b_k' = L b_k + b_k L^T - (b_k - 1) / t_k, L = dev(grad v);"
        " Im G / Re G = eta from 0.3 to 30 Hz to 6 % of it, mu long-time"
    )
    shows = "as swings that die out, all by the same share a cycle; and the faster, the stiffer"
    distinguished_by = (
        "swings of two frequencies: each loses the same share a cycle (viscosity: the faster more; drag: less)"
    )
    terms = ("hysteresis",)
    coefficients = (Coefficient("loss_factor", "1", "of shear, Im G / Re G, eta", 0.0, 0.0, 0.4, 0.1),)

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        mu, _ = lame(inputs, setting)
        shares = branch_shares(values["loss_factor"]).to(mu)
        inputs = added(inputs, hysteresis_modulus=shares * mu[:, None])
        return changed(inputs, hysteresis_time=branch_times().to(mu))


def branch_times() -> Float[Tensor, "3"]:
    """Relaxation times [s] of the branches: 1 / w of the band's lower end, middle and upper end."""
    low, high = BAND
    return 1.0 / (2.0 * math.pi * torch.tensor([low, math.sqrt(low * high), high], dtype=torch.float64))


def branch_shares(loss_factor: Tensor) -> Float[Tensor, "3"]:
    """Shear moduli of the branches over the long-time one, at which the loss factor is LIFT eta at three frequencies.

    With x = w t the loss modulus of a branch is g x / (1 + x^2), its storage modulus g x^2 / (1 + x^2). That the former sum to
    eta (1 + sum of the latter) is linear in the shares g.

    Args:
        loss_factor: eta, shape [].
    """
    eta, times = LIFT * loss_factor.double(), branch_times().to(loss_factor.device)
    stretch = 0.5 * math.log(BAND[1] / BAND[0]) * MATCHED
    matched = torch.exp(stretch * torch.tensor([-1.0, 0.0, 1.0], dtype=torch.float64, device=times.device)) / times[1]
    x = matched[:, None] * times
    return torch.linalg.solve((x - eta * x**2) / (1.0 + x**2), eta.expand(3))
