"""`physreal play`: a twin read from its artifacts, its pulls as captures, its sessions as videos, and the page in a real browser."""

import json
import re
import shutil
import time
from types import SimpleNamespace

import numpy as np
import pytest
import torch
import yaml
from scipy.spatial.transform import Rotation

from applications.play.film import Log
from applications.play.loop import Loop
from applications.play.pictures import camera_of, picture
from applications.play.pulls import Pulls, states_of, write_log
from applications.play.shades import FULL, colours_of, stress, stretch
from applications.twin import Twin
from physreal_core.errors import InputError, SimulationError
from physreal_core.playing import Session, replayed
from physreal_core.playing.changes import Changes
from pipeline.check import examine
from pipeline.cli import main
from pipeline.products.controllers import Controllers
from pipeline.products.particles import Particles
from pipeline.project import Project
from pipeline.stage import run_stage
from stages import build_object, fit_pose, parse_video, sample_particles, segment_and_track
from tests.fitting import scene


def pulled(twin: Twin, folder, frames: int = 12):
    """A session in which the bar's end is pulled from frame 2 on and let go; with what was written."""
    session, pulls = twin.session(), Pulls(twin, folder)
    session.let_hand("open")
    written, handle = [], None
    for frame in range(frames + 6):
        if frame == 2:
            end = session.state.x.double().numpy()[-1]
            handle = session.take(end)
        if 2 <= frame < frames:
            session.move(handle, end + [0.0, 0.0, 0.01 * (frame - 2)])
        if frame == frames:
            session.release(handle)
        written += pulls.follow(session)
        session.step()
    return session, written


def test_what_is_not_there_is_named(project, tmp_path):
    with pytest.raises(InputError, match="fits.lfit; did you mean fits.lift"):
        Twin.load(project, "lfit")
    with pytest.raises(InputError, match="fit_patches"):
        Twin.load(project, "lift", "fit_patch")
    (tmp_path / "params.yaml").write_text((project.root / "params.yaml").read_text())
    with pytest.raises(InputError, match="parse_video has not run on lift.*dvc repro"):
        Twin.load(Project(tmp_path), "lift")
    with pytest.raises(InputError, match=r"actions"):
        Log.read(_written(tmp_path / "log.json", {"sequence": "lift"}))


def _written(path, record):
    path.write_text(json.dumps(record))
    return path


def test_surface_and_splats_start_where_they_were_seen(twin):
    session = twin.session()
    assert np.allclose(twin.surface(session.state), twin.mesh.vertices, atol=1e-6)
    now = twin.splats(session.state)
    assert np.allclose(now.centres, twin.gaussians.means.numpy(), atol=1e-5)
    assert twin.colours().shape == now.centres.shape and twin.opacities().shape == (len(now.centres), 1)


def test_a_pull_is_a_capture_that_the_pipeline_takes(twin, tmp_path):
    """Checked as any capture is, and through the stages up to the particles: the hand holds what was pulled."""
    _, (folder,) = pulled(twin, tmp_path / "played")
    capture = json.loads((folder / "capture.json").read_text())
    assert capture["frame_count"] == 10 and Controllers.load(folder).points.shape == (10, 8, 3)
    project = Project(tmp_path / "again")
    shutil.copytree(folder, project.capture("pull"))
    (project.root / "params.yaml").write_text(
        yaml.safe_dump({"sequences": {"pull": {"sample_particles": {"spacing": 0.02}}}, "fits": {"pull": {}}})
    )
    _, found = examine(project.capture("pull"))
    assert not found.faults
    for stage in (parse_video, segment_and_track, build_object, fit_pose, sample_particles):
        run_stage(stage.__name__.split(".")[-1], "pull", stage.run, project)
    particles = Particles.load(project.artifact("sample_particles", "pull"))
    held = particles.x0[particles.grip_particles]
    assert len(held) and np.linalg.norm(held - Controllers.load(folder).points[0].mean(0), axis=1).max() < 0.04
    assert len(particles.track_ids) > 100


def test_a_pull_lasts_as_long_as_it_was_held(twin, tmp_path):
    session, pulls = twin.session(), Pulls(twin, tmp_path)
    handle = session.take(twin.mesh.vertices[0])
    for _ in range(4):
        pulls.follow(session)
        session.step()
    assert [path.name for path in pulls.close(session)] == ["pull_001"]
    session.release(handle)
    short = session.take(twin.mesh.vertices[0])
    pulls.follow(session)
    session.release(short)
    assert pulls.follow(session) == [], "one frame is no capture"
    assert Pulls(twin, None).follow(session) == []
    assert [path.name for path in tmp_path.iterdir()] == ["pull_001"]


def test_a_pin_ends_as_a_capture_and_not_when_the_memory_does(twin, tmp_path, monkeypatch):
    monkeypatch.setattr("applications.play.pulls.LONGEST", 5)
    session, pulls = twin.session(), Pulls(twin, tmp_path)
    pin, written = session.take(twin.mesh.vertices[0]), []
    for _ in range(12):
        written += pulls.follow(session)
        session.step()
    session.release(pin)
    written += pulls.follow(session)
    assert len(written) == 1 and states_of(written[0])[0].tolist() == list(range(5))


def test_a_session_that_begins_anew_leaves_its_pulls_with_their_log(twin, tmp_path):
    pytest.importorskip("viser")
    import viser

    from applications.play.page import Page

    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        page = Page(server, twin, [twin.session()], tmp_path)
        page.loop.do(lambda session: session.take(twin.mesh.vertices[0]))
        for _ in range(5):
            page.loop.once()
        page._reset()
        page.loop.once()
        (folder,) = tmp_path.iterdir()
        log = Log.read(folder)
        assert [action["do"] for action in log.actions] == ["take"] and log.frames == 5
        assert page.loop.sessions[0].log == [] and page.loop.sessions[0].handles == ()
    finally:
        server.stop()


def test_a_log_brings_the_same_states_again(twin, project, tmp_path, monkeypatch, capsys):
    """By the command, too, which writes them beside the video."""
    _, (folder,) = pulled(twin, tmp_path / "played")
    log = Log.read(folder)
    assert (log.sequence, log.stage, log.ball) == ("lift", "fit_residual", None)
    states = np.stack([state.x.numpy().copy() for state in replayed(twin.session(), log.actions, log.frames)])
    seen, x = states_of(folder)
    assert seen.tolist() == list(range(2, 12)) and np.array_equal(states[seen - 1], x)
    monkeypatch.chdir(project.root)
    with pytest.raises(SystemExit) as ended:
        main(["play", "--replay", str(folder), "--record", str(tmp_path / "again.mp4")])
    assert ended.value.code == 0 and "again.mp4" in capsys.readouterr().out
    with np.load(tmp_path / "again.npz") as file:
        assert np.array_equal(file["x"], states)
    assert (tmp_path / "again.mp4").stat().st_size > 1000


def test_a_command_that_lacks_something_says_what(project, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(project.root)
    for arguments, told in (
        (["play"], "a name under `fits`"),
        (["play", "--replay", str(_written(tmp_path / "log.json", {"sequence": "lift"}))], "model"),
        (["play", "lift", "--record", "a.mp4", "--model", "fit_all"], "fit_all"),
    ):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == 2 and told in capsys.readouterr().err


def test_colour_tells_the_stretch(twin):
    session = twin.session()
    calm = colours_of(stretch(session), FULL, twin.gaussian_binding)
    session.state.F[:, 0, 0] = 1.0 + FULL
    torn = colours_of(stretch(session), FULL, twin.gaussian_binding)
    assert np.allclose(calm, calm[0], atol=0.02) and calm[0, 2] > calm[0, 0]
    assert (torn[:, 0] > 0.75).all() and (torn[:, 2] < 0.2).all()


def test_stress_of_simple_shear_is_that_of_the_modulus(twin):
    """Small shear g: the deviator has two entries mu g, so von Mises stress is sqrt(3) mu g; a pressure has none."""
    session = twin.session()
    session.state.F[:] = torch.eye(3)
    session.state.F[:, 0, 1] = g = 1e-3
    mu = 1e5 / (2 * (1 + scene.MATERIAL["poissons_ratio"]))
    assert np.allclose(stress(session), 3**0.5 * mu * g, rtol=2e-3)
    session.state.F[:] = 0.99 * torch.eye(3)
    assert np.abs(stress(session)).max() < 1e-3 * mu


def test_a_viewers_camera_sees_what_the_filmed_camera_sees(twin):
    """A viewer at the filmed camera: the same directions at the same share of the picture."""
    filmed = twin.camera
    T = filmed.T_world_camera.numpy()
    turn = Rotation.from_matrix(T[:3, :3]).as_quat()
    fov = 2 * np.arctan(filmed.height / (2 * float(filmed.K[1, 1])))
    viewer = SimpleNamespace(position=T[:3, 3], wxyz=np.roll(turn, 1), fov=fov, aspect=filmed.width / filmed.height)
    camera = camera_of(viewer)
    points = torch.as_tensor(twin.mesh.vertices)
    there, here = (c.project(points)[0].numpy() / c.width for c in (filmed, camera))
    assert np.allclose(there, here, atol=0.01) and camera.width == 640
    now = twin.splats(twin.session().state)
    image, depth = picture(now.centres, now.covariances, twin.colours(), twin.opacities(), camera)
    assert image.shape == (480, 640, 3) and depth.shape == (480, 640)
    (middle,), _ = camera.project(points.mean(0)[None])
    column, row = middle.round().int().tolist()
    distance = float(np.linalg.norm(twin.mesh.vertices.mean(0) - T[:3, 3]))
    assert abs(depth[row, column] - distance) < 0.06 and depth[0, 0] > 100 and (image[0, 0] == 255).all()


def test_of_many_splats_every_viewer_is_sent_a_picture(twin, monkeypatch):
    pytest.importorskip("viser")
    import viser

    from applications.play import page as module

    monkeypatch.setattr("applications.play.drawn.LARGEST", 10)
    server, sent = viser.ViserServer(host="127.0.0.1", port=0, verbose=False), []
    eye, look = twin.camera.T_world_camera.numpy(), np.array([1.0, 0.0, 0.0, 0.0])
    camera = SimpleNamespace(position=eye[:3, 3], wxyz=look, fov=0.8, aspect=1.5)
    viewer = SimpleNamespace(camera=camera, scene=SimpleNamespace(set_background_image=lambda *a, **k: sent.append(a)))
    monkeypatch.setattr(server, "get_clients", lambda: {0: viewer, 1: viewer})
    try:
        page = module.Page(server, twin, [twin.session()], None)
        page.loop.once()
        assert len(sent) == 4 and sent[0][0].shape == (427, 640, 3)
    finally:
        server.stop()


def test_two_sessions_do_the_same_and_differ_by_the_effect(twin):
    loop = Loop([twin.session(), twin.session(effects=False)], lambda: None, pytest.fail)
    loop.do(lambda session: session.let_hand("open"))
    handles = []
    loop.do(lambda session: handles.append(session.take(session.state.x.double().numpy()[-1])))
    for frame in range(10):
        loop.do(lambda session, z=0.01 * frame: session.move(1, np.array([0.13, 0.05, 0.03 + z])))
        loop.once()
    assert handles == [1, 1]
    blown, still = (session.state.x[:, 1].mean().item() for session in loop.sessions)
    assert blown > still + 1e-3


def test_what_cannot_be_done_is_told_and_time_goes_on(twin):
    told, shown = [], []
    loop = Loop([twin.session()], lambda: shown.append(1), told.append)
    loop.do(lambda session: session.move(5, np.zeros(3)))
    loop.once()
    assert loop.sessions[0].frame == 1 and "handle 5" in told[0]

    def broken():
        raise SimulationError("the state is not finite", frame=1, substep=0, particle=0)

    session = loop.sessions[0]
    session.step = broken
    loop.once()
    assert "begins anew" in told[1] and session.frame == 0 and len(shown) == 2
    del session.step

    def wild(session):
        raise SimulationError("the state is not finite", frame=1, substep=0, particle=0)

    loop.do(wild)
    loop.once()
    assert "begins anew" in told[2] and session.frame == 0 and len(shown) == 3
    loop.go(False)
    loop.once()
    assert len(shown) == 3, "time stands, and nothing was done"


def test_the_page_answers_what_is_dragged_and_slid(twin, tmp_path):
    """Without a browser: the events that viser would send."""
    pytest.importorskip("viser")
    import asyncio

    import viser

    from applications.play.page import Page

    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        sessions = [twin.session(effects=effects, ball=0.02) for effects in (True, False)]
        page = Page(server, twin, sessions, tmp_path)
        loop = page.loop

        def drag(phase, place, modifier=None):
            event = SimpleNamespace(
                client_id=1, phase=phase, modifier=modifier, start_position=start, end_position=place
            )
            asyncio.run(page._dragged(event))
            loop.once()

        loop.do(lambda session: session.let_hand("open"))
        start = twin.mesh.vertices[twin.mesh.vertices[:, 0].argmax()]
        drag("start", start)
        for rise in (0.02, 0.04, 0.06):
            drag("update", start + [0, 0, rise])
        assert all(len(session.handles) == 1 for session in loop.sessions)
        assert "pulls" in page._rate.content and page._lines.visible
        drag("end", start + [0, 0, 0.06])
        assert all(len(session.handles) == 0 for session in loop.sessions)
        assert [path.name for path in tmp_path.iterdir()] == ["pull_001"]
        drag("start", start, "shift")
        drag("update", start + [0, 0, 0.05], "shift")
        drag("end", start + [0, 0, 0.05], "shift")
        assert all(len(session.handles) == 1 for session in loop.sessions), "a pin stays"
        loop.do(lambda session: session.place_ball(start + [0.0, -0.2, 0.0]))
        loop.once()
        assert page._balls[0].visible and np.allclose(page._balls[0].position, start + [0.0, -0.2, 0.0])
        page._change(stiffness=2.0)
        page._change_effect("wind", "y", 0.0)
        page._jump(4)
        loop.once()
        first, second = loop.sessions
        assert first.changes.stiffness == second.changes.stiffness == 2.0 and first.film == 5
        assert first.changes.effects == {"wind": {"y": 0.0}} and second.changes.effects == {}
        page.loop.start()
        time.sleep(0.5)
        frame = first.frame
        page.close()
        assert first.frame >= frame > 5
    finally:
        server.stop()


def test_forces_are_told_with_their_interval(twin):
    """Of an elastic body they are as far apart as the moduli where its end is led to a place and rests."""
    pytest.importorskip("viser")
    import viser

    from applications.play.page import Page

    soft, stiff = twin.ends()
    fitted = float(twin.model.fields["youngs_modulus"].mean())
    low, high = (float(model.fields["youngs_modulus"].mean()) for model in (soft, stiff))
    assert low < fitted < high and low * high == pytest.approx(fitted**2, rel=1e-6)
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        ends = [Session(twin.problem, model) for model in (soft, stiff)]
        page = Page(server, twin, [twin.session()], None, ends)
        end = twin.mesh.vertices[twin.mesh.vertices[:, 0].argmax()]
        page.loop.do(lambda session: session.change(Changes(brake=20.0)))
        page.loop.do(lambda session: session.take(end))
        for _ in range(60):
            page.loop.do(lambda session: session.move(1, end + [0.0, 0.0, 0.03]))
            page.loop.once()
        here, below, above = (float(np.linalg.norm(own.pull(1).force)) for own in page.loop.sessions)
        assert below < here < above
        told = re.search(r"pulls ([\d.]+) N \(([\d.]+) to ([\d.]+)\)", page._rate.content)
        assert [float(number) for number in told.groups()] == pytest.approx([here, below, above], abs=0.006)
    finally:
        server.stop()


def shown_at(twin: Twin, point: np.ndarray, height: int) -> tuple[int, int]:
    """Where a new viewer sees a point [m], from the middle of a picture of so many pixels' height: as the filmed camera does."""
    camera = twin.camera
    (pixel,), _ = camera.project(torch.tensor(point)[None])
    offset = (pixel.numpy() - camera.K[:2, 2].numpy()) * height / camera.height
    return round(float(offset[0])), round(float(offset[1]))


@pytest.mark.slow
def test_in_a_browser_an_end_is_pulled_and_moves_and_the_log_repeats_it(twin, tmp_path):
    """Chromium without a screen drags the bar's end, sees it move, and lets go; the pull's log leads to the same states."""
    pytest.importorskip("viser")
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        pytest.skip("no chromium with its driver: apt-get install chromium chromium-driver")
    import viser
    from selenium.webdriver.common.action_chains import ActionChains

    from applications.play.page import Page

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium")
    for flag in ("--headless=new", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"):
        options.add_argument(flag)
    options.add_argument("--window-size=1000,700")
    server = viser.ViserServer(host="127.0.0.1", port=8377, verbose=False)
    page = Page(server, twin, [twin.session()], tmp_path)
    page.loop.do(lambda session: session.let_hand("open"))
    page.loop.start()
    browser = webdriver.Chrome(options, webdriver.ChromeService(shutil.which("chromedriver")))
    try:
        browser.get("http://127.0.0.1:8377")
        deadline = time.monotonic() + 60
        while not server.get_clients() and time.monotonic() < deadline:
            time.sleep(0.2)
        time.sleep(8)
        before = browser.get_screenshot_as_png()
        (tmp_path.parent / "before.png").write_bytes(before)
        canvas = browser.find_element("tag name", "canvas")
        place = shown_at(twin, twin.mesh.vertices.mean(0), canvas.size["height"])
        ActionChains(browser, duration=60).move_to_element_with_offset(canvas, *place).click_and_hold().perform()
        for _ in range(15):
            ActionChains(browser, duration=60).move_by_offset(3, -6).perform()
        held = browser.get_screenshot_as_png()
        session = page.loop.sessions[0]
        assert len(session.handles) == 1, "the drag took the body"
        assert np.linalg.norm(session.pull(session.handles[0]).force) > 0.05 * session.weight
        ActionChains(browser).release().perform()
        deadline = time.monotonic() + 20
        while not list(tmp_path.glob("pull_*")) and time.monotonic() < deadline:
            time.sleep(0.2)
        assert before != held
    finally:
        browser.quit()
        page.close()
        server.stop()
    (folder,) = tmp_path.glob("pull_*")
    log = Log.read(folder)
    states = np.stack([state.x.numpy().copy() for state in replayed(twin.session(), log.actions, log.frames)])
    seen, x = states_of(folder)
    assert np.array_equal(states[seen - 1], x)
    assert np.abs(x[-1] - x[0]).max() > 0.005


def test_a_log_is_whole(twin, tmp_path):
    session = twin.session()
    session.step()
    path = write_log(tmp_path, twin, session)
    assert json.loads(path.read_text()) == {
        "sequence": "lift", "model": "fit_residual", "ball": None, "scene": None, "backdrop": None, "frames": 1, "actions": []
    }  # fmt: skip
