"""A rope and a cloth as specimens of the hidden-effect captures: what effects do to their nodes, and what their captures hold."""

from dataclasses import replace

import numpy as np
import pytest

mujoco = pytest.importorskip("mujoco")
pytest.importorskip("trimesh")

from benchmarks.gap.cases import benchmark_cases
from benchmarks.gap.problems import Discretisation, baseline_model, problems_of
from data.rig.bodies import THIN_BODIES
from data.rig.case import Case, make_case
from data.rig.hidden import around, contact, mass, material, other_laws, other_material
from data.rig.hidden.effect import Hidden
from data.rig.hidden.together import Together
from data.rig.session import Session
from data.rig.specimen import Specimen, specimen, stiffened
from data.rig.thin_body import stable_step
from data.rig.thin_simulate import CLOTH_STEP
from data.rig.truth import load_truth
from data.rig.world import World
from physreal_core.effects import EFFECTS
from physreal_core.fitting.thin import cells_of

SEED = 4


def start(hidden, made: Specimen):
    """The world with the effect in it, and what the effect does before a step."""
    scene = made.scene("lift_swing")
    step, integrator = (stable_step(scene.body), "Euler") if made.body.name == "rope" else (CLOTH_STEP, "discrete")
    world = World(scene, step, integrator, hidden.things(scene), hidden.elasticity(scene), hidden.placed)
    act = hidden.prepare(world)
    mujoco.mj_setConst(world.model, world.data)
    mujoco.mj_forward(world.model, world.data)
    return world, act


def pushed(world, act, rise=0.0):
    """Forces [N] on the nodes when the body has risen by so much [m]."""
    world.data.qfrc_applied[:] = 0
    world.data.qpos[world.dofs[:, 2]] = rise
    act(0.1)
    return world.data.qfrc_applied[world.dofs]


@pytest.fixture(params=THIN_BODIES)
def made(request) -> Specimen:
    return specimen(request.param, SEED)


def test_it_lies_on_the_table_and_is_held_at_one_end(made):
    body, mesh = made.body, made.body.shape.mesh()
    np.testing.assert_allclose(body.shape.middle(), [0, 0, body.thickness / 2], atol=1e-12)
    assert body.lower[2] == pytest.approx(0, abs=1e-12) and np.ptp(mesh.vertices[:, 0]) == pytest.approx(
        body.length + body.held
    )
    assert np.abs(body.shape.distance(mesh.vertices)).max() <= body.thickness / 2 + 1e-9
    for above in (-1.0, body.upper[2] / 2):  # of the motions
        held = mesh.vertices[body.grasp(above).distance(mesh.vertices) < 1e-6]
        assert 0 < held[:, 0].min() - (body.upper[0] - body.held) < 0.01
    assert made.material.density == pytest.approx(mesh.lumped_mass(0).sum() / mesh.volumes().sum())


def test_stiffness_follows_the_seed_and_scales_as_a_whole(made):
    scene, other = made.scene("shake"), specimen(made.body.name, SEED + 1)
    names = [name for name in vars(scene.body) if name.endswith("_stiffness")]
    assert len(names) > 1 and all(getattr(scene.body, n) != getattr(other.body.shape, n) for n in names)
    twice = stiffened(scene, 2.0).body
    assert all(getattr(twice, n) == pytest.approx(2 * getattr(scene.body, n)) for n in names)


def test_surface_drag_is_that_of_the_area_across_the_motion(made):
    """Of a body that lies flat and moves at a slant: its area for a cloth, diameter times length for a rope, by the speed across it."""
    world, act = start(around.SurfaceDrag(2.0), made)
    world.data.qvel[world.dofs] = [0.3, 0.0, -0.4]
    force = pushed(world, act).sum(0)
    mesh = world.mesh
    area = mesh.volumes().sum() / mesh.thickness
    if made.body.name == "rope":
        area = mesh.thickness * np.ptp(mesh.vertices[:, 0])
    np.testing.assert_allclose(force, [0.0, 0.0, 0.6 * 2.0 * area * 0.4**2], rtol=1e-6, atol=1e-12)


def strained(hidden, made, places):
    """Forces [N] of the strained cloth on its nodes, which are at `places` [m]."""
    world, _ = start(hidden, made)
    world.data.qpos[world.dofs] = places - world.mesh.vertices
    mujoco.mj_forward(world.model, world.data)
    return world.data.qfrc_passive[world.dofs], world.mesh


def test_fibres_of_a_cloth_do_the_work_of_their_energy():
    """Stretched, t k (a . E a) (F a) . (G a) of an area when it moves on by G; bent about a line, as much as in the plate within a tenth,
    in the mean over their directions."""
    made = specimen("cloth", SEED)
    body, rest = made.body.shape, made.body.shape.mesh().vertices
    area = made.body.shape.mesh().volumes().sum() / body.thickness
    F = np.array([[1.02, 0.01, 0.0], [0.0, 0.99, 0.0], [0.0, 0.0, 1.0]])
    G = np.array([[0.3, -0.2, 0.0], [0.4, 0.5, 0.0], [0.0, 0.0, 0.0]])
    plain, _ = strained(Hidden(), made, rest @ F.T)
    found, _ = strained(material.Fibres(2.0, 0.6, 0.0), made, rest @ F.T)
    a = np.array([np.cos(0.6), np.sin(0.6), 0.0])
    expected = -area * 2.0 * body.membrane_stiffness * (a @ (F.T @ F - np.eye(3)) @ a / 2) * (F @ a) @ (G @ a)
    assert ((found - plain) * (rest @ G.T)).sum() == pytest.approx(expected, rel=1e-4)

    bending = 2.0 * body.bending_stiffness * (1 - body.poissons_ratio**2)
    works = []
    for angle in np.arange(6) * np.pi / 6 + 0.1:
        form = (rest[:, :2] @ [np.cos(angle), np.sin(angle)])[:, None] ** 2 / 2 * [0.0, 0.0, 1.0]
        plain, _ = strained(Hidden(), made, rest + 0.01 * form)
        found, _ = strained(material.Fibres(2.0, angle, 0.0), made, rest + 0.01 * form)
        works.append(-((found - plain) * form).sum() / (0.01 * area * bending))
    assert np.mean(works) == pytest.approx(1.0, rel=0.1)


@pytest.mark.parametrize("make", [around.Wind, other_laws.ProfiledWind])
def test_wind_pushes_all_of_it(made, make):
    world, act = start(make(2.0, -1.0, 0.0), made)
    force = pushed(world, act, rise=other_laws._HEIGHT - made.body.thickness / 2)
    np.testing.assert_allclose(force.sum(0), world.masses.sum() * np.array([2.0, -1.0, 0.0]), rtol=1e-6)


def test_adhesion_pulls_with_its_strength_on_what_lies_on_the_table(made):
    world, act = start(contact.GroundAdhesion(100.0, 0.004), made)
    shape, volume = made.body.shape, world.mesh.volumes().sum()
    assert pushed(world, act, rise=0.004)[:, 2].sum() == pytest.approx(-100.0 * volume / shape.thickness, rel=1e-6)


@pytest.mark.parametrize("make", [mass.DensityGradient, other_laws.TwoDensities])
def test_mass_that_is_spread_unevenly_stays_as_much(made, make):
    world, _ = start(make(6.0, 0.0, 0.0), made)
    bare, _ = start(Together(()), made)
    assert world.masses.sum() == pytest.approx(bare.masses.sum())
    half, centre = np.ptp(world.mesh.vertices[:, 0]) / 2, world.masses @ world.mesh.vertices[:, 0] / world.masses.sum()
    assert centre == pytest.approx(half / np.tanh(6.0 * half) - 1 / 6.0, rel=0.03)


@pytest.mark.parametrize("make", [material.SoftSpot, other_material.SoftEllipsoid])
def test_a_soft_spot_softens_the_hinges_about_it(made, make):
    radius = made.body.spot
    world, _ = start(make(0.7, 0.0, 0.0, made.body.thickness / 2, radius), made)
    bare, _ = start(Together(()), made)
    left, before = world.model.flex_bending, bare.model.flex_bending
    ratio = left[before != 0] / before[before != 0]
    assert ratio.min() == pytest.approx(0.3, abs=0.02)
    assert ratio.max() == pytest.approx(1.0) and 0 < (ratio < 0.99).mean() < 0.9


def test_every_effect_that_acts_on_a_rope_or_a_cloth_is_hidden_once():
    cases = benchmark_cases(EFFECTS, variant="thin", seed=3)
    assert len({case.name for case in cases}) == len(cases)
    for body in THIN_BODIES:
        own = [case for case in cases if case.body == body]
        singles = [case.effect for case in own if case.kind == "single"]
        assert len(singles) == len(set(singles)) >= 20 and len(own) - len(singles) == 6
        assert "plastic_yield" not in singles and ("kelvin_voigt" in singles) == (body == "cloth")
        for case in own:
            made_by_rig = Case.blind(case.effect, case.strength, case.seed, case.body, case.form)
            assert made_by_rig.specimen.body.name == body


@pytest.mark.slow
@pytest.mark.parametrize("name", THIN_BODIES)
def test_captures_become_the_problem_of_a_thin_body(name, tmp_path):
    session = Session(seen=("press_drag",), fps=30.0, seconds={"press_drag": 0.5})
    make_case(Case("none", "middle", SEED, name, session=session), tmp_path / "case", video=False)
    ((motion, problem),) = problems_of(tmp_path / "case", Discretisation(patches=3)).items()
    truth, body = load_truth(tmp_path / "case" / motion), problem.body
    assert cells_of(body).shape[1] == (2 if name == "rope" else 3)
    assert body.mass.sum() == pytest.approx(specimen(name, SEED).material.density * body.volume.sum())
    assert body.volume.sum() == pytest.approx(specimen(name, SEED).body.volume, rel=0.03)
    ours = body.x0[np.unique(problem.grip.particles), 0].min()
    assert ours == pytest.approx(truth.middle_rest[truth.middle_gripped, 0].min(), abs=0.75 * body.spacing)
    assert len(problem.tracks.points0) > 140
    model = baseline_model(problem)
    assert model.fields["bending_ratio"].shape == (3,)
    assert replace(model).simulation_config(30.0, body=body).terms == ("bending",)
