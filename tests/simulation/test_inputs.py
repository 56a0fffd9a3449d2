"""What a rollout may be given instead of the body's and the configuration's own: gravity, density, forces, its start.

The adjoint, also by the controller points, against central differences in float64; values against what another body or
configuration gives, and against closed forms.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.simulation import Body, Clamp, Parameters, PointLoad, SimulationConfig, Simulator
from tests.simulation.conftest import take_fused
from tests.simulation.scenes import block, directional_errors, random_loss, two_point_grip

INPUTS = ("gravity", "density", "force", "initial_position", "initial_deformation")
FRAMES = 4
GRAVITY = 9.81
STEPS = {
    "youngs_modulus": 1e-2,
    "friction_coefficient": 1e-6,
    "grip_stiffness": 1e-6,
    "initial_velocity": 1e-6,
    "gravity": 1e-5,
    "density": 1e-3,
    "force": 1e-8,
    "initial_position": 1e-7,  # short: the force jumps where a particle comes to touch the ground a substep earlier
    "initial_deformation": 1e-6,
}


def tensor(value) -> torch.Tensor:
    return torch.as_tensor(value, dtype=torch.float64)


def scene(counts=(4, 5, 3), **options) -> tuple[Simulator, Parameters, torch.Tensor]:
    """A block thrown along the ground and held by two moving points; everything about it is given."""
    body = block(counts)
    height = float(body.x0[:, 2].max()) + 0.025
    points = np.array([[0.0, 0.0, height], [0.02, 0.0, height]])
    simulator = Simulator(
        body, SimulationConfig(fps=60, **({"dtype": "float64", "terms": INPUTS} | options)),
        two_point_grip(body, points, 8),
    )  # fmt: skip
    time = torch.linspace(0, 1, FRAMES, dtype=torch.float64)[:, None, None]
    count, generator = len(body.x0), torch.Generator().manual_seed(3)

    def random(*shape: int) -> torch.Tensor:
        return torch.rand(shape, generator=generator, dtype=torch.float64)

    parameters = Parameters(
        youngs_modulus=2e3 * (1 + 0.2 * random(count)),
        poissons_ratio=tensor(0.3).expand(count),
        friction_coefficient=tensor(0.3),
        grip_stiffness=tensor(0.3),
        grip_damping=tensor(0.005),
        initial_velocity=tensor([0.5, 0.2, 0.0]).expand(count, 3),
        gravity=tensor([1.0, 0.5, -9.0]),
        density=300 * (1 + 0.3 * random(count)),
        force=1e-4 * random(count, 3),
        initial_position=tensor(body.x0) + 1e-4 * random(count, 3),
        initial_deformation=torch.eye(3, dtype=torch.float64) + 0.05 * random(count, 3, 3),
    )
    return simulator, parameters, tensor(points) + time * tensor([0.01, 0.005, 0.01])


def gradients(simulator: Simulator, parameters: Parameters, controllers: torch.Tensor) -> dict[str, torch.Tensor]:
    """Last positions, and gradients by all of `STEPS` and by the controller points."""
    dtype = getattr(torch, simulator.config.dtype)
    leaves = {name: getattr(parameters, name).to(dtype).clone().requires_grad_() for name in STEPS}
    points = controllers.to(dtype).requires_grad_()
    states = simulator.rollout(replace(parameters, **leaves), points)
    random_loss([1, FRAMES - 1])(states).backward()
    found = {name: leaf.grad for name, leaf in leaves.items()} | {"controllers": points.grad}
    return {"x": states.x[-1].detach()} | found


def assert_close(found: dict[str, torch.Tensor], expected: dict[str, torch.Tensor], tolerance: float) -> None:
    for name, value in expected.items():
        error = float((found[name].double() - value.double()).norm() / value.double().norm())
        assert error < tolerance, (name, error)


# --- gradients ------------------------------------------------------------------------------------------------------


def test_gradients(form):
    simulator, parameters, controllers = scene()
    results = directional_errors(simulator, parameters, controllers, random_loss([1, 2, 3]), STEPS)
    for name, (adjoint, difference) in results.items():
        assert adjoint == pytest.approx(difference, rel=1e-5), name


def test_gradient_by_the_controller_points(form):
    """Also by those at a frame between, which end one frame and begin the next."""
    simulator, parameters, controllers = scene()
    loss, points = random_loss([1, 2, 3]), controllers.clone().requires_grad_()
    loss(simulator.rollout(parameters, points)).backward()
    generator = torch.Generator().manual_seed(1)
    for frames in (slice(None), slice(1, 2)):
        direction = torch.zeros_like(controllers)
        direction[frames] = torch.randn(direction[frames].shape, generator=generator, dtype=torch.float64)
        with torch.no_grad():
            ahead, behind = (loss(simulator.rollout(parameters, controllers + s * 1e-7 * direction)) for s in (1, -1))
        adjoint = float((points.grad * direction).sum())
        assert adjoint == pytest.approx(float((ahead - behind) / 2e-7), rel=1e-5)


def test_two_threads_give_the_fused_forms_gradients(monkeypatch):
    """Sums in another order: 1e-16 each, grown over the substeps."""
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    native, *rest = scene(counts=(8, 8, 8))
    torch.set_num_threads(before)
    assert native._stepper.threads == 2
    take_fused(monkeypatch)
    fused, *_ = scene(counts=(8, 8, 8))
    assert_close(gradients(native, *rest), gradients(fused, *rest), 1e-9)


def test_float32_gradients_agree_with_float64(form):
    """Rounding of 6e-8 a step; 5e-3 is the bound that the parameters of every rollout are held to, too."""
    exact, *rest = scene()
    single, *_ = scene(dtype="float32")
    assert_close(gradients(single, *rest), gradients(exact, *rest), 5e-3)


# --- values ---------------------------------------------------------------------------------------------------------


def bare(body: Body, **options) -> Simulator:
    return Simulator(body, SimulationConfig(**({"fps": 60, "dtype": "float64"} | options)))


def test_given_inputs_are_the_bodys_and_the_configurations(form):
    """Each input in turn against a scene of which it is part, to rounding; and all at once, left out.

    A body put elsewhere keeps its grid: a body that lies there at rest has the same one where that is whole cells away.
    """
    body = block((4, 4, 3))
    count = len(body.x0)
    shifted = replace(body, x0=body.x0 + body.cell * np.array([2, -1, 1]))
    heavier = replace(body, density=1.7 * body.density)
    force = np.random.default_rng(0).normal(0, 1e-3, (count, 3))
    loads = tuple(PointLoad(np.array([p]), np.ones(1), force[p]) for p in range(count))
    gravity = (1.0, 2.0, -3.0)
    config = SimulationConfig(fps=60, dtype="float64")
    cases = {
        "gravity": (Simulator(body, replace(config, gravity=gravity)), tensor(gravity)),
        "density": (Simulator(heavier, config), tensor(heavier.density)),
        "force": (Simulator(body, config, loads=loads), tensor(force)),
        "initial_position": (Simulator(shifted, config), tensor(shifted.x0)),
        "initial_deformation": (Simulator(body, config), torch.eye(3, dtype=torch.float64).expand(count, 3, 3)),
    }
    given = Parameters(tensor(2e3), tensor(0.3), initial_velocity=tensor([0.5, 0.0, -0.5]))
    simulator = bare(body, terms=INPUTS)
    for name, (other, value) in cases.items():
        ours = simulator.rollout(replace(given, **{name: value}), torch.zeros(FRAMES, 0, 3))
        theirs = other.rollout(given, torch.zeros(FRAMES, 0, 3))
        assert (ours.F[-1] - torch.eye(3)).abs().max() > 0.01, "it has not met the ground"
        assert (ours.x - theirs.x).abs().max() < 1e-13, name
        assert (ours.F - theirs.F).abs().max() < 1e-11, name
    ours, theirs = (one.rollout(given, torch.zeros(FRAMES, 0, 3)) for one in (simulator, bare(body)))
    assert (ours.F - theirs.F).abs().max() < 1e-11


def test_a_body_put_elsewhere_moves_as_it_did(form):
    """By any part of a cell, or a kilometre: without ground its path is moved along, to rounding."""
    body = block((4, 5, 3))
    simulator = bare(body, ground_height=None, terms=("initial_position",))
    velocity = 8.0 * tensor(body.x0 - body.x0.mean(0)).roll(1, 1)
    paths = []
    for shift in ([0.0, 0.0, 0.0], [0.003, 0.0071, -0.0123], [1e3, -1e3, 1e3]):
        given = Parameters(
            tensor(2e3), tensor(0.3), initial_velocity=velocity, initial_position=tensor(body.x0) + tensor(shift)
        )
        states = simulator.rollout(given, torch.zeros(FRAMES, 0, 3))
        paths.append((states.x - tensor(shift), states.F))
    assert (paths[0][1][-1] - torch.eye(3)).abs().max() > 0.1
    for (x, F), tolerance in zip(paths[1:], (1e-14, 1e-11), strict=True):
        assert (x - paths[0][0]).abs().max() < tolerance and torch.equal(F, paths[0][1])


def test_free_fall_under_given_gravity_and_force(form):
    """x0 + v0 t + a t (t + dt) / 2, a = g + f / m, the symplectic Euler sum, to rounding; m is the given one, too."""
    body = block((3, 4, 3), corner=(0.1, 0.2, 5.0))
    simulator = bare(body, ground_height=None, terms=("gravity", "force", "density"))
    velocity, gravity, push = tensor([0.3, -0.2, 1.0]), tensor([1.0, 0.5, -3.0]), tensor([0.0, 2.0, 1.0])
    density = 2 * tensor(body.density)
    parameters = Parameters(
        tensor(1e4), tensor(0.3), initial_velocity=velocity, gravity=gravity, density=density,
        force=(density * tensor(body.volume))[:, None] * push,
    )  # fmt: skip
    states = simulator.rollout(parameters, torch.zeros(11, 0, 3))
    t, step = torch.arange(11, dtype=torch.float64)[:, None, None] / 60, 1 / (60 * simulator.substeps(parameters))
    expected = tensor(body.x0) + velocity * t + (gravity + push) * t * (t + step) / 2
    assert (states.x - expected).abs().max() < 1e-12
    assert (states.F - torch.eye(3)).abs().max() < 1e-11


def hanging_bar(fps: int, **options) -> tuple[Simulator, float, np.ndarray]:
    """Ten cells long and clamped at the top, in z from -length to 0; its simulator, length and lower end."""
    spacing, cells = 0.01, 10
    body = block((4, 4, 2 * cells + 2), spacing, 1000.0, corner=(0.0, 0.0, -2 * cells * spacing))
    config = SimulationConfig(fps=fps, ground_height=None, **options)
    simulator = Simulator(body, config, clamps=(Clamp((-1.0, -1.0, 0.0), (1.0, 1.0, 1.0)),))
    return simulator, 2 * cells * spacing, body.x0[:, 2] < body.x0[:, 2].min() + 1e-9


def test_twice_the_density_hangs_twice_as_deep(form):
    """The mean over two periods, which grow with the root of the density, is rho g l^2 / (2 E)."""
    E, fps = 4e4, 200
    simulator, length, end = hanging_bar(fps, terms=("density",))
    stretch = []
    for density in (1000.0, 2000.0):
        frames = round(2 * 4 * length / np.sqrt(E / density) * fps) + 1
        with torch.no_grad():
            states = simulator.rollout(
                Parameters(torch.tensor(E), torch.tensor(0.0), density=torch.tensor(density)), torch.zeros(frames, 0, 3)
            )
        stretch.append(float((states.x[0] - states.x[1:])[:, end, 2].mean()))
        assert stretch[-1] == pytest.approx(density * GRAVITY * length**2 / (2 * E), rel=0.05)
    assert stretch[1] == pytest.approx(2 * stretch[0], rel=0.02)


def test_a_stretched_start_relaxes_to_the_bodys_own_shape(form):
    """A bar held at its upper end that starts stretched by 4 % swings about its rest: both means are those of rest.

    The clamp takes hold to within a tenth of a cell, half a per cent of the length.
    """
    E, fps, stretch = 4e4, 400, 0.04
    simulator, length, end = hanging_bar(
        fps, gravity=(0.0, 0.0, 0.0), terms=("initial_position", "initial_deformation")
    )
    x0 = torch.as_tensor(simulator.body.x0)
    pulled = x0.clone()
    pulled[:, 2] = torch.where(x0[:, 2] < 0, (1 + stretch) * x0[:, 2], x0[:, 2])
    F = torch.eye(3, dtype=torch.float64).repeat(len(x0), 1, 1)
    F[x0[:, 2] < 0, 2, 2] = 1 + stretch
    frames = round(2 * 4 * length / np.sqrt(E / 1000.0) * fps) + 1
    parameters = Parameters(torch.tensor(E), torch.tensor(0.0), initial_position=pulled, initial_deformation=F)
    with torch.no_grad():
        states = simulator.rollout(parameters, torch.zeros(frames, 0, 3))
    lowered = (x0 - states.x)[:, end, 2].mean(1)
    assert float(lowered[0]) == pytest.approx(stretch * length, rel=0.03)
    assert abs(float(lowered[1:].mean())) < 0.1 * stretch * length
    assert float(lowered.min()) < -0.7 * stretch * length  # it swings through
    assert float(states.F[1:, :, 2, 2].mean()) == pytest.approx(1.0, abs=0.1 * stretch)


# --- many rollouts, play, refusals ----------------------------------------------------------------------------------


def test_a_batch_is_its_single_rollouts(form):
    simulator, parameters, controllers = scene(dtype="float32")
    own = {
        "gravity": torch.tensor([[0.0, 0.0, -9.0], [1.0, 0.0, -9.0]]),
        "density": torch.tensor([[300.0], [400.0]]),
        "initial_position": parameters.initial_position + torch.tensor([0.0, 0.002])[:, None, None],
        "initial_deformation": torch.stack([torch.eye(3), 1.02 * torch.eye(3)])[:, None],
    }
    leaves = {name: value.float().requires_grad_() for name, value in own.items()}
    points = torch.stack([controllers, controllers + 0.001]).float().requires_grad_()
    states = simulator.rollout_batch(replace(parameters, **leaves), points)
    states.F.square().sum().backward()
    for r in range(2):
        alone = {name: value.detach()[r].clone().requires_grad_() for name, value in leaves.items()}
        alone_points = points.detach()[r].clone().requires_grad_()
        single = simulator.rollout(replace(parameters, **alone), alone_points)
        assert torch.equal(states.x[r], single.x) and torch.equal(states.F[r], single.F)
        single.F.square().sum().backward()
        for name, leaf in alone.items():
            assert torch.allclose(leaves[name].grad[r], leaf.grad, rtol=1e-4, atol=1e-6), name
        assert torch.allclose(points.grad[r], alone_points.grad, rtol=1e-4)


def test_play_starts_where_a_rollout_does(form):
    simulator, parameters, controllers = scene()
    states = simulator.rollout(parameters, controllers)
    player = simulator.play(parameters, controllers[0].clone().requires_grad_())
    assert torch.equal(player.state.F, parameters.initial_deformation)
    for frame in range(1, FRAMES):
        assert torch.allclose(player.step(controllers[frame]).x, states.x[frame], rtol=1e-12)


def test_what_does_not_fit_is_named():
    body = block((2, 2, 2))
    with pytest.raises(InputError, match=r"SimulationConfig.terms.*'magnet'"):
        bare(body, terms=("magnet",))
    with pytest.raises(InputError, match="each term once"):
        bare(body, terms=("drag", "drag"))
    given = Parameters(tensor(2e3), tensor(0.3))
    for terms, name, value, told in (
        ((), "gravity", tensor([0.0, 0.0, -1.0]), "'gravity' in SimulationConfig.terms"),
        (("density",), "density", tensor(0.0), "positive"),
        (("force",), "force", torch.zeros(3, 3), "shape"),
        (("initial_position",), "initial_position", tensor([np.nan, 0.0, 0.0]), "finite"),
        (("adhesion",), "adhesion_range", tensor(0.0), "positive"),
        (("friction_law",), "friction_law", tensor([0.1, 0.0, 0.0]), "static speed"),
    ):
        with pytest.raises(InputError, match=f"Parameters.{name}.*{told}"):
            bare(body, terms=terms).rollout(replace(given, **{name: value}), torch.zeros(2, 0, 3))
