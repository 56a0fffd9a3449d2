"""The silicone beam of Dubied et al. (sim-to-real for soft robots): motion capture of a cantilever let go, 100 Hz.

World frame: x along the beam from the clamped face (x = 0) to the tip, y across, z up; the beam's axis lies at
z = 0.5 m, so that the support plane z = 0 is out of reach. Beam: 30 x 30 x 100 mm.

The recording's own frame has column 0 up and column 2 along the beam, tilted by 6.6 degrees against it. As its authors
do, the six markers of frame 0 are laid rigidly onto the places where they were mounted (balls 6 mm off the tip's faces
and on the clamp's block), and gravity is taken at right angles to the beam; along the beam it would add 0.02 mm.
"""

from pathlib import Path

import numpy as np

from data.importers._options import Positive, Share
from data.importers._values import numbers, positive
from data.importers._writing import first_part_observed, new_capture, rigid, write_description
from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError
from physreal_core.geometry.mesh import read_trimesh
from pipeline.products.given_tracks import GivenTracks3d
from pipeline.reading.arrays import read_npz
from pipeline.reading.files import regular_file

LENGTH, WIDTH, AXIS_HEIGHT = 0.100, 0.030, 0.5  # [m]
DENSITY = 1070.0  # [kg/m^3]
GRAVITY = 9.81  # [m/s^2]
FASTENED = 0.010  # [m] the load hangs at the upper edge of the tip's face; this near to it the silicone carries it
MARKER_NOISE = 0.0003  # [m] a held beam's markers wander by this much
_RELEASED = 0.0002  # [m] the tip has begun to fall

# Mounting places of the markers [m], beam frame (clamped face at x = 0, centre of the cross-section at y = z = 0).
MOUNTS = np.array(
    [
        [0.100, 0.000, 0.021],
        [0.100, -0.021, 0.009],
        [0.100, 0.021, -0.009],
        [0.006, -0.025, -0.016],
        [0.006, 0.025, 0.0125],
        [0.006, 0.025, -0.015],
    ]
)
TIP, BASE = slice(0, 3), slice(3, 6)


def import_capture(source: Path, destination: Path, *, duration: Positive | None = 2.0, split: Share = 0.5) -> None:
    """One recording (gravity_V2_a.npz, load52_V2_b.npz, ...; beam.stl beside it) as a capture without images.

    Its tracks are the three markers at the tip; those at the base sit on the clamp's block, not on the beam.

    Args:
        source: the recording's .npz.
        destination: capture folder.
        duration: time kept from the release on [s]; None keeps all.
        split: share of it that fits may see.

    Raises:
        InputError: a file or field is missing, the markers do not fit their mounts, or the beam is never let go.
    """
    source = Path(source)
    markers, fps, load = _read(source)
    T_world_recording, misfit = _align(markers[0], source)
    world = markers @ T_world_recording[:3, :3].T + T_world_recording[:3, 3]
    first = _release(world, source)
    last = len(world) if duration is None else min(len(world), first + round(duration * fps))
    points = world[first:last, TIP]
    if len(points) < 2:
        raise InputError(
            f"{len(points)} frames from the release on",
            where=str(source),
            expected="at least 2",
            remedy="keep more of the recording with duration=",
        )
    with new_capture(destination) as folder:
        _write_beam(source.with_name("beam.stl"), folder / "shape_prior.glb")
        valid = np.ones(points.shape[:2], bool)
        sigma = np.full(points.shape[:2], MARKER_NOISE, np.float32)
        GivenTracks3d(points.astype(np.float32), valid, sigma).save(folder)
        settled = world[-round(0.3 * fps) :, TIP].mean(axis=(0, 1)) - points[0].mean(axis=0)
        notes = {
            "source": source.name,
            "release_frame": first,
            "marker_misfit_m": round(misfit, 5),
            "static_tip_displacement_m": settled.round(5).tolist(),
            "tip_load_newton": load,
        }
        write_description(folder, describe(fps, len(points), load, split) | {"notes": notes})


def describe(fps: float, frames: int, load: float, split: float) -> dict:
    """capture.json; `load` is the weight at the tip [N]."""
    below, above = AXIS_HEIGHT - WIDTH, AXIS_HEIGHT + WIDTH
    edge = [LENGTH, 0.0, AXIS_HEIGHT + WIDTH / 2]
    return {
        "kind": "tracks",
        "description": "a cantilever of cast silicone",
        "fps": fps,
        "frame_count": frames,
        "density": DENSITY,
        "T_world_object": np.eye(4),
        "clamps": [{"lower": [-0.05, -WIDTH, below], "upper": [0.0, WIDTH, above]}],
        "payloads": [{"point": edge, "radius": FASTENED, "mass": load / GRAVITY}] if load else [],
        "split": first_part_observed(frames, split),
    }


def _read(source: Path) -> tuple[Float[Array, "T 6 3"], float, float]:
    """Markers [m], frames per second, tip load [N]."""
    file, where = (
        read_npz(source, ("markers", "fps", "tip_load_newton"), remedy="name the recording's .npz"),
        str(source),
    )
    markers = numbers(file["markers"], ("frames", *MOUNTS.shape), where, "markers [m]")
    load = float(numbers(file["tip_load_newton"], (), where, "tip_load_newton [N]"))
    if load < 0 or len(markers) == 0:
        what = f"tip_load_newton = {load}" if load < 0 else "no frames"
        raise InputError(
            what, where=where, expected="a weight of 0 N or more, over at least one frame", remedy="mend it"
        )
    return markers, positive(file["fps"], where, "fps"), load


def _align(markers: Float[Array, "6 3"], source: Path) -> tuple[Float[Array, "4 4"], float]:
    """The rigid motion that lays the markers onto their mounts, and its root-mean-square misfit [m]."""
    from scipy.spatial.transform import Rotation

    mounts = MOUNTS + [0, 0, AXIS_HEIGHT]
    rotation, _ = Rotation.align_vectors(mounts - mounts.mean(axis=0), markers - markers.mean(axis=0))
    turn = rotation.as_matrix()
    shift = mounts.mean(axis=0) - turn @ markers.mean(axis=0)
    misfit = float(np.sqrt(((markers @ turn.T + shift - mounts) ** 2).sum(axis=1).mean()))
    if misfit > 0.003:
        raise InputError(
            f"the markers miss their mounts by {1000 * misfit:.1f} mm",
            where=f"{source}, frame 0",
            expected="metres, markers 0-2 at the straight beam's tip, 3-5 at its base",
            remedy="mend the unit or the order of the markers",
        )
    return rigid(turn, shift), misfit


def _release(world: Float[Array, "T 6 3"], source: Path) -> int:
    """The last frame before the tip falls."""
    height = world[:, TIP, 2].mean(axis=1)
    falling = np.flatnonzero(height < height[:10].mean() - _RELEASED)
    if len(falling) == 0:
        what = "the beam is never let go"
        raise InputError(
            what, where=str(source), expected=f"a tip that falls by {_RELEASED} m", remedy="choose another"
        )
    return max(int(falling[0]) - 1, 0)


def _write_beam(source: Path, path: Path) -> None:
    """beam.stl (mm, its z from tip to clamp) in the world frame [m]."""
    mesh = read_trimesh(
        regular_file(source, expected="the beam's mesh", remedy="put beam.stl beside the recording"), merge=True
    )
    turn = np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]]) / 1000
    mesh.apply_transform(rigid(turn, [LENGTH, -WIDTH / 2, AXIS_HEIGHT - WIDTH / 2]))
    mesh.export(path)
