"""How visible a hidden effect is: nothing is not, more is more, and what a modulus can imitate is not either."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco")

from data.rig import visibility as module
from data.rig.case import Case
from data.rig.hidden.effect import NOTHING, Hidden
from data.rig.session import Session
from data.rig.simulate import BlewUp
from data.rig.visibility import MODULI, distances, elastic

SHORT = Session(seen=("lift_swing",), held_out="press_drag", seconds={"lift_swing": 0.6, "press_drag": 0.4})


@pytest.fixture(autouse=True)
def coarse(monkeypatch):
    monkeypatch.setattr(module, "SPACING", 0.044)


def seen(effect, strength):
    case = Case(effect, strength, 4, session=SHORT)
    return case.yardstick.all(case.hidden)


def test_nothing_is_not_visible():
    assert seen("none", "middle") == {"lift_swing": 0.0, "press_drag": 0.0}


def test_a_stronger_effect_is_more_visible():
    sizes = [seen("grip_offset", strength) for strength in ("weak", "middle", "high")]
    for motion in SHORT.motions:
        weak, middle, high = (size[motion] for size in sizes)
        assert 0.0 < weak < middle < high
    assert 0.0003 < sizes[0]["lift_swing"] < 0.003 < sizes[2]["lift_swing"] < 0.012


def test_another_modulus_is_not_visible(monkeypatch):
    """A body that is 1.2 times as stiff, which lies between those that are simulated."""

    class Stiffer(Hidden):
        def changed(self, scene):
            modulus = 1.2 * scene.material.youngs_modulus
            return replace(scene, material=replace(scene.material, youngs_modulus=modulus))

        def hardening(self, scene):
            return 1.2

    case = Case("none", "middle", 4, session=SHORT)
    found = case.yardstick.all(Stiffer())
    assert max(found.values()) < 0.0005


def test_the_spline_goes_through_the_bodies_that_are_simulated():
    case = Case("none", "middle", 4, session=SHORT)
    scene = replace(case.scene("lift_swing"), mesh_spacing=0.044)
    plain = elastic(scene)
    own = module.moved(scene, NOTHING)
    np.testing.assert_allclose(plain(MODULI[2]), own, atol=1e-12)
    assert distances(plain, own).min() == pytest.approx(0.0, abs=1e-15)


def test_where_a_coarse_body_blows_up_a_finer_one_is_compared(monkeypatch):
    simulated = []

    def blows_up_where_coarse(scene, hidden):
        if scene.mesh_spacing > 0.02:
            raise BlewUp
        simulated.append(scene.mesh_spacing)
        return moved(scene, hidden)

    moved = module.moved
    monkeypatch.setattr(module, "moved", blows_up_where_coarse)
    case = Case("grip_offset", "high", 4, session=SHORT)
    assert 0.003 < case.yardstick.seen(case.hidden) < 0.012
    assert {round(spacing, 4) for spacing in simulated} == {0.0186}
