"""Effects of the material against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import minimize

from physreal_core.effects import EFFECTS
from physreal_core.effects.material.hysteretic_damping import BAND, RIPPLE, branch_shares, branch_times
from physreal_core.simulation import Clamp, States
from physreal_core.simulation.timestep import rate_memory
from tests.effects.hanging import DENSITY, LENGTH, E, closed_stretch, hanging_bar, period, stretch, tip_drop, uniform
from tests.effects.specimen import Specimen, complete, held_specimen, lattice_body, material


def test_kelvin_voigt_damps_the_axial_mode_at_half_omega_squared_t():
    """Decay of the envelope of a hanging bar's swing, beyond what the transfers take out of it.

    The simulator takes the rate of strain as a mean over substeps, which is late by T: s^2 + w^2 (1 + t s / (1 + T s)) = 0.
    Here it is late by 0.17 radians, which takes 3 % of the decay.
    """
    time, scene = 0.004, hanging_bar(100)
    free, damped = tip_drop(scene), tip_drop(scene, kelvin_voigt={"time": time})
    omega = 2 * math.pi / period(free)
    given = scene.inputs({"kelvin_voigt": complete("kelvin_voigt", {"time": time})}).parameters
    simulator = scene.simulator("kelvin_voigt")
    memory = rate_memory(simulator.body, simulator.config, given)
    late = memory / (scene.fps * simulator.substeps(given))
    roots = np.roots([late, 1.0, omega**2 * (late + time), omega**2])
    expected = -float(roots[np.abs(roots.imag).argmax()].real)
    assert decay_rate(damped) - decay_rate(free) == pytest.approx(expected, rel=0.02)
    assert expected == pytest.approx(omega**2 * time / 2, rel=0.04)


def decay_rate(drop: np.ndarray, fps: float = 200.0) -> float:
    """Slope of the log of the extremes' differences [1/s]."""
    turning = [i for i in range(1, len(drop) - 1) if (drop[i] - drop[i - 1]) * (drop[i + 1] - drop[i]) < 0]
    swings = np.abs(np.diff(drop[turning]))
    times = np.asarray(turning[:-1]) / fps
    return float(-np.polyfit(times, np.log(swings), 1)[0])


@pytest.mark.parametrize("eta", [0.01, 0.05, 0.1, 0.2, 0.3])
def test_hysteretic_damping_loses_the_same_at_all_frequencies_of_its_band(eta):
    """Im G / Re G of its branches, within RIPPLE; a single branch's would fall to a tenth towards the ends."""
    shares, times = branch_shares(torch.tensor(eta)).numpy(), branch_times().numpy()
    x = 2 * np.pi * np.geomspace(*BAND, 500)[:, None] * times
    loss = (shares * x / (1 + x**2)).sum(1) / (1 + (shares * x**2 / (1 + x**2)).sum(1))
    assert (shares > 0).all()
    assert abs(loss / eta - 1).max() < RIPPLE
    assert abs(loss.max() + loss.min() - 2 * eta) < 0.03 * eta  # as far above as below


def test_hysteretic_damping_lets_a_swing_die_out_by_its_loss_factor():
    """A hanging bar's swing loses pi eta (1 - E / 9 K) of its amplitude's logarithm a cycle, beyond what transfers take.

    Poisson's ratio is zero, so two thirds of the strain energy are shear's, and a little less as the branches stiffen the shear.
    """
    eta, scene = 0.12, hanging_bar(100)
    free, damped = tip_drop(scene), tip_drop(scene, hysteretic_damping={"loss_factor": eta})
    lost = decay_rate(damped) * period(damped) - decay_rate(free) * period(free)
    shares, times = branch_shares(torch.tensor(eta)).numpy(), branch_times().numpy()
    x = 2 * np.pi / period(damped) * times
    shear = 0.5 * (1 + (shares * 1j * x / (1 + 1j * x)).sum())
    modulus = 3 * shear / (1 + shear)
    assert lost == pytest.approx(math.pi * modulus.imag / modulus.real, rel=0.05)


def test_standard_linear_solid_hangs_as_long_as_the_elastic_one_and_swings_faster():
    """It sags to the elastic stretch; the swing, too fast for the branch, has (1 + g) times the shear modulus."""
    share, scene = 0.8, hanging_bar(300)
    stilled = {"linear_drag": {"rate": 15.0}}
    quick, slow = {"share": share, "time": 20.0}, {"share": share, "time": 0.1}
    elastic = tip_drop(scene, **stilled)[-1]
    assert tip_drop(scene, **stilled, standard_linear_solid=slow)[-1] == pytest.approx(elastic, rel=0.01)
    stiff = 3 * (1 + share) / (3 + share)
    swings = [period(tip_drop(scene, **own)) for own in ({}, {"standard_linear_solid": quick})]
    assert swings[0] / swings[1] == pytest.approx(math.sqrt(stiff), rel=0.01)


def test_maxwell_creep_lets_shear_strain_decay_at_its_rate():
    """A body held everywhere: its deviatoric log strain goes as exp(-r t), its volume stays. Steps of r dt = 0.002."""
    body, rate, frames = lattice_body((4, 4, 4)), 4.0, 13
    stretches = torch.tensor([1.3, 0.9, 0.95], dtype=torch.float64)
    start = torch.diag(stretches).expand(len(body.x0), 3, 3)
    everywhere = Clamp((-1.0,) * 3, (1.0,) * 3)
    given = replace(material(body), initial_deformation=start)
    points = torch.zeros(frames, 0, 3, dtype=torch.float64)
    scene = Specimen(body, points, 60.0, given, clamps=(everywhere,), ground_height=None)
    with torch.no_grad():
        F = scene.rollout(rest_shape={}, maxwell_creep={"rate": rate}).F[-1, 0]
    log, log0 = F.diagonal().log(), stretches.log()
    deviator, deviator0 = log - log.mean(), log0 - log0.mean()
    torch.testing.assert_close(deviator, deviator0 * math.exp(-rate * (frames - 1) / 60), rtol=0.01, atol=1e-6)
    assert float(log.sum()) == pytest.approx(float(log0.sum()), rel=1e-9)


def test_plastic_yield_keeps_the_stress_on_the_yield_surface():
    """Nowhere above sqrt(2/3) sigma_y, at it where the baseline would be far above; the shape stays."""
    scene = held_specimen(frames=8)
    inverse = 100.0
    with torch.no_grad():
        elastic, plastic = scene.rollout().F, scene.rollout(plastic_yield={"inverse_yield_strain": inverse}).F

    def stress(F: torch.Tensor) -> torch.Tensor:  # |2 mu dev eps| over sqrt(2/3) E / a, nu = 0.3
        eps = torch.linalg.svdvals(F).log()
        return (eps - eps.mean(-1, keepdim=True)).norm(dim=-1) / 1.3 * inverse / math.sqrt(2 / 3)

    assert stress(elastic).max() > 1.5
    assert stress(plastic).max() <= 1 + 1e-9
    assert (stress(plastic) > 1 - 1e-6).any()


def test_plastic_yield_begins_where_few_and_where_many_particles_would_yield():
    scene = held_specimen(frames=12)
    with torch.no_grad():
        motion = scene.rollout()
    few, many = EFFECTS["plastic_yield"].starts(scene.setting, motion)
    assert 0 < few["inverse_yield_strain"] < many["inverse_yield_strain"]
    with torch.no_grad():
        change = [(scene.rollout(plastic_yield=start).x - motion.x).abs().max() for start in (few, many)]
    assert 0 < change[0] < change[1]
    unstrained = States(motion.x, motion.v, torch.eye(3, dtype=torch.float64).expand_as(motion.F))
    assert EFFECTS["plastic_yield"].starts(scene.setting, unstrained) == ()


def test_strain_stiffening_against_the_minimum_of_the_energy():
    """A bar so heavy that its upper end stretches by a quarter, every cross-section at the minimum of W - P lambda."""
    gravity, ratio = 50.0, 8.0

    def section(load: float, ratio: float) -> float:
        def potential(stretches: np.ndarray) -> float:  # fixed corotated, nu = 0, and Yeoh's second term; over E
            along, across = stretches
            bar_I1 = (along**2 + 2 * across**2) * (along * across**2) ** (-2 / 3)
            return 0.5 * ((along - 1) ** 2 + 2 * (across - 1) ** 2) + ratio * (bar_I1 - 3) ** 2 - load / E * along

        return minimize(potential, [1.0, 1.0], tol=1e-12).x[0]

    loads = DENSITY * gravity * np.linspace(0.0, LENGTH, 41)
    expected = [np.trapezoid([section(load, r) - 1 for load in loads], dx=LENGTH / 40) for r in (0.0, ratio)]
    scene = hanging_bar(240, gravity)
    damped = {"kelvin_voigt": {"time": 0.02}}  # so that it comes to rest
    found = [tip_drop(scene, **damped, **more)[-1] for more in ({}, {"strain_stiffening": {"ratio": ratio}})]
    assert expected[1] < 0.8 * expected[0]
    assert found[1] / found[0] == pytest.approx(expected[1] / expected[0], rel=0.02)


@pytest.mark.parametrize(("elevation", "factor"), [(math.pi / 2, 1 / 1.8), (0.0, 1.0)])
def test_fibres_stiffen_a_bar_along_them_by_their_modulus_and_not_across(elevation, factor):
    """Stretch of a hanging bar over its stretch without fibres: E / (E + k) along them."""
    scene = hanging_bar()
    fibres = {"ratio": 0.8, "azimuth": 0.3, "elevation": elevation}
    assert stretch(scene, fibres=fibres) / stretch(scene) == pytest.approx(factor, rel=0.01)


def test_soft_spot_lengthens_a_hanging_bar_by_the_integral_of_its_compliance():
    """A spot wide against the bar's width, so that the bar stays one-dimensional."""
    scene = hanging_bar(160)
    spot = {"loss": 0.5, "x": 0.015, "y": 0.015, "z": -0.08, "radius": 0.03}
    soft = closed_stretch(lambda z: E * (1 - 0.5 * np.exp(-((z + 0.08) ** 2) / (2 * 0.03**2))), uniform(DENSITY), 2.0)
    hard = closed_stretch(uniform(E), uniform(DENSITY), 2.0)
    assert stretch(scene, soft_spot=spot) / stretch(scene) == pytest.approx(soft / hard, rel=0.03)


def floating_bar(frames: int) -> Specimen:
    """Without weight or hold."""
    body = lattice_body((24, 4, 4), corner=(0.0, 0.0, 0.5))
    points = torch.zeros(frames, 0, 3, dtype=torch.float64)
    return Specimen(body, points, 100.0, material(body, 4e4, 0.3), ground_height=None, gravity=(0.0, 0.0, 0.0))


def test_a_stretched_bar_relaxes_to_its_rest_length_and_width():
    """Settled by viscosity: shorter by 1 / (1 + s), wider by 1 / (1 - nu s)."""
    scene = floating_bar(60)
    with torch.no_grad():
        x = scene.rollout(rest_shape={"stretch": 0.05}, kelvin_voigt={"time": 0.02}).x
    size = x.amax(1) - x.amin(1)
    assert float(size[-1, 0] / size[0, 0]) == pytest.approx(1 / 1.05, rel=2e-3)
    assert float(size[-1, 1] / size[0, 1]) == pytest.approx(1 / (1 - 0.3 * 0.05), rel=4e-3)


def test_a_bent_bar_relaxes_to_the_opposite_curvature():
    """F_0 says that frame 0 is bent by k against the rest shape, so the straight bar bends by -k."""
    scene = floating_bar(160)
    with torch.no_grad():
        x = scene.rollout(rest_shape={"curvature_1": 1.0}, kelvin_voigt={"time": 0.02}).x[-1].numpy()
    rows = np.abs(scene.body.x0[:, 1:] - scene.body.x0[:, 1:].mean(0))  # nearest the axis
    axis = x[(rows < 0.006).all(1)]
    bend = [2 * np.polyfit(axis[:, 0], axis[:, i], 2)[0] for i in (1, 2)]
    assert float(np.hypot(*bend)) == pytest.approx(1.0, rel=0.05)
