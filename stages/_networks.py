"""The networks and numbers of `segment_and_track`, from its parameters."""

from pathlib import Path

from physreal_core.errors import InputError
from physreal_core.perception.chooser import TargetChooser
from physreal_core.perception.flow import DisFlow, GmFlow
from physreal_core.perception.flow_tracker import FlowTracker
from physreal_core.perception.hand_finder import HandFinder
from physreal_core.perception.lifting import DepthNoise
from physreal_core.perception.perceive import Networks, Video
from physreal_core.perception.segmenter import Segmenter
from physreal_core.perception.settings import PerceptionSettings, TrackerSettings
from physreal_core.perception.tracker import Tracker
from pipeline.config.segment_and_track import OWN_NETWORKS, SegmentAndTrack
from pipeline.models import default_folder, require
from pipeline.reading.text import read_text
from stages._video import given_candidates

_CLIP_KEYS = ("clip_image_onnx", "clip_text_onnx", "clip_tokenizer")


def make_settings(params: SegmentAndTrack) -> PerceptionSettings:
    """The numbers of the perception."""
    noise = DepthNoise(params.depth_noise, params.depth_noise_quadratic, params.pixel_noise)
    return params.as_settings(PerceptionSettings, noise=noise, tracking=params.as_settings(TrackerSettings))


def make_networks(params: SegmentAndTrack, video: Video, capture: Path) -> Networks:
    """Opens what this capture needs: a network whose answer the capture brings is not even looked for."""
    masked = {"object", "controller"} <= set(video.masks)
    finds_hands = params.hand_finder == "mediapipe" and not {"controller"} & (set(video.hints) | set(video.masks))
    described = video.description and not {"object"} & (set(video.hints) | set(video.masks))
    return Networks(
        None if masked else _segmenter(params, video, capture),
        FlowTracker(_flow(params), params.as_settings(TrackerSettings)),
        _tracker(params),
        _hand_finder(params) if finds_hands else None,
        _chooser(params) if described else None,
    )


def _segmenter(params: SegmentAndTrack, video: Video, capture: Path) -> Segmenter | None:
    from physreal_core.perception.onnx_candidates import GivenCandidates, OnnxCandidates
    from physreal_core.perception.sam2 import Sam2Segmenter

    height, width = video.frames[0].shape[:2]
    given = given_candidates(capture, len(video.frames), (width, height))
    if given is not None:
        return GivenCandidates(video.frames, given)
    if params.segmenter == "none":
        return None
    if params.segmenter == "candidates":
        network = _named(params.segmenter_onnx, "segmenter_onnx")
        return OnnxCandidates(network, min_score=params.min_candidate_score, threads=params.threads)
    own = (params.sam2_encoder_onnx, params.sam2_decoder_onnx)
    files = {} if all(own) else require("sam2", default_folder())
    encoder, decoder = (
        _path(o) if o else files[f] for o, f in zip(own, ("sam2_encoder.ort", "sam2_decoder.onnx"), strict=True)
    )
    return Sam2Segmenter(encoder, decoder, threads=params.threads)


def _tracker(params: SegmentAndTrack) -> Tracker | None:
    from physreal_core.perception.onnx_tracker import OnnxTracker

    if params.tracker == "flow":
        return None
    return OnnxTracker(_named(params.tracker_onnx, "tracker_onnx"), threads=params.threads)


def _flow(params: SegmentAndTrack) -> DisFlow | GmFlow:
    if params.flow == "dis":
        return DisFlow()
    network = next(iter(require("gmflow", default_folder()).values()))
    return GmFlow(network, refine=DisFlow(), threads=params.threads)


def _hand_finder(params: SegmentAndTrack) -> HandFinder:
    from physreal_core.perception.mediapipe_hands import MediaPipeHands

    files = require("hands", default_folder())
    return MediaPipeHands(files["palm.onnx"], files["hand_landmark.onnx"], threads=params.threads)


def _chooser(params: SegmentAndTrack) -> TargetChooser | None:
    """Who reads the description; None: nobody, the target is what the hand touches."""
    from physreal_core.perception.text_choosers import ClipChooser, ConseChooser
    from physreal_core.perception.text_encoder import TextEncoder

    threads = params.threads
    if params.target == "touch":
        return None
    if params.target == "clip":
        image, text, tokenizer = (_named(getattr(params, k), k) for k in _CLIP_KEYS)
        return ClipChooser(image, TextEncoder(text, tokenizer, threads=threads), threads=threads)
    texts, images, names = (require(n, default_folder()) for n in ("minilm", "efficientnet", "imagenet_names"))
    return ConseChooser(
        images["efficientnet_lite0.onnx"],
        read_text(names["imagenet_names.txt"]).splitlines(),
        TextEncoder(texts["minilm.onnx"], texts["minilm_tokenizer.json"], threads=threads),
        threads=threads,
    )


def _named(path: str | None, key: str) -> Path:
    if path is None:
        raise InputError("no network is named", where=f"params.yaml, segment_and_track.{key}", expected="a path")
    return _path(path)


def _path(path: str) -> Path:
    """A path in params.yaml, from the project's root.

    Raises:
        InputError: there is no such file, or it lies behind a link to a folder, which DVC does not look into.
    """
    from pipeline.project import Project

    root = Project.find().root
    network = root / path
    if not network.is_file():
        raise InputError("there is no such network", where=path, remedy="put it there, or a link to it")
    inside = (folder for folder in Path(path).parents if len(folder.parts) > len(OWN_NETWORKS.parts))
    if linked := [folder for folder in inside if (root / folder).is_symlink()]:
        raise InputError(
            f"{linked[0]} is a link to a folder",
            where=path,
            expected="a folder, so that DVC sees what changes in it",
            remedy="make it a folder with links to the files",
        )
    return network
