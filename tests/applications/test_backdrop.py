"""What is seen behind a twin: in depth order with the body, as background in masks, on the page, and in logs."""

import dataclasses
import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from applications.backdrop import Backdrop
from applications.generate import pictures as drawing
from applications.generate.command import _resume
from applications.generate.draws import Draws, Randomisation
from applications.generate.episode import Keypoints, at_rest, simulated
from applications.generate.grasps import Hand, candidates
from applications.generate.maker import Setup
from applications.generate.pictures import BACKGROUND, HAND, OBJECT, Studio
from applications.play.film import Log, film
from applications.play.pulls import write_log
from applications.twin import Twin
from physreal_core.errors import InputError
from physreal_core.rendering import Gaussians, load_gaussians, save_gaussians
from pipeline.cli import main
from pipeline.products.camera import RecordedCamera
from pipeline.products.images import FrameImages
from pipeline.products.masks import Masks
from pipeline.project import Project
from pipeline.reading.videos import read_video
from tests.applications.test_scene import wall as solid_wall

PURPLE = (0.6, 0.1, 0.7)

BEHIND, BEFORE = -0.3, 0.25
"""Of a screen, along y [m]: the camera looks back along y from 0.43, the bar lies between 0 and 0.06, and the hand stays within 0.15 of it."""


def screen(folder: Path, y: float, x: tuple[float, float] = (-0.4, 0.5)) -> str:
    """A purple plane across the view, as a file of splats."""
    places = np.stack(np.meshgrid(np.arange(*x, 0.008), [y], np.arange(-0.3, 0.4, 0.008), indexing="ij"), -1)
    means = torch.as_tensor(places.reshape(-1, 3), dtype=torch.float32)
    path = folder / f"screen_{y}.ply"
    save_gaussians(path, Gaussians.from_points(means, 0.006, torch.tensor(PURPLE).expand(len(means), 3)))
    return str(path)


def with_screen(project: Project, folder: Path, y: float, **more) -> Twin:
    return Twin.load(project, "lift", backdrop=screen(folder, y, **more))


def filmed_frame(twin: Twin, folder: Path) -> np.ndarray:
    """The first frame that --record writes, 0 to 1."""
    session = twin.session()
    film(twin, iter([session.step()]), folder / "film.mp4", session.fps)
    return next(iter(read_video(folder / "film.mp4"))) / 255


def test_a_video_has_the_body_before_what_is_behind_it_and_not_behind_what_is_before_it(project, twin, tmp_path):
    plain = filmed_frame(twin, tmp_path)
    behind = filmed_frame(with_screen(project, tmp_path, BEHIND), tmp_path)
    before = filmed_frame(with_screen(project, tmp_path, BEFORE), tmp_path)
    body = np.abs(plain - 0.5).max(-1) < 0.1  # the bar is grey, what is around it pale
    assert body.sum() > 100 and not body.all()
    assert np.abs(behind - plain)[body].mean() < 0.06
    assert np.abs(behind - PURPLE)[:15].max() < 0.12
    assert np.abs(before - PURPLE).max() < 0.12


def test_solids_and_backdrop_are_drawn_together_whatever_their_harmonics(project, tmp_path):
    """A backdrop of first order beside solids of order zero."""
    path = screen(tmp_path, BEHIND)
    flat = load_gaussians(path)
    harmonics = torch.cat([flat.harmonics, torch.zeros(len(flat), 3, 3)], 1)
    save_gaussians(path, dataclasses.replace(flat, harmonics=harmonics))
    both = Twin.load(project, "lift", scene=solid_wall(tmp_path), backdrop=path)
    seen = filmed_frame(both, tmp_path)
    solid = np.abs(seen - np.median(seen[:, :5], axis=(0, 1))).max(-1) < 0.02
    assert np.abs(seen[:10, 30:] - PURPLE).max() < 0.12
    assert 50 < solid.sum() < solid.size / 2


@pytest.fixture(scope="module")
def episode(project):
    """A draw and a motion, and what is seen of it without a backdrop."""
    twin = Twin.load(project, "lift")
    session = twin.session()
    studio = Studio(twin, session.floor)
    at_rest(session, twin.model.fields)
    place = candidates(twin, twin.surface(session.state), 1, 0)[0]
    given = place[None], None, studio.camera, Randomisation.none(), 60, session.fps, session.floor
    draw = Draws(*given, seed=3).draw(0)
    motion = simulated(session, Keypoints(twin), place, draw.way)
    return draw, motion, studio.pictures(motion, draw), session.floor


def test_masks_and_flow_are_as_without_a_backdrop_behind_all_and_depth_is_its_own(project, episode, tmp_path):
    draw, motion, plain, floor = episode
    seen = Studio(with_screen(project, tmp_path, BEHIND), floor).pictures(motion, draw)
    assert (plain.mask == OBJECT).any() and (plain.mask == HAND).any()
    assert np.array_equal(seen.mask, plain.mask) and np.array_equal(seen.flow, plain.flow)
    there = seen.mask != BACKGROUND
    assert np.array_equal(seen.depth[there], plain.depth[there])
    assert np.abs(seen.depth[~there] - (0.43 - BEHIND)).max() < 1e-3
    assert np.abs(seen.flow[~there]).max() == 0.0
    assert np.abs(seen.colour[~there] / 255 - PURPLE).mean() < 0.05


def test_what_a_backdrop_covers_is_background(project, episode, tmp_path):
    """A screen before the left of the view, where x is above 0.09 m, for the camera looks back along y. Its last splats reach 12 pixels further."""
    draw, motion, plain, floor = episode
    seen = Studio(with_screen(project, tmp_path, BEFORE, x=(0.09, 0.5)), floor).pictures(motion, draw)
    left, right = np.s_[:, :, :14], np.s_[:, :, 30:]
    assert (plain.mask[left] == OBJECT).any() and (plain.mask[right] == OBJECT).any()
    assert (seen.mask[left] == BACKGROUND).all() and np.abs(seen.depth[left] - (0.43 - BEFORE)).max() < 1e-3
    assert np.abs(seen.colour[left] / 255 - PURPLE).max() < 0.1
    for name in ("mask", "flow", "depth", "colour"):
        assert np.array_equal(getattr(seen, name)[right], getattr(plain, name)[right]), name


def test_many_splats_are_drawn_some_frames_at_once_to_the_same_pictures(project, episode, tmp_path, monkeypatch):
    draw, motion, _, floor = episode
    studio = Studio(with_screen(project, tmp_path, BEHIND), floor)
    whole = studio.pictures(motion, draw)
    monkeypatch.setattr(drawing, "_AT_ONCE", 30_000)
    assert np.array_equal(studio.pictures(motion, draw).colour, whole.colour)


def test_a_recordings_own_backdrop_is_loaded_with_its_twin(project, tmp_path):
    """The bar's recording with images: before a wall of one colour, 0.5 m away."""
    copy = Project(tmp_path / "copy")
    shutil.copytree(project.root, copy.root)
    with pytest.raises(InputError, match="--backdrop filmed, lift: the recording has no depth.*FILE.ply"):
        Twin.load(copy, "lift", backdrop="filmed")
    images, camera = FrameImages(copy.artifact("parse_video", "lift")), Twin.load(copy, "lift").camera
    size = camera.height, camera.width
    frames = RecordedCamera.load(images.folder).frame_count
    for frame in range(frames):
        images.save(frame, np.full((*size, 3), (153, 26, 178), np.uint8), np.full(size, 500, np.uint16))
    backdrop = Twin.load(copy, "lift", backdrop="filmed").backdrop
    shown = Masks.load(copy.artifact("segment_and_track", "lift"), range(frames)).object
    assert backdrop.source == "filmed" and 0 < len(backdrop.gaussians) <= shown[0].size
    assert np.allclose(backdrop.gaussians.means[:, 1], 0.43 - 0.5, atol=1e-5)
    assert np.allclose(backdrop.gaussians.colours(camera.centre), PURPLE, atol=3e-3)


def test_the_page_has_it_once_beside_the_body_or_in_the_pictures(project, tmp_path, monkeypatch):
    pytest.importorskip("viser")
    import viser

    from applications.play.page import Page

    twin = with_screen(project, tmp_path, BEHIND)
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    sent, add = [], server.scene.add_gaussian_splats
    monkeypatch.setattr(server.scene, "add_gaussian_splats", lambda name, **k: sent.append(name) or add(name, **k))
    pose = twin.camera.T_world_camera.numpy()
    viewer = SimpleNamespace(position=pose[:3, 3], wxyz=np.array([0.0, 0.0, 2**-0.5, -(2**-0.5)]), fov=0.5, aspect=1.5)
    images = []
    scene = SimpleNamespace(set_background_image=lambda image, **more: images.append((image, more["depth"])))
    monkeypatch.setattr(server, "get_clients", lambda: {0: SimpleNamespace(camera=viewer, scene=scene)})
    try:
        Page(server, twin, [twin.session()], None).loop.once()
        assert sent.count("/backdrop") == 1 and len(sent) == 2 and not images
        sent.clear()
        monkeypatch.setattr("applications.play.drawn.LARGEST", 10)
        Page(server, twin, [twin.session()], None).loop.once()
        image, depth = images[-1]
        assert not sent and np.abs(image[5, 5] / 255 - PURPLE).max() < 0.05
        assert depth[5, 5] == pytest.approx(0.43 - BEHIND, abs=1e-3) and depth.min() < 0.43
    finally:
        server.stop()


def test_logs_and_options_know_it(project, tmp_path, monkeypatch):
    twin = with_screen(project, tmp_path, BEHIND)
    session = twin.session()
    session.step()
    folder = tmp_path / "log"
    folder.mkdir()
    assert Log.read(write_log(folder, twin, session)).backdrop == twin.backdrop.source == screen(tmp_path, BEHIND)
    monkeypatch.chdir(project.root)
    with pytest.raises(SystemExit) as ended:
        main(["play", "--replay", str(folder), "--record", str(tmp_path / "again.mp4")])
    assert ended.value.code == 0
    again = next(iter(read_video(tmp_path / "again.mp4"))) / 255
    assert np.abs(again - PURPLE)[:15].max() < 0.12
    options = tmp_path / "parts", 2.0, 1.0, 1.0, 3, Hand(), Randomisation.none(), "cpu", 0
    setup = Setup(project.root, "lift", "fit_residual", *options, backdrop="filmed")
    _resume(setup)
    assert json.loads((tmp_path / "parts/asked.json").read_text())["backdrop"] == "filmed"
    with pytest.raises(InputError, match="begun with other options"):
        _resume(dataclasses.replace(setup, backdrop=None))


def test_what_is_no_backdrop_is_refused(project, tmp_path, monkeypatch, capsys):
    with pytest.raises(InputError, match="bar was filmed by no camera.*colour and depth.*FILE.ply"):
        Backdrop.read("filmed", "bar", tmp_path, tmp_path, None)
    empty = tmp_path / "empty.ply"
    save_gaussians(empty, Gaussians.from_points(torch.zeros(0, 3), 0.01, torch.zeros(0, 3)))
    with pytest.raises(InputError, match="empty.ply: there is no splat"):
        Backdrop.read(str(empty), "bar", tmp_path, tmp_path, None)
    monkeypatch.chdir(project.root)
    for arguments in (["play", "lift", "--record", "a.mp4"], ["generate", "lift"]):
        for named, told in (("none.ply", "none.ply: file is missing"), ("filmed", "the recording has no depth")):
            with pytest.raises(SystemExit) as ended:
                main([*arguments, "--backdrop", named])
            assert ended.value.code == 2 and told in capsys.readouterr().err
