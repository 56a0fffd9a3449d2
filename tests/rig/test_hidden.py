"""Each hidden effect against a closed form: the truth of the benchmark must be what its truth.npz says."""

from dataclasses import replace

import numpy as np
import pytest

mujoco = pytest.importorskip("mujoco")

from data.rig.hidden import around, contact, grip, mass, material, measurement, outside
from data.rig.hidden.elements import Elements, deviator, size
from data.rig.hidden.together import Together
from data.rig.recording import Recording
from data.rig.rig_scene import Material, Motion, RigScene, View
from data.rig.shapes import Block, Capsule, RoundedShape
from data.rig.simulate import simulate
from data.rig.world import World

STILL = Motion(((0.0, 1.0, (0.0, 0.0, 0.0)),))
NOWHERE = RoundedShape((Capsule((5, 5, 5), (5, 5, 5), 0.01),))
FOAM = Material(youngs_modulus=2e5, poissons_ratio=0.3, density=500.0, damping=2e-5, friction_coefficient=0.4)


def block(lower=(-0.06, -0.02, 0.5), upper=(0.06, 0.02, 0.54), **settings):
    """A block that floats half a metre up, without weight unless one is given."""
    scene = RigScene("block", "a block", Block(lower, upper), NOWHERE, STILL, material=FOAM, mesh_spacing=0.02)
    return replace(scene, **{"gravity": (0.0, 0.0, 0.0), "grasp": Block((9, 9, 9), (9, 9, 9))} | settings)


def start(hidden, scene, timestep=1e-4, integrator="Euler"):
    """The world with the effect in it, and what the effect does before a step."""
    scene = hidden.changed(scene)
    things = (hidden.things(scene), hidden.elasticity(scene))
    world = World(scene, timestep, integrator, *things, hidden.placed)
    act = hidden.prepare(world)
    mujoco.mj_setConst(world.model, world.data)
    mujoco.mj_forward(world.model, world.data)
    return world, act


def run(hidden, world, act, duration):
    """Steps the world; returns mean velocities after each step."""
    history = []
    for step in range(round(duration / world.timestep)):
        world.data.qfrc_applied[:] = 0
        act((step + 1) * world.timestep)
        hidden.advance(world)
        history.append(world.masses @ world.velocities / world.masses.sum())
    return np.array(history)


def launch(world, velocity):
    world.data.qvel[world.dofs] = velocity


def pushed(world, act, time=1e-4):
    """Forces on the nodes before a step that ends at `time`."""
    world.data.qfrc_applied[:] = 0
    act(time)
    return world.data.qfrc_applied[world.dofs]


def put(world, positions):
    """Moves the nodes and has MuJoCo compute its own elastic forces there."""
    world.data.qpos[world.dofs] = positions - world.mesh.vertices
    mujoco.mj_forward(world.model, world.data)
    return world.data.qfrc_passive[world.dofs]


def slope_of(energy, positions, step=1e-7):
    """Central differences of an energy at all nodes."""
    gradient = np.zeros_like(positions)
    for index in np.ndindex(*positions.shape):
        shift = np.zeros_like(positions)
        shift[index] = step
        gradient[index] = (energy(positions + shift) - energy(positions - shift)) / (2 * step)
    return gradient


def deformation(world, positions):
    """F of every tetrahedron, straight from its definition."""
    tets, rest = world.mesh.tets, world.mesh.vertices
    return np.stack(
        [(positions[t[1:]] - positions[t[0]]).T @ np.linalg.inv((rest[t[1:]] - rest[t[0]]).T) for t in tets]
    )


def test_linear_drag_slows_exponentially():
    drag = around.LinearDrag(2.0)
    world, act = start(drag, block())
    launch(world, [1.0, 0.5, 0.0])
    speed = np.linalg.norm(run(drag, world, act, 0.3), axis=1)
    assert speed[-1] == pytest.approx(np.hypot(1, 0.5) * np.exp(-2.0 * 0.3), rel=1e-3)


def test_quadratic_drag_slows_as_one_over_time():
    drag = around.QuadraticDrag(3.0)
    world, act = start(drag, block())
    launch(world, [1.0, 0.0, 0.0])
    assert run(drag, world, act, 0.3)[-1, 0] == pytest.approx(1 / (1 + 3.0 * 0.3), rel=1e-3)


def test_surface_drag_brakes_a_solid_by_both_of_its_sides():
    """A block of depth l that moves along x: v = 1 / (1 + c t), c the drag on its cross-section over its mass, half on each face."""
    drag = around.SurfaceDrag(50.0)
    world, act = start(drag, block())
    launch(world, [1.0, 0.0, 0.0])
    per_mass = 0.6 * 50.0 / (world.scene.material.density * np.ptp(world.mesh.vertices[:, 0]))
    assert run(drag, world, act, 0.3)[-1, 0] == pytest.approx(1 / (1 + per_mass * 0.3), rel=1e-3)


def test_wind_accelerates_the_whole_and_presses_the_surface_only():
    wind = around.Wind(0.7, -0.2, 0.1)
    world, act = start(wind, block(upper=(0.06, 0.04, 0.56)))
    inner = np.setdiff1d(np.arange(len(world.mesh.vertices)), world.mesh.faces)
    assert len(inner) and not pushed(world, act)[inner].any()
    np.testing.assert_allclose(run(wind, world, act, 0.1)[-1], [0.07, -0.02, 0.01], rtol=1e-6)


def test_gravity_turns_about_x_then_y_and_grows():
    scene = around.Gravity(0.1, 0.2, 0.05).changed(block(gravity=(0.0, 0.0, -9.81)))
    sx, cx, sy, cy = np.sin(0.1), np.cos(0.1), np.sin(0.2), np.cos(0.2)
    expected = 1.05 * 9.81 * np.array([-sy * cx, sx, -cy * cx])
    np.testing.assert_allclose(scene.gravity, expected, rtol=1e-12)


def test_kelvin_voigt_damps_a_mode_at_half_its_time_by_frequency_squared():
    """A long thin bar let go from a stretch rings in its first axial mode, w = pi / L sqrt(E / rho)."""
    time, length = 0.002, 0.3
    hidden = material.KelvinVoigt(time)
    scene = block(lower=(0.0, -0.01, 0.5), upper=(length, 0.01, 0.52))
    world, _ = start(hidden, scene, timestep=5e-4, integrator="discrete")
    x = world.mesh.vertices[:, 0]
    put(world, world.mesh.vertices - 0.01 * np.cos(np.pi * x / length)[:, None] * [1, 0, 0])
    ends = x > length - 1e-6
    amount = []
    for _ in range(400):
        hidden.advance(world)
        amount.append((world.positions - world.mesh.vertices)[ends, 0].mean())
    amount = np.array(amount)
    turns = np.flatnonzero((amount[1:-1] - amount[:-2]) * (amount[2:] - amount[1:-1]) < 0) + 1
    frequency = np.pi / np.diff(turns).mean() / world.timestep
    assert frequency == pytest.approx(np.pi / length * np.sqrt(2e5 / 500), rel=0.05)
    rate = -np.polyfit(turns * world.timestep, np.log(np.abs(amount[turns])), 1)[0]
    assert rate == pytest.approx(frequency**2 * time / 2, rel=0.05)


def test_creep_takes_the_shear_out_of_a_held_strain():
    hidden = material.MaxwellCreep(3.0)
    world, act = start(hidden, block(), timestep=1e-3)
    put(world, world.mesh.vertices @ np.diag([1.05, 0.99, 1.0]))
    elements = Elements(world)
    before = elements.elastic_strain()
    for step in range(500):
        act((step + 1) * world.timestep)
    after = elements.elastic_strain()
    np.testing.assert_allclose(
        size(deviator(after)), size(deviator(before)) * np.exp(-3.0 * 500 * world.timestep), rtol=3e-3
    )
    np.testing.assert_allclose(after[:, :3].sum(axis=1), before[:, :3].sum(axis=1), rtol=1e-9)


def test_stress_stays_on_von_mises_yield_surface():
    hidden = material.PlasticYield(25.0)
    world, _ = start(hidden, block(), timestep=1e-6)
    put(world, world.mesh.vertices @ np.diag([1.1, 1 / np.sqrt(1.1), 1 / np.sqrt(1.1)]))
    hidden.advance(world)
    shear = 2e5 / 2.6
    stress = 2 * shear * np.sqrt(1.5) * size(deviator(Elements(world).elastic_strain()))
    # MuJoCo maps back on the intermediate configuration, this is the second Piola-Kirchhoff stress: 3 % at these strains.
    np.testing.assert_allclose(stress, 2e5 / 25.0, rtol=0.03)


def test_stiffening_is_the_slope_of_yeohs_second_term():
    hidden = material.StrainStiffening(2.0)
    world, act = start(hidden, block(upper=(-0.02, 0.02, 0.54)))
    positions = world.mesh.vertices * [1.1, 0.97, 0.95] + 0.001 * np.random.default_rng(0).normal(size=(27, 3))

    def energy(points):
        F = deformation(world, points)
        J = np.linalg.det(F)
        return (world.mesh.volumes() * 2.0 * 2e5 * ((F**2).sum(axis=(1, 2)) * J ** (-2 / 3) - 3) ** 2).sum()

    put(world, positions)
    np.testing.assert_allclose(pushed(world, act), -slope_of(energy, positions), rtol=1e-5, atol=1e-5)


def test_fibres_add_their_energy_to_mujocos():
    hidden, plain = material.Fibres(1.5, 0.6, -0.3), Together(())
    scene = block(upper=(-0.02, 0.02, 0.54))
    world, _ = start(hidden, scene)
    bare, _ = start(plain, scene)
    a = np.array([np.cos(-0.3) * np.cos(0.6), np.cos(-0.3) * np.sin(0.6), np.sin(-0.3)])
    positions = world.mesh.vertices * [1.1, 0.97, 0.95] + 0.001 * np.random.default_rng(0).normal(size=(27, 3))

    def energy(points):
        along = ((deformation(world, points) @ a) ** 2).sum(axis=1)
        return (world.mesh.volumes() * 1.5 * 2e5 / 8 * (along - 1) ** 2).sum()

    added = put(world, positions) - put(bare, positions)
    np.testing.assert_allclose(added, -slope_of(energy, positions), rtol=1e-5, atol=1e-5)


def test_soft_spot_scales_elastic_forces():
    scene = block()
    bare, _ = start(Together(()), scene)
    positions = bare.mesh.vertices * [1.05, 1.0, 0.97]
    wide, _ = start(material.SoftSpot(0.4, 0.0, 0.0, 0.52, radius=100.0), scene)
    np.testing.assert_allclose(put(wide, positions), 0.6 * put(bare, positions), rtol=1e-5, atol=1e-6)
    local, _ = start(material.SoftSpot(0.4, -0.06, 0.0, 0.52, radius=0.005), scene)
    far = local.mesh.vertices[:, 0] > 0.0
    np.testing.assert_allclose(put(local, positions)[far], put(bare, positions)[far], rtol=1e-5, atol=1e-6)


def test_rest_shape_is_free_of_stress_where_the_stretch_is_undone():
    world, act = start(material.RestShape(0.004, 0.0, 0.0), block())
    middle = world.mesh.vertices.mean(axis=0)
    shrunk = middle + (world.mesh.vertices - middle) * [1 - 0.004, 1 + 0.3 * 0.004, 1 + 0.3 * 0.004]
    act(0.0)
    assert np.abs(put(world, world.mesh.vertices)).max() < 1e-9  # not let go yet
    act(1e-4)
    pull = put(world, world.mesh.vertices)[world.mesh.vertices[:, 0] > 0.059, 0].sum()
    assert pull == pytest.approx(-2e5 * 0.004 * 0.04**2, rel=0.01)  # E e A
    assert np.abs(put(world, shrunk)).max() < 0.01 * abs(pull)  # second order in the strain


def test_rest_shape_bends_to_the_stated_curvature():
    """Let go, a straight bar that is bent by k against its rest shape takes the curvature -k."""
    scene = block(lower=(-0.12, -0.02, 0.5), upper=(0.12, 0.02, 0.54))
    hidden = material.RestShape(0.0, 0.0, 1.5)
    world, act = start(hidden, scene)
    world.model.dof_damping[:] = 0.3 * world.masses.mean() * 100  # to come to rest
    run(hidden, world, act, 1.0)
    bottom = np.abs(world.mesh.vertices[:, 2] - 0.5) < 1e-6
    x, z = world.positions[bottom, 0], world.positions[bottom, 2]
    # Stretched where z is high, so those fibres want to be short: the ends rise, by k x^2 / 2. Coarse elements: 10 %.
    assert np.polyfit(x, z, 2)[0] == pytest.approx(1.5 / 2, rel=0.1)


def test_payload_adds_its_mass_at_its_place():
    place = (-0.02, 0.0, 0.52)
    world, _ = start(mass.Payload(0.25, *place, radius=0.012), block())
    bare, _ = start(Together(()), block())
    added = world.masses - bare.masses
    assert added.sum() == pytest.approx(0.25 * bare.masses.sum(), rel=1e-9)
    np.testing.assert_allclose(added @ world.mesh.vertices / added.sum(), place, atol=0.002)


def test_density_gradient_keeps_the_mass_and_moves_its_centre():
    world, _ = start(mass.DensityGradient(5.0, 0.0, 0.0), block())
    bare, _ = start(Together(()), block())
    assert world.masses.sum() == pytest.approx(bare.masses.sum())
    centre = (world.masses @ world.mesh.vertices / world.masses.sum())[0]
    a = 0.06 * 5.0  # centre of exp(k x) over -L..L: L coth(k L) - 1 / k; elements of 20 mm and lumping: a few percent
    assert centre == pytest.approx(0.06 / np.tanh(a) - 1 / 5.0, rel=0.1)


def lying(**settings):
    return block(lower=(-0.06, -0.02, 0.0), upper=(0.06, 0.02, 0.04), gravity=(0.0, 0.0, -9.81), **settings)


def test_adhesion_reaches_its_strength_at_its_range():
    world, act = start(contact.GroundAdhesion(300.0, 0.004), lying())
    for height, share in ((0.0, 0.0), (0.004, 1.0), (0.008, 2 * np.exp(-1))):
        put(world, world.mesh.vertices + [0, 0, height])
        assert pushed(world, act)[:, 2].sum() == pytest.approx(-300.0 * 0.12 * 0.04 * share, rel=1e-6)


def sliding(hidden, tangent, duration=0.6):
    """Speed down a slope of this tangent, as gravity turned; implicit steps, which do not let the body chatter."""
    angle = np.arctan(tangent)
    world, act = start(hidden, lying(), timestep=5e-4, integrator="discrete")
    for _ in range(10):  # comes to rest on the level
        run(hidden, world, act, 0.02)
        launch(world, 0.0)
    world.model.opt.gravity[:] = 9.81 * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    return run(hidden, world, act, duration)[:, 0], 9.81 * np.cos(angle)


def test_static_friction_holds_what_dynamic_friction_lets_slide():
    plain, normal = sliding(contact.StickSlip(0.0, 0.03), 0.5)
    assert plain[-1] == pytest.approx((0.5 - 0.4) * normal * 0.6, rel=0.05)
    held, _ = sliding(contact.StickSlip(0.3, 0.03), 0.5)
    assert np.abs(held[-1]) < 0.02 * plain[-1]
    torn, _ = sliding(contact.StickSlip(0.3, 0.03), 0.8)  # above the static threshold of 0.7: slides on at 0.4
    assert (torn[-1] - torn[len(torn) // 3]) / 0.4 == pytest.approx((0.8 - 0.4) * 9.81 / np.hypot(1, 0.8), rel=0.1)


def test_rate_friction_has_a_terminal_speed():
    speed, _ = sliding(contact.RateFriction(2.0), 0.6)
    assert speed[-1] == pytest.approx((0.6 - 0.4) / 2.0, rel=0.1)


def test_body_lies_on_the_sloping_ground_and_stays():
    hidden = contact.GroundPlane(0.01, 0.08, -0.05)
    result = simulate(replace(lying(), frames=5), timestep=2e-4, integrator="Euler", hidden=hidden, settle=0.05)
    under = result.mesh.vertices[:, 2].argsort()[:4]  # corners of the underside are among its lowest
    for points in (result.vertices[0], result.vertices[-1]):
        gap = points @ np.array([-0.08, 0.05, 1.0]) - 0.01
        assert gap.min() == pytest.approx(0.0, abs=0.001) and np.abs(gap[under]).max() < 0.002
    # Friction holds it; the soft constraint creeps a little.
    assert np.abs(result.vertices[-1] - result.vertices[0]).max() < 0.001


@pytest.mark.parametrize(
    ("hidden", "inside"),
    [
        (contact.ObstaclePlane(0.0, 0.0, 0.09), lambda p: p[:, 0] - 0.09),
        (contact.ObstacleSphere(0.12, 0.0, 0.52, 0.03), lambda p: 0.03 - np.linalg.norm(p - [0.12, 0, 0.52], axis=1)),
        (contact.ObstaclePost(0.11, 0.0, 0.7, 0.02), lambda p: 0.02 - np.linalg.norm(p[:, :2] - [0.11, 0], axis=1)),
    ],
    ids=["plane", "sphere", "post"],
)
def test_obstacle_throws_the_body_back(hidden, inside):
    world, act = start(hidden, block())
    launch(world, [0.5, 0.0, 0.0])
    deepest = -1.0
    for _ in range(12):
        run(hidden, world, act, 0.02)
        deepest = max(deepest, inside(world.positions).max())
    assert -0.002 < deepest < 0.002
    assert (world.masses @ world.velocities / world.masses.sum())[0] < -0.1


def test_hold_follows_slip_offset_and_lag():
    times = np.linspace(0.0, 2.0, 201)
    motion = Motion(((0.5, 1.0, (0.1, 0.0, 0.0)),))
    hand = motion.displacement(times)
    slipped = grip.GripSlip(0.01, 0.0, -0.02).held(hand, times, motion)
    np.testing.assert_allclose((hand - slipped)[-1], [0.015, 0.0, -0.03], atol=1e-12)
    np.testing.assert_allclose(slipped[:51], hand[:51])
    offset = grip.GripOffset(0.0, 0.005, 0.0).held(hand, times, motion) - hand
    np.testing.assert_allclose(offset[[50, 60, 70, 200], 1], [0, 0.0025, 0.005, 0.005], atol=1e-12)
    lagged = grip.GripLag(0.1).held(hand, times, motion)
    np.testing.assert_allclose(lagged[10:], hand[:-10], atol=1e-12)


def test_compliant_grip_gives_way_by_weight_times_compliance():
    scene = block(
        gravity=(0.0, 0.0, -9.81), grasp=Block((-1, -1, -1), (1, 1, 1))
    )  # held at every node, so it cannot tip
    hidden = grip.GripCompliance(0.004)
    world, act = start(hidden, scene)
    for _ in range(20):  # comes to rest
        run(hidden, world, act, 0.03)
        launch(world, 0.0)
    weight = world.masses.sum() * 9.81
    fallen = (world.mesh.vertices - world.positions)[:, 2].mean()
    assert fallen == pytest.approx(0.004 * weight, rel=0.02)


def recording(frames=30):
    random = np.random.default_rng(0)
    tracks = random.uniform(-0.1, 0.1, (1, 20, 3)) + random.normal(scale=0.02, size=(frames, 1, 3))
    return Recording(30.0, tracks, tracks[:, :4], View())


def test_camera_drift_moves_and_turns_the_tracks_alone():
    true = recording()
    seen = measurement.CameraDrift(0.01, 0.0, -0.02, roll=0.3).record(true, STILL)
    time, pose = 29 / 30, true.view.pose()
    turn = np.array([[np.cos(0.3 * time), -np.sin(0.3 * time)], [np.sin(0.3 * time), np.cos(0.3 * time)]])
    local, shown = ((tracks[-1] - pose[:3, 3]) @ pose[:3, :3] for tracks in (true.tracks, seen.tracks))
    moved = np.array([0.01, 0.0, -0.02]) * time @ pose[:3, :3]
    np.testing.assert_allclose(shown[:, :2], local[:, :2] @ turn.T + moved[:2])
    np.testing.assert_allclose(shown[:, 2], local[:, 2] + moved[2])
    assert seen.controllers is true.controllers


def test_a_drifting_camera_sees_the_apparent_motion():
    pose, time = View().pose(), 0.7
    true = measurement.CameraDrift(0.01, 0.02, -0.02, roll=0.3).camera(pose, time)
    point = np.array([0.05, -0.02, 0.1, 1.0])
    seen = pose @ np.linalg.inv(true) @ point
    about_axis = (point[:3] - pose[:3, 3]) @ pose[:3, :3]
    cosine, sine = np.cos(0.3 * time), np.sin(0.3 * time)
    turned = pose[:3, :3] @ (np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1.0]]) @ about_axis) + pose[:3, 3]
    np.testing.assert_allclose(seen[:3], turned + time * np.array([0.01, 0.02, -0.02]), atol=1e-12)


def test_biased_depth_keeps_missing_readings():
    depth = measurement.DepthBias(0.01, 0.05).depth(np.array([[0.0, 1.0]]))
    np.testing.assert_allclose(depth, [[0.0, 1.06]])


def test_depth_bias_stretches_depth_along_rays():
    true = recording()
    seen = measurement.DepthBias(0.01, 0.05).record(true, STILL)
    pose = true.view.pose()
    np.testing.assert_allclose(seen.tracks[0], true.tracks[0])
    before, after = ((points - pose[:3, 3]) @ pose[:3, :3] for points in (true.tracks, seen.tracks))
    moved = (after - after[:1])[..., 2]
    np.testing.assert_allclose(moved, 1.05 * (before - before[:1])[..., 2], atol=1e-9)
    assert seen.controllers is true.controllers


def test_frame_rate_slows_the_object_not_the_hands_record():
    motion = Motion(((0.0, 1.0, (0.1, 0.0, 0.0)),))
    hidden = measurement.FrameRate(0.1)
    assert hidden.changed(block()).fps == pytest.approx(30 / 1.1)
    seen = hidden.record(recording(), motion)
    times = np.arange(30) / 30
    np.testing.assert_allclose(
        seen.controllers - seen.controllers[:1], np.broadcast_to(motion.displacement(times)[:, None], (30, 4, 3))
    )


def test_turntable_keeps_in_place_what_rests_outside():
    """A body at rest in the room goes round in the table's frame, at the radius where it was."""
    hidden = outside.Turntable(1.5)
    world, act = start(hidden, block(lower=(0.2, -0.02, 0.5), upper=(0.24, 0.02, 0.54)))
    launch(world, np.cross([0, 0, -1.5], world.positions))
    run(hidden, world, act, 1.0)
    centre = world.masses @ world.positions / world.masses.sum()
    np.testing.assert_allclose(centre[:2], 0.22 * np.array([np.cos(1.5), -np.sin(1.5)]), atol=0.002)


def test_breathing_swells_a_free_body():
    hidden = outside.Breathing(0.03, 1.0)
    world, act = start(hidden, block())
    act(0.25)
    swollen = world.mesh.vertices.mean(axis=0) + 1.03 * (world.mesh.vertices - world.mesh.vertices.mean(axis=0))
    assert np.abs(put(world, swollen)).max() < 1e-6


def test_magnet_draws_with_its_strength_at_five_centimetres():
    pole = np.array([-0.06, 0.0, 0.47])
    world, act = start(outside.Magnet(0.3, *pole), block())
    force = pushed(world, act)
    assert force[:, 2].sum() == pytest.approx(-0.3, rel=0.25)  # the core is spread over the end, 4 cm across
    assert np.abs(force[world.mesh.vertices[:, 0] > 0.05]).max() < 1e-3


def test_tether_is_slack_until_its_length():
    world, act = start(outside.Tether(2.0, 0.1, -0.06, 0.0, 0.4), block())
    distance = np.linalg.norm(world.mesh.vertices[world.mesh.vertices[:, 0] < -0.059].mean(axis=0) - [-0.06, 0, 0.4])
    assert pushed(world, act)[:, 2].sum() == pytest.approx(-2.0 * (distance - 0.1), rel=1e-6)
    slack, act = start(outside.Tether(2.0, 0.2, -0.06, 0.0, 0.4), block())
    assert not pushed(slack, act).any()


def test_together_acts_as_each_part():
    both = Together((around.LinearDrag(2.0), around.Wind(0.5, 0.0, 0.0)))
    world, act = start(both, block())
    assert run(both, world, act, 0.4)[-1, 0] == pytest.approx(0.5 / 2.0 * (1 - np.exp(-0.8)), rel=1e-3)
