"""`physreal generate`: episodes that move the body, pictures that agree with it, and files that the formats' own readers take."""

import dataclasses
import json

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from applications.coarse import coarser
from applications.generate import lerobot, robomimic
from applications.generate.arm import CLOSED, JOINTS, NAMES, OPEN, TOLERANCE, Arm, OutOfReach, Poses
from applications.generate.command import _resume
from applications.generate.draws import Draws, Randomisation
from applications.generate.episode import Keypoints, at_rest, simulated
from applications.generate.grasps import Grasp, Hand, candidates, ranked, tried
from applications.generate.maker import Maker, Setup
from applications.generate.pictures import HAND, OBJECT, Studio
from applications.generate.scenery import Light, Scenery
from applications.generate.statistics import of_numbers, together
from applications.generate.way import FIST, SPEED, HandWay, drawn_push, drawn_way
from physreal_core.errors import InputError
from pipeline.cli import main
from pipeline.models import require
from pipeline.project import CODE_ROOT

FPS, FRAMES = 30.0, 78


@pytest.fixture(scope="module")
def twin(project):
    from applications.twin import Twin

    return Twin.load(project, "lift")


@pytest.fixture(scope="module")
def session(twin):
    return twin.session()


@pytest.fixture(scope="module")
def made(twin, session):
    """A plain episode: its draw, motion and pictures."""
    studio = Studio(twin, session.floor)
    at_rest(session, twin.model.fields)
    place = candidates(twin, twin.surface(session.state), 1, 0)[0]
    draws = Draws(place[None], None, studio.camera, Randomisation.none(), FRAMES, session.fps, session.floor, seed=3)
    draw = draws.draw(0)
    motion = simulated(session, Keypoints(twin), place, draw.way)
    return draw, motion, studio.pictures(motion, draw)


@pytest.fixture(scope="module")
def arm_files():
    """Of the arm, in data/models of this checkout; skips the test where they are not."""
    pytest.importorskip("mujoco")
    pytest.importorskip("mink")
    try:
        return require("viperx", CODE_ROOT / "data" / "models")
    except InputError:
        pytest.skip("the arm is not fetched: physreal models viperx")


TAKEN = np.array([[0.0, 0.02, 0.06], [0.05, -0.02, 0.08]])


@pytest.fixture(scope="module")
def arm(arm_files):
    return Arm.beside(arm_files, TAKEN, 0.0, eye=np.array([0.1, -0.7, 0.4]))


def run(project, monkeypatch, *arguments: str) -> int:
    monkeypatch.chdir(project.root)
    with pytest.raises(SystemExit) as ended:
        main(["generate", "lift", *arguments])
    return ended.value.code


@pytest.mark.parametrize("seed", range(8))
def test_a_way_comes_from_above_and_is_slow_and_stays_over_the_table(seed):
    taken = np.array([0.1, -0.2, 0.05])
    way = drawn_way(np.random.default_rng(seed), taken, 0.03, FRAMES, FPS)
    assert way.frames == FRAMES and way.places[0, 2] > taken[2]
    coming = way.places[: np.flatnonzero(way.closed)[0] + 1]
    assert np.linalg.norm(np.diff(coming, axis=0), axis=1).max() * FPS <= SPEED + 1e-9
    last = coming[-1] - coming[-3]  # straight down at the end
    assert np.linalg.norm(last[:2]) < 0.2 * -last[2]
    held = way.places[way.closed]
    assert np.allclose(held[0], taken)
    assert np.linalg.norm(np.diff(held, axis=0), axis=1).max() * FPS <= SPEED + 1e-9
    assert way.places[:, 2].min() >= 0.03 and held[:, 2].max() > taken[2] + 0.02
    assert not way.closed[0] and not way.closed[-1]
    edges = np.diff(way.closed.astype(int))
    assert (edges == 1).sum() == 1 and (edges == -1).sum() == 1


def test_the_body_follows_the_hand_and_falls_when_it_is_let_go(made):
    _, motion, _ = made
    held = motion.way.closed
    assert np.abs(motion.force[~held]).max() == 0.0 and np.linalg.norm(motion.force[held], axis=1).max() > 0.0
    moved = np.linalg.norm(motion.keypoints - motion.keypoints[0], axis=-1).mean(1)
    first = int(np.flatnonzero(held)[0])
    assert moved[:first].max() < 2e-3
    assert moved[held].max() > 0.02
    assert not torch.equal(motion.x[0], motion.x[-1])
    assert np.allclose(motion.actions[:-1], motion.states[1:])


@pytest.mark.parametrize("seed", range(8))
def test_a_push_begins_beside_the_body_and_goes_through_it_low_over_the_table(twin, seed):
    body = twin.problem.body.x0
    way = drawn_push(np.random.default_rng(seed), body, 0.01, FRAMES, FPS)
    assert way.pushes and way.closed.all() and way.frames == FRAMES
    apart = np.linalg.norm(way.places[:, None] - body[None], axis=-1).min(1)
    coming = round(0.4 * FPS)
    assert apart[: coming + 1].min() > FIST  # it comes down without touching
    assert apart.min() < FIST + 0.01  # and meets what lies there
    assert way.places[:, 2].min() >= 0.01 + FIST - 1e-9
    assert (
        np.linalg.norm(np.diff(way.places, axis=0), axis=1).max() * FPS < SPEED + 0.35
    )  # down and up it is as fast as a hand that takes


def test_a_closed_hand_pushes_the_body_over_the_table(twin):
    session = twin.session(ball=FIST)
    at_rest(session, twin.model.fields)
    body = session.state.x.double().numpy().copy()
    way = drawn_push(np.random.default_rng(1), body, session.floor + 0.01, FRAMES, session.fps)
    motion = simulated(session, Keypoints(twin), np.zeros(3), way)
    ahead = way.places[40] - way.places[15]
    gone = motion.x[-1].double().numpy().mean(0) - body.mean(0)
    assert motion.moved == pytest.approx(np.linalg.norm(gone[:2]), abs=5e-3) and motion.moved > 0.02
    assert gone @ ahead > 0.5 * np.linalg.norm(gone) * np.linalg.norm(ahead)
    touched = np.linalg.norm(motion.force, axis=1) > 0.0
    assert touched.any() and not touched[:10].any() and not motion.lifted.any()
    assert (motion.force[touched] @ ahead > 0.0).mean() > 0.8  # the hand on the body, the way it goes


def test_flow_carries_pixels_of_the_body_to_where_its_points_go(made):
    draw, motion, pictures = made
    frame = int(np.argmax(np.linalg.norm(np.diff(motion.way.places, axis=0), axis=1) * motion.way.closed[:-1]))
    assert (pictures.mask[frame] == OBJECT).sum() > 50
    pixels, far = draw.camera.project(torch.as_tensor(motion.keypoints[frame : frame + 2]))
    now, then = pixels.numpy()
    column, row = now.round().astype(int).T
    inside = (column >= 0) & (column < draw.camera.width) & (row >= 0) & (row < draw.camera.height)
    near = far[0].numpy() - 0.01  # those on the far side are not what is seen there
    on_body = [
        k
        for k in np.flatnonzero(inside)
        if pictures.mask[frame, row[k], column[k]] == OBJECT and pictures.depth[frame, row[k], column[k]] > near[k]
    ]
    told = np.array([pictures.flow[frame, row[k], column[k]] for k in on_body], float)
    assert len(on_body) >= 4
    true = (then - now)[on_body]
    size = np.linalg.norm(true, axis=1).mean()
    assert (
        size > 1.5 and np.median(np.linalg.norm(told - true, axis=1)) < 0.1 * size + 0.25
    )  # [px], of which rounding takes some
    assert np.abs(pictures.flow[-1]).max() == 0.0


def test_depth_is_that_of_the_body_and_of_the_table(made, session):
    draw, motion, pictures = made
    camera = draw.camera
    _, far = camera.project(motion.x[0].double())
    seen = pictures.depth[0][pictures.mask[0] == OBJECT]
    assert float(far.min()) - 0.01 < seen.min() and seen.max() < float(far.max()) + 0.01
    v, u = np.argwhere((pictures.mask[0] == 0) & (pictures.depth[0] > 0))[::500].T
    if len(v):
        points = camera.unproject(
            torch.as_tensor(np.stack([u, v], -1), dtype=torch.float64),
            torch.as_tensor(pictures.depth[0][v, u], dtype=torch.float64),
        )
        assert np.allclose(points[:, 2], session.floor, atol=1e-4)


def test_the_hand_is_seen_where_it_is(made):
    draw, motion, pictures = made
    seen = [frame for frame in range(FRAMES) if (pictures.mask[frame] == HAND).sum() > 20]
    assert seen
    pixels, _ = draw.camera.project(torch.as_tensor(motion.way.places + [0.0, 0.0, 0.03]))
    for frame in seen:
        row, column = np.argwhere(pictures.mask[frame] == HAND).mean(0)
        if 20 < row < draw.camera.height - 20 and 20 < column < draw.camera.width - 20:
            assert np.hypot(*(pixels[frame].numpy() - [column, row])) < 0.05 * draw.camera.intrinsics[0]


def hands(arm: Arm, poses) -> tuple[np.ndarray, np.ndarray]:
    """Where the fingers are [m], and which way the gripper points, by MuJoCo's forward kinematics."""
    import mujoco

    data, places, ways = mujoco.MjData(arm.model), [], []
    for joints in poses.joints:
        data.qpos[: len(JOINTS)] = joints
        mujoco.mj_kinematics(arm.model, data)
        places.append(data.site("fingers").xpos.copy())
        ways.append(data.site("fingers").xmat.reshape(3, 3)[:, 0].copy())
    return np.array(places), np.array(ways)


@pytest.mark.parametrize("seed", range(6))
def test_the_arms_fingers_go_along_the_hands_way_and_point_down(arm, seed):
    way = drawn_way(np.random.default_rng(seed), TAKEN[seed % 2], 0.01, FRAMES, FPS)
    poses = arm.along(way)
    places, ways = hands(arm, poses)
    assert np.linalg.norm(places - way.places, axis=1).max() < TOLERANCE
    assert np.degrees(np.arccos(-ways[:, 2].clip(-1, 1))).max() < 10.0
    lower, upper = arm.model.jnt_range[: len(JOINTS)].T
    assert (poses.joints >= lower - 1e-6).all() and (poses.joints <= upper + 1e-6).all()
    assert np.abs(np.diff(poses.joints, axis=0)).max() * FPS < 6.0  # it does not jump from one posture to another
    assert np.array_equal(poses.opening, np.where(way.closed, 0.0, 1.0))


@pytest.mark.parametrize("aside", np.deg2rad([-60.0, -40.0, -20.0, 20.0, 40.0, 60.0]))
@pytest.mark.parametrize("away", [0.35, 0.43])
def test_a_way_that_begins_aside_of_the_arm_does_not_turn_its_wrist_over(arm, aside, away):
    across = np.cross([0.0, 0.0, 1.0], arm.facing)
    place = arm.foot + away * (np.cos(aside) * arm.facing + np.sin(aside) * across) + [0.0, 0.0, 0.11]
    joints = dict(zip(JOINTS, arm.along(HandWay(place[None], np.array([True]))).joints[0], strict=True))
    assert joints["waist"] == pytest.approx(aside, abs=0.02) and joints["wrist_rotate"] == pytest.approx(
        aside, abs=0.02
    )
    assert abs(joints["forearm_roll"]) < 1e-3 and joints["wrist_angle"] > 0.0


def test_a_way_that_the_arm_cannot_follow_is_told(arm):
    places = np.linspace(TAKEN[0], TAKEN[0] + [0.0, 0.0, 1.5], FRAMES)
    with pytest.raises(OutOfReach, match=r"the fingers stay \d+ mm from frame \d+"):
        arm.along(HandWay(places, np.zeros(FRAMES, bool)))


def test_the_arm_stands_on_the_table_behind_the_body_and_is_drawn_around_its_joints(arm):
    middle = TAKEN.mean(0)
    assert arm.foot[2] == 0.0 and np.linalg.norm(arm.facing) == pytest.approx(1.0)
    assert arm.foot[1] > middle[1]  # the camera is on the other side
    way = HandWay(np.tile(TAKEN[0], (2, 1)), np.array([False, True]))
    look = arm.look(arm.along(way))
    places, normals = look.places.double().numpy(), look.normals.double().numpy()
    assert np.allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=1e-5)
    assert places[..., 2].min() > -0.01
    near = np.linalg.norm(places - TAKEN[0], axis=-1)
    assert near.min(1)[0] < 0.04 and near.min(1)[1] < 0.01  # open and closed
    # Closing moves the fingers alone, by as much as their joints.
    moved = np.linalg.norm(places[1] - places[0], axis=1)
    assert moved.max() == pytest.approx(OPEN - CLOSED, abs=1e-3) and 0.02 < (moved > 1e-3).mean() < 0.5


def test_with_an_arm_states_and_actions_are_joints_and_the_picture_has_the_arm(made, twin, session, arm_files):
    draw, plain, pictures = made
    eye = draw.camera.centre.detach().double().numpy()
    arm = Arm.beside(arm_files, plain.way.places[plain.way.closed][:1], session.floor, eye)
    motion = dataclasses.replace(plain, poses=arm.along(plain.way))
    assert motion.states.shape == (FRAMES, 7) and np.allclose(motion.actions[:-1], motion.states[1:])
    columns = lerobot.columns(motion, FPS)
    assert np.array_equal(columns["observation.hand"], plain.states)
    with_arm = Studio(twin, session.floor).pictures(motion, draw, arm)
    described = lerobot.features(motion, with_arm, FPS)
    assert described["action"]["names"] == NAMES and described["action"]["shape"] == [7]
    # The body is where it was, and more of the picture is hand.
    assert (with_arm.mask == HAND).sum() > 2 * (pictures.mask == HAND).sum()
    assert ((with_arm.mask == OBJECT) & (pictures.mask != OBJECT)).mean() < 0.002


def test_with_an_arm_both_formats_have_the_same_joints_and_hand(made, tmp_path):
    h5py, pq = pytest.importorskip("h5py"), pytest.importorskip("pyarrow.parquet")
    _, plain, pictures = made
    joints = np.random.default_rng(0).normal(size=(FRAMES, len(JOINTS)))
    motion = dataclasses.replace(plain, poses=Poses(joints, np.where(plain.way.closed, 0.0, 1.0)))
    robomimic.write_episode(tmp_path, motion, pictures, {})
    lerobot.write_episode(tmp_path, motion, pictures, FPS, 0)
    table = pq.read_table(tmp_path / lerobot.FRAMES)
    with h5py.File(tmp_path / robomimic.DEMO) as demo:
        found = {name: demo[name][:] for name in ("obs/joints", "obs/hand", "actions")}
    assert found["obs/joints"].shape == (FRAMES, len(NAMES)) and found["obs/hand"].shape == (FRAMES, 4)
    assert np.array_equal(found["obs/joints"], np.float32(np.column_stack([joints, motion.poses.opening])))
    assert np.array_equal(found["actions"], np.concatenate([found["obs/joints"][1:], found["obs/joints"][-1:]]))
    columns = {"observation.state": "obs/joints", "observation.hand": "obs/hand", "action": "actions"}
    for column, name in columns.items():
        assert np.array_equal(np.array(table[column].to_pylist(), np.float32), found[name])


def test_light_from_a_side_brightens_that_side():
    normals = torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    up, down = Light(share=0.5).on(normals)
    assert up.tolist() == [1.5, 1.5, 1.5] and down.tolist() == [0.5, 0.5, 0.5]
    assert Light().on(normals).eq(1.0).all()


def test_the_camera_goes_around_the_body_and_goes_on_looking_at_it(twin):
    camera = Studio(twin, 0.0).camera
    around = dataclasses.replace(Randomisation.none(), camera_around=60.0)
    grasps = twin.problem.body.x0.mean(0)[None]
    draws = Draws(grasps, None, camera, around, FRAMES, FPS, 0.0, seed=1)
    middle = torch.as_tensor(grasps)
    pixel, far = camera.project(middle)
    angles = []
    for number in range(12):
        moved = draws.draw(number).camera
        own, distance = moved.project(middle)
        assert torch.allclose(own, pixel) and torch.allclose(distance, far)
        angles.append(
            Rotation.from_matrix((moved.T_world_camera @ camera.T_world_camera.inverse())[:3, :3]).magnitude()
        )
    assert 0.3 < max(angles) <= np.radians(60) + 1e-9


def test_the_same_number_gives_the_same_draw_and_another_one_another(made, twin):
    camera = Studio(twin, 0.0).camera
    draws = Draws(np.zeros((3, 3)), None, camera, Randomisation(), FRAMES, FPS, 0.0, seed=1)
    one, again, other = draws.draw(4), draws.draw(4), draws.draw(5)
    assert np.array_equal(one.way.places, again.way.places) and not np.array_equal(one.way.places, other.way.places)
    assert torch.equal(one.camera.T_world_camera, again.camera.T_world_camera)
    assert np.array_equal(one.scenery.table, again.scenery.table)
    assert not np.array_equal(one.scenery.table, Scenery().table)


def test_a_grasp_is_as_firm_as_the_pull_asks(twin, session):
    at_rest(session, twin.model.fields)
    place = candidates(twin, twin.surface(session.state), 1, 0)[0]
    strong = tried(session, place, Hand(squeeze=100.0))
    assert strong.holds and strong.peak > 0.0
    assert strong.margin == pytest.approx(1.0 - strong.peak / 120.0)
    weak = Grasp(strong.place, strong.peak, 1.0, -0.1)
    assert ranked([weak, None, strong])[0] is strong
    with pytest.raises(InputError, match="no grasp holds"):
        ranked([weak])


def test_statistics_of_parts_are_those_of_the_whole():
    values = np.random.default_rng(0).normal(size=(50, 3))
    whole, pooled = of_numbers(values), together([of_numbers(values[:20]), of_numbers(values[20:])])
    for key in whole:
        np.testing.assert_allclose(whole[key], pooled[key])


def test_a_body_without_a_quick_form_is_refused(twin):
    assert coarser(twin, 1.0, "") is twin
    with pytest.raises(InputError, match="cannot be simulated with fewer particles"):
        coarser(twin, 20.0, "physreal generate")


def test_a_killed_run_goes_on_with_what_is_there_and_by_the_same_options_alone(project, session, tmp_path):
    pytest.importorskip("h5py")
    setup = Setup(
        project.root, "lift", "fit_residual", tmp_path, 2.0, 1.0, 1.0, 3, Hand(), Randomisation.none(), "cpu", 0
    )
    _resume(setup)
    maker, grasps = Maker(setup), candidates_of(session)
    first = maker.made(0, grasps, None)
    before = (tmp_path / "000000/record.json").stat().st_mtime_ns
    _resume(setup)
    assert maker.made(0, grasps, None) == first
    assert (tmp_path / "000000/record.json").stat().st_mtime_ns == before
    with pytest.raises(InputError, match="begun with other options"):
        _resume(dataclasses.replace(setup, seed=1))


def candidates_of(session) -> np.ndarray:
    """One place on the body [m]."""
    return session.state.x.double().numpy()[:1]


@pytest.mark.slow
def test_pushes_are_a_task_of_their_own(project, monkeypatch, tmp_path):
    pq = pytest.importorskip("pyarrow.parquet")
    folder = tmp_path / "data"
    asked = (
        "--episodes",
        "4",
        "--seconds",
        "3",
        "--jobs",
        "1",
        "--squeeze",
        "1000",
        "--pushes",
        "0.5",
        "--to",
        str(folder),
    )
    assert run(project, monkeypatch, *asked) == 0
    drawn = json.loads((folder / "episodes.json").read_text())
    assert 0 < sum(episode["pushes"] for episode in drawn) < 4
    tasks = pq.read_table(folder / "lerobot/meta/tasks.parquet").to_pylist()
    assert len(tasks) == json.loads((folder / "lerobot/meta/info.json").read_text())["total_tasks"] == 2
    for number, episode in enumerate(drawn):
        table = pq.read_table(folder / f"lerobot/data/chunk-000/file-{number:03d}.parquet")
        assert set(table["task_index"].to_pylist()) == {int(episode["pushes"])}


@pytest.mark.slow
def test_episodes_are_written_and_read_back(project, monkeypatch, tmp_path, capsys):
    h5py, pq = pytest.importorskip("h5py"), pytest.importorskip("pyarrow.parquet")
    folder = tmp_path / "data"
    asked = ("--episodes", "2", "--seconds", "3", "--jobs", "1", "--squeeze", "1000", "--to", str(folder))
    assert run(project, monkeypatch, *asked) == 0
    info = json.loads((folder / "lerobot/meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0" and info["total_episodes"] == 2 and info["total_frames"] == 2 * 90
    table = pq.read_table(folder / "lerobot/data/chunk-000/file-001.parquet")
    assert set(table.column_names) | {"observation.images.camera"} == set(info["features"])
    assert table["index"].to_pylist() == list(range(90, 180)) and table["episode_index"].to_pylist() == [1] * 90
    with h5py.File(folder / "robomimic.hdf5") as file:
        demo = file["data/demo_1"]
        assert file["data"].attrs["total"] == 180 and demo.attrs["num_samples"] == 90
        assert demo["obs/camera_image"].shape[0] == 90 and demo["actions"].shape == (90, 4)
        np.testing.assert_allclose(demo["actions"][:], np.array(table["action"].to_pylist()), rtol=1e-6)
        drawn = json.loads(demo.attrs["physreal"])
    assert drawn == json.loads((folder / "episodes.json").read_text())[1]
    assert not folder.with_name("data.parts").exists()
    assert run(project, monkeypatch, *asked) == 2 and "is there already" in capsys.readouterr().err


def test_without_the_arms_package_the_remedy_is_told(project, monkeypatch, capsys):
    from importlib import util

    known = util.find_spec
    monkeypatch.setattr(util, "find_spec", lambda name, *rest: None if name == "mink" else known(name, *rest))
    assert run(project, monkeypatch, "--arm", "viperx") == 2
    told = capsys.readouterr().err
    assert "mink not installed" in told and "physreal[robot]" in told


@pytest.mark.parametrize(
    ("option", "value"),
    [("--episodes", "0"), ("--seconds", "0.5"), ("--coarser", "0.5"), ("--scale", "0"), ("--pushes", "1.5")],
)
def test_what_cannot_be_is_refused(project, monkeypatch, capsys, option, value):
    assert run(project, monkeypatch, option, value) == 2
    assert option in capsys.readouterr().err
