"""Motion under the optional laws against closed forms, and their gradients against finite differences, in both forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import curve_fit

from physreal_core.effects.material.hysteretic_damping import RIPPLE, branch_shares, branch_times
from physreal_core.simulation import Clamp, Parameters, SimulationConfig, Simulator, States
from tests.simulation.scenes import assert_adjoints_agree, block, directional_errors, random_loss, two_point_grip

pytestmark = pytest.mark.usefixtures("form")

GRAVITY = 9.81


def tensor(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


def rollout(simulator: Simulator, frames: int, **parameters) -> States:
    values = {name: tensor(value) for name, value in parameters.items()}
    with torch.no_grad():
        return simulator.rollout(Parameters(**values), torch.zeros(frames, 0, 3))


# --- gradients ----------------------------------------------------------------------------------------------------

FRAMES = 4
STEPS = {
    "drag": {"linear_drag": 1e-7, "quadratic_drag": 1e-7},
    "adhesion": {"adhesion": 1e-7, "adhesion_range": 1e-8},
    "obstacle": {"obstacle": 1e-7},
    "viscosity": {"viscosity": 1e-5},
    "stiffening": {"stiffening": 1e-1},
    "fibres": {"fibre_modulus": 1e-1, "fibre_direction": 1e-6},
    "friction_law": {"friction_law": 1e-5},
    "relaxation": {"relaxation_modulus": 1e-1, "relaxation_time": 1e-7},
    "hysteresis": {"hysteresis_modulus": 1e-1, "hysteresis_time": 1e-7},
}
"""Half widths of the differences, in the parameters' units."""
STATE_STEPS = {"youngs_modulus": 1e-2, "friction_coefficient": 1e-6, "initial_velocity": 1e-7, "grip_stiffness": 1e-6}


def scene(terms: tuple[str, ...], **options) -> tuple[Simulator, Parameters, torch.Tensor]:
    """A block of 60 particles thrown along the ground against a post, one end of it lifted by two moving points."""
    body = block((4, 5, 3))
    points = np.array([[0.0, 0.0, 0.05], [0.02, 0.0, 0.05]])
    config = SimulationConfig(fps=60, dtype="float64", terms=terms, **options)
    simulator = Simulator(body, config, two_point_grip(body, points, 8))
    time = torch.linspace(0, 1, FRAMES, dtype=torch.float64)[:, None, None]
    controllers = tensor(points) + time * tensor([0.01, 0.005, 0.03])
    count, generator = len(body.x0), torch.Generator().manual_seed(3)

    def random(*shape):
        return 0.5 + torch.rand(shape, generator=generator, dtype=torch.float64)

    directions = torch.randn(count, 3, generator=generator, dtype=torch.float64)
    of_term = {
        "drag": {"linear_drag": 1e-3 * random(count), "quadratic_drag": 2e-3 * random(count)},
        "adhesion": {"adhesion": 5e-3 * random(count), "adhesion_range": tensor(1e-3)},
        "obstacle": {"obstacle": tensor([0.06, 0.02, 0.01, 0.0, 0.01, 0.01, 0.02, 1e4])},
        "viscosity": {"viscosity": random(count, 2)},
        "stiffening": {"stiffening": 500.0 * random(count)},
        "fibres": {
            "fibre_modulus": 1e3 * random(count),
            "fibre_direction": directions / directions.norm(dim=1, keepdim=True),
        },
        "friction_law": {"friction_law": tensor([0.2, 0.3, 0.1])},
        "relaxation": {"relaxation_modulus": 1e3 * random(count), "relaxation_time": tensor(0.02)},
        "hysteresis": {"hysteresis_modulus": 500.0 * random(count, 3), "hysteresis_time": tensor([5e-3, 0.02, 0.08])},
    }
    parameters = Parameters(
        youngs_modulus=2e3 * random(count),
        poissons_ratio=tensor(0.3).expand(count),
        friction_coefficient=tensor(0.3),
        grip_stiffness=tensor(0.3),
        grip_damping=tensor(0.005),
        initial_velocity=tensor((0.5, 0.2, 0.0)).expand(count, 3),
        **{name: value for term in terms for name, value in of_term.get(term, {}).items()},
    )
    return simulator, parameters, controllers


@pytest.mark.parametrize("term", STEPS)
def test_gradients(term):
    """Of the law's own parameters and, through it, of the others and the start."""
    simulator, parameters, controllers = scene((term,))
    assert_adjoints_agree(
        directional_errors(simulator, parameters, controllers, random_loss([1, 2, 3]), STEPS[term] | STATE_STEPS)
    )


def test_gradients_of_all_laws_and_inputs_at_once():
    inputs = {"density": 1e-4, "initial_position": 1e-9, "force": 1e-9}
    simulator, parameters, controllers = scene((*STEPS, *inputs), plastic_law="von_mises")
    body = simulator.body
    parameters = replace(
        parameters,
        plastic=tensor([20.0, 1.0]).expand(len(body.x0), 2),
        density=tensor(body.density),
        # off the faces of cells, where a weight's second derivative jumps
        initial_position=tensor(body.x0)
        + 1e-4 * torch.rand(len(body.x0), 3, generator=torch.Generator().manual_seed(1)),
        force=torch.full((len(body.x0), 3), 1e-4, dtype=torch.float64),
    )
    steps = {name: step for own in STEPS.values() for name, step in own.items()} | STATE_STEPS | inputs
    assert_adjoints_agree(directional_errors(simulator, parameters, controllers, random_loss([1, 2, 3]), steps))


def test_absent_laws_change_nothing():
    """Terms at their dormant values: the motion without them, but for rounding."""
    plain, parameters, controllers = scene(())
    with_terms, *_ = scene(tuple(STEPS))
    with torch.no_grad():
        ours, theirs = (s.rollout(parameters, controllers) for s in (with_terms, plain))
    assert with_terms.substeps(parameters) == plain.substeps(parameters)
    for a, b in ((ours.x, theirs.x), (ours.v, theirs.v), (ours.F, theirs.F)):
        torch.testing.assert_close(a, b, rtol=1e-12, atol=1e-13)


# --- closed forms -------------------------------------------------------------------------------------------------


def falling(**drag) -> tuple[torch.Tensor, torch.Tensor]:
    """Times [s] and mean speeds downwards [m/s] of a small block that falls for 1.5 s; its mass is 8e-3 kg."""
    body = block((2, 2, 2), corner=(0.0, 0.0, 50.0), density=1000.0)
    simulator = Simulator(body, SimulationConfig(fps=20, ground_height=None, terms=("drag",), dtype="float64"))
    states = rollout(simulator, 31, youngs_modulus=1e4, poissons_ratio=0.3, **drag)
    return torch.arange(31).double() / 20, -states.v[:, :, 2].mean(1)


def test_terminal_velocity_of_linear_drag():
    """m v' = m g - c v: v = v_T (1 - exp(-g t / v_T)) with v_T = m g / c, here 2 m/s; the step costs 1e-3 of it."""
    times, speed = falling(linear_drag=1e-3 * GRAVITY / 2.0)
    torch.testing.assert_close(speed, 2.0 * (1 - (-GRAVITY * times / 2.0).exp()), rtol=0, atol=4e-3)
    assert float(speed[-1]) == pytest.approx(2.0, rel=1e-3)


def test_terminal_velocity_of_quadratic_drag():
    """m v' = m g - c v^2: v = v_T tanh(g t / v_T) with v_T = sqrt(m g / c), here 2 m/s."""
    times, speed = falling(quadratic_drag=1e-3 * GRAVITY / 4.0)
    torch.testing.assert_close(speed, 2.0 * (GRAVITY * times / 2.0).tanh(), rtol=0, atol=4e-3)
    assert float(speed[-1]) == pytest.approx(2.0, rel=1e-3)


@pytest.mark.parametrize(("share", "lets_go"), [(0.9, False), (1.1, True)])
def test_adhesion_lets_go_above_its_peak(share, lets_go):
    """Pulled up, against a drag that lets nothing overshoot, by a force of `share` times weight and largest pull."""
    body = block((3, 3, 2), density=1000.0)
    count, mass, peak, reach = len(body.x0), 1e-3, 0.02, 1e-3
    config = SimulationConfig(fps=30, terms=("adhesion", "drag", "force"))
    simulator = Simulator(body, config)
    force = torch.zeros(count, 3)
    force[:, 2] = share * (mass * GRAVITY + peak)
    states = rollout(
        simulator, 25, youngs_modulus=5e4, poissons_ratio=0.3, adhesion=torch.full((count,), peak),
        adhesion_range=reach, linear_drag=torch.full((count,), 0.5), force=force,
    )  # fmt: skip
    height = (states.x - states.x[0])[:, :, 2].mean(1)
    if lets_go:
        assert float(height[-1]) > 5 * reach
    else:
        u = float(height[-1]) / reach  # on the rising branch, where the pull is the force without the weight
        assert u < 1
        assert peak * u * math.exp(1 - u) == pytest.approx(share * (mass * GRAVITY + peak) - mass * GRAVITY, rel=0.02)
        assert float(height[-1] - height[-3]) < 1e-2 * reach


def test_body_rests_on_a_ball_at_depth_g_over_k():
    """A flat block in a ball of 20 m: its particles are g / k deep in the mean when drag has calmed it."""
    body = block((2, 2, 2), corner=(-0.01, -0.01, -0.02), density=1000.0)
    stiffness = 1e3
    config = SimulationConfig(fps=30, ground_height=None, terms=("obstacle", "drag"), dtype="float64")
    states = rollout(
        Simulator(body, config), 20, youngs_modulus=2e4, poissons_ratio=0.3,
        obstacle=[0.0, 0.0, -20.0, 0.0, 0.0, 0.0, 20.0, stiffness], linear_drag=0.06,
    )  # fmt: skip
    assert float(states.v[-1].abs().max()) < 1e-4
    assert float(-states.x[-1, :, 2].mean()) == pytest.approx(GRAVITY / stiffness, rel=2e-3)


BAR_LENGTH, BAR_DENSITY = 0.4, 1000.0


def free_bar_swing(E: float = 2e4, *terms: str, branches: tuple = ((), ()), **parameters) -> tuple[float, float]:
    """Decay rate and frequency [1/s] of a free bar's first longitudinal mode, 20 cells long; with E = 2e4 Pa, w = 35 /s.

    The 41 frames are three and a half cycles whatever E is. Poisson's ratio is zero.

    Args:
        branches: moduli over the bar's and relaxation times of Maxwell branches. What they add to the swing, decaying parts that
            do not swing, is taken off.
    """
    frames, fps, speed = 41, 200 / 3 * math.sqrt(E / 2e4), 0.02 * math.sqrt(E / 2e4)
    body = block((4, 4, 40), density=BAR_DENSITY)
    shape = np.cos(math.pi * body.x0[:, 2] / BAR_LENGTH)
    config = SimulationConfig(fps=fps, gravity=(0.0, 0.0, 0.0), ground_height=None, elastic_law="hencky", terms=terms)
    start = speed * shape[:, None] * np.array([0.0, 0.0, 1.0])
    states = rollout(
        Simulator(body, config), frames, youngs_modulus=E, poissons_ratio=0.0, initial_velocity=start, **parameters
    )
    displacement = (states.x - states.x[0])[:, :, 2].double().numpy() @ shape / (shape**2).sum()
    times = np.arange(frames) / fps
    poles, residues = bar_response(E, *branches)
    still = abs(poles.imag) < 1e-9
    displacement = displacement - speed * (np.exp(times[:, None] * poles[still]) @ residues[still]).real

    def swing(t, amplitude, rate, frequency, phase):
        return amplitude * np.exp(-rate * t) * np.sin(frequency * t + phase)

    guess = poles[poles.imag.argmax()]
    _, rate, frequency, _ = curve_fit(
        swing, times, displacement, p0=[speed / guess.imag, 0.1 - guess.real, guess.imag, 0]
    )[0]
    return rate, frequency


def bar_frequency(E: float) -> float:
    """Angular frequency [1/s] of the elastic bar's first mode."""
    return math.pi / BAR_LENGTH * math.sqrt(E / BAR_DENSITY)


def bar_response(E: float, shares: tuple = (), times: tuple = ()) -> tuple[np.ndarray, np.ndarray]:
    """Poles [1/s] and residues [s] of the mode's displacement after a start at unit speed, 1 / (s^2 + w^2 E(s) / E).

    Poisson's ratio is zero for slow motion, so G = E / 2 and K = E / 3. With Maxwell branches G(s) = G (1 + sum g s t / (1 + s t)),
    and along the bar E(s) = 9 K G(s) / (3 K + G(s)).
    """
    parts = [np.polynomial.Polynomial([1.0, t]) for t in times]
    below = math.prod(parts, start=np.polynomial.Polynomial([1.0]))
    shear = below + sum(
        np.polynomial.Polynomial([0.0, g * t]) * math.prod(parts[:k] + parts[k + 1 :], start=1.0)
        for k, (g, t) in enumerate(zip(shares, times, strict=True))
    )
    above = 2.0 * below + shear
    system = np.polynomial.Polynomial([0.0, 0.0, 1.0]) * above + 3.0 * bar_frequency(E) ** 2 * shear
    poles = system.roots().astype(complex)
    return poles, above(poles) / system.deriv()(poles)


def test_kelvin_voigt_bar_decays():
    """Its mode decays with t w^2 / 2, t the retardation time; what transfers damp without viscosity is taken off."""
    without, frequency = free_bar_swing()
    for retardation in (2e-3, 8e-3):
        rate, _ = free_bar_swing(2e4, "viscosity", viscosity=[retardation * 1e4, 0.0])
        assert rate - without == pytest.approx(retardation * frequency**2 / 2, rel=0.03)


def test_strong_viscosity_is_stable():
    """A retardation time of thirty elastic substeps: three times as many do, where without the average it would be fifty."""
    body = block((6, 4, 4))
    simulator = Simulator(body, SimulationConfig(fps=30, terms=("viscosity",)))
    velocity = 0.3 * torch.randn(len(body.x0), 3, generator=torch.Generator().manual_seed(0))
    values = {"youngs_modulus": 2e4, "poissons_ratio": 0.3, "initial_velocity": velocity}
    states = rollout(simulator, 6, viscosity=[200.0, 200.0], **values)
    assert torch.isfinite(states.x).all()
    assert states.v[-1].norm(dim=1).max() < velocity.norm(dim=1).max()
    given = Parameters(torch.tensor(2e4), torch.tensor(0.3))
    assert simulator.substeps(replace(given, viscosity=torch.tensor([200.0, 200.0]))) < 4 * simulator.substeps(given)


def swinging(poles: np.ndarray) -> complex:
    return poles[poles.imag.argmax()]


@pytest.mark.parametrize(("share", "time"), [(0.6, 3e-3), (0.6, 0.03), (0.6, 1.0), (1.2, 0.1)])
def test_standard_linear_solid_swings_as_its_complex_modulus_says(share, time):
    """Slower than its relaxation, about as fast and faster: frequency and decay beside those without a branch."""
    E = 2e4
    pole, without = swinging(bar_response(E, [share], [time])[0]), free_bar_swing(E)
    found = free_bar_swing(
        E, "relaxation", branches=([share], [time]), relaxation_modulus=share * E / 2, relaxation_time=time
    )
    assert found[1] / without[1] == pytest.approx(pole.imag / bar_frequency(E), rel=3e-3)
    assert found[0] - without[0] == pytest.approx(-pole.real, rel=0.02, abs=4e-3)
    if time == 1.0:  # too fast for the branch: the modulus is that of 1 + g times the shear modulus
        stiff = 3 * (1 + share) / (3 + share)
        assert found[1] / without[1] == pytest.approx(math.sqrt(stiff), rel=2e-3)


def test_hysteresis_takes_the_same_share_of_a_swing_at_any_frequency():
    """Two bars of which one swings twice as fast lose the same a cycle; with viscosity the faster one loses twice as much.

    What is lost a cycle is 2 pi rate / frequency, of the amplitude's logarithm. The branches are those of the effect, whose loss
    is flat to RIPPLE; bars of E and 4 E swing at 6 and 13 Hz.
    """
    shares, times = branch_shares(tensor(0.15)), branch_times()
    lost, expected, viscous = [], [], []
    for E in (2e4, 8e4):
        without, branches = free_bar_swing(E), (shares.tolist(), times.tolist())
        rate, frequency = free_bar_swing(
            E, "hysteresis", branches=branches, hysteresis_modulus=shares * E / 2, hysteresis_time=times
        )
        pole = swinging(bar_response(E, *branches)[0])
        assert frequency / without[1] == pytest.approx(pole.imag / bar_frequency(E), rel=3e-3)
        lost.append(rate / frequency - without[0] / without[1])
        expected.append(-pole.real / pole.imag)
        rate, frequency = free_bar_swing(E, "viscosity", viscosity=[2e-3 * E / 2, 0.0])
        viscous.append(rate / frequency - without[0] / without[1])
    assert lost == pytest.approx(expected, rel=0.02)
    assert lost[1] / lost[0] == pytest.approx(1.0, abs=RIPPLE)
    assert viscous[1] / viscous[0] == pytest.approx(2.0, rel=0.05)


def test_a_hanging_bar_sags_slowly_to_its_elastic_length():
    """Let go, it first stretches by what 1 + g times the shear modulus leaves, and then on to the elastic stretch.

    The creep of Zener's solid: 1 / G(t) = (1 - g / (1 + g) exp(-t / ((1 + g) t_r))) / G, and 1 / E = 1 / (3 G) + 1 / (9 K).
    Viscosity stills the swing.
    """
    E, share, time, fps, frames = 4e4, 1.0, 0.4, 60.0, 181
    length = 0.2
    body = block((4, 4, 22), 0.01, 1000.0, corner=(0.0, 0.0, -length))
    clamp = Clamp((-1.0, -1.0, 0.0), (1.0, 1.0, 1.0))
    config = SimulationConfig(
        fps=fps, ground_height=None, gravity=(0.0, 0.0, -2.0), terms=("relaxation", "viscosity"), dtype="float64"
    )
    tip = body.x0[:, 2] < body.x0[:, 2].min() + 1e-9
    drops = []
    for modulus in (share * E / 2, 0.0):
        states = rollout(
            Simulator(body, config, clamps=(clamp,)), frames, youngs_modulus=E, poissons_ratio=0.0,
            relaxation_modulus=modulus, relaxation_time=time, viscosity=[0.01 * E, 0.0],
        )  # fmt: skip
        drops.append((states.x[0] - states.x)[:, tip, 2].mean(1).numpy())
    relaxing, elastic = drops[0], drops[1][-1]
    t = np.arange(frames) / fps
    expected = elastic * (2 / 3 * (1 - share / (1 + share) * np.exp(-t / ((1 + share) * time))) + 1 / 3)
    still = t > 0.4  # the swing has died out
    np.testing.assert_allclose(relaxing[still], expected[still], rtol=0.01)
    assert relaxing[still][0] < 0.82 * elastic
    assert relaxing[-1] == pytest.approx(elastic, rel=0.01)


def test_maxwell_branches_give_no_energy_to_a_spinning_body():
    """Free, spinning and swinging: what swings dies out, and no more; the spin stays.

    It turns faster where the body shrinks, so its energy swings by a few hundredths at first.
    """
    body, mass = block((8, 4, 4), density=1000.0), 1e-3
    arm = body.x0 - body.x0.mean(0)
    config = SimulationConfig(
        fps=60, ground_height=None, gravity=(0.0, 0.0, 0.0), terms=("relaxation", "hysteresis"), dtype="float64"
    )
    start = np.cross([0.0, 0.0, 12.0], arm) + 2.0 * arm * [1.0, -1.0, 0.5]
    states = rollout(
        Simulator(body, config), 61, youngs_modulus=1e5, poissons_ratio=0.3, initial_velocity=start,
        relaxation_modulus=2.5e4, relaxation_time=0.02, hysteresis_modulus=[1.5e4, 1.5e4, 2.5e4],
        hysteresis_time=branch_times(),
    )  # fmt: skip
    x, v = (values.numpy()[1:] for values in (states.x - states.x.mean(1, keepdim=True), states.v))
    kinetic = 0.5 * mass * (v**2).sum((1, 2))
    spin = mass * np.cross(x, v)[..., 2].sum(1)
    of_spin = 0.5 * spin**2 / (mass * (x[..., :2] ** 2).sum((1, 2)))
    assert 1.02 * kinetic[0] > kinetic.max() and kinetic[0] > 1.005 * of_spin[0]
    np.testing.assert_allclose(spin, spin[0], rtol=5e-3)
    np.testing.assert_allclose(spin[10:], spin[10], rtol=2e-3)
    assert kinetic[-1] == pytest.approx(of_spin[-1], rel=1e-4)
    assert of_spin[-1] == pytest.approx(of_spin[10], rel=4e-3)


def test_a_strong_branch_is_stable():
    """Twenty times as stiff as the elastic law: the time step knows of it."""
    body = block((6, 4, 4))
    simulator = Simulator(body, SimulationConfig(fps=30, terms=("relaxation",)))
    velocity = 0.3 * torch.randn(len(body.x0), 3, generator=torch.Generator().manual_seed(0))
    values = {"youngs_modulus": 2e4, "poissons_ratio": 0.3, "initial_velocity": velocity}
    states = rollout(simulator, 12, relaxation_modulus=20 * 2e4 / 2.6, relaxation_time=10.0, **values)
    assert torch.isfinite(states.x).all()
    assert states.v[-1].norm(dim=1).max() < velocity.norm(dim=1).max()
    given = Parameters(torch.tensor(2e4), torch.tensor(0.3))
    stiff = replace(given, relaxation_modulus=torch.tensor(20 * 2e4 / 2.6))
    assert simulator.substeps(stiff) > 2 * simulator.substeps(given)


@pytest.mark.parametrize("memory", [0, 1, 8, 40])
def test_viscous_step_is_the_stability_limit(memory):
    """Of the mode v' = v - a X - g R, X' = X + v', R' = (n R + v') / (n + 1): stable up to a + 2 g / (2 n + 1) = 4."""

    def amplification(total: float, elastic: float) -> float:
        a, g, b = total * elastic, total * (1 - elastic) * (2 * memory + 1) / 2, 1 / (memory + 1)
        step = np.array([[1, -a, -g], [1, 1 - a, -g], [b, -b * a, 1 - b - b * g]])
        return np.abs(np.linalg.eigvals(step)).max()

    for elastic in np.linspace(0.01, 0.99, 21):
        assert max(amplification(total, elastic) for total in np.linspace(0.05, 3.99, 40)) < 1 + 1e-9
        assert amplification(4.01, elastic) > 1 + 1e-4


def test_fibres_add_to_the_stiffness_along_them():
    """A bar hung up by its end, in weak gravity, stretches by rho g l^2 / 2 (E + k); across the fibres by rho g l^2 / 2 E."""
    E, density, spacing, cells, gravity = 1e4, 1000.0, 0.01, 10, 1.0
    length = 2 * cells * spacing
    body = block((4, 4, 2 * cells + 2), spacing, density, corner=(0.0, 0.0, -length))
    clamp = Clamp((-1.0, -1.0, 0.0), (1.0, 1.0, 1.0))
    for direction, modulus in (((0.0, 0.0, 1.0), E + 1e4), ((1.0, 0.0, 0.0), E)):
        fps, period = 200, 4 * length / np.sqrt(modulus / density)
        config = SimulationConfig(fps=fps, ground_height=None, gravity=(0.0, 0.0, -gravity), terms=("fibres",))
        states = rollout(
            Simulator(body, config, clamps=(clamp,)), round(2 * period * fps) + 1, youngs_modulus=E, poissons_ratio=0.0,
            fibre_modulus=1e4, fibre_direction=direction,
        )  # fmt: skip
        tip = body.x0[:, 2] < body.x0[:, 2].min() + 1e-9
        stretch = float((states.x[0] - states.x[1:])[:, tip, 2].mean())
        assert stretch == pytest.approx(density * gravity * length**2 / (2 * modulus), rel=0.05)


def sliding_block(friction: float, law: tuple, speed: float, frames: int, gravity=(0.0, 0.0, -GRAVITY)) -> np.ndarray:
    """How far [m] a block has slid along x at frame times of 1/60 s; stiff, as its shear swings against the friction."""
    body = block((10, 10, 4), spacing=0.008)
    simulator = Simulator(body, SimulationConfig(fps=60, terms=("friction_law",), gravity=gravity))
    states = rollout(
        simulator, frames, youngs_modulus=3e5, poissons_ratio=0.3, friction_coefficient=friction,
        friction_law=law, initial_velocity=[speed, 0.0, 0.0],
    )  # fmt: skip
    return (states.x - states.x[0])[:, :, 0].double().mean(1).numpy()


def test_friction_that_rises_with_speed_stops_a_block_sooner():
    """s' = -g (mu + r s): it stops after s0 / (r g) - mu / (r^2 g) log(1 + r s0 / mu)."""
    friction, rate, speed = 0.3, 0.2, 1.0
    distance = speed / (rate * GRAVITY) - friction / (rate**2 * GRAVITY) * math.log(1 + rate * speed / friction)
    slid = sliding_block(friction, (0.0, 1.0, rate), speed, 30)
    assert slid[-1] == pytest.approx(distance, rel=0.03)
    assert distance < 0.8 * speed**2 / (2 * friction * GRAVITY)


def test_a_block_holds_on_a_slope_until_it_is_pushed():
    """On 20 degrees (tan = 0.36) with mu from 0.2 to 0.8: at rest it stays, pushed it slides on, and faster.

    Well above the static speed of 0.1 m/s its acceleration is g (sin a - 0.2 cos a).
    """
    sine, cosine = math.sin(math.radians(20.0)), math.cos(math.radians(20.0))
    gravity = (GRAVITY * sine, 0.0, -GRAVITY * cosine)
    law = (0.6, 0.1, 0.0)
    resting = sliding_block(0.2, law, 0.0, 25, gravity)
    assert abs(resting[-1] - resting[8]) < 5e-5
    pushed, time = sliding_block(0.2, law, 0.8, 25, gravity), 24 / 60
    expected = 0.8 * time + GRAVITY * (sine - 0.2 * cosine) * time**2 / 2
    assert pushed[-1] == pytest.approx(expected, rel=0.03)
