"""Track votes (eq. mask_tracking) and masks followed through a film, with a segmenter whose candidates are known."""

import numpy as np
import pytest

from physreal_core.perception.appearance import Appearance
from physreal_core.perception.association import Thing, follow_masks
from physreal_core.perception.evidence import Carried, gather
from physreal_core.perception.flow_tracker import FlowTracker
from physreal_core.perception.mask_geometry import intersection_over_union, signed_distance, spread_points
from physreal_core.perception.prompting import make_prompts, window_around
from physreal_core.perception.segmenter import Candidates, Prompt, zoomed_candidates
from physreal_core.perception.settings import AppearanceSettings, AssociationSettings, EvidenceSettings, WindowSettings
from physreal_core.perception.tracker import Tracks
from physreal_core.perception.votes import choose_by_votes, count_votes, standing_still
from tests.perception.scene import FilmSegmenter, film


def _candidates(*masks: np.ndarray, scores: tuple[float, ...] | None = None) -> Candidates:
    scores = scores or tuple(0.9 for _ in masks)
    return Candidates(np.stack(masks), np.array(scores, np.float32), np.full(len(masks), -1))


def _box(u0: int, v0: int, u1: int, v1: int) -> np.ndarray:
    mask = np.zeros((20, 30), bool)
    mask[v0:v1, u0:u1] = True
    return mask


def test_votes_count_visible_points_inside_as_the_equation_says():
    masks = np.stack([_box(0, 0, 10, 10), _box(10, 0, 20, 10)])
    points = np.array([[2.0, 2], [9.4, 3], [9.6, 3], [15, 5], [15, 15], [-3, 2], [12, 2]], np.float32)
    visible = np.array([1, 1, 1, 1, 1, 1, 0], bool)
    # 9.4 rounds into the first mask, 9.6 into the second; one point is on neither, one off the image, one not visible.
    assert count_votes(masks, points, visible).tolist() == [2, 2]


def test_on_disjoint_candidates_the_most_votes_win_whatever_the_score():
    points = np.array([[2.0, 2], [3, 3], [4, 4], [15, 5]], np.float32)
    candidates = _candidates(_box(0, 0, 10, 10), _box(10, 0, 20, 10), scores=(0.1, 1.0))
    assert choose_by_votes(candidates, points, np.zeros((0, 2), np.float32)) == 0


def test_a_mask_of_everything_does_not_win_against_points_known_to_be_elsewhere():
    mine = np.array([[2.0, 2], [3, 3], [4, 4]], np.float32)
    elsewhere = np.array([[20.0, 15], [25, 15]], np.float32)
    everything = np.ones((20, 30), bool)
    candidates = _candidates(everything, _box(0, 0, 10, 10), scores=(1.0, 0.6))
    assert choose_by_votes(candidates, mine, elsewhere) == 1


def test_without_votes_there_is_no_choice():
    candidates = _candidates(_box(0, 0, 5, 5))
    assert choose_by_votes(candidates, np.zeros((0, 2), np.float32), np.zeros((0, 2), np.float32)) is None
    assert choose_by_votes(candidates, np.array([[20.0, 15]], np.float32), np.zeros((0, 2), np.float32)) is None


def test_masks_are_followed_through_a_film_with_keyframes_and_flow_between():
    scene, tracker = film(7), FlowTracker()
    segmenter = FilmSegmenter(scene)

    def tracked(mask: np.ndarray) -> Tracks:
        return tracker.track(scene.frames, spread_points(mask, 60))

    things = [
        Thing("object", scene.objects[0], tracked(scene.objects[0])),
        Thing("hand", scene.hands[0], tracked(scene.hands[0])),
    ]
    away = signed_distance(scene.objects[0] | scene.hands[0]) < -4
    background = tracker.track(scene.frames, spread_points(away, 60))
    followed = follow_masks(
        scene.frames, things, background, segmenter, lambda a, b: tracker.flow_between(scene.frames, a, b), stride=3
    )
    masks = followed.masks
    assert not any(followed.unanswered(name) for name in masks)
    for name, truth in (("object", scene.objects), ("hand", scene.hands)):
        for t in (0, 3, 6):  # keyframes: the right candidate, neither half of it nor the two together
            assert np.array_equal(masks[name][t], truth[t])
        for t in (1, 2, 4, 5):  # in between: carried, right to about half a pixel of the outline
            assert intersection_over_union(masks[name][t], truth[t]) > 0.93


def test_when_no_candidate_holds_a_track_the_carried_mask_stands_and_is_reported():
    scene, tracker = film(4), FlowTracker()

    class Blind:
        promptable = False

        def candidates(self, image, prompts=None):
            return Candidates.empty(*image.shape[:2])

    lost = Tracks(np.zeros((4, 5, 2), np.float32), np.zeros((4, 5), bool))
    followed = follow_masks(
        scene.frames,
        [Thing("object", scene.objects[0], lost)],
        lost,
        Blind(),
        lambda a, b: tracker.flow_between(scene.frames, a, b),
        stride=3,
    )
    assert followed.unanswered("object") == [3]
    assert intersection_over_union(followed.masks["object"][3], scene.objects[3]) > 0.85


class Amputating(FilmSegmenter):
    """A segmenter that offers half the object alone from frame 1 on, and says it is sure."""

    def candidates(self, image, prompts=None):
        found = super().candidates(image, prompts)
        return found if image.tobytes() == self.first else found.where(np.array([0]))

    def __init__(self, scene):
        super().__init__(scene)
        self.first = scene.frames[0].tobytes()


def test_what_no_track_sees_is_not_left_behind():
    """Voters on half of the disc alone, and a segmenter that offers that half: the other half stays in, and it is said."""
    scene, tracker = film(7), FlowTracker(anchored=False)
    half = scene.objects[0] & (np.arange(scene.objects[0].shape[1]) < 60)
    voters = tracker.track(scene.frames, spread_points(half, 40))
    away = signed_distance(scene.objects[0] | scene.hands[0]) < -4
    background = tracker.track(scene.frames, spread_points(away, 60))
    things = [
        Thing("object", scene.objects[0], voters),
        Thing("hand", scene.hands[0], tracker.track(scene.frames, spread_points(scene.hands[0], 40))),
    ]
    flow = lambda a, b: tracker.flow_between(scene.frames, a, b)
    followed = follow_masks(scene.frames, things, background, Amputating(scene), flow, stride=3)
    for t in range(7):
        assert intersection_over_union(followed.masks["object"][t], scene.objects[t]) > 0.85  # half would be 0.5


def test_background_that_is_carried_along_does_not_vote():
    points = np.zeros((2, 5, 2), np.float32)
    points[:, :, 0] = np.arange(5) * 10
    points[1, 4] += 6
    visible = np.ones((2, 5), bool)
    visible[1, 0] = False
    assert standing_still(Tracks(points, visible), 1, 1.5)[:, 0].tolist() == [10, 20, 30]


def test_evidence_is_unknown_where_the_flow_was_lost_and_against_where_background_stands():
    mask = _box(5, 5, 25, 15)
    held = np.ones_like(mask)
    held[:, 15:] = False
    carried = Carried(signed_distance(mask), held)
    nobody, settings = np.zeros((0, 2), np.float32), EvidenceSettings()
    sure = gather(carried, nobody, nobody, np.zeros(mask.shape), settings)
    assert sure[10, 10] == settings.carried and sure[10, 20] == pytest.approx(settings.lost * settings.carried)
    against = gather(carried, nobody, np.array([[20.0, 10]], np.float32), np.zeros(mask.shape), settings)
    assert against[10, 20] < 0 < against[10, 8]


def test_appearance_tells_the_object_from_hand_and_table():
    scene = film(2)
    memory = Appearance(AppearanceSettings(least_pixels=20))
    memory.learn(scene.frames[0], {"object": scene.objects[0], "hand": scene.hands[0]})
    inner = [signed_distance(m) > 3 for m in (scene.objects[1], scene.hands[1])]
    for name, own, other in (("object", *inner), ("hand", *inner[::-1])):
        evidence = memory.evidence(scene.frames[1], name)
        assert evidence[own].mean() > 1 and evidence[other].mean() < -1
    assert (Appearance(AppearanceSettings()).evidence(scene.frames[0], "object") == 0).all()


def test_a_prompt_is_cut_to_its_window():
    class Keeping:
        promptable = True

        def candidates(self, image, prompts=None):
            self.prompts, self.shape = prompts, image.shape[:2]
            return Candidates.empty(*image.shape[:2])

    segmenter, mask = Keeping(), _box(5, 5, 25, 15)
    prompt = Prompt(np.array([[12.0, 8], [29, 8]], np.float32), np.array([1, 0]), (4.0, 4.0, 26.0, 16.0), mask)
    zoomed_candidates(segmenter, np.zeros((20, 30, 3), np.uint8), [prompt], (10, 2, 20, 18))
    asked = segmenter.prompts[0]
    assert asked.points.tolist() == [[2, 6]] and asked.labels.tolist() == [1] and asked.box == (-6, 2, 16, 14)
    assert asked.mask.shape == segmenter.shape and np.array_equal(asked.mask, mask[2:18, 10:20])


def test_spread_points_lie_inside_and_apart():
    mask = film(1).objects[0]
    points = spread_points(mask, 6)
    pixel = points.astype(int)
    assert len(points) == 6 and mask[pixel[:, 1], pixel[:, 0]].all()
    gaps = np.linalg.norm(points[:, None] - points[None], axis=-1)[np.triu_indices(6, 1)]
    assert gaps.min() > 8  # a disc of radius 20 has room for that
    assert len(spread_points(np.zeros_like(mask), 6)) == 0


def test_prompts_ask_in_several_ways_and_say_what_is_not_meant():
    scene = film(1)
    prompts = make_prompts(scene.objects[0], [scene.hands[0]])
    assert {p.box is None for p in prompts} == {True, False}
    for prompt in prompts:
        pixel = np.rint(prompt.points).astype(int)
        on = scene.objects[0][pixel[:, 1], pixel[:, 0]]
        assert np.array_equal(on, prompt.labels.astype(bool))


@pytest.mark.parametrize("margin", [0.1, 0.5])
def test_window_holds_the_mask(margin: float):
    mask = np.zeros((100, 160), bool)
    mask[40:50, 60:75] = True
    u0, v0, u1, v1 = window_around(mask, WindowSettings(margin=margin))
    assert mask[v0:v1, u0:u1].sum() == mask.sum()
    assert (u1 - u0) * (v1 - v0) < mask.size


def test_which_votes_count_as_equal_is_a_setting():
    """Nine of ten voters lie in both masks, the tenth in the wider one alone; the narrower has the better score."""
    candidates = _candidates(_box(0, 0, 9, 9), _box(0, 0, 10, 9), scores=(0.9, 0.8))
    voters = np.array([[u, 4.0] for u in range(10)], np.float32)
    nobody = np.zeros((0, 2), np.float32)
    assert choose_by_votes(candidates, voters, nobody) == 1
    assert choose_by_votes(candidates, voters, nobody, settings=AssociationSettings(tie=0.1)) == 0
