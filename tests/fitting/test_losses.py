"""Each term against its formula, its unit, and what it must not see."""

import math

import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.fitting import losses
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.problem import Problem, TrackObservations, reduce_masks
from physreal_core.rendering import Binding, carry_gaussians, carry_points, rasterise
from tests.fitting import scene


def tracks(points3d, valid, sigma=0.0, points2d=None):
    count = points3d.shape[1]
    binding = Binding(torch.zeros(count, 1, dtype=torch.int64), torch.ones(count, 1))
    sigmas = torch.full(valid.shape, sigma)
    return TrackObservations(torch.zeros(count, 3), binding, points3d, valid, sigmas, points2d, valid)


def test_an_error_of_ten_scales_costs_about_ten():
    shifted = torch.zeros(4, 3, 3, dtype=torch.float64)
    shifted[..., 0] = 0.05
    observed = tracks(torch.zeros(4, 3, 3), torch.ones(4, 3, dtype=torch.bool))
    value = losses.track_loss_3d(shifted, observed, LossConfig(track_scale=0.005))
    assert value.item() == pytest.approx(math.sqrt(1 + 100) - 1, rel=1e-6)
    huber = losses.track_loss_3d(shifted, observed, LossConfig(track_scale=0.005, penalty="huber"))
    assert huber.item() == pytest.approx(9.5, rel=1e-6)


def test_a_noisy_point_counts_less():
    shifted = torch.full((1, 1, 3), 0.01, dtype=torch.float64)
    seen = torch.ones(1, 1, dtype=torch.bool)
    sharp, blurred = (
        losses.track_loss_3d(shifted, tracks(torch.zeros(1, 1, 3), seen, s), LossConfig()) for s in (0.0, 0.02)
    )
    assert blurred < 0.2 * sharp


def test_what_was_not_measured_neither_counts_nor_poisons_the_gradient():
    measured = torch.full((2, 2, 3), float("nan"))
    measured[0, 0] = 0.0
    valid = torch.tensor([[True, False], [False, False]])
    moved = torch.full((2, 2, 3), 0.01, dtype=torch.float64, requires_grad=True)
    value = losses.track_loss_3d(moved, tracks(measured, valid), LossConfig())
    value.backward()
    assert moved.grad[0, 0].abs().sum() > 0
    assert torch.equal(moved.grad[0, 1], torch.zeros(3)) and torch.equal(moved.grad[1], torch.zeros(2, 3))


def test_the_gradient_at_no_error_is_zero_not_nan():
    still = torch.zeros(1, 1, 3, dtype=torch.float64, requires_grad=True)
    for penalty in ("charbonnier", "huber"):
        observed = tracks(torch.zeros(1, 1, 3), torch.ones(1, 1, dtype=torch.bool))
        losses.track_loss_3d(still, observed, LossConfig(penalty=penalty)).backward()
        assert torch.equal(still.grad, torch.zeros_like(still))


def test_pixels_are_those_of_the_camera():
    given = scene.problem(scene.model(), with_masks=False)
    carried = given.tracks.points3d.nan_to_num(0.05).double()
    exact = losses.track_loss_2d(carried, given.tracks, given.camera, LossConfig())
    assert exact.item() < 1e-9
    # 3 mm along the image's x at about 0.4 m and f = 100 px is about 0.75 px
    moved = carried + torch.tensor([0.003, 0.0, 0.0])
    value = losses.track_loss_2d(moved, given.tracks, given.camera, LossConfig(pixel_scale=0.75))
    assert value.item() == pytest.approx(math.sqrt(2) - 1, rel=0.2)


def test_a_perfect_silhouette_costs_nothing_even_where_pixels_are_half_covered():
    alpha = torch.tensor([[0.0, 0.3, 1.0]], dtype=torch.float64)
    known = torch.ones(1, 3, dtype=torch.bool)
    assert losses.silhouette_loss(alpha, alpha, known).item() == pytest.approx(0.0, abs=1e-12)


def test_the_silhouette_under_the_hand_is_unknown():
    coverage = torch.tensor([[1.0, 1.0, 0.0]])
    known = torch.tensor([[True, True, False]])
    alpha = torch.tensor([[1.0, 1.0, 1.0]], dtype=torch.float64, requires_grad=True)
    value = losses.silhouette_loss(alpha, coverage, known)
    value.backward()
    assert value.item() == pytest.approx(0.0, abs=1e-9) and alpha.grad[0, 2] == 0.0


def test_missing_the_object_costs_the_same_at_every_resolution():
    """Per object pixel, so neither the picture's size nor the object's share of it matters."""
    values = []
    for size in (8, 32):
        coverage = torch.zeros(size, size)
        coverage[: size // 2] = 1.0
        known = torch.ones(size, size, dtype=torch.bool)
        values.append(losses.silhouette_loss(torch.zeros(size, size, dtype=torch.float64), coverage, known).item())
    assert values[0] == pytest.approx(values[1]) and values[0] == pytest.approx(-math.log(1e-3), rel=0.01)


def test_masks_are_reduced_to_coverage_and_known_pixels():
    masks = torch.zeros(1, 5, 4, dtype=torch.bool)
    masks[0, :2, 0] = True
    hidden = torch.zeros(1, 5, 4, dtype=torch.bool)
    hidden[0, 3, 3] = True
    coverage, known = reduce_masks(masks, hidden, 2)
    assert coverage.tolist() == [[[0.5, 0.0], [0.0, 0.0]]]
    assert known.tolist() == [[[True, True], [True, False]]]


@pytest.fixture(scope="module")
def moving():
    """A problem, x0 and states of another material, moved at random so that no gradient vanishes by symmetry; float64."""
    given = scene.problem(scene.model(dtype="float64"))
    states = scene.simulate(given, scene.model(dtype="float64", youngs_modulus=1e4))
    generator = torch.Generator().manual_seed(0)
    x, F = (a + 1e-3 * torch.randn(a.shape, generator=generator, dtype=a.dtype) for a in (states.x, states.F))
    return given, torch.from_numpy(given.body.x0), x.requires_grad_(), F.requires_grad_()


def _same(at_once, one_by_one, x, F):
    """Equal values and equal gradients in x and F, to rounding in float64."""
    torch.testing.assert_close(at_once, one_by_one, rtol=1e-12, atol=1e-14)
    bar = torch.randn(at_once.shape, generator=torch.Generator().manual_seed(1), dtype=at_once.dtype)
    gradients = [torch.autograd.grad(value, (x, F), bar) for value in (at_once, one_by_one)]
    for found, expected in zip(*gradients, strict=True):
        assert expected.abs().max() > 0.0
        torch.testing.assert_close(found, expected, rtol=1e-10, atol=1e-13 * expected.abs().max().item())


def test_tracks_carried_at_all_frames_are_those_carried_frame_by_frame(moving):
    given, x0, x, F = moving
    tracks = given.tracks
    points0 = tracks.points0.double()
    one_by_one = torch.stack([carry_points(tracks.binding, points0, x0, x[t], F[t]) for t in range(len(x))])
    _same(losses.carried_tracks(tracks, x0, x, F), one_by_one, x, F)


@pytest.mark.parametrize("horizon", [12, 8])
def test_the_mask_loss_is_the_mean_over_its_frames_within_the_horizon(moving, horizon):
    given, x0, x, F = moving
    masks = given.masks
    values = []
    for row, frame in enumerate(masks.frames.tolist()):
        if frame >= horizon:
            continue
        means, covariances = carry_gaussians(masks.binding, masks.gaussians, x0, x[frame], F[frame])
        opacities = masks.gaussians.opacities().double()
        alpha = rasterise(means, covariances, opacities, torch.zeros_like(means), masks.camera).alpha
        bounded, target = (1e-3 + (1 - 2e-3) * share.double() for share in (alpha, masks.coverage[row]))
        crossed = -target * bounded.log() - (1 - target) * (1 - bounded).log()
        entropy = -target * target.log() - (1 - target) * (1 - target).log()
        known = masks.known[row]
        values.append((crossed - entropy)[known].sum() / target[known].sum())
    assert len(values) == (2 if horizon == 12 else 1)
    _same(losses.mask_loss(masks, x0, x[:horizon], F[:horizon]), torch.stack(values).mean(), x, F)


def test_a_horizon_before_the_first_mask_has_no_mask_loss(moving):
    given, x0, x, F = moving
    assert losses.mask_loss(given.masks, x0, x[:3], F[:3]).item() == 0.0


def test_the_settled_term_sees_the_swing_s_middle_not_the_swing():
    times = torch.arange(72, dtype=torch.float64)
    swing = torch.zeros(72, 1, 3, dtype=torch.float64)
    swing[:, 0, 2] = -0.006 * (1.0 - torch.cos(2.0 * torch.pi * times / 11.7))
    rest = torch.zeros(200, 1, 3)
    rest[:, 0, 2] = -0.006
    observed = tracks(rest, torch.ones(200, 1, dtype=torch.bool))
    config = LossConfig(settled=1.0, track_scale=0.001)
    assert losses.settled_loss(swing, observed, 200, config)[0].item() < 0.01
    assert losses.settled_loss(swing - 0.001, observed, 200, config)[0].item() > 0.3


def test_a_problem_without_measurements_is_an_error():
    given = scene.problem(scene.model(), with_masks=False)
    with pytest.raises(InputError, match="neither tracks nor masks"):
        Problem(
            given.body,
            given.fps,
            given.controllers,
            given.observed,
            given.patch_neighbours,
            given.patch_weights,
            given.grip,
        )
