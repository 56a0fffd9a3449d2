"""The page of `physreal label`: its parts without a browser, and, where there is one, clicks that end in capture.json."""

import importlib.util
import json
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.request

import cv2
import numpy as np
import pytest

from physreal_core.errors import InputError
from pipeline.cli import main
from pipeline.clicks import Clicks
from pipeline.config import load_parameters
from pipeline.label.clip import Clip
from pipeline.label.drawing import clicks_svg, sheet_svg
from pipeline.label.editing import Editing
from pipeline.label.pictures import Sheet, outline_path, picture, sheet_picture
from pipeline.label.plot import plot_options
from pipeline.label.running import Runner, commands, progress_of
from pipeline.label.serve import serve
from pipeline.label.suspects import Curves, suspects
from pipeline.products.masks import Masks
from pipeline.products.tracks import MeasuredTracks
from pipeline.project import CODE_ROOT, Project
from pipeline.provenance import write_provenance
from tests.pipeline.captures import HEIGHT, WIDTH, write_capture

FRAMES = 6


@pytest.fixture
def project(tmp_path) -> Project:
    (tmp_path / "params.yaml").write_text(json.dumps({"seed": 0, "sequences": {}, "clips": {"clip": {}}}))
    write_capture(tmp_path / "data" / "captures" / "clip", frames=FRAMES)
    return Project(tmp_path)


def found(project: Project, scale: int = 1) -> None:
    """An output of segment_and_track: the object vanishes in frame 3, the tracks after frame 4."""
    folder = project.artifact("segment_and_track", "clip")
    folder.mkdir(parents=True)
    objects = np.zeros((FRAMES, HEIGHT // scale, WIDTH // scale), bool)
    objects[:, 4 // scale : 20 // scale, 4 // scale : 20 // scale] = True
    objects[3] = False
    Masks(objects, np.roll(objects, 20 // scale, axis=2)).save(folder)
    visible = np.ones((FRAMES, 5), bool)
    visible[5, 1:] = False
    points = np.full((FRAMES, 5, 2), 10.0 / scale, np.float32)
    nothing = np.full((FRAMES, 5), np.nan, np.float32)
    MeasuredTracks(points, visible, np.full((FRAMES, 5, 3), np.nan, np.float32), ~visible & visible, nothing).save(
        folder
    )
    (folder / "segmentation.json").write_text(json.dumps({"keyframes_without_vote": {"object": [2]}}))
    (folder / "quality.json").write_text(json.dumps({"warnings": ["the hand was not found in 3 frames"]}))
    record = {"stage": "segment_and_track", "inputs": {}, "seed": 0, "sequence": "clip"}
    params = load_parameters(project.parameters).stage("segment_and_track", "clip").model_dump(mode="json")
    write_provenance(folder, record | {"parameters": params})


def test_a_clip_without_results_is_shown(project):
    clip = Clip(project, "clip")
    assert len(clip) == FRAMES and clip.found is None and "run" in clip.state
    image = cv2.imdecode(np.frombuffer(picture(clip, 2), np.uint8), cv2.IMREAD_COLOR)
    assert image.shape == (HEIGHT, WIDTH, 3)
    assert plot_options(None, {}, 0)["series"] == []


@pytest.mark.parametrize("scale", [1, 2])
def test_a_clip_with_results_shows_masks_tracks_and_what_to_look_at(project, scale):
    plain = picture(Clip(project, "clip"), 1)
    found(project, scale)
    clip = Clip(project, "clip")
    assert clip.state == "up to date"
    assert clip.mask("object", 1)[6, 6] and not clip.mask("object", 1)[25, 25] and not clip.mask("object", 3).any()
    assert clip.mask("object", 1).shape == (HEIGHT, WIDTH)
    assert picture(clip, 1) != plain and picture(clip, 1, masks=False, tracks=False) == plain
    assert clip.found.warnings == ["the hand was not found in 3 frames"]
    assert sorted(clip.found.suspects) == [2, 3, 5]
    options = plot_options(clip.found.curves, clip.found.suspects, 4)
    assert [len(one["data"]) for one in options["series"]] == [FRAMES] * 3
    assert json.dumps(options)


def test_results_of_other_parameters_are_called_out_of_date(project):
    found(project)
    values = json.loads(project.parameters.read_text()) | {"segment_and_track": {"track_count": 77}}
    project.parameters.write_text(json.dumps(values))
    assert Clip(project, "clip").state.startswith("out of date")


def test_damaged_results_are_told_and_the_frames_are_still_shown(project):
    found(project)
    (project.artifact("segment_and_track", "clip") / "tracks.npz").write_bytes(b"nothing")
    clip = Clip(project, "clip")
    assert clip.found is None and "cannot be shown" in clip.state and picture(clip, 0)


def test_a_sequence_that_is_not_there_is_told(project):
    with pytest.raises(InputError, match="clip"):
        Clip(project, "clap")


def test_frames_on_the_sheet_are_found_again(project):
    clip = Clip(project, "clip")
    sheet = Sheet.of(clip)
    for t in range(FRAMES):
        u, v = sheet.corner(t)
        assert sheet.frame_at(u + 1, v + 1) == t
        assert sheet.frame_at(u + sheet.size[0] - 1, v + sheet.size[1] - 1) == t
    image = cv2.imdecode(np.frombuffer(sheet_picture(clip, sheet), np.uint8), cv2.IMREAD_COLOR)
    assert image.shape[1::-1] == sheet.extent
    many = Sheet(1000, (10, 10), 5, 8)
    assert many.frame_at(*many.corner(503)) == 500 and many.frame_at(1e9, 1e9) == 995


def test_what_is_suspicious():
    area = np.array([0.1, 0.1, 0.2, 0.2, 0.0, 0.2])
    seen = np.array([1.0, 0.9, 0.9, 0.4, 0.9, 0.9])
    told = suspects(Curves(area, area, seen), {"keyframes_without_vote": {"controller": [5, 99]}, "other": 1})
    assert set(told) == {2, 3, 4, 5}
    assert "100%" in told[2][0] and "40%" in told[3][0] and "hand" in told[5][0] or "controller" in told[5][0]


def test_clicks_are_added_undone_removed_and_only_changes_are_saved():
    editing = Editing({(3, "object"): Clicks(((1.0, 2.0),), (1,))})
    editing.add(3, "object", (5.0, 6.0), 0)
    editing.add(4, "controller", (7.0, 8.0), 1)
    assert editing.frames() == [3, 4] and editing.at(3, "object").labels == (1, 0)
    assert editing.undo() == 4 and editing.undo() == 3 and not editing.edits and editing.undo() is None
    editing.clear(3)
    assert editing.edits == {(3, "object"): Clicks()} and editing.frames() == []
    editing.done({}, dict(editing.edits))
    assert not editing.edits and editing.frames() == []


def test_marks_are_drawn_where_the_clicks_are():
    svg = clicks_svg(Clicks(((10.0, 20.0), (30.0, 5.0)), (1, 0), (1.0, 2.0, 8.0, 9.0)), "object", 4.0)
    assert 'cx="10.5" cy="20.5"' in svg and svg.count("<path") == 2 and 'x="1" y="2" width="8"' in svg
    assert sheet_svg(Sheet(6, (10, 8), 1, 3), 4, [1, 2], [5]).count("<rect") == 4
    mask = np.zeros((9, 9), bool)
    mask[2:5, 3:7] = True
    assert outline_path(mask).startswith("M") and outline_path(mask).endswith("Z") and outline_path(~mask | mask) != ""


def test_the_run_goes_through_dvc_where_the_project_has_it(project):
    assert [command[2] for command in commands(project, "clip")] == ["stages.parse_video", "stages.segment_and_track"]
    (project.root / ".dvc").mkdir()
    (command,) = commands(project, "clip")
    assert command[1:] == ["-m", "dvc", "repro", "pipeline/segment_and_track/dvc.yaml:segment_and_track_clip@clip"]
    assert progress_of("segment_and_track clip: masks and tracks: 3/10, 78 s, about 182 s left") == 0.3
    assert progress_of("3/10") is None


def test_a_run_that_fails_says_why(project):
    import asyncio

    lines: list[str] = []
    (project.capture("clip") / "color" / "000002.png").unlink()
    env = os.environ.get("PYTHONPATH", "")
    os.environ["PYTHONPATH"] = f"{CODE_ROOT}{os.pathsep}{env}"
    try:
        assert not asyncio.run(Runner(project, "clip").run(lines.append))
    finally:
        os.environ["PYTHONPATH"] = env
    assert any("frame 2 is missing" in line for line in lines), lines


def test_without_nicegui_the_command_says_what_to_install(project, monkeypatch, capsys):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *rest: None if name == "nicegui" else find(name, *rest)
    )
    monkeypatch.chdir(project.root)
    with pytest.raises(SystemExit) as ended:
        main(["label", "clip"])
    assert ended.value.code == 2 and 'pip install "physreal[label]"' in capsys.readouterr().err


def test_a_port_that_is_taken_is_told(project, monkeypatch):
    pytest.importorskip("nicegui", reason='the page needs NiceGUI: pip install "physreal[label]"')
    monkeypatch.chdir(project.root)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        with pytest.raises(InputError, match="--port"):
            serve("clip", port=other.getsockname()[1], browser=False)


def test_clean_deletes_what_is_kept(project, monkeypatch, capsys):
    project.kept.mkdir(parents=True)
    (project.kept / "a.checkpoint").write_bytes(b"0" * 2**20)
    monkeypatch.chdir(project.root)
    with pytest.raises(SystemExit) as ended:
        main(["clean"])
    assert ended.value.code == 0 and "1.0 MiB" in capsys.readouterr().out and not project.kept.exists()


# --- in a browser -----------------------------------------------------------------------------------------------


@pytest.fixture
def browser():
    """A browser without a screen; skipped where the packages for it are not there."""
    pytest.importorskip("nicegui", reason='the page needs NiceGUI: pip install "physreal[label]"')
    pytest.importorskip("selenium", reason="the browser is steered by selenium: pip install selenium")
    program, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not (program and driver):
        pytest.skip("no browser: apt-get install chromium chromium-driver")
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = program
    for argument in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--window-size=1600,1000"):
        options.add_argument(argument)
    steered = webdriver.Chrome(options=options, service=Service(driver))
    yield steered
    steered.quit()


@pytest.fixture
def address(project):
    """Where `physreal label clip` is served."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    env = os.environ | {"PYTHONPATH": f"{CODE_ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    # NiceGUI starts a test client of its own under pytest, by these variables.
    env = {key: value for key, value in env.items() if not key.startswith(("PYTEST", "NICEGUI"))}
    command = [sys.executable, "-m", "pipeline.cli", "label", "clip", "--no-browser", "--port", str(port)]
    server = subprocess.Popen(command, cwd=project.root, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    place = f"http://127.0.0.1:{port}"
    try:
        _until(lambda: urllib.request.urlopen(place).status == 200, "the page is served", server)
        yield place
    finally:
        server.terminate()
        server.wait(20)


def _until(holds, what: str, server: subprocess.Popen | None = None, seconds: float = 60.0) -> None:
    """Wait until something is so."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if server is not None and server.poll() is not None:
            raise AssertionError(server.stdout.read().decode())
        try:
            if holds():
                return
        except OSError:
            pass
        time.sleep(0.2)
    raise AssertionError(f"not after {seconds:.0f} s: {what}")


@pytest.mark.slow
def test_a_click_on_the_page_becomes_a_hint_and_one_in_a_later_frame_a_correction(project, browser, address):
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By

    def one(selector: str):
        return browser.find_element(By.CSS_SELECTOR, selector)

    def click(u: float, v: float) -> None:
        image = one(".label-image img")
        width, height = image.size["width"], image.size["height"]
        at = (u + 0.5) / WIDTH * width - width / 2, (v + 0.5) / HEIGHT * height - height / 2
        ActionChains(browser).move_to_element_with_offset(image, *map(round, at)).click().perform()

    def note(text: str) -> None:
        _until(lambda: text in one(".label-note").text or "no preview" in one(".label-note").text, text)

    before = json.loads((project.capture("clip") / "capture.json").read_text())
    browser.get(address)
    _until(lambda: browser.find_elements(By.CSS_SELECTOR, ".label-image img"), "the frame is there")
    _until(lambda: one(".label-image img").size["height"] > 100, "the frame is shown")
    click(20, 10)
    _until(lambda: browser.find_elements(By.CSS_SELECTOR, ".label-image circle"), "the click is drawn")
    note("1 changes not saved")
    sheet = one(".label-sheet img")
    scale = sheet.size["width"] / Sheet(FRAMES, (128, 96), 1, 6).extent[0]
    ActionChains(browser).move_to_element_with_offset(
        sheet, round(4.5 * 128 * scale - sheet.size["width"] / 2), 0
    ).click().perform()
    _until(lambda: "frame/4.jpg" in one(".label-image img").get_attribute("src"), "frame 4 is shown")
    browser.find_element(
        By.XPATH, "//*[contains(@class, 'label-thing')]//button[.='hand' or .//*[text()='hand']]"
    ).click()
    click(30, 20)
    browser.find_element(By.XPATH, "//*[contains(@class, 'label-sign')]//button[.//*[text()='not this']]").click()
    click(40, 30)
    _until(lambda: len(browser.find_elements(By.CSS_SELECTOR, ".label-image svg path")) >= 2, "the cross is drawn")
    one(".label-save").click()
    file = project.capture("clip") / "capture.json"
    _until(lambda: "corrections" in json.loads(file.read_text()), "the clicks are saved")
    after = json.loads(file.read_text())
    assert np.allclose(after["hints"]["object"]["point"], [20, 10], atol=0.2)
    (entry,) = after["corrections"]
    assert (entry["frame"], entry["thing"], entry["labels"]) == (4, "controller", [1, 0])
    assert np.allclose(entry["points"], [[30, 20], [40, 30]], atol=0.2)
    assert {key: value for key, value in after.items() if key not in ("hints", "corrections")} == before
    assert not [line for line in browser.get_log("browser") if line["level"] == "SEVERE"]
