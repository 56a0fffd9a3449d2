"""The camera at working size, as the core takes it."""

from pathlib import Path

from physreal_core.rendering import Camera
from pipeline.products.camera import RecordedCamera, require_world


def load_camera(parsed: Path) -> Camera:
    """The camera in parse_video's output, of a capture with images.

    Raises:
        InputError: nothing set the world.
    """
    view = RecordedCamera.load(parsed)
    require_world(view.T_world_camera, has_depth=False, where=str(parsed))
    return Camera(view.K, view.T_world_camera, view.width, view.height)
