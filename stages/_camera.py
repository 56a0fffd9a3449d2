"""The camera at working size, as the core takes it."""

from pathlib import Path

from physreal_core.rendering import Camera
from pipeline.products.camera import RecordedCamera


def load_camera(parsed: Path) -> Camera:
    """The camera in parse_video's output, of a capture with images."""
    view = RecordedCamera.load(parsed)
    return Camera(view.K, view.T_world_camera, view.width, view.height)
