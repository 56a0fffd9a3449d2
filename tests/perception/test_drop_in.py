"""A user's own networks by path: tiny ONNX files made here go through the same code as EntityV2 or CoTracker3 would."""

import numpy as np
import pytest

from physreal_core.errors import InputError
from physreal_core.perception.flow import GmFlow
from physreal_core.perception.flow_tracker import FlowTracker
from physreal_core.perception.onnx_candidates import GivenCandidates, OnnxCandidates
from physreal_core.perception.onnx_tracker import OnnxTracker
from physreal_core.perception.perceive import Networks, Video, perceive
from physreal_core.perception.session import open_session
from physreal_core.perception.settings import PerceptionSettings
from tests.perception.scene import HEIGHT, T_WORLD_CAMERA, WIDTH, K, film

onnx = pytest.importorskip("onnx", reason="the tiny networks are made with the package onnx")
helper, numpy_helper, FLOAT, BOOL = onnx.helper, onnx.numpy_helper, onnx.TensorProto.FLOAT, onnx.TensorProto.BOOL


def _save(path, nodes, inputs, outputs, constants):
    graph = helper.make_graph(
        nodes,
        "tiny",
        [helper.make_tensor_value_info(n, FLOAT, s) for n, s in inputs],
        [helper.make_tensor_value_info(n, FLOAT, s) for n, s in outputs],
        [
            numpy_helper.from_array(np.asarray(v, np.float32 if np.asarray(v).dtype.kind == "f" else np.int64), n)
            for n, v in constants.items()
        ],
    )
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8), str(path))
    return path


def colour_segmenter(path):
    """An "entity segmenter": more blue than red is the one mask, much more red than blue the other; a fixed score each."""
    weights = np.array([[-1, 0, 1], [1, 0, -1]], np.float32).reshape(2, 3, 1, 1) * 40
    nodes = [
        helper.make_node("Conv", ["image", "weights", "bias"], ["logits"]),
        helper.make_node("Sigmoid", ["logits"], ["masks"]),
        helper.make_node("Identity", ["constant_scores"], ["scores"]),
    ]
    constants = {
        "weights": weights,
        "bias": np.array([-6, -8], np.float32),
        "constant_scores": np.array([[0.9, 0.8]], np.float32),
    }
    return _save(path, nodes, [("image", [1, 3, None, None])], [("masks", None), ("scores", [1, 2])], constants)


def steady_tracker(path, step, frames, limit=70.0):
    """A "CoTracker": every query moves by `step` px a frame; visibility is its first coordinate below `limit` px."""
    moves = (np.arange(frames, dtype=np.float32)[:, None] * np.array(step, np.float32)).reshape(1, frames, 1, 2)
    nodes = [
        helper.make_node("Slice", ["queries", "one", "three", "two"], ["uv"]),
        helper.make_node("Unsqueeze", ["uv", "one"], ["uv4"]),
        helper.make_node("Add", ["uv4", "moves"], ["tracks"]),
        helper.make_node("Slice", ["tracks", "zero", "one", "last"], ["u"]),
        helper.make_node("Squeeze", ["u", "last"], ["u3"]),
        helper.make_node("Sub", ["limit", "u3"], ["margin"]),
        helper.make_node("Sigmoid", ["margin"], ["visibility"]),
        helper.make_node("ReduceMean", ["video"], ["unused"], keepdims=0),
    ]
    constants = {
        "moves": moves,
        "zero": [0],
        "one": [1],
        "two": [2],
        "three": [3],
        "last": [3],
        "limit": np.array(limit),
    }
    inputs = [("video", [1, None, 3, None, None]), ("queries", [1, None, 3])]
    return _save(path, nodes, inputs, [("tracks", None), ("visibility", None)], constants)


def test_an_own_segmenter_is_run(tmp_path):
    scene = film(1)
    found = OnnxCandidates(colour_segmenter(tmp_path / "entity.onnx")).candidates(scene.frames[0])
    assert len(found) == 2 and found.scores.tolist() == pytest.approx([0.9, 0.8])
    assert (found.masks[0] & scene.objects[0]).sum() > 0.95 * scene.objects[0].sum()
    assert len(OnnxCandidates(tmp_path / "entity.onnx", min_score=0.85).candidates(scene.frames[0])) == 1


def test_an_own_tracker_is_run_and_its_visibility_is_kept(tmp_path):
    tracker = OnnxTracker(steady_tracker(tmp_path / "cotracker.onnx", (2.0, 0.5), 4))
    tracks = tracker.track(film(4).frames, np.array([[60.0, 40], [68, 30]], np.float32))
    assert np.allclose(tracks.points[:, 0], [[60, 40], [62, 40.5], [64, 41], [66, 41.5]])
    assert tracks.visible.T.tolist() == [[True] * 4, [True, False, False, False]]


def test_the_whole_parsing_runs_with_own_networks(tmp_path):
    scene = film(5)
    networks = Networks(
        OnnxCandidates(colour_segmenter(tmp_path / "entity.onnx")),
        FlowTracker(),
        OnnxTracker(steady_tracker(tmp_path / "cotracker.onnx", (1.7, 0.6), 5, 200.0)),
    )
    hints = {"object": {"colour": "teal"}, "controller": {"box": [80, 23, 104, 55]}}
    video = Video(scene.frames, scene.depth.astype(np.float32), K, T_WORLD_CAMERA, hints=hints)
    parsed = perceive(video, networks, PerceptionSettings(keyframe_stride=2, track_count=60, hand_track_count=60))
    union = (parsed.object_masks | scene.objects).sum()
    assert (parsed.object_masks & scene.objects).sum() > 0.9 * union
    assert np.allclose(parsed.tracks.points - parsed.tracks.points[0], scene.motion[:, None], atol=1e-3)
    assert parsed.lifted.valid.sum() > 100
    moved = parsed.controllers.points - parsed.controllers.points[0]
    truth = scene.motion * 0.52 / 140 * np.array([1, -1])  # metres, at the hand's depth; v points down
    assert np.abs(moved[..., :2] - truth[:, None]).max() < 0.001


def test_a_flow_network_is_scaled_to_the_frames(tmp_path):
    """Constant flow (2, -1) px at 48 x 64 is (4, -2) px on a frame twice as large."""
    flow = np.tile(np.array([2, -1], np.float32).reshape(1, 2, 1, 1), (1, 1, 48, 64))
    nodes = [
        helper.make_node("ReduceMean", ["img0"], ["m0"], keepdims=0),
        helper.make_node("ReduceMean", ["img1"], ["m1"], keepdims=0),
        helper.make_node("Sub", ["m0", "m0"], ["nothing"]),
        helper.make_node("Add", ["constant", "nothing"], ["flow"]),
    ]
    inputs = [("img0", [1, 3, 48, 64]), ("img1", [1, 3, 48, 64])]
    network = _save(tmp_path / "flow.onnx", nodes, inputs, [("flow", None)], {"constant": flow})
    found = GmFlow(network)(*film(2).frames)
    assert found.shape == (HEIGHT, WIDTH, 2) and np.allclose(found, [4, -2])


def test_candidates_made_elsewhere_are_found_by_their_frame():
    scene = film(3)
    given = GivenCandidates(scene.frames, [np.stack([o, h]) for o, h in zip(scene.objects, scene.hands, strict=True)])
    assert np.array_equal(given.candidates(scene.frames[2]).masks[0], scene.objects[2])
    assert len(given.candidates(np.zeros((HEIGHT, WIDTH, 3), np.uint8))) == 0


def test_a_missing_or_unreadable_network_is_named_with_the_command(tmp_path):
    with pytest.raises(InputError, match="physreal models"):
        open_session(tmp_path / "none.onnx")
    (tmp_path / "broken.onnx").write_bytes(b"not a network")
    with pytest.raises(InputError, match=r"broken\.onnx.*physreal models"):
        open_session(tmp_path / "broken.onnx")


def test_a_network_with_another_interface_is_refused(tmp_path):
    path = colour_segmenter(tmp_path / "entity.onnx")
    with pytest.raises(InputError, match="at least 2 inputs"):
        OnnxTracker(path)
