"""Contact of layers against its energy in torch, conservation laws, and scenes whose end is known."""

import dataclasses

import numpy as np
import pytest
import torch

from benchmarks.thin import touching
from benchmarks.thin_scenes import crossing_ropes, stacked_sheets
from physreal_core.simulation import Body, Grip, Parameters, SimulationConfig, Simulator, rod_body
from physreal_core.simulation.contact import surface as contact_module
from physreal_core.simulation.contact.reference import contact_energy
from physreal_core.simulation.cuda import contacts
from physreal_core.simulation.native import NativeStepper
from tests.simulation.thin.test_gradients import scattered

SCENES = {"shell": stacked_sheets, "rod": crossing_ropes}
WEIGHTLESS = {"ground_height": None, "gravity": (0.0, 0.0, 0.0), "dtype": "float64", "self_contact": True}


def number(value: float) -> torch.Tensor:
    return torch.tensor(value, dtype=torch.float64)


@pytest.mark.parametrize("kind", SCENES)
def test_forces_are_the_slope_of_the_energy(kind, form):
    """Elastic forces cancel between a step with and one without contact."""
    body = SCENES[kind]()
    count = len(body.x0)
    parameters = Parameters(scattered(count, 2e5, 1), number(0.25), initial_velocity=torch.zeros(3).double())
    config = SimulationConfig(fps=1e6, **WEIGHTLESS)
    own = dataclasses.replace(parameters, layer_friction=number(0.5))
    touching = Simulator(body, config).rollout(own, torch.zeros(2, 0, 3)).v[1]
    free = (
        Simulator(body, dataclasses.replace(config, self_contact=False)).rollout(parameters, torch.zeros(2, 0, 3)).v[1]
    )
    force = (touching - free) * config.fps * torch.tensor(body.mass)[:, None]
    x = torch.tensor(body.x0, requires_grad=True)
    contact_energy(body.elements.surface, x, parameters.youngs_modulus).backward()
    assert float(x.grad.abs().max()) > 1e-3
    torch.testing.assert_close(force, -x.grad, rtol=0, atol=1e-8 * float(x.grad.abs().max()))


@pytest.mark.parametrize("kind", SCENES)
def test_momentum_is_kept(kind, form):
    """With friction: forces between layers are pairs along one line, or shared at the nearest points."""
    body = SCENES[kind]()
    config = SimulationConfig(fps=500, **WEIGHTLESS)
    up = torch.tensor(body.x0[:, 2] > body.x0[:, 2].mean()).double()[:, None]
    start = (2 * up - 1) * torch.tensor([0.3, 0.1, -0.3], dtype=torch.float64)
    parameters = Parameters(number(2e5), number(0.25), initial_velocity=start, layer_friction=number(0.5))
    states = Simulator(body, config).rollout(parameters, torch.zeros(11, 0, 3))
    mass = torch.tensor(body.mass)[:, None]
    momentum = (mass * states.v).sum(1)
    assert (mass * (states.v[-1] - states.v[0])).abs().sum() > 0.2 * (mass * states.v[0]).abs().sum()  # they do collide
    assert (momentum - momentum[0]).abs().max() < 1e-12 * float((mass * states.v[0]).abs().sum())


@pytest.mark.parametrize("kind", SCENES)
def test_a_bounce_without_friction_keeps_the_energy(kind, form):
    """Of stiff layers that have parted again: kinetic and elastic energy; what a step of first order loses shrinks with it."""
    body = SCENES[kind](gap=1.3) if kind == "shell" else crossing_ropes(gap=1.3)
    errors = []
    for courant in (0.4, 0.1):
        config = SimulationConfig(fps=400, courant=courant, **WEIGHTLESS)
        up = torch.tensor(body.x0[:, 2] > body.x0[:, 2].mean()).double()[:, None]
        start = (2 * up - 1) * torch.tensor([0.0, 0.0, -0.5], dtype=torch.float64)
        parameters = Parameters(number(2e5), number(0.25), initial_velocity=start, layer_friction=number(0.0))
        states = Simulator(body, config).rollout(parameters, torch.zeros(21, 0, 3))
        energy = [total_energy(body, parameters, states, frame) for frame in range(21)]
        errors.append(max(abs(e / energy[0] - 1.0) for e in energy))
        assert float((states.v[-1] - states.v[0]).abs().max()) > 0.5
    assert errors[0] < 0.06
    assert errors[1] < 0.01


def total_energy(body: Body, parameters: Parameters, states, frame: int) -> float:
    from physreal_core.simulation.thin.reference import rod_energy, shell_energy

    energy_of = shell_energy if body.elements.element == "Shell" else rod_energy
    E, nu = (value.expand(len(body.x0)) for value in (parameters.youngs_modulus, parameters.poissons_ratio))
    rows = body.elements.stiffness(Parameters(E, nu))
    x, v = states.x[frame], states.v[frame]
    kinetic = 0.5 * (torch.tensor(body.mass)[:, None] * v.square()).sum()
    return float(kinetic + energy_of(body.elements, x, rows) + contact_energy(body.elements.surface, x, E))


# --- which pairs are looked at ----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", SCENES)
def test_which_pairs_are_listed_does_not_matter(kind, form, monkeypatch):
    """A margin of a fiftieth of an edge, with lists every other step, and one that holds the whole body give the same digits."""
    monkeypatch.setattr(contacts, "AT_FIRST", 4)
    body = SCENES[kind](gap=1.2)
    up = torch.tensor(body.x0[:, 2] > body.x0[:, 2].mean()).double()[:, None]
    start = (2 * up - 1) * torch.tensor([0.8, 0.3, -1.0], dtype=torch.float64)
    results = []
    for margin in (0.02, 10.0):
        monkeypatch.setattr(contact_module, "FINDING", margin)
        parameters = Parameters(
            number(2e5).requires_grad_(), number(0.25), initial_velocity=start, layer_friction=number(0.3)
        )
        states = Simulator(body, SimulationConfig(fps=100, **WEIGHTLESS)).rollout(parameters, torch.zeros(6, 0, 3))
        states.x[-1].square().sum().backward()
        results.append((states.x.detach(), parameters.youngs_modulus.grad))
    assert torch.allclose(results[0][0], results[1][0], rtol=0, atol=1e-9)
    assert torch.allclose(results[0][1], results[1][1], rtol=1e-5, atol=0)


def collision(body: Body, slide: float = 0.8) -> dict[str, torch.Tensor]:
    """Places and gradients of layers that meet."""
    up = torch.tensor(body.x0[:, 2] > body.x0[:, 2].mean()).double()[:, None]
    start = (2 * up - 1) * torch.tensor([slide, 0.3, -1.0], dtype=torch.float64)
    leaves = {
        "youngs_modulus": scattered(len(body.x0), 2e5, 1).requires_grad_(),
        "layer_friction": number(0.3).requires_grad_(),
    }
    config = SimulationConfig(fps=100, **WEIGHTLESS)
    states = Simulator(body, config).rollout(
        Parameters(poissons_ratio=number(0.25), initial_velocity=start, **leaves), torch.zeros(6, 0, 3)
    )
    states.x[-1].square().sum().backward()
    return {"x": states.x.detach()} | {name: leaf.grad for name, leaf in leaves.items()}


@pytest.mark.parametrize("kind", SCENES)
def test_too_little_room_and_too_few_lists_are_made_good(kind, fused, monkeypatch):
    """The fused form repeats a frame with more room for pairs, and with more lists where vertices go too far between two; a rerun gives the same
    bytes."""
    body = SCENES[kind](gap=1.2)
    as_usual = collision(body)
    for setting, value, remedy in (("FIRST_ROOM", 0.1, "grow"), ("AT_FIRST", 64, "list_more_often")):
        with monkeypatch.context() as patch:
            patch.setattr(contacts, setting, value)
            taken, mend = [], getattr(contacts.ContactModel, remedy)
            patch.setattr(contacts.ContactModel, remedy, lambda own, to=taken, by=mend: to.append(by(own)) or to[-1])
            found = collision(body)
            for name, values in as_usual.items():
                torch.testing.assert_close(found[name], values, rtol=1e-12, atol=0)
            assert any(taken), remedy
    again = collision(body)
    assert all(torch.equal(again[name], values) for name, values in as_usual.items())


def test_the_number_of_threads_does_not_matter():
    body = touching.folded((24, 24), (0.24, 0.24), 0.004, radius=0.0014)
    parameters = Parameters(number(1e5), number(0.3), number(0.3), layer_friction=number(0.3))
    results = []
    for threads in (1, 2):
        torch.set_num_threads(threads)
        simulator = Simulator(body, SimulationConfig(fps=100, dtype="float64", self_contact=True))
        assert isinstance(simulator._stepper, NativeStepper) and simulator._stepper.threads == threads
        results.append(simulator.rollout(parameters, torch.zeros(4, 0, 3)).x)
    assert torch.equal(*results)


# --- scenes whose end is known ----------------------------------------------------------------------------------


def test_a_folded_sheet_comes_to_rest_a_thickness_apart():
    """Dropped with its halves 3 thicknesses apart."""
    height, thickness = touching.rest_fold(20)
    assert height == pytest.approx(thickness, rel=0.1)


def test_without_contact_the_folded_sheet_falls_through_itself():
    body = touching.folded((20, 8), (0.2, 0.08), 0.002, radius=0.003)
    config = SimulationConfig(fps=30, terms=("drag", "bending"))
    parameters = Parameters(
        torch.tensor(1e5), torch.tensor(0.3), torch.tensor(0.4), bending_ratio=torch.tensor(0.05),
        linear_drag=torch.tensor(3.0) * torch.tensor(body.mass),
    )  # fmt: skip
    states = Simulator(body, config).rollout(parameters, torch.zeros(46, 0, 3))
    assert float(states.x[-1, -54:, 2].mean()) < 0.0015  # on the ground, as the lower half


@pytest.mark.parametrize("friction, slope", [(0.3, 0.2), (0.3, 0.5), (0.0, 0.3), (0.6, 0.7)])
@pytest.mark.parametrize("slides", [touching.sliding_strip, touching.sliding_block])
def test_what_lies_on_itself_slides_by_coulombs_law(slides, friction, slope):
    """Where tan(slope) is below friction it stays but for a creep."""
    acceleration, speed = slides(30 if slides is touching.sliding_strip else 2, friction, slope)
    expected = touching.slide_down(slope, friction)
    if expected == 0.0:
        assert speed < (2 if slides is touching.sliding_strip else 5) * contact_module.LAYER_SPEED
    else:
        assert acceleration == pytest.approx(expected, rel=0.03)


def test_a_cloth_folded_in_half_and_lifted_by_the_upper_corners_opens():
    height, length = touching.cloth_opens(20)
    assert height == pytest.approx(length, rel=0.02)


def test_a_rope_laid_in_a_loop_and_pulled_does_not_pass_through_itself():
    least, diameter = touching.loop_pulled(60)
    assert least > 0.5 * diameter


def test_hooked_ropes_do_not_pass_through_each_other():
    """Two loops through each other, pulled apart by their ends until they are taut: they hold each other, half a diameter apart at least."""
    radius = 0.005
    body, ends = hooked_ropes(radius)
    grip = Grip(ends, np.arange(4), np.ones(4), np.full(4, 0.005))
    config = SimulationConfig(
        fps=60, terms=("drag", "bending"), self_contact=True, ground_height=None, gravity=(0.0,) * 3
    )
    parameters = Parameters(
        torch.tensor(2e6), torch.tensor(0.3), bending_ratio=torch.tensor(0.05), grip_stiffness=torch.tensor(50.0),
        grip_damping=torch.tensor(0.05), linear_drag=torch.tensor(5.0) * torch.tensor(body.mass),
        layer_friction=torch.tensor(0.2),
    )  # fmt: skip
    frames = 25
    time = torch.linspace(0, 1, frames)[:, None, None]
    outwards = torch.tensor([[-1.0, 0.0, 0.0]] * 2 + [[1.0, 0.0, 0.0]] * 2)
    path = torch.tensor(body.x0[ends]).float() + (0.005 + 0.035 * time) * outwards
    touching = Simulator(body, config, grip).rollout(parameters, path).x
    free = (
        Simulator(body, dataclasses.replace(config, self_contact=False), grip)
        .rollout(dataclasses.replace(parameters, layer_friction=None), path)
        .x
    )
    half = len(body.x0) // 2
    assert strand_distance(touching, half).min() > radius
    assert strand_distance(free, half).min() < 0.8 * radius
    for x, sign in ((touching, 1), (free, -1)):  # how far the middle of the one is beyond that of the other
        beyond = float(x[-1, half // 2, 0] - x[-1, half + half // 2, 0])
        assert sign * beyond > 0, beyond


def hooked_ropes(radius: float) -> tuple[Body, np.ndarray]:
    """Two U-shaped ropes in planes across each other, each through the other's loop, and their four ends."""
    turn, width = np.linspace(-np.pi / 2, np.pi / 2, 11), 0.03
    straight = np.linspace(0.0, 0.1, 12)[1:][::-1]
    bow = np.stack([width * np.cos(turn), width * np.sin(turn)], 1)
    plane = np.concatenate(
        [np.stack([-straight, 0 * straight - width], 1), bow, np.stack([-straight[::-1], 0 * straight + width], 1)]
    )
    one = np.stack([plane[:, 0] - 0.01, 0 * plane[:, 0], plane[:, 1]], 1)
    other = np.stack([0.01 - plane[:, 0], plane[:, 1], 0 * plane[:, 0]], 1)
    count = len(one)
    return rod_body(np.concatenate([one, other]), radius, 600.0, rows=(count, count)), np.array(
        [0, count - 1, count, 2 * count - 1]
    )


def strand_distance(x: torch.Tensor, half: int) -> np.ndarray:
    """Least distance of the first `half` vertices' segments from the others', of every frame [m], by points on them."""
    along = torch.linspace(0, 1, 9)[:-1, None]
    points = [
        (s[:, :-1, None] + along * (s[:, 1:, None] - s[:, :-1, None])).flatten(1, 2) for s in (x[:, :half], x[:, half:])
    ]
    return np.array([float(torch.cdist(p, q).min()) for p, q in zip(*points, strict=True)])
