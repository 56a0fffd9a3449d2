"""Maps between values and the coordinates Adam moves."""

import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.fitting.variables import Variable


@pytest.mark.parametrize(
    ("variable", "values"),
    [
        (Variable("youngs_modulus", "log", 0.1, 1e3, 1e7), [1e3, 6e4, 1e7]),
        (Variable("poissons_ratio", "logit", 0.1, 0.05, 0.48), [0.06, 0.3, 0.47]),
        (Variable("latent_elastic", "identity", 0.1), [-2.0, 0.0, 5.0]),
    ],
)
def test_value_of_free_is_the_value(variable, values):
    value = torch.tensor(values, dtype=torch.float64)
    torch.testing.assert_close(variable.value(variable.free(value)), value, rtol=1e-12, atol=1e-12)


def test_a_logit_variable_never_leaves_its_range():
    variable = Variable("poissons_ratio", "logit", 0.1, 0.05, 0.48)
    values = variable.value(torch.tensor([-50.0, 50.0], dtype=torch.float64))
    assert values.min() >= 0.05 and values.max() <= 0.48


def test_a_logit_variable_may_start_on_its_bound_and_still_move():
    variable = Variable("poissons_ratio", "logit", 0.1, 0.05, 0.48)
    free = variable.free(torch.tensor(0.48, dtype=torch.float64)).requires_grad_()
    variable.value(free).backward()
    assert torch.isfinite(free) and free.grad > 0.0


def test_a_ratio_keeps_its_product_with_the_field_that_it_is_a_ratio_to():
    """A step of Young's modulus alone leaves the bending stiffness, as far as the ratio's range allows."""
    ratio, modulus = Variable("bending_ratio", "log", 0.1, 0.01, 10.0), Variable("youngs_modulus", "log", 0.1, 1e3, 1e7)
    starts = {"bending_ratio": torch.tensor([0.5]), "youngs_modulus": torch.tensor([1e5])}
    values = {"bending_ratio": torch.tensor([0.6]), "youngs_modulus": torch.tensor([2e5])}
    assert ratio.of(values, starts).item() == pytest.approx(0.3)
    assert modulus.of(values, starts).item() == 2e5
    assert ratio.of({"bending_ratio": values["bending_ratio"]}, starts).item() == pytest.approx(0.6), "E is held"
    far = {"bending_ratio": torch.tensor([0.6]), "youngs_modulus": torch.tensor([1e7])}
    assert ratio.of(far, starts).item() == pytest.approx(0.01)


def test_a_value_at_its_bound_may_start_there_after_it_went_through_a_logarithm():
    variable = Variable("youngs_modulus", "log", 0.1, 1e3, 5e6)
    rounded = torch.tensor(1e3, dtype=torch.float64).log().exp()
    assert rounded < 1e3
    assert variable.free(rounded) == torch.tensor(1e3, dtype=torch.float64).log()
    with pytest.raises(InputError, match="starts at 999"):
        variable.free(torch.tensor(999.0, dtype=torch.float64))


def test_project_puts_a_logarithm_back_into_its_range():
    variable = Variable("friction_coefficient", "log", 0.1, 0.01, 2.0)
    moved = variable.project(torch.tensor([-20.0, 0.0, 20.0], dtype=torch.float64)).exp()
    torch.testing.assert_close(moved, torch.tensor([0.01, 1.0, 2.0], dtype=torch.float64))


def test_a_start_outside_the_range_is_named():
    with pytest.raises(InputError, match="youngs_modulus starts at 10"):
        Variable("youngs_modulus", "log", 0.1, 1e3, 1e7).free(torch.tensor(10.0))


def test_a_range_upside_down_is_named():
    with pytest.raises(InputError, match="range .* of poissons_ratio"):
        Variable("poissons_ratio", "logit", 0.1, 0.48, 0.05)
