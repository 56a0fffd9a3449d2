"""Each law of another form against its own formula, or against the library's law in the limit in which they agree."""

import numpy as np
import pytest

mujoco = pytest.importorskip("mujoco")

from data.rig.hidden import around, contact, grip, mass, material, other_laws, other_material, outside
from data.rig.hidden.elements import Elements, deviator, size
from data.rig.hidden.forms import OTHER_FORMS
from data.rig.hidden.library import LIBRARY, OUTSIDE
from data.rig.hidden.measurement import CameraDrift, DepthBias
from data.rig.hidden.together import Together
from data.rig.rig_scene import Motion
from physreal_core.effects import EFFECTS
from tests.rig.test_hidden import (
    STILL,
    block,
    deformation,
    launch,
    lying,
    pushed,
    put,
    recording,
    run,
    slope_of,
    start,
)


def test_the_names_are_the_librarys_and_unknown_coefficients_are_not_stated():
    assert set(OTHER_FORMS) <= set(EFFECTS) and not any(name.startswith(OUTSIDE) for name in OTHER_FORMS)
    assert set(EFFECTS) <= set(LIBRARY)
    assert other_laws.PowerDrag(1.0, 1.6, 0.3).values() == {}
    assert other_laws.ExtendedPayload(0.3, 0.1, 0.2, 0.3, 0.04).values() == {"ratio": 0.3, "x": 0.1, "y": 0.2, "z": 0.3}


@pytest.mark.parametrize(("exponent", "plain"), [(1.0, around.LinearDrag(2.0)), (2.0, around.QuadraticDrag(2.0 / 0.3))])
def test_a_drag_of_power_one_or_two_is_the_librarys(exponent, plain):
    speeds = []
    for drag in (other_laws.PowerDrag(2.0, exponent, 0.3), plain):
        world, act = start(drag, block())
        launch(world, [0.5, 0.2, 0.0])
        speeds.append(run(drag, world, act, 0.2)[-1])
    np.testing.assert_allclose(*speeds, rtol=2e-3, atol=1e-9)


def test_a_drag_of_power_1_6_slows_by_its_formula():
    """dv/dt = -c v (v / s)^0.6 has v^-0.6 = v0^-0.6 + 0.6 c t / s^0.6."""
    drag = other_laws.PowerDrag(2.0, 1.6, 0.3)
    world, act = start(drag, block())
    launch(world, [0.5, 0.0, 0.0])
    assert run(drag, world, act, 0.3)[-1, 0] ** -0.6 == pytest.approx(0.5**-0.6 + 0.6 * 2.0 * 0.3 / 0.3**0.6, rel=2e-3)


def test_a_wind_with_a_profile_blows_as_stated_at_eight_centimetres():
    flat, profiled = around.Wind(0.7, 0.0, 0.0), other_laws.ProfiledWind(0.7, 0.0, 0.0)
    forces = [
        pushed(*start(wind, block(lower=(-0.06, -0.02, 0.04), upper=(0.06, 0.02, 0.08)))) for wind in (flat, profiled)
    ]
    world, _ = start(flat, block(lower=(-0.06, -0.02, 0.04), upper=(0.06, 0.02, 0.08)))
    height = world.positions[:, 2]
    np.testing.assert_allclose(forces[1], forces[0] * ((height / 0.08) ** 0.4)[:, None], atol=1e-12)


def test_a_payload_with_an_extent_has_its_mass_and_its_place():
    place = (-0.02, 0.0, 0.52)
    world, _ = start(other_laws.ExtendedPayload(0.25, *place, radius=0.03), block())
    bare, _ = start(Together(()), block())
    added = world.masses - bare.masses
    assert added.sum() == pytest.approx(0.25 * bare.masses.sum(), rel=1e-9)
    np.testing.assert_allclose(added @ world.mesh.vertices / added.sum(), place, atol=0.003)
    assert not added[np.linalg.norm(world.mesh.vertices - place, axis=1) > 0.045].any()


def test_two_densities_move_the_centre_of_mass_as_a_gradient_does():
    centres = []
    for hidden in (mass.DensityGradient(5.0, 0.0, 0.0), other_laws.TwoDensities(5.0, 0.0, 0.0)):
        world, _ = start(hidden, block())
        centres.append(world.masses @ world.mesh.vertices / world.masses.sum())
    np.testing.assert_allclose(*centres, atol=0.001)
    density = world.masses / start(Together(()), block())[0].masses
    assert len(np.unique(density.round(3))) <= 3  # two, and that of the nodes between


def test_adhesion_of_a_triangle_rises_and_falls_in_proportion():
    world, act = start(other_laws.TriangularAdhesion(300.0, 0.004), lying())
    for height, share in ((0.002, 0.5), (0.004, 1.0), (0.006, 0.5), (0.009, 0.0)):
        put(world, world.mesh.vertices + [0, 0, height])
        assert pushed(world, act)[:, 2].sum() == pytest.approx(-300.0 * 0.12 * 0.04 * share, rel=1e-6, abs=1e-9)


def test_friction_by_other_laws_of_speed():
    speed = np.array([0.0, 0.1, 10.0])
    fading = other_laws.HyperbolicStickSlip(0.6, 0.1).coefficient(speed, 0.4)
    np.testing.assert_allclose(fading, [1.0, 0.7, 0.4 + 0.6 / 101])
    growing = other_laws.SaturatingFriction(2.0, 0.1).coefficient(speed, 0.4)
    np.testing.assert_allclose(growing, [0.4, 0.5, 0.4 + 2.0 * 10 / 101])
    for law in (other_laws.HyperbolicStickSlip(0.6, 0.1), other_laws.SaturatingFriction(2.0, 0.1)):
        assert law.implicit_step() == contact.StickSlip(0.6, 0.1).implicit_step()
        assert law.values() == {} and type(law).advance is contact.Sliding.advance


@pytest.mark.parametrize(
    ("hidden", "inside"),
    [
        (other_laws.ObstacleEllipsoid(0.12, 0.0, 0.52, 0.04), lambda p: 0.06 - np.abs(p[:, 0] - 0.12)),
        (other_laws.ObstaclePillar(0.11, 0.0, 0.7, 0.02), lambda p: p[:, 0] - 0.09),
    ],
    ids=["ellipsoid", "pillar"],
)
def test_obstacles_of_another_shape_throw_the_body_back(hidden, inside):
    world, act = start(hidden, block())
    launch(world, [0.5, 0.0, 0.0])
    deepest = -1.0
    for _ in range(12):
        run(hidden, world, act, 0.02)
        deepest = max(deepest, inside(world.positions).max())
    assert -0.004 < deepest < 0.002  # the nodes that touch lie off the middle, where an egg is a little narrower
    assert (world.masses @ world.velocities / world.masses.sum())[0] < -0.1


def test_holds_that_saturate_come_late_or_wander():
    times, motion = np.linspace(0.0, 3.0, 301), Motion(((0.5, 1.0, (0.1, 0.0, 0.0)),))
    hand = motion.displacement(times)
    slipped = hand - other_laws.SaturatingSlip(0.01, 0.0, 0.0).held(hand, times, motion)
    constant = hand - grip.GripSlip(0.01, 0.0, 0.0).held(hand, times, motion)
    np.testing.assert_allclose(slipped[52, 0], constant[52, 0], rtol=0.02)  # at first as fast
    assert slipped[-1, 0] == pytest.approx(0.01 * 0.8 * (1 - np.exp(-2.5 / 0.8)))
    offset = other_laws.SlowOffset(0.0, 0.005, 0.0).held(hand, times, motion) - hand
    np.testing.assert_allclose(offset[[50, 80, 110, 300], 1], [0, 0.0025, 0.005, 0.005], atol=1e-12)
    wandering = other_laws.WanderingLag(0.1).held(hand, times, motion)
    np.testing.assert_allclose(
        wandering[65], grip.GripLag(0.1).held(hand, times, motion)[65], atol=1e-9
    )  # half a period


def test_a_grip_that_hardens_is_the_librarys_where_it_gives_little():
    for away, ratio in ((1e-5, 1.0), (0.002, 2.0)):
        forces = []
        for hidden in (grip.GripCompliance(0.004), other_laws.HardeningGrip(0.004)):
            world, act = start(hidden, block(grasp=block().body))
            put(world, world.mesh.vertices + [0, 0, away])
            forces.append(pushed(world, act)[:, 2].sum())
        assert forces[1] == pytest.approx(ratio * forces[0], rel=1e-3)


def test_a_camera_that_sways_is_back_after_its_way():
    true, drift = recording(80), CameraDrift(0.01, 0.0, -0.02, roll=0.3)
    swaying = other_laws.SwayingCamera(0.01, 0.0, -0.02, 0.3).record(true, STILL).tracks
    np.testing.assert_allclose(swaying[78], true.tracks[78], atol=1e-12)  # 2.6 s
    np.testing.assert_allclose(swaying[39], drift.recorded_at(true, np.full(80, 1.3)).tracks[39], atol=1e-12)


def test_a_curved_depth_is_the_librarys_at_its_distance():
    depth = np.array([[0.0, 0.8, 1.6]])
    np.testing.assert_allclose(
        other_laws.CurvedDepth(0.01, 0.05).depth(depth),
        [[0.0, DepthBias(0.01, 0.05).depth(depth)[0, 1], 1.6 + 0.01 + 0.16]],
    )
    true = recording()
    np.testing.assert_allclose(other_laws.CurvedDepth(0.01, 0.05).record(true, STILL).tracks[0], true.tracks[0])


def test_shear_alone_is_stiffer_at_once_and_relaxes_to_the_bodys_own():
    """A held shear: its stress begins at three times the body's own and falls to it; volume is not damped."""
    hidden = other_material.ShearZener(0.01)
    world, act = start(hidden, block(), timestep=5e-4)
    bare, _ = start(Together(()), block())
    sheared = world.mesh.vertices @ np.array([[1, 0, 0], [0.005, 1, 0], [0, 0, 1.0]])
    first, own = put(world, sheared), put(bare, sheared)
    np.testing.assert_allclose(first, 3 * own, atol=0.02 * np.abs(own).max())  # second order in the strain
    for _ in range(100):
        act(world.timestep)
    np.testing.assert_allclose(put(world, sheared), own, atol=0.02 * np.abs(own).max())
    swollen, _ = start(hidden, block())
    puffed = world.mesh.vertices * 1.01
    np.testing.assert_allclose(put(swollen, puffed), put(bare, puffed), atol=1e-3 * np.abs(own).max())


def test_creep_with_two_times_relaxes_each_half_by_its_own():
    hidden = other_material.TwoTimesCreep(3.0)
    world, act = start(hidden, block(), timestep=1e-3)
    put(world, world.mesh.vertices @ np.diag([1.05, 0.99, 1.0]))
    elements = Elements(world)
    before = size(deviator(elements.elastic_strain()))
    for step in range(500):
        act((step + 1) * world.timestep)
    left = (np.exp(-0.5) + np.exp(-4.5)) / 2  # rates of 1 and 9 per second
    np.testing.assert_allclose(
        size(deviator(elements.elastic_strain())), left * before, rtol=0.02
    )  # first order in the step


def test_hardening_yields_at_the_librarys_stress_and_goes_on_with_its_modulus():
    hidden = other_material.HardeningYield(25.0)
    world, act = start(hidden, block(), timestep=1e-6)
    elements, limits = Elements(world), []
    for stretch in (1.02, 1.1, 1.2):
        put(world, world.mesh.vertices @ np.diag([stretch, 1 / np.sqrt(stretch), 1 / np.sqrt(stretch)]))
        trial = size(deviator(elements.elastic_strain()))[0]
        act(1e-6)
        limits.append((trial, size(deviator(elements.elastic_strain()))[0]))
    shear, first = 2e5 / 2.6, 2 * 1.3 / (3 * 25.0) * np.sqrt(1.5)
    assert 2 * shear * np.sqrt(1.5) * first == pytest.approx(2e5 / 25.0)
    assert limits[0][0] == limits[0][1] < first  # elastic below it
    flowed = limits[1][0] - limits[1][1]
    assert limits[1][1] == pytest.approx(first + 0.15 * flowed)
    assert limits[2][1] == pytest.approx(first + 0.15 * (flowed + limits[2][0] - limits[2][1]))


def test_exponential_stiffening_is_the_slope_of_its_energy():
    hidden = other_material.ExponentialStiffening(2.0)
    world, act = start(hidden, block(upper=(-0.02, 0.02, 0.54)))
    positions = world.mesh.vertices * [1.1, 0.97, 0.95] + 0.001 * np.random.default_rng(0).normal(size=(27, 3))

    def energy(points):
        F = deformation(world, points)
        J = (F**2).sum(axis=(1, 2)) * np.linalg.det(F) ** (-2 / 3) - 3
        return (world.mesh.volumes() * 2 * 2.0 * 2e5 * (np.exp(6 * J) - 1 - 6 * J) / 36).sum()

    put(world, positions)
    np.testing.assert_allclose(pushed(world, act), -slope_of(energy, positions), rtol=1e-5, atol=1e-5)


def test_fibres_pull_as_the_librarys_and_do_not_push():
    scene = block(upper=(-0.02, 0.02, 0.54))
    plain, fibred = (start(hidden, scene) for hidden in (Together(()), material.Fibres(1.5, 0.0, 0.0)))
    world, act = start(other_material.TensionFibres(1.5, 0.0, 0.0), scene)
    for stretch, share in ((1.08, 1.0), (0.95, 0.0)):
        positions = world.mesh.vertices * [stretch, 1.0, 1.0]
        added = put(fibred[0], positions) - put(plain[0], positions)
        put(world, positions)
        np.testing.assert_allclose(pushed(world, act), share * added, rtol=1e-5, atol=1e-6)


def test_a_soft_ellipsoid_has_an_edge():
    world, _ = start(other_material.SoftEllipsoid(0.4, 0.0, 0.0, 0.52, 0.03), block())
    bare, _ = start(Together(()), block())
    ratio = Elements(world).stiffness[:, 0] / Elements(bare).stiffness[:, 0]
    assert {0.6, 1.0} == set(ratio.round(6)) and 0.1 < (ratio < 0.9).mean() < 0.9


def test_uneven_bending_has_the_mean_curvature_of_the_even_one():
    world, _ = start(material.RestShape(0.0, 0.0, 1.0), block())
    even, uneven = (material.RestShape(0.0, 0.0, 1.0)._rest_displacement(world, share) for share in (0.0, 1.0))
    x = world.mesh.vertices[:, 0]
    line = np.abs(world.mesh.vertices[:, 1]) + np.abs(world.mesh.vertices[:, 2] - 0.52) < 1e-6
    np.testing.assert_allclose(np.polyfit(x[line], even[line, 2], 3)[:2], [0.0, 0.5], atol=1e-6)
    third, second = np.polyfit(x[line], uneven[line, 2], 3)[:2]
    assert second == pytest.approx(0.5) and 6 * third * 0.06 == pytest.approx(1.0)  # from nothing to twice at the ends


def test_a_charge_draws_every_part_and_a_field_grows_with_x():
    world, act = start(outside.Charge(0.04, 1.0, 0.0, 0.52), block())
    force = pushed(world, act)
    way = np.array([1.0, 0.0, 0.52]) - world.positions
    np.testing.assert_allclose(force, 0.04 * world.masses[:, None] * way / ((way**2).sum(1) + 1e-4)[:, None] ** 1.5)
    world, act = start(outside.GradientField(20.0), block())
    np.testing.assert_allclose(pushed(world, act)[:, 1], 20.0 * world.masses * world.positions[:, 0])


def test_gyration_turns_a_velocity_and_keeps_its_size():
    hidden = outside.Gyration(4.0)
    world, act = start(hidden, block())
    launch(world, [0.3, 0.0, 0.0])
    velocity = run(hidden, world, act, 0.25)[-1]
    np.testing.assert_allclose(velocity, [0.3 * np.cos(1.0), 0.3 * np.sin(1.0), 0.0], atol=2e-3)
