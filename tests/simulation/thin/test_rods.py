"""Rods with directors against closed forms: rest, rigid turns, natural curvature, torsion, buckling under twist, energy, damping."""

from itertools import pairwise

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.simulation import Body, Clamp, Parameters, SimulationConfig, Simulator, rod_body, untwisted_directors
from physreal_core.simulation.thin.reference import framed_rod_energy

LENGTH, RADIUS, DENSITY, MODULUS, POISSON = 0.4, 0.004, 1000.0, 1e6, 0.25
AREA, SECOND_MOMENT = np.pi * RADIUS**2, np.pi * RADIUS**4 / 4.0
BENDING, TWISTING = MODULUS * SECOND_MOMENT, MODULUS / (2 * (1 + POISSON)) * 2.0 * SECOND_MOMENT
TERMS = ("bending", "twisting", "rest_curvature", "retardation", "drag")
HAND = torch.zeros(0, 3)


def straight(
    segments: int, angle: np.ndarray | None = None, bent: np.ndarray | None = None, loose: float = 0.0
) -> Body:
    """A rod along x of which the directors stand at angles [rad] about it, and that is `bent` by so much along y [m] at vertices."""
    vertices = np.zeros((segments + 1, 3))
    vertices[:, 0] = np.linspace(0.0, LENGTH, segments + 1)
    angle = np.zeros(segments + 1) if angle is None else angle
    directors = np.stack([0.0 * angle, np.cos(angle), np.sin(angle)], 1)
    rest = np.full(segments, LENGTH / segments)
    if bent is not None:
        vertices[:, 1] += bent
    return rod_body(vertices, RADIUS, DENSITY, (1.0 + loose) * rest, directors=directors)


def simulator(body: Body, fps: float, *clamps: Clamp, gravity: float = 0.0) -> Simulator:
    config = SimulationConfig(fps=fps, dtype="float64", ground_height=None, gravity=(0.0, 0.0, gravity), terms=TERMS)
    return Simulator(body, config, clamps=clamps)


def around(x: np.ndarray) -> Clamp:
    """A clamp that holds what starts at these places."""
    return Clamp(tuple(x.min(0) - 1e-6), tuple(x.max(0) + 1e-6))


def parameters(**others) -> Parameters:
    return Parameters(torch.tensor(MODULUS), torch.tensor(POISSON), **others)


def end_angles(states) -> torch.Tensor:
    """Angle [rad] by which the last vertex of a rod along x has turned about it since the start, of every frame."""
    F = states.F[:, -1]
    return torch.atan2(F[:, 2, 1], F[:, 1, 1])


def wave(times: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Angular frequency [rad/s] and decay rate [1/s] of a free vibration, by its zeros and its extrema."""
    values = np.asarray(values)
    zero = np.flatnonzero(values[:-1] * values[1:] < 0)
    crossings = times[zero] + (times[1] - times[0]) * values[zero] / (values[zero] - values[zero + 1])
    frequency = np.pi * (len(crossings) - 1) / (crossings[-1] - crossings[0])
    peaks = [np.abs(values[a + 1 : b + 1]).max() for a, b in pairwise(zero)]
    decay = -np.polyfit(np.arange(len(peaks)) * np.pi / frequency, np.log(peaks), 1)[0]
    return frequency, decay


def test_a_straight_rod_at_rest_stays():
    states = simulator(straight(10), 30.0).rollout(parameters(), torch.zeros(10, 0, 3))
    assert torch.allclose(states.x[-1], states.x[0], atol=1e-14)
    assert torch.allclose(states.F, torch.eye(3, dtype=torch.float64), atol=1e-15)


def test_forces_turn_with_the_rod():
    rng = np.random.default_rng(0)
    x = straight(8).x0 + 0.005 * rng.normal(size=(9, 3))
    directors = untwisted_directors(x) + 0.4 * rng.normal(size=x.shape)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    rest = np.full(8, LENGTH / 8)
    curved = parameters(rest_curvature=torch.tensor(10.0 * rng.normal(size=(9, 2))))
    found = []
    for way in (np.eye(3), turn):
        body = rod_body(x @ way.T, RADIUS, DENSITY, rest, directors=directors @ way.T)
        found.append(simulator(body, 1000.0).rollout(curved, torch.zeros(20, 0, 3)))
    assert torch.allclose(found[1].x, found[0].x @ torch.tensor(turn).T, atol=1e-12)
    assert float((found[0].x[-1] - found[0].x[0]).norm()) > 1e-3


def test_a_ring_with_its_own_curvature_is_free_of_stress():
    """The polygon's curvature 2 tan(angle / 2) / l is that of the circle to the square of the angle, and the force goes with it."""
    shares = []
    for count in (40, 80):
        turn = 1.8 * np.pi * np.arange(count + 1) / count
        ring = 0.1 * np.stack([np.cos(turn), 0.0 * turn, np.sin(turn)], 1)
        body = rod_body(ring, RADIUS, DENSITY, directors=untwisted_directors(ring, first=np.array([0.0, 1.0, 0.0])))
        forces = []
        for curvature in (10.0, 0.0):  # the second is -binormal . director
            rest = torch.tensor([0.0, curvature], dtype=torch.float64)
            states = simulator(body, 1e5).rollout(parameters(rest_curvature=rest), torch.zeros(2, 0, 3))
            forces.append(float(states.v[1].norm(dim=1).max()))
        shares.append(forces[0] / forces[1])
    assert shares[0] < 1e-2
    assert shares[1] == pytest.approx(shares[0] / 4, rel=0.05)


def test_a_rod_takes_the_shape_of_its_own_curvature():
    radius = LENGTH / np.pi  # half a ring
    curved = parameters(rest_curvature=torch.tensor([0.0, 1.0 / radius]), linear_drag=torch.tensor(2e-3))
    body = straight(32)
    states = simulator(body, 10.0, around(body.x0[:2])).rollout(curved, torch.zeros(101, 0, 3))
    assert float(states.v[-1].norm(dim=1).max()) < 1e-3
    assert float((states.x[-1, -1] - states.x[-1, 0]).norm()) == pytest.approx(
        2 * radius, rel=0.02
    )  # a clamped segment is straight
    assert float(states.x[-1, :, 1].abs().max()) < 1e-9


def test_a_turned_end_twists_the_rod_evenly():
    """Clamped at both ends, one of them turned: all of the twist starts beside it, and spreads until it is even."""
    count = 20
    angle = np.zeros(count + 1)
    angle[count - 1 :] = 1.5
    body = straight(count, angle)
    lag = parameters(retardation_time=torch.tensor([0.0, 2e-3]))
    states = simulator(body, 100.0, around(body.x0[:2]), around(body.x0[-2:])).rollout(lag, torch.zeros(101, 0, 3))
    F = states.F[-1]
    turned = torch.atan2(F[:, 2, 1], F[:, 1, 1]).numpy()
    segment = np.arange(count)
    expected = 1.5 * segment / (count - 1) - angle[:count]
    expected = np.append((np.append(expected[0], (expected[1:] + expected[:-1]) / 2)), expected[-1])
    assert turned[2:-2] == pytest.approx(expected[2:-2], abs=2e-3)  # mean over the jump of the start is the only error
    assert float(states.x[-1].sub(torch.tensor(body.x0)).norm()) < 1e-9


def test_torsional_vibration():
    """One end held: w = pi / (2 L) sqrt(G / rho), and the dashpot's decay T w^2 / 2."""
    count = 40
    first, lag = LENGTH / count, 4e-4
    middle = (np.arange(count + 1) - 0.5) * first  # of the segments, from the one that is held on
    body = straight(count, 0.4 * np.sin(np.pi * middle / (2 * (LENGTH - 0.5 * first))))
    still = parameters(retardation_time=torch.tensor([0.0, lag]))
    states = simulator(body, 4000.0, around(body.x0[:2])).rollout(still, torch.zeros(1201, 0, 3))
    director = states.F[:, -1] @ torch.tensor(body.elements.directors[-2])
    angle = torch.atan2(director[:, 2], director[:, 1]).numpy()
    expected = np.pi / (2 * (LENGTH - 0.5 * first)) * np.sqrt(MODULUS / (2 * (1 + POISSON)) / DENSITY)
    frequency, decay = wave(np.arange(len(angle)) / 4000.0, angle)
    assert frequency == pytest.approx(expected, rel=0.01)
    assert decay == pytest.approx(lag * expected**2 / 2, rel=0.02)


def test_bending_vibration_decays_by_the_retardation():
    """Ends held in place but free to tilt: w^2 = E I / (rho A) (pi / L)^4, decay T w^2 / 2."""
    count, lag = 16, 2e-2
    body = straight(count, bent=1e-5 * np.sin(np.pi * np.linspace(0, 1, count + 1)))
    ends = around(body.x0[:1]), around(body.x0[-1:])
    still = parameters(retardation_time=torch.tensor([lag, 0.0]))
    states = simulator(body, 100.0, *ends).rollout(still, torch.zeros(801, 0, 3))
    expected = np.sqrt(BENDING / (DENSITY * AREA)) * (np.pi / LENGTH) ** 2
    frequency, decay = wave(np.arange(801) / 100.0, states.x[:, count // 2, 1].numpy())
    assert frequency == pytest.approx(expected, rel=0.01)
    assert decay == pytest.approx(lag * expected**2 / 2, rel=0.02)


@pytest.mark.parametrize(("share", "buckles"), [(0.95, False), (1.1, True)])
def test_a_twisted_rod_buckles_at_the_moment_of_greenhill(share, buckles):
    """Between clamps a moment M buckles a straight rod from tan u = u, u = M L / (2 E I) = 4.4934 on."""
    count = 40
    free = LENGTH * (count - 1) / count  # between the middles of the held segments
    twist = share * 2 * 4.4934 * BENDING / free / TWISTING  # [1/m]
    rng = np.random.default_rng(1)
    bent = 1e-6 * rng.normal(size=count + 1)
    bent[[0, 1, -2, -1]] = 0.0
    body = straight(count, twist * LENGTH / count * np.arange(count + 1), bent)
    held = around(body.x0[:2]), around(body.x0[-2:])
    states = simulator(body, 20.0, *held).rollout(parameters(), torch.zeros(41, 0, 3))
    away = states.x[:, :, 1:].norm(dim=-1).amax(1)
    assert bool(away[20:].max() > 100 * away[0]) == buckles
    assert buckles or float(away.max()) < 20 * float(away[0])


def test_an_undamped_swing_keeps_its_energy():
    count = 16
    body = straight(count, angle=np.linspace(0.0, 2.0, count + 1))
    curved = parameters(rest_curvature=torch.tensor([2.0, 3.0]))
    scene = simulator(body, 50.0, around(body.x0[:2]), gravity=-9.81)
    player = scene.play(curved, HAND)
    mobility = body.elements.mobility(torch.tensor(body.density)).numpy()
    inertia = np.divide(1.0, mobility, where=mobility > 0, out=np.zeros(count + 1))
    mass, complete = torch.tensor(body.mass), scene._complete(curved)
    stiffness = body.elements.stiffness(complete)

    def energy(state) -> float:
        kinetic = 0.5 * float((mass * state.v.square().sum(1)).sum())
        kinetic += 0.5 * float((torch.tensor(inertia) * state.spin.square()).sum())
        kinetic += 9.81 * float((mass * state.x[:, 2]).sum())
        return kinetic + float(framed_rod_energy(body.elements, state.x, state.director, stiffness))

    states = [energy(player.state)] + [energy(player.step(HAND)) for _ in range(150)]
    turned_over = 9.81 * float(mass.sum()) * LENGTH / 2  # between level and hanging
    first, last = np.mean(states[:50]), np.mean(states[100:])  # two seconds between them
    assert abs(last - first) / 2.0 < 0.01 * turned_over
    assert np.ptp(states) > 0


@pytest.mark.parametrize("lag", [(0.0, 0.0), (0.05, 0.0), (0.0, 0.01), (0.02, 0.02)])
def test_substeps_are_stable_up_to_the_courant_number_of_volumes(lag):
    """A bent and twisted rod whose ends are held, at 0.94 of the longest step that the bound allows."""
    count = 16
    rng = np.random.default_rng(3)
    body = straight(count, rng.normal(size=count + 1) * 0.3, 0.004 * rng.normal(size=count + 1))
    config = SimulationConfig(fps=20.0, courant=0.8, dtype="float64", ground_height=None, terms=TERMS)
    scene = Simulator(body, config, clamps=(around(body.x0[:2]), around(body.x0[-2:])))
    own = parameters(
        rest_curvature=torch.tensor([4.0, -6.0]),
        retardation_time=torch.tensor(lag),
        bending_ratio=torch.tensor(3.0),
        twisting_ratio=torch.tensor(3.0),
    )
    states = scene.rollout(own, torch.zeros(41, 0, 3))
    assert float(states.v.abs().max()) < 10.0


def test_what_a_rod_refuses():
    with pytest.raises(InputError, match="lies along it"):
        straight_along = np.tile([1.0, 0.0, 0.0], (4, 1))
        rod_body(straight(3).x0, RADIUS, DENSITY, directors=straight_along)
    with pytest.raises(InputError, match="fabric"):
        Simulator(straight(3), SimulationConfig(fps=30.0, terms=("fabric",)))
