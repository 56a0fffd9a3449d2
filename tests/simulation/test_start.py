"""The nodes' velocities at the start against the fields that they are to give."""

import numpy as np
import pytest
import torch

from physreal_core.simulation.lattice import lattice_of
from physreal_core.simulation.start import NodeStart, stencils
from tests.simulation.scenes import block


@pytest.fixture
def body():
    return block((7, 5, 6), corner=(0.013, -0.002, 0.0))


def fitted(body, velocity):
    """Velocities of the nodes [nodes, 3], and of their field at the particles."""
    lattice = lattice_of(body, ())
    found = NodeStart(body, lattice, torch.float64, "cpu").nodes(torch.as_tensor(velocity)[None])[0, :, :3].numpy()
    nodes, weights = stencils(body.x0, lattice)
    return found, (weights[..., None] * found[nodes]).sum(1)


def test_an_affine_field_is_found(body):
    gradient = np.random.default_rng(0).normal(0, 5, (3, 3))
    velocity = (body.x0 - body.x0.mean(0)) @ gradient.T + [1.0, 2.0, 3.0]
    _, field = fitted(body, velocity)
    assert np.abs(field - velocity).max() < 1e-12 * np.abs(velocity).max()


def test_a_wave_is_found_but_for_a_few_per_cent(body):
    velocity = np.cos(np.pi * body.x0 / 0.07)
    _, field = fitted(body, velocity)
    assert np.abs(field - velocity).max() < 0.05


def test_momentum_is_kept_and_nothing_grows_large(body):
    velocity = np.random.default_rng(0).normal(0, 1, body.x0.shape)
    found, field = fitted(body, velocity)
    momentum = body.mass @ velocity
    assert np.abs(body.mass @ field - momentum).max() < 1e-12
    assert np.abs(found).max() < 6 * np.abs(velocity).max()


def test_the_adjoint_is_the_transpose(body):
    start = NodeStart(body, lattice_of(body, ()), torch.float64, "cpu")
    generator = torch.Generator().manual_seed(0)
    v = torch.randn(2, len(body.x0), 3, generator=generator, dtype=torch.float64)
    bar = torch.randn(*start.nodes(v).shape, generator=generator, dtype=torch.float64)
    forward = (start.nodes(v) * bar)[..., :3].sum()
    assert float((v * start.particles(bar)).sum()) == pytest.approx(float(forward), rel=1e-12)
