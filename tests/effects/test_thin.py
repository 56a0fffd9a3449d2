"""Every effect on a sheet and on a rope: it acts and is differentiable, or the reason why it does not is told."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from physreal_core.effects import EFFECTS, lacking
from physreal_core.effects.shape import exposure
from physreal_core.errors import InputError
from physreal_core.simulation import Grip, rod_body, shell_body
from tests.effects.specimen import Specimen, complete, held_specimen, material
from tests.effects.test_chain import VISIBLE
from tests.simulation.thin.scenes import sheet

LEFT_OUT = {
    "kelvin_voigt": "a thin body has no viscosity",
    "hysteretic_damping": "a thin body has no hysteresis",
    "standard_linear_solid": "a thin body has no relaxation",
    "maxwell_creep": "a thin body does not flow",
    "plastic_yield": "a thin body does not flow",
    "strain_stiffening": "a thin body has no stiffening",
    "fibres": "a thin body has no fibres",
    "rest_shape": "a thin body has no initial deformation",
}

OWN = {"sheet": {"kelvin_voigt", "fibres"}, "rope": set()}
"""Effects that one kind has all the same."""
ACTING = [(kind, name) for kind in OWN for name in EFFECTS if name not in LEFT_OUT or name in OWN[kind]]


@cache
def specimen(kind: str) -> Specimen:
    """The hand's motion of `held_specimen`, with a sheet or a rope of the bar's length in it."""
    plain = held_specimen()
    if kind == "sheet":
        vertices, triangles = sheet((8, 3), (0.08, 0.03), 0.001)
        body = shell_body(vertices, triangles, 0.002, 500.0)
    else:
        along = np.linspace(0.0, 0.08, 12)
        body = rod_body(np.stack([along, np.full(12, 0.015), np.full(12, 0.003)], 1), 0.003, 500.0)
    points = plain.controllers[0].numpy()
    held = np.flatnonzero(body.x0[:, 0] > 0.06)
    lengths = np.linalg.norm(body.x0[held] - points[held % 2], axis=1)
    grip = Grip(held, held % 2, np.full(len(held), 0.5), lengths)
    own = material(body, 2e5, friction_coefficient=0.4, grip_stiffness=2.0, grip_damping=0.01)
    return replace(plain, body=body, grip=grip, material=own)


@pytest.mark.parametrize("kind", ["sheet", "rope"])
def test_what_does_not_act_says_why_and_is_refused(kind):
    body = specimen(kind).body
    left = {name: reason for name, reason in LEFT_OUT.items() if name not in OWN[kind]}
    assert {name: reason for name, effect in EFFECTS.items() if (reason := lacking(effect, body))} == left
    of_volumes = {name: reason for name, effect in EFFECTS.items() if (reason := lacking(effect, held_specimen().body))}
    assert of_volumes == {"surface_drag": "a volume has no surface drag"}
    for name in left:
        with pytest.raises(InputError, match="thin|shell|rod"):
            specimen(kind).simulator(name)


@pytest.mark.parametrize(("kind", "name"), ACTING)
def test_dormant_is_the_baseline_and_visible_is_not(kind, name):
    scene = specimen(kind)
    with torch.no_grad():
        plain, dormant, visible = (
            s.x for s in (scene.rollout(), *(scene.rollout(**{name: v}) for v in ({}, VISIBLE[name])))
        )
    assert (dormant - plain).abs().max() < 1e-11
    assert (visible - plain).abs().max() > 1e-5


@pytest.mark.parametrize(("kind", "name"), ACTING)
def test_gradient_of_the_whole_chain(kind, name):
    """Each coefficient against central differences, as for a volume."""
    scene = specimen(kind)
    weights = torch.randn(6, len(scene.body.x0), 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    motion = lambda values: scene.rollout(**{name: values}).x
    values = complete(name, VISIBLE[name])
    leaves = {key: value.clone().requires_grad_() for key, value in values.items()}
    (motion(leaves) * weights).sum().backward()
    for coefficient in EFFECTS[name].coefficients:
        step = 3e-7 * coefficient.scale
        with torch.no_grad():
            ahead, behind = (
                motion({**values, coefficient.name: values[coefficient.name] + sign * step}) for sign in (1, -1)
            )
        difference = float(((ahead - behind) * weights).sum()) / (2 * step)
        assert float(leaves[coefficient.name].grad) == pytest.approx(difference, rel=1e-4, abs=1e-6), coefficient.name


def test_all_of_a_sheet_lies_open():
    body = specimen("sheet").body
    np.testing.assert_allclose(exposure(body), body.volume / body.volume.sum())


def falling(kind: str, turn: float, **values: dict[str, float]) -> np.ndarray:
    """Speed of a stiff sheet's or rope's centre of mass [m/s] in free fall, turned about y [rad], by frame."""
    vertices, triangles = sheet((4, 4), (0.2, 0.2), 5.0)
    along = np.linspace(0.0, 0.2, 9)
    start = vertices if kind == "sheet" else np.stack([along, 0.0 * along, 0.0 * along + 5.0], 1)
    start = (start - start.mean(0)) @ Rotation.from_euler("y", turn).as_matrix().T + [0.0, 0.0, 5.0]
    body = shell_body(start, triangles, 0.002, 100.0) if kind == "sheet" else rod_body(start, 0.005, 50.0)
    points = torch.zeros(31, 0, 3, dtype=torch.float64)
    free = Specimen(body, points, 30.0, material(body, 1e6), ground_height=None)
    with torch.no_grad():
        return -free.rollout(**values).v[:, :, 2].mean(1).numpy()


@pytest.mark.parametrize(
    ("kind", "per_mass"), [("sheet", 1.0 / (100.0 * 0.002)), ("rope", 0.01 / (50.0 * np.pi * 0.005**2))]
)
def test_surface_drag_brakes_a_fall_across_and_not_along(kind, per_mass):
    """Across, the speed is v tanh(g t / v), v the root of g over the drag per mass; the sheet bends a little on its way. Along, it falls freely."""
    drag = 0.6 * 10.0 * per_mass
    time, final = np.arange(31) / 30, np.sqrt(9.81 / drag)
    across = falling(kind, 0.0, surface_drag={"coefficient": 10.0})
    np.testing.assert_allclose(across, final * np.tanh(9.81 * time / final), rtol=0.01, atol=2e-3)
    along = falling(kind, np.pi / 2, surface_drag={"coefficient": 10.0})
    np.testing.assert_allclose(along, 9.81 * time, rtol=1e-6, atol=1e-9)
