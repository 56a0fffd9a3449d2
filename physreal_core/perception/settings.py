"""The numbers of the perception, each with its meaning and unit. A number of `PerceptionSettings` that also stands in
params.yaml, under `segment_and_track`, has the same name there."""

from dataclasses import dataclass, field

from physreal_core.perception.lifting import DepthNoise


@dataclass(frozen=True)
class WindowSettings:
    """The part of the image that a segmenter is shown, so that a small thing is seen large."""

    margin: float = 0.15
    """Widening around what is looked for, on each side [share of its size]."""
    least: float = 0.3
    """Least side of a window [share of the image's side]."""
    whole: float = 0.7
    """A window of a larger area than this is the whole image [share of the image's area]."""
    wider: float = 0.5
    """Widening around a mask that its window cut off, on each side [share of its size]."""
    widenings: int = 3
    """How often a window is widened at most."""
    cut: int = 2
    """A window cuts a mask off where more of the mask's pixels than this lie on a side within the image [px]."""


@dataclass(frozen=True)
class PromptSettings:
    """How a segmenter is asked for a thing."""

    points: int = 6
    """Points on the thing, where points alone are given."""
    points_in_box: int = 3
    """Points on the thing, where a box is given too."""
    points_off: int = 2
    """Points on each other thing, which say what is not meant."""
    margin: float = 0.03
    """Widening of the box around the expected mask, on each side [share of its size]."""
    margin_of_tracks: float = 0.06
    """Widening of the box around the visible tracks, on each side [share of its size]."""


@dataclass(frozen=True)
class AssociationSettings:
    """How one mask per frame is chosen by the votes of the tracks (eq. mask_tracking) and carried in between."""

    tie: float = 0.03
    """Candidates this near to the most votes count as equal [share of the voters]."""
    unlike: float = 0.3
    """Among equals a score counts this + IoU times, IoU being the likeness to the expected mask (0 to 1)."""
    carried_score: float = 0.3
    """Score of the mask that the flow carried to a keyframe, among the network's own (0 to 1)."""
    least_voters: int = 3
    """With fewer visible tracks a thing is not voted on: the carried mask stands."""
    near: float = 6.0
    """Pixels this near to a visible track may belong to its thing in any case [px]."""
    near_spacings: float = 3.0
    """And those within so many spacings of the tracks, where that is more."""
    spacing_neighbours: int = 3
    """The tracks' spacing is the median distance to the nearest so many, counting the track itself."""
    keyframes_back: int = 3
    """Keyframes that say once more what belongs to a thing in frame 0."""
    agreement: float = 0.5
    """A pixel of frame 0 belongs to a thing if more than this share of them, and of frame 0's own mask, say so."""
    window: WindowSettings = field(default_factory=WindowSettings)
    prompts: PromptSettings = field(default_factory=PromptSettings)


@dataclass(frozen=True)
class QuerySettings:
    """Which pixels of frame 0 are tracked."""

    rim: float = 1.5
    """Tracked points lie farther than this within their mask's edge [px]."""
    least_inner: int = 20
    """A mask with fewer pixels than this within the rim is used up to its edge [px]."""
    least_near: int = 50
    """A hand with fewer pixels than this within `hand_reach` of the object is tracked as a whole [px]."""
    background_gap: float = 3.0
    """Points of the background lie farther than this from all things [px]."""
    background_near: float = 0.12
    """Up to this distance from the things, the background is tracked more densely [share of the image's diagonal]."""
    background_near_count: int = 600
    """Points tracked there, about."""
    background_far_count: int = 200
    """Points tracked on the rest of the background, about."""


@dataclass(frozen=True)
class TrackerSettings:
    """How points are followed (`flow_tracker.FlowTracker`)."""

    max_round_trip: float = 1.0
    """A point is lost where the flow there and back misses by more [px]."""
    round_trip_share: float = 0.05
    """And by more than this share of the step itself on top: fast motion is measured less well."""
    neighbours: int = 16
    """Tracks that say how the surface around a point moves."""
    least_neighbours: int = 4
    """With fewer tracks in sight around it, nothing is said of how a point should move."""
    spread_floor: float = 0.5
    """Neighbours that agree to this are taken to agree no better [px]."""
    max_departure: float = 5.0
    """A point is lost that departs from its neighbours by more than so many times as they do themselves."""
    min_stretch: float = 0.3
    """A point is lost whose neighbourhood has shrunk to less than this of its width in some direction: its surface has
    turned away, and points pile up where it does (0 to 1)."""
    max_step_colour: float = 0.04
    """A point is lost where the mean colour around it changes by more than this from one frame to the next: something
    came before it [share of the brightness]."""
    step_patch: int = 4
    """Half side of the patch whose colour that is [px]."""
    max_colour_change: float = 0.04
    """A lost point is found again only where the mean colour is the same to this [share of the brightness]."""
    patch: int = 4
    """Half side of the patch that a point is known by [px]."""
    grey_noise: float = 6.0
    """Standard deviation of an image's noise [grey levels]."""
    min_likeness: float = 0.85
    """Least correlation with its patch for a point to be corrected by it (-1 to 1)."""
    found_likeness: float = 0.75
    """Least correlation with its patch for a lost point to be found again; its neighbours must agree, too (-1 to 1)."""
    max_correction: float = 3.0
    """A patch corrects a point by no more than this [px]."""
    max_strain: float = 1.0
    """A patch moves a point away from where its neighbours carry it no farther than so many times their own spread."""
    renewed_below: float = 0.9
    """A point that is corrected while it looks less alike than this gets a new patch: it has turned (-1 to 1)."""
    renewed_after: int = 10
    """A point that was not corrected in so many frames, though it is seen, gets a new patch [frames]."""
    search_reach: int = 6
    """A lost point is looked for this far around where its neighbours carry it [px]."""
    found_departure: float = 3.0
    """It is found no farther from there than so many times the neighbours' own spread."""
    found_stretch: float = 0.5
    """Nor where the neighbourhood has shrunk to less than this of its width in some direction (0 to 1)."""
    search_every: int = 2
    """Lost points are looked for every so many frames [frames]."""
    search_limit: int = 150
    """So many lost points are looked for in a frame, at most; the others have their turn later."""
    min_distinct: float = 0.05
    """A point is found again only where it is more alike by this than anywhere else in reach."""
    min_contrast: float = 5.0
    """A patch with less contrast than this cannot be looked for [grey levels]."""
    min_confidence: float = 0.05
    """A point in sight counts as visible unless it is right with a smaller probability than this (0 to 1). What needs
    sure points reads the confidence itself."""


@dataclass(frozen=True)
class PerceptionSettings:
    """The numbers of `perceive.perceive`."""

    keyframe_stride: int = 5
    """Masks are proposed and voted on every so many frames [frames]."""
    track_count: int = 400
    """Points tracked on the object, about."""
    hand_track_count: int = 200
    """Points tracked on the controller, about."""
    hand_reach: float = 0.25
    """The controller is tracked within this distance of the object [share of the image's diagonal]."""
    mask_tolerance: float = 2.0
    """A track may lie this far outside its thing's mask and still count as seen [px]."""
    still_round_trip: float = 1.0
    """A pixel's motion is followed until the flow there and back misses by this much [px]."""
    max_depth_edge: float = 0.02
    """Depth spread in 3 x 3 pixels beyond which a point is on an edge, not lifted [m]."""
    max_stray: float = 0.02
    """Motion unlike the neighbours' by more is a misreading or an occlusion [m]."""
    noise: DepthNoise = field(default_factory=DepthNoise)
    """Of depth readings and of tracks."""
    controller_count: int = 30
    """Controller points on all hands' seen faces."""
    least_controllers: int = 3
    """Controller points on each hand's seen face, at least."""
    controller_reach: float = 0.05
    """They lie on the hand within this distance of the object [m]."""
    controller_thickness: float = 0.05
    """Of the hand behind its seen face, where further points stand for it [m]."""
    controller_smoothing: float = 0.5
    """Standard deviation of the temporal smoothing of the hand's motion [frames]."""
    least_part: int = 30
    """A part of a given controller mask with fewer pixels is no hand [px]."""
    least_part_share: float = 0.1
    """Nor is one with a smaller share of the largest part's pixels."""
    association: AssociationSettings = field(default_factory=AssociationSettings)
    queries: QuerySettings = field(default_factory=QuerySettings)
    tracking: TrackerSettings = field(default_factory=TrackerSettings)


DEFAULTS = PerceptionSettings()
