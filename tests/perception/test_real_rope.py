"""The real rope clip through the real networks: 50 frames of a person lifting a rope (no depth), exact camera."""

import json
from pathlib import Path

import numpy as np
import pytest

from physreal_core.perception.flow import DisFlow, GmFlow
from physreal_core.perception.flow_tracker import FlowTracker
from physreal_core.perception.lifting import project
from physreal_core.perception.mask_geometry import signed_distance
from physreal_core.perception.mediapipe_hands import MediaPipeHands
from physreal_core.perception.onnx_tracker import inside_masks
from physreal_core.perception.overlay import draw_overlay, write_video
from physreal_core.perception.perceive import Networks, Video, perceive
from physreal_core.perception.sam2 import Sam2Segmenter
from physreal_core.perception.settings import PerceptionSettings
from pipeline.models import check_files
from tests.conftest import ROOT

pytestmark = pytest.mark.slow
MODELS = ROOT / "data" / "models"


@pytest.fixture(scope="module")
def networks() -> Networks:
    for name in ("sam2", "hands"):
        if any(check_files(name, MODELS).values()):
            pytest.skip(f"the {name} networks are not in {MODELS} (run `physreal models`)")
    segmenter = Sam2Segmenter(MODELS / "sam2_encoder.ort", MODELS / "sam2_decoder.onnx")
    hands = MediaPipeHands(MODELS / "palm.onnx", MODELS / "hand_landmark.onnx")
    return Networks(segmenter, FlowTracker(DisFlow()), None, hands)


@pytest.fixture(scope="module")
def clip(real_data) -> Video:
    """The clip at half size, and its camera."""
    import cv2

    folder = real_data / "phystwin_single_lift_rope"
    camera = json.loads((folder / "camera.json").read_text())
    images = [cv2.imread(str(folder / "color" / "0" / f"{i}.jpg"))[..., ::-1] for i in range(50)]
    frames = [np.ascontiguousarray(cv2.resize(i, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)) for i in images]
    K = np.array(camera["K"])
    K[:2, 2] += 0.5
    K[:2] *= 0.5
    K[:2, 2] -= 0.5
    return Video(frames, None, K, np.array(camera["T_world_camera"]), camera["description"])


def _projected(folder: Path, name: str, video: Video) -> np.ndarray:
    """Centres [T, 2] px that the benchmark's own 3D reconstruction (three cameras) gives."""
    table = np.genfromtxt(folder / name, delimiter=",", names=True)
    points = np.stack([table["x_m"], table["y_m"], table["z_m"]], -1)
    return project(points[None], video.K, video.T_world_camera)[0]


def test_hands_are_found_in_every_tenth_frame_and_nothing_else(networks, clip):
    for t in range(0, 50, 10):
        hands = networks.hand_finder.find(clip.frames[t])
        assert len(hands) == 1 and hands[0].presence > 0.99


def test_rope_and_hand_have_a_mask_in_every_frame_and_tracks_stay_on_the_rope(networks, clip, real_data, tmp_path):
    parsed = perceive(clip, networks, PerceptionSettings(keyframe_stride=7))
    assert parsed.report["chosen_by"]["object"] == "what the hand touches"
    folder = real_data / "phystwin_single_lift_rope"
    rope, hand = (_projected(folder, n, clip) for n in ("visible_rope_centre.csv", "hand_centre.csv"))
    for t in range(50):
        on_rope = signed_distance(parsed.object_masks[t])
        on_hand = signed_distance(parsed.controller_masks[t])
        v, u = np.rint(rope[t]).astype(int)[::-1]
        # A bent rope's centre of gravity lies beside it: within 6 px (the rope is 10 px thick) and near the mask's own.
        assert on_rope[v, u] > -6
        # The mask reaches up to the fingers, where the other cameras' points end earlier.
        assert np.linalg.norm(np.argwhere(parsed.object_masks[t])[:, ::-1].mean(0) - rope[t]) < 20
        v, u = np.rint(hand[t]).astype(int)[::-1]
        assert on_hand[v, u] > -3
        assert 900 < parsed.object_masks[t].sum() < 1500 and 500 < parsed.controller_masks[t].sum() < 8000
    inside = inside_masks(parsed.tracks.points, np.stack([signed_distance(m) > -2 for m in parsed.object_masks]))
    assert inside[parsed.tracks.visible].all()
    assert parsed.tracks.visible[-1].mean() > 0.5
    assert np.isnan(parsed.lifted.points).all() and parsed.controllers is None  # without depth nothing is invented
    pictures = draw_overlay(clip.frames, parsed.object_masks, parsed.controller_masks, parsed.tracks)
    write_video(tmp_path / "overlay.mp4", pictures, 30.0)
    assert (tmp_path / "overlay.mp4").stat().st_size > 50_000


def test_gmflow_measures_a_large_shift(clip):
    """The picture moved by 40 px, found to half a pixel; GMFlow alone is off by about one."""
    if any(check_files("gmflow", MODELS).values()):
        pytest.skip(f"GMFlow is not in {MODELS} (run `physreal models gmflow`)")
    first = clip.frames[0]
    found = GmFlow(MODELS / "gmflow_256x384.onnx", refine=DisFlow())(first, np.roll(first, 40, axis=1))
    assert np.median(np.linalg.norm(found[90:150, 100:330] - [40, 0], axis=-1)) < 0.5
