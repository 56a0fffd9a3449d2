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
    points_in_whole: int = 10
    """Points spread over the whole thing, where its expected mask is shown too."""
    points_rim: int = 6
    """Points on the background around a thing, which say what is not meant."""
    rim_gap: float = 5.0
    """They lie farther than this from the thing [px]."""
    rim_reach: float = 0.6
    """And nearer than this [share of the square root of the thing's area]."""
    margin: float = 0.03
    """Widening of the box around the expected mask, on each side [share of its size]."""
    margin_of_tracks: float = 0.06
    """Widening of the box around the visible tracks, on each side [share of its size]."""


@dataclass(frozen=True)
class CorrectionSettings:
    """How a frame that was corrected by hand is used (`corrections.py`)."""

    reach: float = 3.0
    """Where no candidate answers to a click, the mask is put right this far around it [px]."""
    doubt: float = 12.0
    """Nearer than this to a click that is off the thing, nothing of the expected mask is asked with [px]."""
    piecewise: float = 0.9
    """A mask to which a piece is added, or from which one is taken, counts so much of its pieces' score."""
    tolerance: float = 2.0
    """A track that is seen farther than this off a corrected mask votes no more [px]."""
    voters: int = 100
    """Points on a corrected mask that vote from there on, about."""
    round_trip: float = 1.0
    """They vote until the flow there and back misses by this much [px]."""


@dataclass(frozen=True)
class AppearanceSettings:
    """The memory of colours: histograms in Lab, each channel from 0 to 255."""

    light_bin: int = 20
    """Width of a bin of lightness [levels]."""
    colour_bin: int = 6
    """Width of a bin of a and of b [levels]."""
    blur: float = 0.7
    """Standard deviation of the smoothing before colours are read [px]."""
    rim: float = 2.0
    """Pixels this near to a mask's edge teach nothing [px]."""
    surroundings: float = 0.15
    """The background is learned up to this distance from all things [share of the image's diagonal]."""
    least_pixels: int = 60
    """From fewer pixels of a thing nothing is learned [px]."""
    rate: float = 0.2
    """Share of a new frame in the memory of the later frames; frame 0 is remembered beside it, with equal weight."""
    surprise: float = 1e-3
    """Likelihood of a bin that was never seen: how far a rare colour can be trusted."""
    largest: float = 2.0
    """Evidence of a colour is cut there [log-odds]."""


@dataclass(frozen=True)
class EvidenceSettings:
    """How what is known of a pixel adds up [log-odds]."""

    carried: float = 2.0
    """Of a pixel well inside the mask that the flow carried here; minus that well outside."""
    carried_depth: float = 4.0
    """Distance from the carried mask's edge at which it is well inside [px]."""
    lost: float = 0.3
    """Share of it that counts where the flow there and back disagreed on the way."""
    vote: float = 2.0
    """Of a visible track at the pixel: for its own thing, against any other."""
    vote_reach: float = 3.0
    """A vote falls off over this distance, or over the tracks' spacing where that is more [px]."""
    colour: float = 1.0
    """Weight of the colours' log-odds."""
    segmenter: float = 1.5
    """Of a pixel that all candidates hold; minus that of one which none holds."""
    score: float = 0.15
    """Weight of a candidate's own score beside the share of the evidence that it gathers."""
    piece: float = 0.5
    """A piece is added to the best candidate, or taken off it, where its mean evidence for that is more."""
    strip: float = 2.0
    """A piece is deeper than this somewhere: along a thing's edge the segmenter knows better [px]."""
    least_piece: float = 0.003
    """Smallest piece [share of the expected mask's area]."""


@dataclass(frozen=True)
class CheckSettings:
    """When a keyframe's answer is asked again, and when it is not believed."""

    overlap: float = 0.8
    """Least IoU of the answer with the carried mask."""
    area: float = 1.2
    """Largest ratio of the two areas, either way."""
    held: float = 0.5
    """A carried mask with a smaller share of pixels on which the flow agrees is no witness against the answer."""
    gain: float = 0.6
    """Least share of the evidence that the answer gathers."""
    drop: float = 0.5
    """From this mean evidence against a piece on, it is taken off a carried mask that stands in for an answer."""


@dataclass(frozen=True)
class AssociationSettings:
    """How one mask per frame is chosen by the votes of the tracks (eq. mask_tracking) and carried in between."""

    tie: float = 0.03
    """Candidates this near to the most votes count as equal [share of the voters]."""
    unlike: float = 0.3
    """Among equals a score counts this + IoU times, IoU being the likeness to the expected mask (0 to 1)."""
    carried_score: float = 0.3
    """Score of the mask that the flow carried to a keyframe, among the network's own (0 to 1)."""
    still: float = 1.5
    """A background track votes against the things if it stays within this of the background's motion [px]."""
    round_trip: float = 1.0
    """The carried mask is a guess where the flow there and back misses by more [px]."""
    texture: float = 3.0
    """And where the grey gradient around a pixel is less than this, root mean square [grey levels per px]."""
    texture_patch: int = 5
    """Side of the square around a pixel that is looked at for texture [px]."""
    stray: float = 0.15
    """A keyframe is set where the flow lost more of a mask than this since the last one [share of its pixels]."""
    beside: float = 3.0
    """A point this near to a mask's edge is on neither side of it for sure [px]."""
    least_stride: int = 4
    """But no nearer to the last one than this [frames]."""
    keyframes_back: int = 3
    """Keyframes that say once more what belongs to a thing in frame 0."""
    agreement: float = 0.5
    """A pixel of frame 0 belongs to a thing if more than this share of them, and of frame 0's own mask, say so."""
    as_it_was: float = 0.95
    """Frame 0 is not asked again where all things agree to this with what the keyframes say (IoU)."""
    reach: float = 0.1
    """Of a thing other than the object the window holds what is this near to the object [share of the diagonal]."""
    appearance: AppearanceSettings = field(default_factory=AppearanceSettings)
    evidence: EvidenceSettings = field(default_factory=EvidenceSettings)
    check: CheckSettings = field(default_factory=CheckSettings)
    window: WindowSettings = field(default_factory=WindowSettings)
    prompts: PromptSettings = field(default_factory=PromptSettings)
    correction: CorrectionSettings = field(default_factory=CorrectionSettings)


@dataclass(frozen=True)
class MotionSettings:
    """What counts as motion (`motion.Motion`)."""

    texture: float = 3.0
    """Motion is seen where the grey gradient around a pixel is more than this, root mean square [grey levels per px]."""
    patch: int = 7
    """Side of the square around a pixel that is looked at for texture [px]."""
    round_trip: float = 1.0
    """A pixel's motion is followed until the flow there and back misses by this much [px]."""
    least: float = 1.5
    """What moves less than this stands still [px]."""
    share: float = 0.2
    """And what moves less than this share of the hand's motion."""
    quantile: float = 0.9
    """The hand's motion is this quantile of its pixels' (0 to 1)."""
    looks: int = 3
    """Later frames in which candidates of frame 0 are looked at."""
    close: int = 9
    """Gaps up to this wide between what moves are closed, before the segmenter is asked for it [px]."""


@dataclass(frozen=True)
class ShadowSettings:
    """What looks like a shadow on the table (`shadow.shadow_on`); levels are natural logarithms of grey levels."""

    dark: float = 0.15
    """A shadow is darker than the table by at least this [log]."""
    darkest: float = 1.2
    """And by no more than this [log]."""
    hue: float = 0.08
    """Its colours are darker by the same, to within this [log]."""
    blur: float = 1.0
    """Standard deviation of the smoothing before colours are read [px]."""
    near: float = 0.3
    """The table's colour is the median of what does not move this near to the hand [share of the image's diagonal]."""
    weight: float = 0.9
    """A candidate that is all shadow counts less by this share."""
    extra: float = 0.5
    """A whole of which more than this share beyond its part looks like a shadow is not preferred to the part."""


@dataclass(frozen=True)
class RankingSettings:
    """How candidates of frame 0 are ranked (`ranking.fit_to_touch`)."""

    max_gap: float = 0.03
    """A target comes this near to the hand in some frame [share of the image's diagonal]."""
    gap: float = 0.5
    """A target at that gap counts less by this share than one that touches."""
    least_area: int = 30
    """A target has at least so many pixels [px]."""
    largest: float = 0.4
    """And no larger area than this [share of the image]."""
    least_contrast: float = 0.2
    """A candidate with the colours of its surroundings counts this, one with nothing in common with them 1 more."""
    outline: float = 2.0
    """Exponent of the share of a candidate's outline at which the image has an edge."""
    seam: float = 5.0
    """This near to the hand motion and outlines say nothing of the target [px]."""
    part: float = 0.05
    """Parts of a candidate smaller than this are specks [share of its largest part]."""
    seeds: int = 4
    """Points on what moves at which the segmenter is asked."""
    largest_body: float = 0.25
    """A connected textured region with a moving part is asked for if it is no larger than this [share of the image]."""
    least_moving: int = 30
    """With fewer moving pixels nothing is concluded from motion [px]."""
    still: float = 0.35
    """Exponent of the share of a candidate's textured pixels that move."""
    whole: float = 1.0
    """Exponent of the share of all moving pixels that a candidate holds."""
    untouched: float = 0.02
    """Where words are given: weight of what the hand does not touch; among many things one sounds right by chance."""
    ring: int = 16
    """Points around the hand at which the segmenter is asked."""
    ring_reach: float = 0.06
    """They lie within this distance of it [share of the image's diagonal]."""
    whole_fit: float = 0.5
    """A whole is preferred to its best part if it fits at least this share as well."""
    part_fit: float = 0.7
    """A part of the chosen mask is no rival of it, unless this share of its fit is more than the whole's."""
    nothing: float = 0.03
    """Fit of "none of these": a choice that hardly fits better is not sure."""
    rivals: int = 4
    """Candidates that are shown beside the chosen one, at most."""
    same: float = 0.8
    """Candidates with a larger IoU are the same."""
    largest_found: float = 0.5
    """A candidate of a larger area is left out at once: a table or a wall [share of the image]."""
    motion: MotionSettings = field(default_factory=MotionSettings)
    shadow: ShadowSettings = field(default_factory=ShadowSettings)
    appearance: AppearanceSettings = field(default_factory=AppearanceSettings)


@dataclass(frozen=True)
class HandSettings:
    """How a hand's landmarks become the mask of hand and arm (`hands.find_hands`)."""

    landmarks: AssociationSettings = field(default_factory=lambda: AssociationSettings(tie=0.15))
    """Of 21 landmarks three may lie beside the hand."""
    window: WindowSettings = field(default_factory=lambda: WindowSettings(margin=1.0, least=0.4))
    """Around the landmarks: a hand reaches beyond them."""
    box: float = 0.1
    """Widening of the box around the landmarks, on each side [share of its size]."""
    good: float = 0.8
    """A mask from the whole image is good enough if it holds this share of the landmarks; else a window is shown."""
    one: float = 0.3
    """Two hands that share more than this of the second one's mask are one hand."""
    steps: tuple[float, ...] = (0.6, 1.2, 2.0, 3.0)
    """The arm is asked for behind the wrist at these distances [palm lengths]."""
    breadth: float = 0.7
    """An arm lies within this of the line from the knuckles through the wrist, on either side [palm lengths]."""
    inside: float = 0.85
    """Least share of an arm's mask within that strip."""
    longest: float = 12.0
    """An arm is no larger than this [areas of its hand]."""
    gap: float = 4.0
    """And no farther than this from its hand [px]."""
    alike: float = 1.0
    """A pixel looks like a known hand's from this evidence of its colour on [log-odds]."""
    other: tuple[float, float] = (0.3, 2.5)
    """Another hand that looks so has between these areas [areas of the known hands]."""
    moves: float = 0.3
    """And at least this share of what can be seen of it moves."""
    rim: float = 0.02
    """Width of the border at which something reaches in [share of the image's diagonal]."""
    least_rim: int = 20
    """Fewer moving pixels there are nothing that reaches in [px]."""
    appearance: AppearanceSettings = field(default_factory=AppearanceSettings)


@dataclass(frozen=True)
class DoubtSettings:
    """From where on something is told to the reader as doubtful (`doubts.py`)."""

    sure: float = 0.75
    """Least certainty of the choice in frame 0 (0.5: the next best is as good)."""
    moves: float = 0.1
    """Least share of the chosen object's textured pixels that move."""
    voters: float = 0.5
    """Least share of the voters of frame 0 that are seen on a keyframe."""
    left_out: float = 0.12
    """Largest share of an object's visible voters off its mask."""
    taken_in: float = 0.08
    """Largest number of points of other things on an object's mask [share of the object's voters]."""
    overlap: float = 0.8
    """Least IoU of a keyframe's mask with the one that the flow carried there."""
    colour: float = 0.0
    """Least mean evidence of the colours on a keyframe's mask [log-odds]."""
    area: float = 1.3
    """Largest ratio of the area to its median in the frames before, either way."""
    before: int = 8
    """So many frames before [frames]."""
    looks: int = 4
    """Frames in which other hands are looked for, spread over the clip."""
    border: float = 0.3
    """Pixels on the image's border, from which on a mask is cut off [square root of its area]."""
    hand_gone: int = 5
    """A hand may be out of sight in fewer frames than this [frames]."""
    seen: float = 0.5
    """Least share of tracks that are seen in a frame."""
    thin: float = 0.25
    """Largest share of the mask that may have no track near."""
    thin_spacings: float = 4.0
    """A track is near within so many spacings of the tracks in frame 0."""
    thin_every: int = 5
    """That is looked at in every so many frames [frames]."""


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
    search_reach: float = 6.0
    """A lost point is found again no farther than this from where its neighbours carry it [px]."""
    found_miss: float = 0.7
    """There the flow to frame 0 and back misses by no more than this [px]."""
    found_shift: float = 1.0
    """And its patch lies no farther from there than this [px]."""
    found_stretch: float = 0.5
    """Nor where the neighbourhood has shrunk to less than this of its width in some direction (0 to 1)."""
    search_every: int = 2
    """Frame 0 is recognised, and lost points found again in it, every so many frames [frames]."""
    min_contrast: float = 2.0
    """New points are chosen where a patch has more contrast than this [grey levels]."""
    min_confidence: float = 0.05
    """A point in sight counts as visible unless it is right with a smaller probability than this (0 to 1). What needs
    sure points reads the confidence itself."""
    entering_every: int = 10
    """Where a thing shows a new side, new points are chosen on it every so many frames [frames]."""
    entering_gap: float = 2.0
    """New points lie farther than this from all visible ones [spacings of the points in frame 0]."""
    least_entering: int = 8
    """Fewer new points than this are not worth following."""


@dataclass(frozen=True)
class PerceptionSettings:
    """The numbers of `perceive.perceive`."""

    keyframe_stride: int = 8
    """Masks are proposed and voted on every so many frames at least, more often where the flow loses the object [frames]."""
    track_count: int = 400
    """Points tracked on the object, about."""
    hand_track_count: int = 200
    """Points tracked on the controller, about."""
    hand_reach: float = 0.25
    """The controller is tracked within this distance of the object [share of the image's diagonal]."""
    mask_tolerance: float = 2.0
    """A track may lie this far outside its thing's mask and still count as seen [px]."""
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
    hands: HandSettings = field(default_factory=HandSettings)
    ranking: RankingSettings = field(default_factory=RankingSettings)
    doubts: DoubtSettings = field(default_factory=DoubtSettings)
    queries: QuerySettings = field(default_factory=QuerySettings)
    tracking: TrackerSettings = field(default_factory=TrackerSettings)


DEFAULTS = PerceptionSettings()
