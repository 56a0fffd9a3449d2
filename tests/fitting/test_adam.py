"""Adam's step against torch's own."""

import torch

from physreal_core.fitting.adam import BETAS, adam_step


def test_steps_are_those_of_torch_s_adam_to_the_last_bit():
    generator = torch.Generator().manual_seed(0)
    value = torch.randn(7, generator=generator, dtype=torch.float64)
    expected = value.clone().requires_grad_()
    optimiser = torch.optim.Adam([expected], betas=BETAS)
    moments = torch.zeros_like(value), torch.zeros_like(value)
    for count in range(1, 30):
        gradient = torch.randn(7, generator=generator, dtype=torch.float64) * 10.0 ** (count % 5 - 2)
        rate = 0.1 / count
        adam_step(value, gradient, *moments, rate, count)
        optimiser.param_groups[0]["lr"], expected.grad = rate, gradient
        optimiser.step()
        assert torch.equal(value, expected.detach())
