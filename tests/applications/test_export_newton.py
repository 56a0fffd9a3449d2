"""`physreal export --format newton`: what stands in the file, and, where Newton is installed, that it loads and sags."""

import math

import numpy as np
import pytest

from applications.export import newton
from applications.export.body.material import NEWTON, Material
from applications.export.body.nodes import Nodes
from applications.export.moving import Moving
from physreal_core.fitting.named_effects import effect_record
from tests.applications.bodies import DENSITY, MODULUS, POISSON, clamped_bar, strip
from tests.applications.test_export import exported

pxr = pytest.importorskip("pxr")


def opened(folder):
    from pxr import Usd

    return Usd.Stage.Open(str(folder / newton.FILE))


def written(twin, folder):
    """The stage, and what was told."""
    sentences = newton.write(Moving(twin, None), folder)
    return opened(folder), sentences


def number(stage, name: str) -> float:
    """Of the body's material."""
    return stage.GetPrimAtPath(newton.MATERIAL).GetAttribute(f"physics:{name}").Get()


def test_the_command_writes_body_table_hand_and_hold(project, twin, monkeypatch, tmp_path, capsys):
    folder = exported(project, monkeypatch, tmp_path, "newton")
    told, stage = capsys.readouterr().out, opened(folder)
    assert "wind is left out: Newton" in told and "stable Neo-Hookean" in told and "soft_contact_mu`: set 0.5" in told
    assert told.splitlines()[0] in stage.GetMetadata("comment")
    body = stage.GetPrimAtPath(newton.SIMULATED)
    assert "PhysicsVolumeDeformableSimAPI" in body.GetPrimTypeInfo().GetAppliedAPISchemas()
    points = np.array(body.GetAttribute("points").Get(), float)
    tets = np.array(body.GetAttribute("tetVertexIndices").Get())
    a, b, c, d = points[tets].transpose(1, 0, 2)
    volumes = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6
    assert (volumes > 0).all()
    assert volumes.sum() * number(stage, "density") == pytest.approx(twin.problem.body.mass.sum(), rel=1e-3)
    assert number(stage, "youngsModulus") == pytest.approx(1e5, rel=1e-4)
    # What the hand holds is at the same place in the hand's frame as in the world.
    hold, hand = stage.GetPrimAtPath("/World/hold"), stage.GetPrimAtPath(newton.HAND)
    held = np.array(hold.GetAttribute("physics:indices0").Get())
    local = np.array(hold.GetAttribute("physics:coords1").Get())
    place = np.array(hand.GetAttribute("xformOp:translate").Get())
    assert len(held) > 0 and np.allclose(local + place, points[held], atol=1e-6)
    assert hand.GetAttribute("physics:kinematicEnabled").Get()
    path = np.genfromtxt(folder / "hand.csv", delimiter=",", names=True)
    assert np.allclose([path["x"][0], path["y"][0], path["z"][0]], place, atol=1e-6)
    table = stage.GetPrimAtPath("/World/table_material")
    assert table.GetAttribute("physics:dynamicFriction").Get() == pytest.approx(0.5)


def test_a_clamp_holds_and_viscosity_is_told_to_be_missing(tmp_path):
    twin = clamped_bar(effect_record("kelvin_voigt", {"time": 0.02}))
    stage, told = written(twin, tmp_path)
    assert any("0.02 s is left out" in sentence for sentence in told)
    assert any("kelvin_voigt is left out" in sentence for sentence in told)
    fixed = np.array(stage.GetPrimAtPath("/World/fixed").GetAttribute("physics:indices0").Get())
    points = np.array(stage.GetPrimAtPath(newton.SIMULATED).GetAttribute("points").Get())
    assert points[fixed, 0].max() < 0.045 and not stage.GetPrimAtPath("/World/table")
    assert stage.GetPrimAtPath(newton.CLAMP) and not stage.GetPrimAtPath(newton.HAND)


def test_stiffnesses_of_a_rope_and_a_cloth_are_those_of_their_sections(tmp_path):
    h, G = 0.006, MODULUS / (2 * (1 + POISSON))
    rope, cloth = (strip(kind, h) for kind in ("rope", "cloth"))
    (tmp_path / "rope").mkdir()
    (tmp_path / "cloth").mkdir()
    stage, _ = written(rope, tmp_path / "rope")
    curves = stage.GetPrimAtPath(newton.SIMULATED)
    assert list(curves.GetAttribute("curveVertexCounts").Get()) == [25]
    assert number(stage, "curvesStretchStiffness") == pytest.approx(MODULUS * math.pi * h**2 / 4)
    assert number(stage, "curvesBendStiffness") == pytest.approx(MODULUS * math.pi * h**4 / 64)
    assert number(stage, "curvesTwistStiffness") == pytest.approx(G * math.pi * h**4 / 32)
    stage, told = written(cloth, tmp_path / "cloth")
    assert number(stage, "surfaceStretchStiffness") == pytest.approx(MODULUS * h / (1 - POISSON**2))
    assert number(stage, "surfaceBendStiffness") == pytest.approx(MODULUS * h**3 / (12 * (1 - POISSON**2)))
    assert number(stage, "density") == pytest.approx(DENSITY, rel=1e-4)
    # Legs of 5 mm, hypotenuses of 7.1 mm: heights of 5, 5 and 3.5 mm.
    assert any("by 222" in sentence or "by 221" in sentence for sentence in told)


@pytest.mark.slow
def test_newton_loads_it_and_the_bar_sags_as_beam_theory_has_it(tmp_path):
    """It brakes what it has not solved, so after three seconds it has nearly come to rest."""
    sim = pytest.importorskip("newton")
    twin = clamped_bar()
    newton.write(Moving(twin, None), tmp_path)
    builder = sim.ModelBuilder()
    builder.add_usd(str(tmp_path / newton.FILE))
    builder.color()
    model = builder.finalize(device="cpu")
    solver = sim.solvers.SolverVBD(model, iterations=100, particle_enable_self_contact=False)
    state, after, control = model.state(), model.state(), model.control()
    start = state.particle_q.numpy().copy()
    for _ in range(720):
        state.clear_forces()
        solver.step(state, after, control, None, 1 / 240)
        state, after = after, state
    sunk = (state.particle_q.numpy() - start)[:, 2]
    nodes = Nodes.of(twin, Material.of(twin, NEWTON).density)
    assert np.abs(sunk[nodes.fixed]).max() < 1e-6
    length = 0.16 - start[nodes.fixed, 0].max()
    load, rigidity = DENSITY * 9.81 * 0.04**2, MODULUS * 0.04**4 / 12
    shear = load * length**2 / (2 * 5 / 6 * MODULUS / (2 * (1 + POISSON)) * 0.04**2)
    assert sunk[start[:, 0] > 0.155].mean() == pytest.approx(-(load * length**4 / (8 * rigidity) + shear), rel=0.2)
