"""Flow and tracks on images whose motion is known."""

import numpy as np

from physreal_core.perception.flow import DisFlow, pixel_grid, round_trip_error, sample, warp_back
from physreal_core.perception.flow_tracker import FlowTracker
from physreal_core.perception.onnx_tracker import inside_masks
from tests.perception.scene import HEIGHT, WIDTH, _texture, film


def _bend(t: float) -> np.ndarray:
    """A smooth non-rigid map of the image: where pixel p of frame 0 lies at time t [H, W, 2]."""
    grid = pixel_grid(HEIGHT, WIDTH).astype(np.float64)
    u, v = grid[..., 0], grid[..., 1]
    return grid + t * np.stack([1.2 + 0.5 * np.sin(v / 20), -0.8 + 0.4 * np.cos(u / 25)], -1)


def _bent_film(count: int) -> list[np.ndarray]:
    """Frames of a texture under `_bend`; the inverse map by fixed-point iteration."""
    frames = []
    for t in range(count):
        source = pixel_grid(HEIGHT, WIDTH).astype(np.float64)
        for _ in range(30):
            source = source - (_shift(source, t) + source - pixel_grid(HEIGHT, WIDTH))
        frames.append(
            np.clip(255 * _texture(source[..., 0], source[..., 1], 1.0, (0.5, 0.5, 0.5)), 0, 255).astype(np.uint8)
        )
    return frames


def _shift(points: np.ndarray, t: float) -> np.ndarray:
    u, v = points[..., 0], points[..., 1]
    return t * np.stack([1.2 + 0.5 * np.sin(v / 20), -0.8 + 0.4 * np.cos(u / 25)], -1)


def test_dense_flow_of_a_known_warp_is_right_to_a_tenth_of_a_pixel():
    frames = _bent_film(3)
    error = np.linalg.norm(DisFlow()(frames[0], frames[2]) - (_bend(2) - pixel_grid(HEIGHT, WIDTH)), axis=-1)
    inner = error[10:-10, 10:-10]
    assert np.median(inner) < 0.1 and np.quantile(inner, 0.95) < 0.3


def test_tracks_of_a_known_warp_do_not_drift():
    frames = _bent_film(12)
    queries = (pixel_grid(6, 8).reshape(-1, 2) * 11 + 22).astype(np.float32)
    tracks = FlowTracker().track(frames, queries)
    truth = np.stack([queries + _shift(queries, t) for t in range(12)])
    error = np.linalg.norm(tracks.points - truth, axis=-1)
    assert tracks.visible.mean() > 0.95
    # Twelve steps: errors against frame 0 and not their sum. The texture's own noise is its 8 bits.
    assert np.median(error[-1]) < 0.1 and np.quantile(error[tracks.visible], 0.95) < 0.4


def test_anchoring_removes_drift():
    frames = _bent_film(12)
    noisy = [
        np.clip(f + np.random.default_rng(i).normal(0, 8, f.shape), 0, 255).astype(np.uint8)
        for i, f in enumerate(frames)
    ]
    queries = (pixel_grid(6, 8).reshape(-1, 2) * 11 + 22).astype(np.float32)
    truth = queries + _shift(queries, 11)
    chained, anchored = (
        np.median(np.linalg.norm(FlowTracker(anchored=a).track(noisy, queries).points[-1] - truth, axis=1))
        for a in (False, True)
    )
    assert anchored < 0.6 * chained


def test_occluded_points_are_marked_and_found_again():
    scene = film(7, step=(1.0, 0.0), occluder=True)
    queries = np.array([[u, v] for u in range(46, 74, 3) for v in range(33, 58, 3)], np.float32)
    queries = queries[scene.objects[0][queries[:, 1].astype(int), queries[:, 0].astype(int)]]
    tracks = FlowTracker().track(scene.frames, queries)
    hidden = np.abs(queries[:, 0] - 52) <= 4  # well under the bar, which moves with the disc
    free = np.abs(queries[:, 0] - 52) >= 12
    middle = slice(1, 6)
    assert tracks.visible[middle][:, hidden].mean() < 0.1
    assert tracks.visible[:, free].mean() > 0.95
    assert tracks.visible[-1, hidden].mean() > 0.7  # the bar is gone in the last frame
    truth = queries + scene.motion[-1]
    seen = tracks.visible[-1]
    assert np.quantile(np.linalg.norm(tracks.points[-1] - truth, axis=1)[seen], 0.9) < 0.3


def test_given_occluders_hide_points():
    scene = film(4)
    queries = np.array([[60.0, 45], [50, 45]], np.float32)
    occluders = np.zeros(scene.objects.shape, bool)
    occluders[2, :, 55:75] = True
    tracks = FlowTracker().track(scene.frames, queries, occluders)
    assert tracks.visible[:, 0].tolist()[:3] == [True, True, False] and tracks.visible[2, 1]


def test_no_queries_give_no_tracks():
    tracks = FlowTracker().track(film(3).frames, np.zeros((0, 2), np.float32))
    assert tracks.points.shape == (3, 0, 2) and tracks.visible.shape == (3, 0)


def test_warping_back_by_the_true_flow_gives_the_first_image():
    frames = _bent_film(2)
    flow = (_bend(1) - pixel_grid(HEIGHT, WIDTH)).astype(np.float32)
    back = warp_back(frames[1], flow).astype(float)
    # Bilinear interpolation of a texture with wavelengths from 7 px on.
    assert np.abs(back - frames[0])[6:-6, 6:-6].mean() < 3
    assert round_trip_error(flow, -flow).mean() < 0.1


def test_sampling_is_bilinear_and_membership_is_by_nearest_pixel():
    image = np.arange(12, dtype=np.float32).reshape(3, 4)
    assert np.allclose(sample(image, np.array([[1.5, 0.5], [0.0, 2.0]], np.float32)), [3.5, 8.0], atol=0.02)
    masks = image[None] > 5
    inside = inside_masks(np.array([[[1.6, 1.4], [1.4, 1.0], [9.0, 1.0], [np.nan, 0.0]]], np.float32), masks)
    assert inside.tolist() == [[True, False, False, False]]
