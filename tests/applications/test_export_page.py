"""`physreal export --format page`: what the player reads, and the page in a real browser, opened from the disk."""

import io
import shutil
import time

import numpy as np
import pytest

from applications.export.moving import Moving
from applications.export.page import document as module
from applications.export.page.packed import COLUMNS, Packed
from physreal_core.errors import InputError
from pipeline.models import require
from pipeline.project import CODE_ROOT
from tests.applications.test_export import exported


def test_packed_numbers_are_the_carried_gaussians(twin):
    moving = Moving.of(twin)
    packed = Packed.of(moving)
    scales = packed.scales
    numbers = np.frombuffer(packed.motion, "<u2").reshape(scales["frames"], scales["splats"], COLUMNS) / 65535
    low, high = (np.array(scales[end]) for end in ("low", "high"))
    for now, gaussians in zip(numbers, moving.splats(), strict=True):
        assert np.allclose(low + now[:, :3] * (high - low), gaussians.means, atol=1e-5)
        assert np.allclose(now[:, 3:6] * scales["largest"], gaussians.log_scales.exp(), atol=1e-6)
        assert np.allclose(now[:, 6:] * 2 - 1, np.roll(gaussians.rotations, -1, -1), atol=1e-4)
    colours = np.frombuffer(packed.colours, "u1").reshape(-1, 4) / 255
    assert np.allclose(colours, np.hstack([twin.colours(), twin.opacities()]), atol=1 / 255)


def test_without_a_connection_nothing_is_written_and_the_remedy_is_told(project, monkeypatch, tmp_path, capsys):
    def broken(names, folder):
        raise InputError("`npm pack` failed", remedy="check the connection to the registry")

    monkeypatch.setattr(module, "fetch", broken)
    with pytest.raises(AssertionError):
        exported(project, monkeypatch, tmp_path, "page")
    assert "check the connection" in capsys.readouterr().err and not list(tmp_path.iterdir())


def test_a_motion_capture_has_no_page(twin, tmp_path):
    import dataclasses

    blind = dataclasses.replace(twin, gaussians=None, camera=None)
    with pytest.raises(InputError, match="--format page.*gltf"):
        module.write(Moving.of(blind), tmp_path)


def pinned() -> dict:
    """Spark and three.js in data/models of this checkout; skips the test where they are not."""
    try:
        found = [require(name, CODE_ROOT / "data" / "models") for name in ("three", "spark")]
    except InputError:
        pytest.skip("Spark and three.js are not fetched: physreal models page")
    return {file: path for files in found for file, path in files.items()}


@pytest.mark.slow
def test_in_a_browser_splats_are_drawn_and_time_moves(project, monkeypatch, tmp_path):
    """Chromium without a screen opens the file, which asks for no other, and lets it play; then time stands where the slider says."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
    if not (shutil.which("chromium") and shutil.which("chromedriver")):
        pytest.skip("no chromium with its driver: apt-get install chromium chromium-driver")
    from PIL import Image

    files = pinned()
    monkeypatch.setattr(module, "_fetched", lambda: files)
    page = exported(project, monkeypatch, tmp_path, "page") / "page.html"
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium")
    for flag in ("--headless=new", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"):
        options.add_argument(flag)
    options.add_argument("--window-size=800,600")
    browser = webdriver.Chrome(options, webdriver.ChromeService(shutil.which("chromedriver")))

    def picture() -> np.ndarray:
        return np.asarray(Image.open(io.BytesIO(browser.get_screenshot_as_png())).convert("RGB"), dtype=int)[40:400]

    def shown(frame: int) -> np.ndarray:
        browser.execute_script(
            "const s = document.getElementById('time'); s.value = arguments[0]; s.dispatchEvent(new Event('input'))",
            frame,
        )
        time.sleep(3)
        return picture()

    try:
        browser.get(page.as_uri())
        deadline = time.monotonic() + 60
        while browser.find_element("id", "told").text != "lift" and time.monotonic() < deadline:
            time.sleep(0.2)
        times = set()
        while len(times) < 3 and time.monotonic() < deadline:
            times.add(browser.find_element("id", "frame").text)
        assert len(times) >= 3, "it plays"
        first, last = shown(0), shown(7)
        assert (
            browser.find_element("id", "play").text == "Play" and browser.find_element("id", "frame").text == "0.23 s"
        )
        asked = browser.execute_script("return performance.getEntriesByType('resource').map(r => r.name)")
        assert all(name.startswith(("blob:", "data:")) for name in asked), "nothing else is loaded"
    finally:
        browser.quit()
    background = np.array([0xED, 0xF0, 0xF5])
    for now in (first, last):
        assert (np.abs(now - background).max(-1) > 30).mean() > 0.005, "splats are drawn"
    assert (np.abs(last - first).max(-1) > 30).mean() > 0.002, "they have moved"
