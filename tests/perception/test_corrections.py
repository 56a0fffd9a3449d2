"""Frames put right by hand: the mask answers to the clicks, what follows starts from it, what came before stays."""

import json
import shutil

import cv2
import numpy as np
import pytest

from physreal_core.perception.association import Thing, _Film, follow_masks
from physreal_core.perception.corrections import Correction, Corrections, corrected_mask
from physreal_core.perception.flow_tracker import FlowTracker
from physreal_core.perception.mask_geometry import intersection_over_union, spread_points
from physreal_core.perception.perceive import Networks, Video, perceive
from physreal_core.perception.segmenter import Candidates
from physreal_core.perception.settings import PerceptionSettings
from pipeline.provenance import digest_folder
from tests.perception.scene import T_WORLD_CAMERA, FilmSegmenter, K, film
from tests.perception.test_stage import SCENE as STAGE_SCENE
from tests.perception.test_stage import capture, describe, segment  # noqa: F401

SCENE = film(9)


def correction(frame: int, on=(), off=(), box=None, thing: str = "object") -> Correction:
    points = np.array([*on, *off], np.float32).reshape(-1, 2)
    return Correction(frame, thing, points, np.r_[np.ones(len(on), int), np.zeros(len(off), int)], box)


def right_half(t: int) -> np.ndarray:
    """A pixel of the disc that lies on the whole disc alone, not on the half of it that is proposed, too."""
    return np.array([66.0, 45.0]) + SCENE.motion[t]


class Things(FilmSegmenter):
    """Proposes half the object, the object, and the hand."""

    def candidates(self, image, prompts=None):
        return super().candidates(image, prompts).where(np.array([0, 1, 2]))


class ByColour:
    """A segmenter that needs prompts: every pixel of a tint like that of the first point on the thing."""

    promptable = True
    TINTS = np.array([(0.45, 0.45, 0.4), (0.15, 0.5, 0.55), (0.8, 0.5, 0.4)])

    def candidates(self, image, prompts=None):
        tint = (image / np.maximum(image.sum(-1, keepdims=True), 1))[..., None, :]
        kind = np.abs(tint - self.TINTS / self.TINTS.sum(1, keepdims=True)).sum(-1).argmin(-1)
        points = [np.rint(prompt.points[prompt.labels == 1][0]).astype(int) for prompt in prompts]
        masks = np.stack([kind == kind[v, u] for u, v in points])
        return Candidates(masks, np.full(len(masks), 0.9, np.float32), np.arange(len(masks)))


@pytest.mark.parametrize("promptable", [False, True])
def test_the_mask_is_the_candidate_that_answers_to_the_clicks(promptable):
    segmenter = ByColour() if promptable else Things(SCENE)
    wrong = SCENE.hands[3]
    clicks = correction(3, on=[right_half(3)], off=[np.argwhere(wrong).mean(0)[::-1]])
    wide = PerceptionSettings().association
    mask = corrected_mask(SCENE.frames[3], clicks, wrong, segmenter, wide)
    assert intersection_over_union(mask, SCENE.objects[3]) > 0.99


def test_a_click_adds_a_piece_and_another_takes_one_off():
    """Half the object and the hand are expected; the segmenter answers by tint, so it knows both and no half."""
    t, left = 3, np.arange(SCENE.hands.shape[2]) < 60 + SCENE.motion[3, 0]
    segmenter = Halves(SCENE)
    hand = np.argwhere(SCENE.hands[t]).mean(0)[::-1]
    half = SCENE.objects[t] & left
    mask = corrected_mask(SCENE.frames[t], correction(t, on=[right_half(t)]), half, segmenter)
    assert np.array_equal(mask, SCENE.objects[t])
    both = half | SCENE.hands[t]
    mask = corrected_mask(SCENE.frames[t], correction(t, on=[right_half(t)], off=[hand]), both, segmenter)
    assert np.array_equal(mask, SCENE.objects[t])
    mask = corrected_mask(SCENE.frames[t], correction(t, off=[hand]), SCENE.objects[t] | SCENE.hands[t], segmenter)
    assert np.array_equal(mask, SCENE.objects[t])


class Halves(Things):
    """Proposes the halves of the object, never all of it, and the hand."""

    def candidates(self, image, prompts=None):
        found = FilmSegmenter.candidates(self, image)
        left, whole, hand = found.masks[:3]
        t = list(self._of).index(image.tobytes())
        left = whole & (np.arange(whole.shape[1]) < 60 + SCENE.motion[t, 0])
        return Candidates(np.stack([left, whole & ~left, hand]), np.full(3, 0.9, np.float32), np.full(3, -1))


def test_what_no_candidate_answers_is_put_right_around_the_click():
    class Blind:
        promptable = False

        def candidates(self, image, prompts=None):
            return Candidates.empty(*image.shape[:2])

    expected = SCENE.objects[0]
    clicks = correction(0, on=[(20.0, 20.0)], off=[right_half(0)])
    mask = corrected_mask(SCENE.frames[0], clicks, expected, Blind())
    assert mask[20, 20] and mask[20, 22] and not mask[45, 66] and not mask[45, 68]
    changed = mask != expected
    assert 2 * 20 < changed.sum() < 2 * 40  # two discs of a radius of 3 px


def test_a_box_stands_for_what_is_expected():
    u, v = np.argwhere(SCENE.objects[2]).mean(0)[::-1]
    clicks = correction(2, box=(u - 20, v - 20, u + 20, v + 20))
    mask = corrected_mask(SCENE.frames[2], clicks, SCENE.hands[2], Things(SCENE))
    assert intersection_over_union(mask, SCENE.objects[2]) > 0.9


class Losing(Things):
    """From frame 4 on it proposes nothing but the hand, unless it is asked in a frame that is corrected."""

    def __init__(self, scene, corrected: set[int]) -> None:
        super().__init__(scene)
        self._lost = {f.tobytes() for t, f in enumerate(scene.frames) if t >= 4 and t not in corrected}

    def candidates(self, image, prompts=None):
        found = super().candidates(image, prompts)
        return found.where(np.array([2])) if image.tobytes() in self._lost else found


def followed(corrections: list[Correction], segmenter):
    tracker = FlowTracker()
    flow = lambda a, b: tracker.flow_between(SCENE.frames, a, b)
    wrong = [SCENE.objects[0] & (np.arange(SCENE.objects.shape[2]) < 50), SCENE.hands[0]]
    things = [
        Thing(name, mask, tracker.track(SCENE.frames, spread_points(mask, 40)))
        for name, mask in zip(("object", "controller"), wrong, strict=True)
    ]
    background = tracker.track(SCENE.frames, np.array([[10.0, 10], [15, 80], [110, 85]], np.float32))
    told = Corrections(corrections, SCENE.frames, segmenter, flow)
    found = follow_masks(SCENE.frames, things, background, segmenter, flow, stride=4, corrections=told)
    return found.masks, {name: found.unanswered(name) for name in found.masks}


def test_masks_start_from_a_corrected_frame_both_ways_and_mend_a_doubtful_one_before_it():
    """The tracks vote for half the object until a click in frame 6 says that it is whole."""
    before, _ = followed([], Things(SCENE))
    after, unanswered = followed([correction(6, on=[right_half(6)])], Things(SCENE))
    assert intersection_over_union(before["object"][4], SCENE.objects[4]) < 0.7 and not unanswered["object"]
    assert np.array_equal(after["object"][4], SCENE.objects[4])
    assert intersection_over_union(before["object"][6], SCENE.objects[6]) < 0.7
    assert np.array_equal(after["object"][6], SCENE.objects[6])
    assert np.array_equal(after["object"][8], SCENE.objects[8])  # voted on with the new voters
    assert intersection_over_union(after["object"][7], SCENE.objects[7]) > 0.93


def test_where_nothing_is_found_the_corrected_mask_is_carried():
    after, unanswered = followed([correction(6, on=[right_half(6)])], Losing(SCENE, {6}))
    assert np.array_equal(after["object"][6], SCENE.objects[6]) and 6 not in unanswered["object"]
    for t in (7, 8):
        assert intersection_over_union(after["object"][t], SCENE.objects[t]) > 0.85


def test_tracks_off_a_corrected_mask_vote_no_more_and_new_ones_do():
    tracker = FlowTracker()
    told = Corrections([correction(3, on=[right_half(3)])], SCENE.frames, Things(SCENE),
                       lambda a, b: tracker.flow_between(SCENE.frames, a, b))  # fmt: skip
    astray = tracker.track(SCENE.frames, spread_points(SCENE.hands[0], 10))
    tracks = told.amended(3, {"object": astray}, {"object": SCENE.objects[3]})["object"]
    assert np.array_equal(tracks.visible[:3, :10], astray.visible[:3]) and not tracks.visible[3:, :10].any()
    new_points, new_seen = tracks.points[:, 10:], tracks.visible[:, 10:]
    assert not new_seen[:3].any() and new_seen[3].all() and new_seen[8].mean() > 0.8
    moved = (new_points[8] - new_points[3] - (SCENE.motion[8] - SCENE.motion[3]))[new_seen[8]]
    assert np.median(np.linalg.norm(moved, axis=1)) < 0.5  # flow is smooth across the disc's rim


def test_a_corrected_hand_takes_its_pixels_from_the_object():
    masks = {"object": SCENE.objects[0] | SCENE.hands[0], "controller": np.zeros_like(SCENE.hands[0])}
    centre = np.argwhere(SCENE.hands[0]).mean(0)[::-1]
    told = Corrections([correction(0, on=[centre], thing="controller")], SCENE.frames, Things(SCENE))
    assert told.apply(0, masks) == {"controller"}
    assert np.array_equal(masks["controller"], SCENE.hands[0]) and np.array_equal(masks["object"], SCENE.objects[0])


def test_of_two_hands_the_nearer_one_is_corrected():
    left, right = np.zeros((2, *SCENE.hands[0].shape), bool)
    left[:10, :10], right[:10, -10:] = True, True
    told = Corrections([correction(0, on=[(100.0, 40.0)], thing="controller")], SCENE.frames, Things(SCENE))
    assert told.apply(0, {"controller 0": left, "controller 1": right}) == {"controller 1"}


def test_frame_0_answers_to_its_correction_to_the_end():
    hints = {"object": {"point": [48.0, 45.0]}, "controller": {"box": [80, 23, 104, 55]}}
    video = Video(SCENE.frames, None, K, T_WORLD_CAMERA, hints=hints)
    clicked = [correction(0, on=[(30.0, 20.0)])]  # on the table: nobody would choose that
    networks = Networks(Things(SCENE), FlowTracker())
    settings = PerceptionSettings(keyframe_stride=4, track_count=60, hand_track_count=60)
    parsed = perceive(Video(**{**vars(video), "corrections": clicked}), networks, settings)
    assert parsed.object_masks[0][20, 30]
    assert "corrected by hand" in parsed.report["chosen_by"]["object"]


@pytest.fixture
def proposed(capture):  # noqa: F811
    """The stage's capture with candidates and hints, so that no network is needed."""
    for t in range(len(STAGE_SCENE.frames)):
        (capture / "candidates" / f"{t:06d}").mkdir(parents=True)
        for i, mask in enumerate([STAGE_SCENE.objects[t], STAGE_SCENE.hands[t]]):
            cv2.imwrite(str(capture / "candidates" / f"{t:06d}" / f"{i}.png"), mask.astype(np.uint8) * 255)
    describe(capture, hints={"object": {"colour": "teal"}, "controller": {"box": [80, 23, 104, 55]}})
    return capture


def test_the_stage_reads_corrections_from_the_capture(proposed):
    describe(proposed, corrections=[{"frame": 3, "thing": "object", "points": [[20, 80]]}])
    output = segment(proposed, segmenter="none")
    mask = cv2.imread(str(output / "masks" / "object" / "000003.png"), cv2.IMREAD_GRAYSCALE)
    assert mask[80, 20] == 255
    assert json.loads((output / "segmentation.json").read_text())["frames"] == len(STAGE_SCENE.frames)


def test_a_correction_runs_the_stage_from_there_and_ends_in_the_bytes_of_a_fresh_run(proposed, monkeypatch):
    asked = []

    def counted(film, start, stop, follow=_Film.follow):
        asked.append(stop)
        return follow(film, start, stop)

    monkeypatch.setattr(_Film, "follow", counted)
    kept = proposed.parents[2] / ".scratch" / "kept"
    segment(proposed, segmenter="none")
    assert asked == [2, 3] and kept.is_dir()
    describe(proposed, corrections=[{"frame": 3, "thing": "object", "points": [[20, 80]]}])
    digest = digest_folder(segment(proposed, segmenter="none"))
    assert asked == [2, 3, 3]
    shutil.rmtree(kept)
    assert digest_folder(segment(proposed, segmenter="none")) == digest
    assert asked == [2, 3, 3, 2, 3]
    segment(proposed, segmenter="none", keyframe_stride=1)  # another setting: nothing is taken over
    assert asked == [2, 3, 3, 2, 3, 1, 2, 3]
