"""Bodies that are shaken until their elements turn inside out: they are moved less."""

from dataclasses import replace

import numpy as np
import pytest

from data.rig import case as rig_case
from data.rig.case import Case
from data.rig.mesh import mesh_shape
from data.rig.motions import MOTIONS, shrunk
from data.rig.shapes import Block
from data.rig.trajectory import Trajectory

MESH = mesh_shape(Block((0.0, 0.0, 0.0), (0.04, 0.02, 0.02)), 0.01)


def squeezed(share: float) -> Trajectory:
    """A block at rest, then its half below x = 0.02 m at a share of its length."""
    moved = MESH.vertices.copy()
    moved[:, 0] = np.maximum(moved[:, 0], 0.02) + share * np.minimum(moved[:, 0] - 0.02, 0.0)
    return Trajectory(MESH, np.stack([MESH.vertices, moved]), np.zeros((2, 3)), np.array([0]))


@pytest.mark.parametrize(("share", "crushed"), [(1.0, 0.0), (0.4, 0.0), (0.2, 0.5), (-0.5, 0.5)])
def test_the_share_of_the_volume_that_is_crushed(share, crushed):
    assert squeezed(share).crushed() == pytest.approx(crushed)


def test_strokes_are_shorter_where_the_body_would_be_crushed(monkeypatch):
    """A stand-in for the simulation crushes half of the body where the hand goes further than six centimetres."""
    case = Case("none", "middle", 3)
    written = MOTIONS["shake"](np.random.default_rng(0))

    def furthest(motion) -> float:
        return float(np.abs(motion.displacement(np.linspace(0, 3, 200))).max())

    assert furthest(shrunk(written, 0.5)) == pytest.approx(0.5 * furthest(written))
    monkeypatch.setattr(rig_case, "run", lambda scene, hidden: squeezed(0.0 if furthest(scene.motion) > 0.06 else 1.0))
    strokes, scene, trajectory = rig_case._uncrushed(case, "shake")
    full = furthest(case.scene("shake").motion)
    assert strokes == max(s for s in rig_case.STROKES if s * full <= 0.06) < 1.0
    assert furthest(scene.motion) == pytest.approx(strokes * full) and trajectory.crushed() == 0.0
    kept = case.specimen.scene("shake", replace(case.session, strokes={"press_drag": 0.5}))
    assert furthest(kept.motion) == pytest.approx(full)


def test_a_body_that_is_crushed_by_any_stroke_is_an_error(monkeypatch):
    monkeypatch.setattr(rig_case, "run", lambda scene, hidden: squeezed(0.0))
    with pytest.raises(RuntimeError, match="bar, none, shake, seed 3: crushed even at 0.25 times the strokes"):
        rig_case._uncrushed(Case("none", "middle", 3), "shake")
