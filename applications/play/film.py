"""A session without a browser: the filmed motion or a log, drawn into a video, and the states that it went through."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from applications.appearance import Appearance
from applications.play.pulls import LOG
from applications.twin import Twin
from physreal_core.array_types import Array, Float, UInt8
from physreal_core.errors import InputError
from physreal_core.perception.overlay import write_video
from physreal_core.rendering import Gaussians, render_carried
from physreal_core.simulation.play import FrameState
from pipeline.reading.text import read_record, understood

BACKGROUND = (0.93, 0.94, 0.96)


@dataclass(frozen=True)
class Log:
    """What `physreal play` wrote of a session.

    Attributes:
        sequence, stage: whose model.
        ball: radius of the ball [m], None without one.
        scene: mesh file of the solids around it, None without one.
        backdrop: what is seen behind it, `filmed` or a file of splats; None without.
        frames: how many the session had.
        actions: as `physreal_core.playing.replayed` takes them.
    """

    sequence: str
    stage: str
    ball: float | None
    scene: Path | None
    backdrop: str | None
    frames: int
    actions: list[dict]

    @classmethod
    def read(cls, path: Path) -> "Log":
        """A log.json, or that in a pull's folder; InputError where it is none."""
        path, remedy = path / LOG if path.is_dir() else path, "give a log.json that `physreal play` wrote"
        record = read_record(path, ("sequence", "model", "ball", "frames", "actions"), remedy)
        with understood(path, remedy):
            ball = None if record["ball"] is None else float(record["ball"])
            scene, backdrop = record.get("scene"), record.get("backdrop")  # logs of earlier versions have neither
            return cls(
                sequence=record["sequence"],
                stage=record["model"],
                ball=ball,
                scene=None if scene is None else Path(scene),
                backdrop=backdrop,
                frames=int(record["frames"]),
                actions=list(record["actions"]),
            )


def film(twin: Twin, states: Iterator[FrameState], path: Path, fps: float) -> Float[Array, "T N 3"]:
    """Draw the states into an mp4 as the filmed camera would see them, and return the particles' positions [m]."""
    look, still = Appearance.of(twin), _still(twin)
    x0 = torch.as_tensor(twin.problem.body.x0, dtype=torch.float32)
    pictures: list[UInt8[Array, "h w 3"]] = []
    places = []
    for state in states:
        x, F = state.x.cpu().float(), state.F.cpu().float()
        with torch.no_grad():
            drawn = render_carried(look.gaussians, look.binding, x0, x, F, look.camera, BACKGROUND, still=still).rgb
        pictures.append((drawn.clamp(0, 1) * 255).round().to(torch.uint8).numpy())
        places.append(x.numpy().copy())
    if not pictures:
        raise InputError("no frame", where="physreal play --record", expected="one or more", remedy="raise --frames")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_video(path, pictures, fps)
    return np.stack(places)


def _still(twin: Twin) -> Gaussians | None:
    """The solids around it and the backdrop; None where there is neither."""
    parts = ([twin.scene.look[0]] if twin.scene else []) + ([twin.backdrop.gaussians] if twin.backdrop else [])
    return _joined(parts) if parts else None


def _joined(parts: list[Gaussians]) -> Gaussians:
    """All of them, their harmonics filled up with zeros to the highest degree."""
    bands = max(part.harmonics.shape[1] for part in parts)
    harmonics = [torch.nn.functional.pad(part.harmonics, (0, 0, 0, bands - part.harmonics.shape[1])) for part in parts]
    same = ("means", "log_scales", "rotations", "opacity_logits")
    return Gaussians(*(torch.cat([getattr(part, name) for part in parts]) for name in same), torch.cat(harmonics))


def written(path: Path, places: Float[Array, "T N 3"]) -> str:
    """A sentence about what was written; the states lie beside the video."""
    beside = path.with_suffix(".npz")
    np.savez_compressed(beside, x=places)
    return f"wrote {path} ({len(places)} frames) and {beside}"
