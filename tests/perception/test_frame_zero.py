"""Frame 0: controller and target by hint, by hand, by touch; what is said when there is none."""

from dataclasses import replace

import numpy as np
import pytest

from physreal_core.errors import InputError
from physreal_core.perception.choices import Choice
from physreal_core.perception.chooser import fit_to_hint, hint_prompts
from physreal_core.perception.colour import colour_mask, largest_part
from physreal_core.perception.frame_zero import find_controllers, find_object
from physreal_core.perception.hand_finder import Hand
from physreal_core.perception.mask_geometry import signed_distance
from physreal_core.perception.motion import Motion, watch
from physreal_core.perception.ranking import fit_to_touch
from physreal_core.perception.segmenter import Candidates, drop_duplicates
from physreal_core.perception.settings import MotionSettings
from tests.perception.scene import FilmSegmenter, film

SCENE = film(2)
IMAGE, DISC, HAND = SCENE.frames[0], SCENE.objects[0], SCENE.hands[0]
HANDS = Choice(HAND, "given")


class Finder:
    """Finds the film's hand, as landmarks on it."""

    def find(self, image):
        pixels = np.argwhere(HAND)[::40, ::-1].astype(np.float32)
        return [Hand(pixels, 0.97)]


class NoHands:
    def find(self, image):
        return []


def test_a_found_hand_is_the_controller():
    choices = find_controllers(IMAGE, None, Finder(), FilmSegmenter(SCENE))
    assert len(choices) == 1 and np.array_equal(choices[0].mask, HAND)
    assert "0.97" in choices[0].how


@pytest.mark.parametrize(
    "hint", [{"point": [92, 40]}, {"box": [80, 23, 104, 55]}, {"colour": "orange"}, {"colour": "skin"}], ids=str
)
def test_a_hint_names_the_controller(hint):
    choices = find_controllers(IMAGE, hint, None, FilmSegmenter(SCENE))
    assert np.array_equal(choices[0].mask, HAND)


@pytest.mark.parametrize("finder", [NoHands(), None], ids=["no hand seen", "no finder"])
def test_no_controller_is_an_error_that_names_the_key(finder):
    with pytest.raises(InputError, match=r"no controller found.*hints\.controller"):
        find_controllers(IMAGE, None, finder, FilmSegmenter(SCENE))


class Around:
    """A segmenter that proposes these masks wherever it is asked."""

    promptable = True

    def __init__(self, *masks):
        self._masks = np.stack(masks)

    def candidates(self, image, prompts=None):
        return Candidates(self._masks, np.full(len(self._masks), 0.9, np.float32), np.full(len(self._masks), -1))


def test_where_no_hand_is_known_the_controller_reaches_in_from_the_border_and_moves():
    arm, shelf = np.zeros_like(DISC), np.zeros_like(DISC)
    arm[:60, 80:100], shelf[:40, :30] = True, True
    masks = arm & (np.arange(128) < 85), shelf, DISC, DISC | shelf, arm
    moves = Motion.of(np.where(DISC | arm, 8.0, 0.0))
    (found,) = find_controllers(IMAGE, None, NoHands(), Around(*masks), motion=moves)
    assert np.array_equal(found.mask, arm) and found.how == "reaches in from the border and moves"
    still = Motion.of(np.where(DISC, 8.0, 0.0))
    with pytest.raises(InputError, match="no controller found"):
        find_controllers(IMAGE, None, NoHands(), Around(*masks), motion=still)


@pytest.mark.parametrize("hint", [{"box": [40, 25, 80, 65]}, {"colour": "teal"}], ids=str)
def test_a_hint_names_the_object(hint):
    assert np.array_equal(find_object(IMAGE, hint, [HANDS], FilmSegmenter(SCENE)).mask, DISC)


def test_without_a_hint_the_object_is_what_the_hand_touches():
    choice = find_object(IMAGE, None, [HANDS], FilmSegmenter(SCENE), motion=Motion.of(np.where(DISC | HAND, 8.0, 0.0)))
    assert np.array_equal(choice.mask, DISC) and choice.how == "what the hand touches"


def test_a_chooser_can_overrule_touch():
    class Words:
        def scores(self, image, masks, description):
            assert description == "half a disc"
            return -masks.sum((1, 2)).astype(float)  # the smallest

    choice = find_object(IMAGE, None, [HANDS], FilmSegmenter(SCENE), description="half a disc", chooser=Words())
    assert choice.mask.sum() < 0.7 * DISC.sum()


def test_nothing_to_choose_is_an_empty_mask_and_said_so():
    class Blind:
        promptable = False

        def candidates(self, image, prompts=None):
            return Candidates.empty(*image.shape[:2])

    with pytest.raises(InputError, match=r"mask is empty.*hints\.object"):
        find_object(IMAGE, None, [HANDS], Blind())
    with pytest.raises(InputError, match=r"hints\.object.*no mask answers"):
        find_object(IMAGE, {"point": [3, 3]}, [HANDS], Blind())


@pytest.mark.parametrize(
    "hint", [{"point": [500, 3]}, {"point": [1]}, {"circle": [1, 2]}, {"colour": "octarine"}, {}], ids=str
)
def test_a_wrong_hint_is_named(hint):
    with pytest.raises(InputError):
        hint_prompts(IMAGE, hint, "capture.json, hints.object")


def test_touch_leaves_out_hand_table_and_what_is_far():
    table = ~(DISC | HAND)
    far = np.zeros_like(DISC)
    far[80:92, 5:20] = True
    masks = np.stack([HAND, table, far, DISC])
    fit = fit_to_touch(Candidates(masks, np.ones(4, np.float32), np.zeros(4, int)), HAND)
    assert (fit[:3] == 0).all() and fit[3] > 0


def test_fit_to_box_and_colour_prefer_the_thing_itself():
    masks = np.stack([DISC, np.ones_like(DISC), DISC & (np.arange(128) < 55)])
    assert fit_to_hint(IMAGE, masks, {"box": [40, 25, 80, 65]}).argmax() == 0
    assert fit_to_hint(IMAGE, masks, {"colour": "teal"}).argmax() == 0


def test_colour_words_split_the_film():
    assert (colour_mask(IMAGE, "teal") & DISC).sum() > 0.9 * DISC.sum()
    assert (colour_mask(IMAGE, "teal") & ~DISC).sum() < 0.02 * DISC.size
    with pytest.raises(InputError, match="octarine"):
        colour_mask(IMAGE, "octarine")


def test_largest_part():
    mask = np.zeros((10, 10), bool)
    mask[:2, :2], mask[5:9, 5:9] = True, True
    assert largest_part(mask).sum() == 16 and largest_part(np.zeros_like(mask)).sum() == 0


def test_duplicates_keep_the_best_scored():
    moved = np.roll(DISC, 1, axis=1)
    found = Candidates(np.stack([DISC, moved, HAND]), np.array([0.5, 0.9, 0.3], np.float32), np.zeros(3, int))
    assert drop_duplicates(found).scores.tolist() == pytest.approx([0.9, 0.3])


def _still_flow(moving: np.ndarray, step: float):
    """Flow in which the pixels of a mask move `step` px to the right in every frame."""
    flow = np.zeros((*moving.shape, 2), np.float32)
    flow[moving, 0] = step
    return lambda a, b: flow if b > a else -flow


def test_motion_counts_only_where_there_is_texture():
    """The flow moves disc, hand and a bare patch of the table: the patch shows no motion."""
    image = IMAGE.copy()
    image[60:90, 5:45] = 150
    bare = np.zeros_like(DISC)
    bare[65:85, 10:40] = True
    motion = watch([image] * 5, _still_flow(DISC | HAND | bare, 2.0), MotionSettings())
    moving = motion.moving(HAND, MotionSettings())
    assert moving[signed_distance(DISC) > 4].mean() > 0.95 and not moving[bare].any()
    assert motion.held.shape == (3, *DISC.shape) and motion.distance[45, 60] == pytest.approx(8)


def test_what_the_hand_comes_to_only_later_is_touched():
    far = np.roll(HAND, 20, axis=1)
    found = Candidates(DISC[None], np.ones(1, np.float32), np.zeros(1, int))
    assert fit_to_touch(found, far)[0] == 0
    places = np.stack(np.meshgrid(np.arange(128.0), np.arange(96.0)), -1).astype(np.float32)
    places[far] -= [20, 0]  # the hand comes, all else stays
    unseen = Motion.of(np.zeros(far.shape))
    motion = replace(unseen, places=places[None], held=np.ones((1, *far.shape), bool))
    assert fit_to_touch(found, far, motion)[0] > 0


def test_a_patch_of_the_table_loses_against_a_thing_with_an_outline():
    patch = np.zeros_like(DISC)
    patch[55:92, 60:110] = True
    patch &= ~DISC & ~HAND
    plain = np.where((DISC | HAND)[..., None], IMAGE, 120).astype(np.uint8)
    found = Candidates(np.stack([patch, DISC]), np.ones(2, np.float32), np.zeros(2, int))
    table, disc = fit_to_touch(found, HAND, image=plain)
    assert disc > 5 * table


def test_an_arm_behind_the_wrist_belongs_to_the_hand():
    """A hand at the top of the picture and a sleeve that reaches it from the border; the object lies below."""
    hand, arm, thing = (np.zeros((100, 120), bool) for _ in range(3))
    hand[40:56, 50:66], arm[0:40, 52:64], thing[57:80, 40:80] = True, True, True
    fingers = np.linspace(0, 1, 21)[:, None] * [0, 14] + [58.0, 41.0]
    fingers[[0, 9]] = [[58, 41], [58, 49]]

    class Things:
        promptable = True

        def candidates(self, image, prompts=None):
            asked = [m for p in prompts for m in (hand, arm, thing) if m[tuple(p.points[-1].astype(int)[::-1])]]
            return Candidates(np.array(asked), np.ones(len(asked), np.float32), np.zeros(len(asked), int))

    class One:
        def find(self, image):
            return [Hand(fingers.astype(np.float32), 0.99)]

    (found,) = find_controllers(np.zeros((100, 120, 3), np.uint8), None, One(), Things())
    assert np.array_equal(found.mask, hand | arm) and np.array_equal(found.hand, hand)


def test_a_choice_says_how_sure_it_is_and_which_hint_settles_it():
    whole, part = DISC, DISC & (np.arange(128) < 60)
    choice = Choice(whole, "what the hand touches", np.stack([whole, part]), np.array([0.5, 0.4]))
    assert choice.sure == pytest.approx(0.5 / (0.5 + 0.4 + 0.1)) and Choice(whole, "given").sure == 1.0
    first, second = choice.hints()
    u, v = first["point"]
    assert whole[v, u] and not part[v, u] and second == {"box": [41, 26, 59, 64]}
