"""Motion against closed forms and conservation laws."""

import numpy as np
import pytest
import torch

from physreal_core.fitting.grip import springs
from physreal_core.simulation import Body, Clamp, Grip, Parameters, SimulationConfig, Simulator, States
from physreal_core.simulation.lattice import Lattice
from physreal_core.simulation.start import stencils
from tests.simulation.scenes import block

pytestmark = pytest.mark.usefixtures("form")

GRAVITY = 9.81


def rollout(simulator: Simulator, frames: int, controllers=None, **parameters) -> States:
    values = {name: torch.as_tensor(value, dtype=torch.float64) for name, value in parameters.items()}
    points = torch.zeros(frames, 0, 3) if controllers is None else controllers
    with torch.no_grad():
        return simulator.rollout(Parameters(**values), points)


def test_free_fall_is_exact():
    """All particles move as x0 + v0 t + g t (t + dt) / 2, the symplectic Euler sum, to rounding."""
    body = block((3, 4, 3), corner=(0.1, 0.2, 5.0))
    simulator = Simulator(body, SimulationConfig(fps=30, ground_height=None, dtype="float64"))
    velocity = torch.tensor([0.3, -0.2, 1.0], dtype=torch.float64)
    states = rollout(simulator, 11, youngs_modulus=1e4, poissons_ratio=0.3, initial_velocity=velocity)
    substeps = simulator.substeps(Parameters(torch.tensor(1e4), torch.tensor(0.3)))
    t = torch.arange(11, dtype=torch.float64)[:, None, None] / 30
    fall = torch.tensor([0.0, 0.0, -GRAVITY], dtype=torch.float64) * t * (t + 1 / (30 * substeps)) / 2
    assert (states.x - torch.as_tensor(body.x0) - velocity * t - fall).abs().max() < 1e-12
    assert (states.F - torch.eye(3)).abs().max() < 1e-11


@pytest.mark.parametrize("friction", [0.3, 0.6])
def test_sliding_block_stops_after_v2_over_2_mu_g(friction):
    body = block((10, 10, 4), spacing=0.008)
    simulator = Simulator(body, SimulationConfig(fps=60))
    frames = int(60 * 1.3 / (friction * GRAVITY)) + 3
    states = rollout(
        simulator, frames, youngs_modulus=6e4, poissons_ratio=0.3, friction_coefficient=friction,
        initial_velocity=[1.0, 0.0, 0.0],
    )  # fmt: skip
    distance = float((states.x[-1] - states.x[0])[:, 0].mean())
    assert distance == pytest.approx(1.0 / (2 * friction * GRAVITY), rel=0.03)


@pytest.mark.parametrize("friction", [0.2, 0.8])
def test_block_on_a_slope_slides_or_stays(friction):
    """Gravity tilted by 30 degrees: acceleration g (sin a - mu cos a) below tan a, none above."""
    body = block((8, 8, 4), spacing=0.008)
    sine, cosine = 0.5, np.sqrt(0.75)
    config = SimulationConfig(fps=60, gravity=(GRAVITY * sine, 0.0, -GRAVITY * cosine))
    frames = 25
    states = rollout(
        Simulator(body, config), frames, youngs_modulus=6e4, poissons_ratio=0.3, friction_coefficient=friction
    )
    travelled = (states.x - states.x[0])[:, :, 0].mean(1)
    time = (frames - 1) / 60
    if friction < sine / cosine:
        assert float(travelled[-1]) == pytest.approx(GRAVITY * (sine - friction * cosine) * time**2 / 2, rel=0.03)
    else:  # it moves while its weight settles on the plane, then not any more
        assert abs(float(travelled[8])) < 4e-3
        assert abs(float(travelled[-1] - travelled[8])) < 1e-4


def test_block_lands_near_the_plane():
    """The gap that contact through grid nodes leaves: a fifth of a cell after a fall, none at rest."""
    cell = 0.016
    for corner, low, high in ((0.0, -0.01, 0.01), (0.03, 0.0, 0.2)):
        body = block((10, 10, 8), spacing=0.008, corner=(0.0, 0.0, corner))
        states = rollout(
            Simulator(body, SimulationConfig(fps=30)),
            30,
            youngs_modulus=6e4,
            poissons_ratio=0.3,
            friction_coefficient=0.5,
        )
        gap = float(states.x[-10:, :, 2].amin(1).mean()) - 0.004
        assert low * cell <= gap <= high * cell


def test_a_landing_moves_a_motion_by_no_more_than_substeps():
    """Where contact begins between two frames, or just before one, makes no difference: heights 0.05 mm apart lead to motions that
    lie closer than what the block falls in three substeps."""
    fallen = []
    for height in 0.012 + 5e-5 * np.arange(41):
        simulator = Simulator(block((5, 5, 5), spacing=0.008, corner=(0.0, 0.0, height)), SimulationConfig(fps=30))
        material = {"youngs_modulus": 5e4, "poissons_ratio": 0.3, "friction_coefficient": 0.5}
        fallen.append(rollout(simulator, 9, **material).x[..., 2].mean(1))
        substeps = simulator.substeps(Parameters(*map(torch.tensor, material.values())))
    apart = torch.stack(fallen).diff(dim=0).abs().max()
    assert apart < 3 * np.sqrt(2 * GRAVITY * 0.014) / (30 * substeps)


def test_a_weight_does_not_press_a_block_into_the_plane():
    """The lower half of a block bears an upper one eight times as dense: its lower face stays, its height shrinks by the strain."""
    body = block((10, 10, 8), spacing=0.008)
    density = np.where(body.x0[:, 2] > 0.032, 8000.0, 1000.0)
    body = Body(body.x0, body.volume, density, body.spacing)
    states = rollout(
        Simulator(body, SimulationConfig(fps=30)), 60, youngs_modulus=6e4, poissons_ratio=0.0, friction_coefficient=0.5
    )
    lowest = body.x0[:, 2] < 0.005
    resting = states.x[-30:].mean(0)[:, 2]
    strain = GRAVITY * (8000.0 + 1000.0) * 0.032 / 6e4  # at the lower face
    face = resting[lowest].mean() - 0.004 * (1 - strain)
    assert abs(float(face)) < 0.03 * body.cell


def test_hanging_bar_stretches_by_rho_g_l2_over_2e():
    """Ten cells long and clamped at the top; the mean over two periods is the static stretch."""
    E, density, spacing, cells = 2e4, 1000.0, 0.01, 10
    length = 2 * cells * spacing
    body = block((4, 4, 2 * cells + 2), spacing, density, corner=(0.0, 0.0, -length))
    fps, period = 200, 4 * length / np.sqrt(E / density)
    simulator = Simulator(
        body, SimulationConfig(fps=fps, ground_height=None), clamps=(Clamp((-1.0, -1.0, 0.0), (1.0, 1.0, 1.0)),)
    )
    states = rollout(simulator, round(2 * period * fps) + 1, youngs_modulus=E, poissons_ratio=0.0)
    tip = body.x0[:, 2] < body.x0[:, 2].min() + 1e-9
    stretch = float((states.x[0] - states.x[1:])[:, tip, 2].mean())
    assert stretch == pytest.approx(density * GRAVITY * length**2 / (2 * E), rel=0.05)


def test_cantilever_tip_and_first_period():
    """Three cells thick, fifteen long: Timoshenko's static tip and first period under own weight, both within 5 %.

    The period is Euler-Bernoulli's with the shear mode added in squares (Dunkerley).
    """
    E, density, spacing, gravity = 2e5, 1000.0, 0.01, 0.5
    length, thickness, fps = 0.3, 0.06, 100
    body = block((34, 6, 6), spacing, density, corner=(-0.04, 0.0, 0.0))
    config = SimulationConfig(fps=fps, ground_height=None, gravity=(0.0, 0.0, -gravity))
    simulator = Simulator(body, config, clamps=(Clamp((-1.0, -1.0, -1.0), (0.0, 1.0, 1.0)),))
    area, inertia, shear = thickness**2, thickness**4 / 12, 5 / 6 * E / 2
    load = density * area * gravity
    static = load * length**4 / (8 * E * inertia) + load * length**2 / (2 * shear * area)
    bending = 2 * np.pi / 3.516 * length**2 * np.sqrt(density * area / (E * inertia))
    period = np.hypot(bending, 4 * length / np.sqrt(shear / density))

    states = rollout(simulator, round(2 * period * fps) + 1, youngs_modulus=E, poissons_ratio=0.0)
    end = body.x0[:, 0] > body.x0[:, 0].max() - 1e-9
    deflection = (states.x[0] - states.x)[:, end, 2].mean(1).double().numpy()
    mean = deflection[1:].mean()
    assert mean == pytest.approx(static, rel=0.05)
    crossing = np.flatnonzero(np.diff(np.sign(deflection - mean)))
    times = (crossing + (mean - deflection[crossing]) / (deflection[crossing + 1] - deflection[crossing])) / fps
    found = 2 * (times[-1] - times[0]) / (len(times) - 1)
    assert found == pytest.approx(period, rel=0.05)
    assert mean / found**2 == pytest.approx(static / period**2, rel=0.03), "in which modulus and density cancel"


def test_body_hangs_from_its_grip_where_the_forces_balance():
    """Settled by the dashpot, sum of w k (l / l0 - 1) is the weight."""
    body = block((4, 4, 4))
    points = torch.tensor([[0.02, 0.02, 0.24]], dtype=torch.float64)
    top = np.flatnonzero(body.x0[:, 2] > 0.03)
    lengths = np.linalg.norm(body.x0[top] - points.numpy(), axis=1)
    grip = Grip(top, np.zeros(len(top), dtype=int), np.ones(len(top)), lengths)
    simulator = Simulator(body, SimulationConfig(fps=30, ground_height=None), grip)
    stiffness = 0.2
    states = rollout(
        simulator, 60, points.expand(60, 1, 3), youngs_modulus=2e4, poissons_ratio=0.3, grip_stiffness=stiffness,
        grip_damping=0.02,
    )  # fmt: skip
    assert states.v[-1].abs().max() < 2e-3
    arms = states.x[-1, top].double() - points
    stretch = arms.norm(dim=1) / torch.as_tensor(lengths) - 1
    lift = -(stiffness * stretch[:, None] * arms / arms.norm(dim=1, keepdim=True)).sum(0)
    assert float(lift[2]) == pytest.approx(body.mass.sum() * GRAVITY, rel=0.01)


def test_the_step_keeps_linear_and_angular_momentum():
    """Without outer forces, to rounding; angular momentum is that of the nodes, one substep a frame."""
    body = block((4, 4, 4))
    config = SimulationConfig(fps=5000, gravity=(0.0, 0.0, 0.0), ground_height=None, dtype="float64")
    simulator = Simulator(body, config)
    velocity = np.random.default_rng(0).normal(0, 0.3, body.x0.shape)
    numbers = {"youngs_modulus": 5e3, "poissons_ratio": 0.3, "initial_velocity": velocity}
    given = simulator._complete(Parameters(**{name: torch.as_tensor(value) for name, value in numbers.items()}), 1)
    shown, record = simulator._loop.forward(given, torch.zeros(100, 1, 0, 3), None, keep=True)
    v, F = shown["v"], shown["F"]
    assert record.substeps == [1]
    assert (F[-1] - torch.eye(3)).abs().max() > 0.05
    linear = (torch.as_tensor(body.mass)[:, None] * v[:, 0]).sum(1)
    assert (linear[1:] - linear[0]).norm(dim=1).max() < 1e-12
    lattice = simulator._stepper.lattice
    mass = node_masses(body, lattice)
    index = np.stack(np.meshgrid(*map(np.arange, lattice.count), indexing="ij"), -1).reshape(-1, 3)
    velocities = record.further["nodes"][:, 0, :, :3]
    places = torch.as_tensor(lattice.offset + lattice.cell * index) + velocities[1:].cumsum(0) / config.fps
    angular = (mass[:, None] * torch.linalg.cross(places, velocities[1:])).sum(1)
    assert (angular - angular[0]).norm(dim=1).max() < 1e-12 * float(angular[0].norm())


def elastic_energy(body: Body, F: torch.Tensor, E: float, nu: float) -> torch.Tensor:
    """Fixed corotated energy of every frame [J]."""
    mu, lam = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    stretches = torch.linalg.svdvals(F)
    density = mu * ((stretches - 1) ** 2).sum(-1) + lam / 2 * (stretches.prod(-1) - 1) ** 2
    return (density * torch.as_tensor(body.volume)).sum(-1)


def node_masses(body: Body, lattice: Lattice) -> torch.Tensor:
    nodes, weights = stencils(body.x0, lattice)
    mass = torch.zeros(lattice.nodes).double()
    return mass.index_add_(0, torch.as_tensor(nodes.ravel()), torch.as_tensor((weights * body.mass[:, None]).ravel()))


def test_energy_stays():
    """A block thrown with a stretching velocity field swings freely for thirty cycles: elastic and kinetic energy, that of the nodes,
    swing by what a symplectic step of first order lets them, and do not drift."""
    body = block((4, 6, 4))
    config = SimulationConfig(fps=200, gravity=(0.0, 0.0, 0.0), ground_height=None, dtype="float64", courant=0.1)
    centred = body.x0 - body.x0.mean(0)
    simulator, (E, nu) = Simulator(body, config), (5e3, 0.3)
    numbers = {"youngs_modulus": E, "poissons_ratio": nu, "initial_velocity": centred * np.array([-8.0, 15.0, -8.0])}
    given = simulator._complete(Parameters(**{name: torch.as_tensor(value) for name, value in numbers.items()}), 1)
    shown, record = simulator._loop.forward(given, torch.zeros(241, 1, 0, 3), None, keep=True)
    F = shown["F"]
    mass = node_masses(body, simulator._stepper.lattice)
    kinetic = (0.5 * mass[:, None] * record.further["nodes"][:, 0, :, :3] ** 2).sum((1, 2))
    elastic = elastic_energy(body, F[:, 0], E, nu)
    energy = (kinetic + elastic) / (kinetic + elastic)[0]
    assert elastic.max() > 0.3 * kinetic[0]  # it does swing
    assert (energy - 1).abs().max() < 0.06
    assert energy[-60:].mean() == pytest.approx(float(energy[:60].mean()), abs=0.01)


def test_a_swing_does_not_die_out_and_its_middle_stays():
    """A cantilever four cells long that is held by stiff bonds and let go: its tip comes back to where it began, swing after swing."""
    body = block((26, 5, 5), spacing=0.008, corner=(0.0, 0.0, 0.1), density=600.0)
    held = np.flatnonzero(body.x0[:, 0] < 0.04)
    points = block((6, 6, 6), spacing=0.008, corner=(-0.004, -0.004, 0.096)).x0
    grip = springs(body.x0, held, points, body.spacing, 8)
    simulator = Simulator(body, SimulationConfig(fps=60, ground_height=None, courant=0.6), grip)
    controllers = torch.as_tensor(points).float().expand(181, -1, -1)
    states = rollout(
        simulator, 181, controllers, youngs_modulus=2e5, poissons_ratio=0.3, grip_stiffness=3000.0, grip_damping=0.0
    )
    tip = states.x[:, body.x0[:, 0] > 0.2, 2].mean(1).double()
    tip = tip - tip[0]
    assert tip.min() < -0.03
    first, last = tip[:60], tip[-60:]
    assert last.max() > 0.05 * tip.min()
    assert last.min() == pytest.approx(float(first.min()), rel=0.05)
    assert last.mean() == pytest.approx(float(first.mean()), rel=0.05)


def test_deformation_gradients_say_how_the_particles_lie():
    """In a cantilever that swings for two seconds."""
    body = block((26, 5, 5), spacing=0.008, corner=(0.0, 0.0, 0.1), density=600.0)
    config = SimulationConfig(fps=30, ground_height=None, courant=0.5)
    simulator = Simulator(body, config, clamps=(Clamp((-1.0, -1.0, -1.0), (0.016, 1.0, 1.0)),))
    states = rollout(simulator, 61, youngs_modulus=2e5, poissons_ratio=0.3)
    x, F = (state[-1].double().reshape(26, 5, 5, *state.shape[2:]) for state in (states.x, states.F))
    between_neighbours = (x[2:] - x[:-2]).norm(dim=-1)[4:-4] / 0.016 - 1
    stated = F[1:-1, ..., 0].norm(dim=-1)[4:-4] - 1
    size = stated.square().mean().sqrt()
    assert size > 0.02
    assert (between_neighbours - stated).square().mean().sqrt() < 0.25 * size


def test_a_spinning_block_is_not_strained():
    """The nodes start with the field of the particles' velocities; the centrifugal strain, in the mean rho w^2 L^2 / (12 E) = 2e-4
    along two axes, swings up to twice that."""
    body = block((10, 10, 10), spacing=0.01, density=1000.0, corner=(0.1037, 0.1037, 0.1037))
    config = SimulationConfig(fps=30, ground_height=None, gravity=(0.0, 0.0, 0.0))
    spin = np.cross([0.0, 0.0, 5.0], body.x0 - body.x0.mean(0))
    states = rollout(Simulator(body, config), 31, youngs_modulus=1e5, poissons_ratio=0.3, initial_velocity=spin)
    strain = (states.F[-1].double().mT @ states.F[-1].double() - torch.eye(3)) / 2
    assert strain.square().sum((1, 2)).mean().sqrt() < 6e-4
