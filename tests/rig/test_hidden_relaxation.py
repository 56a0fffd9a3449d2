"""The hidden effects that remember, against closed forms."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("mujoco")

from dataclasses import replace

from data.rig.hidden.relaxation import HystereticDamping, StandardLinearSolid
from tests.rig.test_hidden import FOAM, block, deformation, pushed, put, slope_of, start

SHEAR = FOAM.youngs_modulus / (2 * (1 + FOAM.poissons_ratio))


def test_a_held_strain_loses_its_over_stress_within_the_time():
    """It begins with the forces of the energy m |dev E|^2 a volume, m = share mu, and fades as exp(-t / time)."""
    share, time = 0.7, 0.02
    world, act = start(StandardLinearSolid(share, time), block(upper=(-0.02, 0.02, 0.54)), timestep=1e-3)
    positions = world.mesh.vertices * [1.1, 0.97, 0.95] + 0.001 * np.random.default_rng(0).normal(size=(27, 3))

    def energy(points):
        F = deformation(world, points)
        strain = 0.5 * (F.transpose(0, 2, 1) @ F - np.eye(3))
        strain -= np.trace(strain, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
        return (world.mesh.volumes() * share * SHEAR * (strain**2).sum(axis=(1, 2))).sum()

    put(world, positions)
    first = pushed(world, act)
    np.testing.assert_allclose(first, -slope_of(energy, positions), rtol=1e-5, atol=1e-5)
    for step in range(1, 31):
        fades = np.exp(-step * world.timestep / time)
        np.testing.assert_allclose(pushed(world, act), fades * first, rtol=1e-9, atol=1e-9 * np.abs(first).max())


def test_nothing_is_left_to_fade_at_frame_0():
    world, act = start(StandardLinearSolid(0.7, 5.0), block(), timestep=1e-3)
    put(world, world.mesh.vertices * [1.1, 0.97, 0.95])
    assert not pushed(world, act, time=0.0).any()
    assert np.abs(pushed(world, act, time=1e-3)).max() < 1e-9


def test_the_over_stress_turns_with_the_body():
    world, act = start(StandardLinearSolid(0.7, 5.0), block(), timestep=1e-3)
    turn = Rotation.from_euler("zx", [0.9, -0.4]).as_matrix()
    put(world, world.mesh.vertices @ turn.T)
    assert np.abs(pushed(world, act)).max() < 1e-8
    stretched = world.mesh.vertices * [1.1, 0.97, 0.95]
    put(world, stretched)
    straight = pushed(world, act)
    put(world, stretched @ turn.T)
    fades = np.exp(-world.timestep / 5.0)
    np.testing.assert_allclose(pushed(world, act), fades * straight @ turn.T, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("eta", [0.02, 0.1, 0.3])
def test_the_spectrum_loses_the_same_at_all_frequencies_of_a_capture(eta):
    """Within 5 % from 0.5 to 20 Hz; what lies beyond its slowest and fastest time is missing there."""
    shares, times = HystereticDamping(eta).spectrum()
    x = 2 * np.pi * np.geomspace(0.5, 20.0, 200)[:, None] * times
    loss = (shares * x / (1 + x**2)).sum(axis=1) / (1 + (shares * x**2 / (1 + x**2)).sum(axis=1))
    assert (shares > 0).all()
    assert np.abs(loss / eta - 1).max() < 0.05


def ring(hidden, modulus, length=0.3):
    """Loss of the amplitude's logarithm a cycle, and angular frequency [1/s], of a long thin bar let go from a stretch."""
    material = replace(FOAM, youngs_modulus=modulus, damping=0.0)
    scene = block(lower=(0.0, -0.01, 0.5), upper=(length, 0.01, 0.52), material=material)
    frequency = np.pi / length * np.sqrt(modulus / FOAM.density)
    world, act = start(hidden, scene, timestep=0.004 / frequency)
    x = world.mesh.vertices[:, 0]
    put(world, world.mesh.vertices - 0.003 * np.cos(np.pi * x / length)[:, None] * [1, 0, 0])
    ends, amount = x > length - 1e-6, []
    for step in range(6000):
        world.data.qfrc_applied[:] = 0
        act((step + 1) * world.timestep)
        hidden.advance(world)
        amount.append((world.positions - world.mesh.vertices)[ends, 0].mean())
    amount = np.array(amount)
    turns = np.flatnonzero((amount[1:-1] - amount[:-2]) * (amount[2:] - amount[1:-1]) < 0) + 1
    swings = np.abs(np.diff(amount[turns]))
    return -2 * np.polyfit(np.arange(len(swings)), np.log(swings), 1)[0], np.pi / np.diff(turns).mean() / world.timestep


def test_a_bar_loses_the_same_a_cycle_at_two_frequencies():
    """pi times the loss factor of its extension, 9 K G / (3 K + G) of the complex G: the closed form and each other."""
    hidden, lost = HystereticDamping(0.12), []
    for modulus in (6e3, 2.4e4):
        found, frequency = ring(hidden, modulus)
        shares, times = hidden.spectrum()
        x = 1j * frequency * times
        shear = modulus / 2.6 * (1 + (shares * x / (1 + x)).sum())
        bulk = modulus / (3 * (1 - 2 * FOAM.poissons_ratio))
        extension = 9 * bulk * shear / (3 * bulk + shear)
        assert found == pytest.approx(np.pi * extension.imag / extension.real, rel=0.05)
        lost.append(found)
    assert lost[1] == pytest.approx(lost[0], rel=0.05)
