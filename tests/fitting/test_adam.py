"""Adam's step against torch's own, and what one wild gradient does to it."""

import torch

from physreal_core.fitting.adam import BETAS, LONGEST, adam_step


def test_steps_are_those_of_torch_s_adam_to_the_last_bit():
    generator = torch.Generator().manual_seed(0)
    value = torch.randn(7, generator=generator, dtype=torch.float64)
    expected = value.clone().requires_grad_()
    optimiser = torch.optim.Adam([expected], betas=BETAS)
    moments = torch.zeros_like(value), torch.zeros_like(value)
    for count in range(1, 30):
        gradient = torch.randn(7, generator=generator, dtype=torch.float64) * 2.0 ** (count % 5 - 2)
        rate = 0.1 / count
        adam_step(value, gradient, *moments, rate, count)
        optimiser.param_groups[0]["lr"], expected.grad = rate, gradient
        optimiser.step()
        assert torch.equal(value, expected.detach())


def test_one_wild_gradient_does_not_end_the_descent():
    def descended(wild: float) -> list[float]:
        value, path = torch.tensor([1.0], dtype=torch.float64), []
        moments = torch.zeros_like(value), torch.zeros_like(value)
        for count in range(1, 21):
            adam_step(value, wild * value if count == 4 else value.clone(), *moments, 0.1, count)
            path.append(value.item())
        return path

    steady, kicked = descended(1.0), descended(-1e9)
    assert abs(steady[-1]) < 0.1 and abs(kicked[-1]) < 0.3
    assert abs(kicked[3] - kicked[2]) < 0.1 * LONGEST
