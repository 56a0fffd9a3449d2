"""`physreal plan`: from a goal's file to a folder that is a capture, and what it refuses."""

import json

import numpy as np
import pytest

from applications.plan.goals import read_goal
from physreal_core.errors import InputError
from physreal_core.geometry.mesh import Mesh, save_mesh
from physreal_core.planning import Silhouette, TargetShape
from pipeline.check import examine
from pipeline.cli import main
from pipeline.products.controllers import Controllers
from pipeline.products.given_tracks import GivenTracks3d

WAY = np.array([0.01, 0.02, 0.04])
SHORT = ("--seconds", "0.7", "--models", "2", "--rounds", "2")


@pytest.fixture
def goal(twin, tmp_path):
    """The body's corners by `WAY` from where they are."""
    points = twin.mesh.vertices[:8]
    path = tmp_path / "points.json"
    path.write_text(json.dumps({"points": points.tolist(), "places": (points + WAY).tolist()}))
    return path


def run(project, monkeypatch, *arguments: str) -> int:
    monkeypatch.chdir(project.root)
    with pytest.raises(SystemExit) as ended:
        main(["plan", "lift", *arguments])
    return ended.value.code


def test_a_plan_brings_the_body_nearer_and_is_a_capture(project, twin, goal, monkeypatch, tmp_path, capsys):
    folder = tmp_path / "planned"
    assert run(project, monkeypatch, "--goal", str(goal), "--to", str(folder), "--record", *SHORT) == 0
    record, printed = json.loads((folder / "plan.json").read_text()), capsys.readouterr().out
    assert record["distance_before"] == pytest.approx(np.linalg.norm(WAY), rel=1e-3)
    assert max(record["distance"]) < 0.5 * record["distance_before"] and len(record["distance"]) == 2
    assert f"{1e3 * record['distance'][0]:.1f}" in printed and str(folder) in printed
    hand, tracks = Controllers.load(folder).points, GivenTracks3d.load(folder).points3d
    assert len(hand) == len(tracks) == 22
    assert np.allclose(hand[0], twin.problem.controllers[0], atol=1e-6)
    assert np.allclose(hand - hand[:1], np.array(record["hand"])[:, [0]], atol=1e-6)
    reached = np.linalg.norm(tracks[-5:, -8:].mean(0) - twin.mesh.vertices[:8] - WAY, axis=1)
    assert reached.max() == pytest.approx(record["farthest_point"], abs=1e-5)
    with np.load(folder / "states.npz") as states:
        assert states["x"].shape == (22, len(twin.problem.body.x0), 3)
        assert np.allclose(states["x"][0], twin.problem.body.x0, atol=1e-6)
    assert (folder / "plan.mp4").stat().st_size > 1000
    _, found = examine(folder)
    assert not found.faults


def test_bounds_hold(project, twin, goal, monkeypatch, tmp_path):
    centre = twin.problem.controllers[0].double().numpy().mean(0)
    box = [*(centre - 0.02), *(centre + 0.02)]
    folder = tmp_path / "planned"
    arguments = ["--bounds", *map(str, box), "--speed", "0.1", "--to", str(folder), *SHORT]
    assert run(project, monkeypatch, "--goal", str(goal), *arguments) == 0
    moved = np.array(json.loads((folder / "plan.json").read_text())["hand"])
    assert np.abs(moved).max() <= 0.02 + 1e-9
    assert np.linalg.norm(np.diff(moved, axis=0), axis=-1).max() * 30.0 <= 0.1 + 1e-9


def test_two_hands_of_ones_own(project, twin, goal, monkeypatch, tmp_path):
    x0, folder = twin.problem.body.x0, tmp_path / "planned"
    places = [word for at in (x0[0], x0[-1]) for word in ("--grasp", *map(str, at))]
    assert run(project, monkeypatch, "--goal", str(goal), "--open", *places, "--to", str(folder), *SHORT) == 0
    record = json.loads((folder / "plan.json").read_text())
    assert np.array(record["hand"]).shape == (22, 2, 3)
    assert record["distance"][0] < 0.5 * record["distance_before"]


def test_a_shape_and_a_mask_are_goals(twin, tmp_path):
    from PIL import Image

    moved = Mesh(twin.mesh.vertices + WAY, twin.mesh.faces)
    save_mesh(tmp_path / "shape.glb", moved)
    shape, points0 = read_goal(tmp_path / "shape.glb", twin)
    assert isinstance(shape, TargetShape) and np.allclose(
        shape.shift(points0), WAY, atol=0.006
    )  # two scatters of 150 points
    camera = twin.camera
    mask = np.zeros((camera.height, camera.width), np.uint8)
    mask[5:15, 5:15] = 255
    Image.fromarray(mask).save(tmp_path / "mask.png")
    silhouette, _ = read_goal(tmp_path / "mask.png", twin)
    assert isinstance(silhouette, Silhouette) and np.array_equal(silhouette.mask, mask > 0)


@pytest.mark.parametrize(
    ("record", "told"),
    [
        ({"points": [[0.0, 0.0, 0.0]]}, "places"),
        ({"points": [[0.0, 0.0, 0.0]], "places": [[0.0, 0.0]]}, "finite"),
        ({"points": [[0.0, 0.0, 0.0]], "places": [[0.0, 0.0, 0.0]] * 2}, "1 points and 2 places"),
        ({"points": [[1.0, 0.0, 0.0]], "places": [[0.0, 0.0, 0.0]]}, "from the object"),
    ],
)
def test_what_is_no_goal_is_refused(twin, tmp_path, record, told):
    path = tmp_path / "points.json"
    path.write_text(json.dumps(record))
    with pytest.raises(InputError, match=told):
        read_goal(path, twin)


def test_the_command_says_what_does_not_fit(project, goal, monkeypatch, tmp_path, capsys):
    tried = {
        "nowhere.json": ("--goal", "nowhere.json"),
        "that ends in": ("--goal", str(goal.with_suffix(".txt"))),
        "widen the box": ("--goal", str(goal), "--bounds", "1", "1", "1", "2", "2", "2"),
        "there already": ("--goal", str(goal), "--to", str(tmp_path)),
        "no grasp": ("--goal", str(goal), "--open"),
        "--seconds": ("--goal", str(goal), "--seconds", "0.2"),
        "--models": ("--goal", str(goal), "--models", "0"),
        "quantile from 0 to 1": ("--goal", str(goal), "--quantile", "2"),
    }
    for words, arguments in tried.items():
        assert run(project, monkeypatch, *arguments) == 2
        assert words in capsys.readouterr().err
    assert not (project.root / "data" / "planned").exists()
