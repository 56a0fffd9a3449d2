"""Time steps that would take for ever are refused with their cause, long ones are told, and a torn body names the hand."""

import dataclasses
import math
import time
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError, SimulationError
from physreal_core.fitting.curriculum import ScanConfig, scan_youngs_modulus
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.fitting.variables import TRANSFORMS, Variable
from physreal_core.simulation import Grip, Parameters, SimulationConfig, Simulator
from physreal_core.simulation.timestep import LARGEST_SUBSTEPS, USUAL_SUBSTEPS, needed_substeps, substeps_per_frame
from stages._substeps import tell_substeps
from tests.fitting import scene
from tests.simulation.scenes import block

COUNTS = (3, 3, 3)
HAND = np.array([[0.0, 0.0, 0.05], [0.02, 0.0, 0.05]])


def parameters(**changes: object) -> Parameters:
    values = {"youngs_modulus": torch.tensor(6e4), "poissons_ratio": torch.tensor(0.3)} | changes
    return Parameters(**{name: torch.as_tensor(value) for name, value in values.items()})


CAUSES = {
    "youngs_modulus": ({"youngs_modulus": 1e13}, {}, {}, "lower youngs_modulus, which is 1e+13 Pa"),
    "youngs_modulus of a steel": ({"youngs_modulus": 2e11}, {}, {}, "lower youngs_modulus, which is 2e+11 Pa"),
    "youngs_modulus beyond float32": ({"youngs_modulus": 3e38}, {}, {}, "lower youngs_modulus, which is 3e+38 Pa"),
    "poissons_ratio": ({"poissons_ratio": 0.4999999}, {}, {}, "lower poissons_ratio, which is 0.5"),
    "density": ({}, {"density": 1e-9}, {}, "raise the density, which is 1e-09 kg/m3"),
    "density of air": ({"youngs_modulus": 1e8}, {"density": 1e-3}, {}, "raise the density, which is 0.001 kg/m3"),
    "spacing": ({}, {"spacing": 1e-6}, {}, "raise the particles' spacing, which is 1e-06 m"),
    "fps": ({}, {}, {"fps": 1e-3}, "check fps, which is 0.001"),
    "courant": ({}, {}, {"courant": 1e-4}, "raise courant, which is 0.0001"),
    "viscosity": ({"viscosity": [1e9, 0.0]}, {}, {"terms": ("viscosity",)}, "lower the viscosity"),
    "drag": ({"linear_drag": 1e4}, {}, {"terms": ("drag",)}, "weaken the drag, adhesion or obstacle"),
    "fibres": (
        {"fibre_modulus": 1e13, "fibre_direction": [1.0, 0.0, 0.0]}, {}, {"terms": ("fibres",)}, "lower the fibres' modulus"),
}  # fmt: skip


def simulator(body: dict, config: dict) -> Simulator:
    return Simulator(block(COUNTS, **body), SimulationConfig(**({"fps": 30.0, "courant": 0.6} | config)))


@pytest.mark.parametrize("name", CAUSES)
@pytest.mark.parametrize("asked", ["substeps", "rollout", "play"])
def test_too_many_substeps_are_refused_at_once_with_their_cause(name, asked):
    changes, body, config, remedy = CAUSES[name]
    try:
        made = simulator(body, config)
        given = parameters(**changes)
        made._complete(given)
    except InputError as error:
        pytest.fail(str(error))
    call = {
        "substeps": lambda: made.substeps(given),
        "rollout": lambda: made.rollout(given, torch.zeros(50, 0, 3)),
        "play": lambda: made.play(given, torch.zeros(0, 3)),
    }[asked]
    with pytest.raises(InputError) as raised:
        call()
    error = raised.value
    assert "substeps a frame" in error.what and error.where == "the simulator's time step"
    assert error.expected == f"at most {LARGEST_SUBSTEPS}" and remedy in error.remedy, str(error)


@pytest.mark.parametrize("youngs_modulus", [1e2, 1e4, 1e6, 1e8, 1e9])
def test_the_number_is_that_of_the_waves(youngs_modulus):
    """c = sqrt((lambda + 2 mu) / rho), a substep 0.6 dx / c."""
    made = simulator({}, {})
    speed = math.sqrt(youngs_modulus * 0.7 / (1.3 * 0.4) / 300.0)
    expected = max(1, math.ceil(speed / (30.0 * 0.6 * 0.02)))
    assert made.substeps(parameters(youngs_modulus=youngs_modulus)) == pytest.approx(expected, abs=1)


def test_the_limit_is_where_it_says():
    body, config = block(COUNTS), SimulationConfig(fps=30.0, courant=0.6)
    at_limit = 1e6 * (LARGEST_SUBSTEPS / needed_substeps(body, config, parameters(youngs_modulus=1e6))) ** 2
    assert substeps_per_frame(body, config, parameters(youngs_modulus=0.999 * at_limit)) <= LARGEST_SUBSTEPS
    with pytest.raises(InputError, match="substeps a frame"):
        substeps_per_frame(body, config, parameters(youngs_modulus=1.001 * at_limit))


def test_of_many_rollouts_one_that_would_take_for_ever_fails_alone():
    made = simulator({}, {})
    moduli = torch.tensor([[6e4], [1e13], [3e4]])
    with torch.no_grad():
        states = made.rollout_batch(parameters(youngs_modulus=moduli), torch.zeros(3, 0, 3))
        alone = made.rollout(parameters(youngs_modulus=3e4), torch.zeros(3, 0, 3))
    assert [failure is None for failure in states.failures] == [True, False, True]
    assert "lower youngs_modulus, which is 1e+13 Pa" in str(states.failures[1]) and states.failures[1].frame == 0
    assert torch.isnan(states.x[1, 1:]).all() and torch.equal(states.x[2], alone.x)


@pytest.mark.parametrize("moduli", [[1e13], [1e13, 1e14]], ids=["one", "two"])
def test_all_of_a_batch_may_fail(moduli):
    made = simulator({}, {})
    with torch.no_grad():
        states = made.rollout_batch(parameters(youngs_modulus=torch.tensor(moduli)[:, None]), torch.zeros(3, 0, 3))
    assert all("substeps a frame" in str(failure) for failure in states.failures)


@pytest.fixture(scope="session")
def given():
    return scene.problem(scene.model(), frames=8, observed=6, with_masks=False)


def test_a_scan_passes_over_a_modulus_that_would_take_for_ever(given):
    variable = Variable("youngs_modulus", TRANSFORMS["youngs_modulus"], rate=0.1, lower=1e3, upper=1e14)
    model = scene.model(youngs_modulus=1e8)
    found = scan_youngs_modulus(Objective(given, model, LossConfig()), model, variable, ScanConfig(3, 1e5))
    assert math.isinf(found[-1][1]) and math.isfinite(found[0][1])


CONTEXT = SimpleNamespace(stage="fit_global", sequence="lift")


def variables(youngs_modulus: float | None = None, poissons_ratio: float | None = None) -> list[Variable]:
    uppers = {"youngs_modulus": youngs_modulus, "poissons_ratio": poissons_ratio}
    return [
        Variable(name, TRANSFORMS[name], rate=0.1, lower=1e-3, upper=upper) for name, upper in uppers.items() if upper
    ]


def told(given, capsys, moved: list[Variable], **values: float) -> str:
    model = scene.model(**values)
    tell_substeps(CONTEXT, Rollouts(given, model), model.fields, moved)
    return capsys.readouterr().out


@pytest.mark.parametrize("upper", [None, 1e5, 5e6])
def test_nothing_is_said_of_a_usual_number(given, capsys, upper):
    assert told(given, capsys, variables(upper, upper and 0.45)) == ""


@pytest.mark.parametrize(("upper", "ratio"), [(3e9, None), (1e9, 0.45), (1e7, 0.4999)])
def test_a_line_is_said_of_many_at_the_bounds(given, capsys, upper, ratio):
    said = told(given, capsys, variables(upper, ratio))
    assert said.startswith("fit_global lift: ") and said.count("\n") == 1
    assert f"youngs_modulus.upper = {upper:g}" in said and f"more than {USUAL_SUBSTEPS} take long" in said
    assert ("poissons_ratio.upper" in said) == (ratio is not None)


def test_a_line_is_said_of_many_at_the_start(given, capsys):
    assert "substeps a frame; more than" in told(given, capsys, [], youngs_modulus=2e9)


@pytest.mark.parametrize(
    ("upper", "ratio", "cause"),
    [
        (1e13, None, "lower youngs_modulus"),
        (1e13, 0.45, "lower youngs_modulus"),
        (1e6, 0.4999999, "lower poissons_ratio"),
    ],
)
def test_bounds_that_would_take_for_ever_are_refused_before_the_fit(given, upper, ratio, cause):
    model = scene.model()
    with pytest.raises(InputError) as raised:
        tell_substeps(CONTEXT, Rollouts(given, model), model.fields, variables(upper, ratio))
    error = raised.value
    assert "the fit may go to" in error.what and "params.yaml, fit_global: youngs_modulus.upper" in error.where
    assert (
        cause in error.remedy and "`upper` in params.yaml" in error.remedy and str(LARGEST_SUBSTEPS) in error.expected
    )


@pytest.mark.parametrize("density", [1e-9, 1e-3])
def test_a_body_without_mass_is_refused_before_the_fit(given, density):
    light = dataclasses.replace(given.body, density=np.full(len(given.body.x0), density))
    model = scene.model()
    began = time.perf_counter()
    with pytest.raises(InputError, match=r"raise the density.*capture\.json"):
        tell_substeps(
            CONTEXT, Rollouts(dataclasses.replace(given, body=light), model), scene.model(youngs_modulus=1e8).fields
        )
    assert time.perf_counter() - began < 60.0


# --- a body that is torn ------------------------------------------------------------------------------------------------


def held(frames: int) -> tuple[Simulator, torch.Tensor]:
    """A block held by two controller points that rise by a millimetre a frame."""
    body = block(COUNTS)
    lengths = np.linalg.norm(body.x0[:6] - HAND[np.arange(6) % 2], axis=1)
    grip = Grip(np.arange(6), np.arange(6) % 2, np.ones(6), lengths)
    points = torch.from_numpy(HAND)[None].repeat(frames, 1, 1)
    points[:, :, 2] += 1e-3 * torch.arange(frames)[:, None]
    return Simulator(body, SimulationConfig(fps=30.0), grip), points.float()


@pytest.mark.parametrize("frame", [1, 4, 7])
@pytest.mark.parametrize("controller", [0, 1])
@pytest.mark.parametrize("jump", [30.0, 100.0, 1e6])
def test_a_jump_of_the_hand_is_named_with_its_frame(frame, controller, jump):
    made, points = held(9)
    points[frame:, controller, 0] += jump
    with pytest.raises(SimulationError) as raised, torch.no_grad():
        made.rollout(parameters(grip_stiffness=12.0), points)
    path = f"controller point {controller} moves {jump:.3g} m from frame {frame - 1} to {frame}"
    assert f"the state is not finite; {path}" in str(raised.value)
    assert raised.value.frame in (frame - 2, frame - 1), "a jump behind a frame bends the way within it"


def test_of_many_rollouts_each_names_its_own_hand():
    made, points = held(6)
    each = points[None].repeat(3, 1, 1, 1)
    each[0, 2:, 1, 0] += 100.0
    each[2, 4:, 0, 1] += 200.0
    with torch.no_grad():
        failures = made.rollout_batch(parameters(grip_stiffness=12.0), each).failures
    assert "controller point 1 moves 100 m from frame 1 to 2" in str(failures[0]) and failures[1] is None
    assert "controller point 0 moves 200 m from frame 3 to 4" in str(failures[2])


def test_a_hand_that_is_steered_is_named_too():
    made, points = held(3)
    player = made.play(parameters(grip_stiffness=12.0), points[0])
    player.step(points[1])
    with pytest.raises(SimulationError, match="controller point 0 moves 100 m from frame 1 to 2"):
        player.step(points[2] + torch.tensor([[100.0, 0, 0], [0, 0, 0]]))
