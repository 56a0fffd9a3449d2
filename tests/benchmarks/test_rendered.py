"""True tracks of a rendered sequence, and the flow tracker on them: a few small frames of an animal that is lifted."""

from dataclasses import replace

import numpy as np
import pytest

for package in ("cv2", "mujoco", "trimesh"):
    pytest.importorskip(package)

from benchmarks import rendered
from benchmarks.perception_scoring import alive, track_errors
from data.rig import sequences
from data.rig.capture import film
from data.rig.rig_scene import Motion
from data.rig.simulate import simulate
from physreal_core.perception.flow_tracker import FlowTracker
from physreal_core.perception.queries import spread_over
from physreal_core.perception.settings import DEFAULTS


@pytest.fixture(scope="module")
def judged(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sequences")
    scene = sequences.plush_lifted(0)
    view = replace(scene.view, width=160, height=120, focal=scene.view.focal / 2)
    motion = Motion(((0.0, 0.2, (-0.005, 0.0, 0.02)),))
    scene = replace(scene, frames=5, observed=3, view=view, motion=motion, mesh_spacing=0.018, hand_spacing=0.008)
    film(scene, simulate(scene, timestep=0.004, settle=0.05), folder / "plush_lifted_0", hint=None)
    return rendered.load_rendered("plush_lifted_0", folder)


def test_a_user_would_have_pictures_alone(judged):
    assert len(judged.video.frames) == 5 and judged.video.depth is None and not judged.video.hints
    assert judged.object_masks.shape == judged.hand_masks.shape == (5, 120, 160)
    assert judged.object_masks.any((1, 2)).all() and not (judged.object_masks & judged.hand_masks).any()


def test_true_points_start_at_their_pixels_and_stay_on_the_true_mask(judged):
    queries = spread_over(judged.object_masks[0], 100, DEFAULTS.queries)
    true = rendered.true_points(judged, queries)
    assert true.known.mean() > 0.97
    np.testing.assert_allclose(true.points[0, true.known], queries[true.known], atol=0.01)
    for mask, points, visible in zip(judged.object_masks, true.points, true.visible, strict=True):
        u, v = np.rint(points[visible]).astype(int).T
        assert mask[v, u].mean() > 0.97
    off = rendered.true_points(judged, np.array([[3.0, 100.0]], np.float32))
    assert not off.known.any() and not off.visible.any()


def test_the_flow_tracker_follows_the_truth(judged):
    queries = spread_over(judged.object_masks[0], 100, DEFAULTS.queries)
    true, tracks = rendered.true_points(judged, queries), FlowTracker().track(judged.video.frames, queries)
    errors = track_errors(tracks.points, true.points, tracks.visible & true.known, true.visible)
    assert np.linalg.norm(true.points[-1] - true.points[0], axis=1).max() > 3  # px: there is something to follow
    assert errors.mean() < 0.5
    assert alive(true.visible[-1], tracks.visible[-1]) > 0.85
