"""Interactive video parsing (paper, III-B): object and controller masks, tracks, their lift to 3D, controller points."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from physreal_core.array_types import Array, Bool, Float, UInt8
from physreal_core.checkpoints import record_array, record_of, remembered
from physreal_core.errors import InputError
from physreal_core.perception.association import Thing, follow_masks
from physreal_core.perception.choices import Choice
from physreal_core.perception.chooser import TargetChooser
from physreal_core.perception.controllers import ControllerMotion, move_controllers, pick_controllers, with_depth
from physreal_core.perception.corrections import Correction, Corrections
from physreal_core.perception.doubts import Doubt, find_doubts
from physreal_core.perception.entering import with_entering
from physreal_core.perception.flow_tracker import FlowTracker
from physreal_core.perception.frame_zero import find_controllers, find_object
from physreal_core.perception.hand_finder import HandFinder
from physreal_core.perception.hands import more_hands
from physreal_core.perception.lifting import LiftedTracks, depth_at, lift_tracks
from physreal_core.perception.mask_geometry import distance_to, large_parts, signed_distance
from physreal_core.perception.motion import Motion, watch
from physreal_core.perception.onnx_tracker import inside_masks
from physreal_core.perception.queries import background_queries, hand_queries, spread_over
from physreal_core.perception.segmenter import Segmenter
from physreal_core.perception.settings import PerceptionSettings
from physreal_core.perception.support import lies_flat, without_support
from physreal_core.perception.tracker import Tracker, Tracks
from physreal_core.perception.without_depth import PALM, depth_at_hand, lifted_by_size, lifted_in_frame_zero
from physreal_core.resting import Resting

_HAND_ON_MASK = 0.2  # share of a known hand's landmarks that lie on a controller's mask, at least


@dataclass(frozen=True)
class Video:
    """RGB frames [T, H, W, 3] and what is known of them.

    Attributes:
        depth: [T, H, W] m along the camera's z, 0 = no reading; None for a colour video.
        K, T_world_camera: intrinsics [px], camera to world.
        hints: {"object": {...}, "controller": {...}}, see `chooser.hint_prompts`.
        masks: given masks [T, H, W] by "object" or "controller"; they replace the segmentation.
        tracks: given tracks of the object; they replace the tracker.
        corrections: of frames whose masks somebody put right by hand; those of a thing with given masks are not used.
        resting: of a colour video whose object lies on the support plane in frame 0; None where nothing tells where it is.
    """

    frames: Sequence[UInt8[Array, "H W 3"]]
    depth: Float[Array, "T H W"] | None
    K: Float[Array, "3 3"]
    T_world_camera: Float[Array, "4 4"]
    description: str = ""
    hints: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    masks: Mapping[str, Bool[Array, "T H W"]] = field(default_factory=dict)
    tracks: Tracks | None = None
    corrections: Sequence[Correction] = ()
    resting: Resting | None = None


@dataclass(frozen=True)
class Networks:
    """What does the seeing. `flow` carries masks between keyframes and is the tracker unless another one is given."""

    segmenter: Segmenter | None
    flow: FlowTracker
    tracker: Tracker | None = None
    hand_finder: HandFinder | None = None
    chooser: TargetChooser | None = None


@dataclass(frozen=True)
class Perceived:
    """Masks [T, H, W], tracks and their lift, controller motion (None where nothing tells how far anything is), and a report of how it went."""

    object_masks: Bool[Array, "T H W"]
    controller_masks: Bool[Array, "T H W"]
    tracks: Tracks
    lifted: LiftedTracks
    controllers: ControllerMotion | None
    report: dict[str, Any]
    choices: Mapping[str, Choice] = field(default_factory=dict)
    doubts: Sequence[Doubt] = ()


def perceive(
    video: Video, networks: Networks, settings: PerceptionSettings, tick: Callable[[str], None] = lambda step: None
) -> Perceived:
    """Everything that the video says about the object and what moves it.

    Args:
        video: the frames and what is known of them.
        networks: what does the seeing.
        settings: the numbers.
        tick: called with the name of the step whenever a part of the work is done.

    Raises:
        InputError: no controller found, an empty object mask in frame 0, masks of another size.
    """
    report: dict[str, Any] = {}
    choices = _chosen(video, networks, settings, tick)
    report["chosen_by"] = {name: choice.how for name, choice in choices.items()}
    tracker = networks.tracker or networks.flow
    first = {name: choice.mask for name, choice in choices.items()}
    masks = _followed(video, networks, settings, tracker, first, report, tick)
    keyframes = {name: {int(t): k for t, k in told.items()} for name, told in report.get("keyframes", {}).items()}
    hands = [name for name in first if name != "object"]
    queries = _queries({name: mask[0] for name, mask in masks.items()}, settings)
    tracks = video.tracks or _tracks_on(masks["object"], tracker, video.frames, queries["object"], settings, True)
    tick("tracks")
    if video.depth is not None:
        lifted = lift(video, tracks, settings)
        # a depth that jumps is an occlusion or a loss
        tracks = replace(tracks, visible=tracks.visible & ~_jumped(video.depth, tracks, lifted, settings))
        motions = [_controller(video, masks, n, queries[n], len(hands), tracker, settings) for n in hands]
    elif video.resting is not None:
        depth = video.resting.depth(masks["object"][0], video.K, video.T_world_camera)
        lifted = lifted_in_frame_zero(tracks, depth, video.K, video.T_world_camera, settings.noise)
        motions = [_by_its_size(video, masks[n], depth, len(hands), tracker, settings) for n in hands]
        report["depth"] = (
            "none: the object lies on the support plane in frame 0, and the hand's distance is by its size"
        )
    else:
        lifted, motions = unlifted(tracks), []
        report["controller"] = "no depth: controller points cannot be placed in 3D"
    controllers = _together(motions) if motions else None
    if controllers is not None:
        report["controller_interpolated_frames"] = controllers.interpolated
    from_start = tracks.visible[:, tracks.starts == 0]
    report["visible_share_per_frame"] = [round(float(v), 4) for v in from_start.mean(1)] if from_start.size else []
    hand_masks = np.any([masks[n] for n in hands], axis=0) if hands else np.zeros_like(masks["object"])
    strangers = _strangers(video, networks, settings.doubts.looks, hand_masks)
    doubts = find_doubts(choices, masks, keyframes, tracks, strangers, settings.doubts)
    report["warnings"] = [doubt.sentence for doubt in doubts]
    return Perceived(masks["object"], hand_masks, tracks, lifted, controllers, report, choices, doubts)


def lift(video: Video, tracks: Tracks, settings: PerceptionSettings) -> LiftedTracks:
    """Tracks to 3D by the video's depth."""
    return lift_tracks(
        tracks.points,
        tracks.visible,
        video.depth,
        video.K,
        video.T_world_camera,
        max_edge=settings.max_depth_edge,
        max_stray=settings.max_stray,
        noise=settings.noise,
    )


def unlifted(tracks: Tracks) -> LiftedTracks:
    """Tracks of which nothing is known in 3D."""
    shape = tracks.visible.shape
    unknown = np.full((*shape, 3), np.nan, np.float32)
    return LiftedTracks(unknown, np.zeros(shape, bool), unknown[..., 0])


def _chosen(
    video: Video, networks: Networks, settings: PerceptionSettings, tick: Callable[[str], None]
) -> dict[str, Choice]:
    """`_frame_zero`, from its checkpoint where there is one."""
    size = video.frames[0].shape[:2]

    def choose() -> dict[str, Array]:
        choices = _frame_zero(video, networks, settings, tick)
        target = choices["object"]
        return {
            "masks": np.stack([choice.mask for choice in choices.values()]),
            "cores": np.stack([choice.hand for choice in choices.values()]),
            "rivals": target.mask[None] if target.rivals is None else target.rivals,
            "shares": np.ones(1) if target.shares is None else target.shares,
            "told": record_array([(name, choice.how, choice.moves) for name, choice in choices.items()]),
        }

    shapes = {name: (None, *size) for name in ("masks", "cores", "rivals")} | {"shares": (None,), "told": (None,)}
    clicks = [one.told() for one in video.corrections if one.frame == 0]
    depends = [video.frames[0], sorted(video.hints.items()), clicks, settings]
    found = remembered("frame zero", lambda: depends, shapes, choose, lasting=True)
    out = {}
    for (name, how, moves), mask, core in zip(record_of(found["told"]), found["masks"], found["cores"], strict=True):
        if name == "object":
            out[name] = Choice(mask, how, found["rivals"], found["shares"], moves=moves)
        else:
            out[name] = Choice(mask, how, core=core)
    return out


def _frame_zero(
    video: Video, networks: Networks, settings: PerceptionSettings, tick: Callable[[str], None]
) -> dict[str, Choice]:
    """The object's mask and the controllers' in frame 0; "object" first."""
    image, given = video.frames[0], video.masks
    motion = None if {"object", "controller"} <= set(given) else _motion(video, networks, settings)
    if "controller" in given:
        parts = large_parts(given["controller"][0], settings.least_part, settings.least_part_share)
        hands = [Choice(part, "given masks/controller") for part in parts]
        if not hands:
            raise InputError(
                "no controller found", where="masks/controller, frame 0", expected="a mask that is not empty"
            )
    else:
        segmenter, moves = _needed(networks.segmenter), settings.ranking.motion
        hands = find_controllers(
            image, video.hints.get("controller"), networks.hand_finder, segmenter, settings.hands, motion, moves
        )
        hands += more_hands(image, hands, motion, segmenter, settings.hands, moves)
    tick("controller in frame 0")
    if "object" in given:
        target = Choice(given["object"][0], "given masks/object")
        if not target.mask.any():
            raise InputError("the object's mask is empty", where="masks/object, frame 0", expected="a mask with pixels")
    else:
        target = find_object(
            image,
            video.hints.get("object"),
            hands,
            _needed(networks.segmenter),
            description=video.description,
            chooser=networks.chooser,
            motion=motion,
            settings=settings.ranking,
        )
        target = replace(target, mask=_standing(video, target.mask, 0, settings))
    tick("object in frame 0")
    names = ["controller"] if len(hands) == 1 else [f"controller {i}" for i in range(len(hands))]
    return _put_right(
        {"object": target} | dict(zip(names, hands, strict=True)), _corrections(video, networks, settings)
    )


def _motion(video: Video, networks: Networks, settings: PerceptionSettings) -> Motion:
    return watch(video.frames, _flow_between(video, networks), settings.ranking.motion)


def _put_right(choices: dict[str, Choice], corrections: Corrections) -> dict[str, Choice]:
    """The choices of frame 0 with what was corrected there by hand."""
    masks = {name: choice.mask.copy() for name, choice in choices.items()}
    certain = corrections.apply(0, masks)
    return {
        name: replace(
            choice,
            mask=masks[name],
            core=None if choice.core is None else choice.core & masks[name],
            how=f"{choice.how}, corrected by hand" if name in certain else choice.how,
        )
        for name, choice in choices.items()
    }


def _corrections(video: Video, networks: Networks, settings: PerceptionSettings) -> Corrections:
    """Those of things without given masks."""
    return Corrections(
        [one for one in video.corrections if one.thing not in video.masks],
        video.frames,
        networks.segmenter,
        _flow_between(video, networks),
        settings.association,
        settings.queries,
    )


def _followed(
    video: Video,
    networks: Networks,
    settings: PerceptionSettings,
    tracker: Tracker,
    first: Mapping[str, Array],
    report: dict[str, Any],
    tick: Callable[[str], None],
) -> dict[str, Array]:
    """`_all_masks`, from its checkpoint where there is one; what it tells goes into the report."""

    def follow() -> dict[str, Array]:
        told: dict[str, Any] = {}
        masks = _all_masks(video, networks, settings, tracker, first, told, tick)
        return {"masks": np.stack([masks[name] for name in first]), "told": record_array(told)}

    shape = len(first), len(video.frames), *video.frames[0].shape[:2]
    clicks = [one.told() for one in video.corrections]
    found = remembered("masks", lambda: [*first.values(), clicks], {"masks": shape, "told": (None,)}, follow)
    report.update(record_of(found["told"]))
    return dict(zip(first, found["masks"], strict=True))


def _all_masks(
    video: Video,
    networks: Networks,
    settings: PerceptionSettings,
    tracker: Tracker,
    first: Mapping[str, Array],
    report: dict[str, Any],
    tick: Callable[[str], None],
) -> dict[str, Array]:
    if set(video.masks) >= {"object", "controller"}:
        hands = [n for n in first if n != "object"]
        parts = _split_between(video.masks["controller"], [first[n] for n in hands])
        return {"object": video.masks["object"], **dict(zip(hands, parts, strict=True))}
    # Votes need no more than the flow's chain: what drifts a little is still on its thing.
    chained = networks.tracker or replace(networks.flow, anchored=False)
    things = [
        Thing(name, mask, _votes(chained, video, spread_over(mask, settings.track_count, settings.queries)))
        for name, mask in first.items()
    ]
    still = replace(networks.flow, anchored=False)
    away = background_queries(np.any(list(first.values()), axis=0), settings.queries)
    background = _votes(still, video, away)
    tick("votes")

    def settled(count: int) -> None:
        for _ in range(count):
            tick("masks of a frame")

    corrections = _corrections(video, networks, settings)
    followed = follow_masks(
        video.frames,
        things,
        background,
        _needed(networks.segmenter),
        _flow_between(video, networks),
        stride=settings.keyframe_stride,
        settings=settings.association,
        corrections=corrections,
        tick=settled,
    )
    report["keyframes_without_vote"] = {n: frames for n in first if (frames := followed.unanswered(n))}
    report["keyframes"] = {
        n: {str(t): {k: round(v, 3) for k, v in told.items()} for t, told in keys.items()}
        for n, keys in followed.keyframes.items()
    }
    masks = dict(followed.masks)
    if "object" in video.masks:
        masks["object"] = video.masks["object"]
    # of a thing that lies flat, as a cloth does, the part that is not lifted yet lies on the table as its shadow would
    elif not _lies_flat(video, first["object"], settings):
        certain = corrections.of("object")
        own = [m if t in certain else _standing(video, m, t, settings) for t, m in enumerate(masks["object"])]
        masks["object"] = np.stack(own)
    return masks


def _strangers(video: Video, networks: Networks, looks: int, hands: Bool[Array, "T H W"]) -> list[int]:
    """Of a few frames spread over the clip those in which a hand is found where no controller is."""
    if networks.hand_finder is None:
        return []
    found = []
    for t in np.unique(np.linspace(0, len(video.frames) - 1, looks).astype(int)).tolist():
        for hand in networks.hand_finder.find(video.frames[t]):
            on = inside_masks(hand.points[None], hands[t][None])[0]
            if on.mean() < _HAND_ON_MASK:
                found.append(t)
                break
    return found


def _votes(tracker: Tracker, video: Video, queries: Float[Array, "J 2"]) -> Tracks:
    """Tracks that vote, from an earlier run where there are some."""

    def track() -> dict[str, Array]:
        return vars(tracker.track(video.frames, queries))

    size = len(video.frames), len(queries)
    shapes = {"points": (*size, 2), "visible": size, "confidence": size, "starts": size[1:]}
    depends = [video.frames[0], queries, getattr(tracker, "anchored", True)]
    return Tracks(**remembered("votes", lambda: depends, shapes, track, lasting=True))


def _standing(video: Video, mask: Array, t: int, settings: PerceptionSettings) -> Array:
    """The object's mask in frame t without its shadow and table, where depth can tell."""
    if video.depth is None:
        return mask
    return without_support(mask, video.depth[t], video.K, video.T_world_camera, settings.noise)


def _lies_flat(video: Video, mask: Array, settings: PerceptionSettings) -> bool:
    """Whether the object, whose mask in frame 0 this is, lies flat on the table, where depth can tell."""
    return video.depth is not None and lies_flat(mask, video.depth[0], video.K, video.T_world_camera, settings.noise)


def _controller(
    video: Video,
    masks: Mapping[str, Array],
    name: str,
    queries: Array,
    hand_count: int,
    tracker: Tracker,
    settings: PerceptionSettings,
) -> ControllerMotion:
    start = _start(video, video.depth[0], masks[name][0], masks["object"][0], hand_count, settings)
    lifted = lift(video, _tracks_on(masks[name], tracker, video.frames, queries, settings), settings)
    return move_controllers(start, lifted.points, lifted.valid, smoothing=settings.controller_smoothing)


def _start(
    video: Video, depth: Array, hand: Array, thing: Array, hand_count: int, settings: PerceptionSettings
) -> Float[Array, "points 3"]:
    """The points in frame 0, of this depth, that stand for a hand with this mask [m]."""
    count = max(settings.controller_count // hand_count, settings.least_controllers)
    seen, touched = (_surface(video, depth, mask, settings) for mask in (hand, thing))
    face = pick_controllers(seen, touched, count, settings.controller_reach)
    return with_depth(face, video.T_world_camera[:3, 3], settings.controller_thickness)


def _by_its_size(
    video: Video, masks: Array, depth: Array, hand_count: int, tracker: Tracker, settings: PerceptionSettings
) -> ControllerMotion:
    """Of a hand without depth; `depth` is that of the object in frame 0."""
    hand, thing = masks[0], depth > 0
    far = depth_at_hand(depth, hand, settings.controller_thickness)
    start = _start(video, np.where(hand, far, depth), hand, thing, hand_count, settings)
    reach = PALM * video.K[0, 0] / far / np.hypot(*hand.shape)
    queries = hand_queries(hand, thing, settings.hand_track_count, reach, settings.queries)
    tracks = _tracks_on(masks, tracker, video.frames, queries, settings)
    lifted = lifted_by_size(tracks, far, video.K, video.T_world_camera, settings.noise)
    return move_controllers(start, lifted.points, lifted.valid, smoothing=settings.controller_smoothing)


def _together(motions: Sequence[ControllerMotion]) -> ControllerMotion:
    interpolated = sorted({t for m in motions for t in m.interpolated})
    return ControllerMotion(np.concatenate([m.points for m in motions], 1), motions[0].poses, interpolated)


def _surface(video: Video, depth: Array, mask: Array, settings: PerceptionSettings) -> Float[Array, "P 3"]:
    """World points of a mask of frame 0 with trustworthy depth [m]."""
    pixels = np.argwhere(mask)[:, ::-1].astype(np.float64)
    visible = np.ones((1, len(pixels)), bool)
    z = depth_at(depth, pixels, settings.max_depth_edge)
    pixels, visible = pixels[z > 0], visible[:, z > 0]
    lifted = lift_tracks(
        pixels[None], visible, depth[None], video.K, video.T_world_camera, max_edge=settings.max_depth_edge
    )
    return lifted.points[0][lifted.valid[0]]


def _tracks_on(
    masks: Array,
    tracker: Tracker,
    frames: Sequence[Array],
    queries: Array,
    settings: PerceptionSettings,
    entering: bool = False,
) -> Tracks:
    """Tracks that are only seen on their own mask, or nearly so; with those of points that enter later, if wanted."""
    near = np.stack([signed_distance(mask) > -settings.mask_tolerance for mask in masks])
    tracks = tracker.track(frames, queries, ~near)
    if entering and isinstance(tracker, FlowTracker):
        tracks = with_entering(tracks, tracker, frames, masks, ~near, settings.queries)
    return replace(tracks, visible=tracks.visible & inside_masks(tracks.points, near))


def _jumped(depth: Array, tracks: Tracks, lifted: LiftedTracks, settings: PerceptionSettings) -> Array:
    """Visible points that have a depth reading which does not fit their neighbours' motion."""
    z = np.stack([depth_at(d, p, settings.max_depth_edge) for d, p in zip(depth, tracks.points, strict=True)])
    return tracks.visible & (z > 0) & ~lifted.valid


def _queries(masks: Mapping[str, Array], settings: PerceptionSettings) -> dict[str, Float[Array, "J 2"]]:
    """Which pixels of frame 0 are tracked, by name of the thing whose mask [H, W] they lie on."""
    thing, own = masks["object"], settings.queries
    hands = {
        name: hand_queries(mask, thing, settings.hand_track_count, settings.hand_reach, own)
        for name, mask in masks.items()
        if name != "object"
    }
    return {"object": spread_over(thing, settings.track_count, own), **hands}


def _split_between(masks: Array, first: Sequence[Array]) -> list[Array]:
    """Given controller masks shared out among the hands of frame 0: each pixel to the hand nearest in the frame before."""
    if len(first) == 1:
        return [masks]
    parts = [np.zeros_like(masks) for _ in first]
    before = list(first)
    for t, mask in enumerate(masks):
        nearest = np.argmin([distance_to(b) for b in before], axis=0)
        for i, part in enumerate(parts):
            part[t] = mask & (nearest == i)
            before[i] = part[t] if part[t].any() else before[i]
    return parts


def _flow_between(video: Video, networks: Networks) -> Callable[[int, int], Array]:
    return lambda source, target: networks.flow.flow_between(video.frames, source, target)


def _needed(segmenter: Segmenter | None) -> Segmenter:
    if segmenter is None:
        raise InputError(
            "no segmenter is configured and the capture gives no masks",
            where="params.yaml, segment_and_track.segmenter",
            remedy="set it to sam2 (and run `physreal models`), or give masks/object/ and masks/controller/",
        )
    return segmenter
