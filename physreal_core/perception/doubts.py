"""What of the masks and tracks should not be trusted unseen: one sentence each, with the frames and what to do."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from physreal_core.array_types import Array, Bool
from physreal_core.perception.choices import Choice
from physreal_core.perception.evidence import vote_spacing
from physreal_core.perception.mask_geometry import distance_to, with_pixels_of
from physreal_core.perception.settings import DoubtSettings
from physreal_core.perception.tracker import Tracks

LOOK = "look at overlay.mp4, and put the frame right with `physreal label`"


@dataclass(frozen=True)
class Doubt:
    """One thing that may be wrong.

    Attributes:
        kind: a word for the rule that found it.
        frames: the frames it is about, in order.
        sentence: for the reader, with what to do.
    """

    kind: str
    frames: list[int]
    sentence: str


def find_doubts(
    choices: Mapping[str, Choice],
    masks: Mapping[str, Bool[Array, "T H W"]],
    keyframes: Mapping[str, Mapping[int, Mapping[str, float]]],
    tracks: Tracks,
    strangers: Sequence[int],
    settings: DoubtSettings,
) -> list[Doubt]:
    """All doubts about one clip, the choice of frame 0 first.

    Args:
        choices: of frame 0, by the things' names.
        masks: by the things' names, "object" among them.
        keyframes: numbers of every thing on its keyframes, see `association.NUMBERS`; empty for given masks.
        tracks: of the object.
        strangers: frames in which a hand is seen where no controller is.
        settings: from where on something is doubtful.
    """
    found = [*_of_choice(choices["object"], settings)]
    for name, told in keyframes.items():
        found += _of_keyframes(name, told, settings)
    found += _of_areas(masks["object"], settings)
    found += [d for name, mask in masks.items() if name != "object" for d in _of_hand(name, mask, settings)]
    if strangers:
        found.append(
            Doubt(
                "another hand",
                list(strangers),
                f"a hand is seen{_in(strangers)} where no controller is: if it moves the object, {_click('controller')}",
            )
        )
    return found + _of_tracks(masks["object"], tracks, settings)


def _of_choice(choice: Choice, settings: DoubtSettings) -> list[Doubt]:
    out = []
    if choice.sure < settings.sure:
        hints = choice.hints()
        settled = f": hints.object {_json(hints[0])} in capture.json settles it" if hints else ""
        other = f", {_json(hints[1])} names the next best" if len(hints) > 1 else ""
        sentence = f"the object was chosen in frame 0 with a certainty of {choice.sure:.2f} only, look at choice.png"
        out.append(Doubt("choice", [0], f"{sentence}{settled}{other}"))
    if choice.moves is not None and choice.moves < settings.moves:
        share = f"{choice.moves:.0%} of what can be seen of the object in frame 0 moves"
        out.append(Doubt("motion", [0], f"only {share}: if it is another thing, {_click('object')}"))
    return out


def _of_keyframes(name: str, told: Mapping[int, Mapping[str, float]], s: DoubtSettings) -> list[Doubt]:
    rules = {
        "not answered": (
            lambda k: not k["answered"],
            "the segmenter's answer was not believed, the carried mask stands",
        ),
        "voters": (lambda k: k["voters"] < s.voters, f"fewer than {s.voters:.0%} of the tracks from frame 0 are seen"),
        "left out": (
            lambda k: k["left_out"] > s.left_out,
            f"more than {s.left_out:.0%} of its tracks lie off the mask",
        ),
        "taken in": (
            lambda k: k["taken_in"] > s.taken_in,
            "the mask holds points of the background or of another thing",
        ),
        "jump": (lambda k: k["overlap"] < s.overlap, "the mask is unlike the one that the flow carried there"),
        "colour": (lambda k: k["colour"] < s.colour, "the mask's colours are unlike those of frame 0"),
    }
    if name != "object":  # a hand turns and changes much; what is wrong with it shows on the object
        rules = {"not answered": rules["not answered"]}
    out = []
    for kind, (wrong, words) in rules.items():
        frames = [t for t, k in told.items() if wrong(k)]
        if frames:
            out.append(Doubt(kind, frames, f"{name}: {words}{_in(frames)}; {LOOK}"))
    return out


def _of_areas(masks: Array, settings: DoubtSettings) -> list[Doubt]:
    area = masks.sum((1, 2)).astype(float)
    out = []
    if empty := np.flatnonzero(area == 0).tolist():
        out.append(Doubt("empty", empty, f"object: the mask is empty{_in(empty)}; {LOOK}"))
    usual = np.array([np.median(area[max(0, t - settings.before) : t]) if t else area[0] for t in range(len(area))])
    ratio = np.maximum(area, 1) / np.maximum(usual, 1)
    jumps = np.flatnonzero((np.maximum(ratio, 1 / ratio) > settings.area) & (area > 0)).tolist()
    if jumps:
        out.append(Doubt("area", jumps, f"object: the mask's area jumps{_in(jumps)}; {LOOK}"))
    rim = np.array([_on_border(m) / max(np.sqrt(m.sum()), 1) for m in masks])
    if cut := np.flatnonzero(rim > settings.border).tolist():
        words = f"object: the mask runs along the image's border{_in(cut)}, what is outside is not measured; {LOOK}"
        out.append(Doubt("border", cut, words))
    return out


def _of_hand(name: str, masks: Array, settings: DoubtSettings) -> list[Doubt]:
    gone = np.flatnonzero(masks.sum((1, 2)) == 0).tolist()
    if len(gone) < settings.hand_gone:
        return []
    return [Doubt("hand", gone, f"{name}: no hand{_in(gone)}; if it is in the picture, {_click('controller')}")]


def _of_tracks(masks: Array, tracks: Tracks, settings: DoubtSettings) -> list[Doubt]:
    """Frames in which few tracks are seen, or a good part of the mask has none near."""
    if not tracks.visible.size:
        return [Doubt("tracks", [0], f"object: there are no tracks; {LOOK}")]
    begun = tracks.starts <= np.arange(len(tracks.visible))[:, None]
    share = (tracks.visible & begun).sum(1) / np.maximum(begun.sum(1), 1)
    out = []
    if few := np.flatnonzero(share < settings.seen).tolist():
        out.append(Doubt("few tracks", few, f"object: fewer than {settings.seen:.0%} of the tracks are seen{_in(few)}"))
    reach = settings.thin_spacings * max(vote_spacing(tracks.points[0][tracks.visible[0]]), 1.0)
    looked = range(0, len(masks), settings.thin_every)
    thin = [t for t in looked if _bare(masks[t], tracks.points[t][tracks.visible[t]], reach) > settings.thin]
    if thin:
        out.append(
            Doubt("thin", thin, f"object: more than {settings.thin:.0%} of the mask has no track near{_in(thin)}")
        )
    return out


def _bare(mask: Array, points: Array, reach: float) -> float:
    if not mask.any():
        return 0.0
    seen = with_pixels_of(np.zeros_like(mask), points)
    return float((distance_to(seen)[mask] > reach).mean()) if seen.any() else 1.0


def _on_border(mask: Array) -> int:
    return int(mask[0].sum() + mask[-1].sum() + mask[:, 0].sum() + mask[:, -1].sum())


def _in(frames: Sequence[int]) -> str:
    """ " in frames 3, 8 to 11": runs of frames that follow one another."""
    frames = sorted(set(frames))
    starts = [frames[0], *(b for a, b in pairwise(frames) if b > a + 1)]
    ends = [*(a for a, b in pairwise(frames) if b > a + 1), frames[-1]]
    runs = [f"{a}" if a == b else f"{a} to {b}" for a, b in zip(starts, ends, strict=True)]
    shown = runs if len(runs) <= _RUNS else [*runs[:_RUNS], f"{len(runs) - _RUNS} more"]
    return f" in frame{'s' if len(frames) > 1 else ''} {', '.join(shown)}"


_RUNS = 4


def _click(thing: str) -> str:
    return f"click it with `physreal label`, or give hints.{thing} in capture.json"


def _json(hint: Mapping[str, object]) -> str:
    kind, value = next(iter(hint.items()))
    return f'{{"{kind}": {value}}}'
