"""The residual networks' share of the stress, where it is known."""

import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.fitting.curriculum import with_residual
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.fitting.share import residual_share
from physreal_core.simulation.laws.residual_config import ResidualConfig, split_weights
from tests.fitting import scene

BETA = 0.15


@pytest.fixture(scope="module")
def given():
    return scene.problem(scene.model(), frames=6, observed=6, with_masks=False)


def _model():
    return with_residual(
        scene.model(), ResidualConfig(latent_size=2, hidden=4, beta_elastic=BETA, beta_plastic=0.0), seed=0
    )


def test_networks_at_their_start_carry_nothing(given):
    model = _model()
    assert residual_share(Rollouts(given, model), model) == 0.0


def test_networks_at_their_bound_carry_just_that_share(given):
    """A large constant output saturates the network everywhere: |delta tau| = beta (|tau| - what a tiny stress is forgiven)."""
    model = _model()
    weights = model.fields["network_elastic"].clone()
    split_weights(model.residual, weights)["bias_3"][:] = torch.tensor([1e4, 0.0, 0.0, 0.0, 0.0, 0.0])
    model = model.with_fields(network_elastic=weights)
    share = residual_share(Rollouts(given, model), model)
    assert 0.95 * BETA < share <= BETA


def test_a_model_without_networks_is_refused(given):
    model = scene.model()
    with pytest.raises(InputError, match="no residual of the stress"):
        residual_share(Rollouts(given, model), model)
