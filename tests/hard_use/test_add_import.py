"""`physreal add` and `physreal import`: nothing lost, nothing left behind, whatever goes wrong and however many at once."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from pipeline.cli import main
from pipeline.compose import compose
from pipeline.config import load_parameters
from pipeline.project import CODE_ROOT, Project
from tests.hard_use.test_names import files
from tests.pipeline.captures import K, write_capture

MINE = """\
# my own remarks
seed: 7  # my lucky number

sequences:  # what I filmed
  mug:  # the blue one
    geometry: linear  # it is a rope, really
    fit_global: {youngs_modulus: {initial: 2.0e4}}  # measured by hand

  # the other one
  "jug": {}
clips: {}  # none yet
fits:
  mug:
    companion: jug  # the same object

# how long I search
find_gap:
  seconds: 2
"""


@pytest.fixture(scope="module")
def capture(tmp_path_factory) -> Path:
    return write_capture(tmp_path_factory.mktemp("captures") / "capture")


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    (folder / "color").mkdir()
    random = np.random.default_rng(0)
    for frame in range(3):
        Image.fromarray(random.integers(0, 255, (36, 48, 3), dtype=np.uint8)).save(folder / "color" / f"{frame}.png")
    (folder / "camera.json").write_text(json.dumps({"K": K.tolist(), "T_world_camera": np.eye(4).tolist()}))
    return folder


@pytest.fixture
def project(tmp_path: Path, monkeypatch) -> Project:
    project = Project(tmp_path / "project")
    project.root.mkdir()
    project.parameters.write_text(MINE)
    monkeypatch.chdir(project.root)
    return project


def run(capsys, *arguments: object) -> tuple[int, str, str]:
    capsys.readouterr()
    with pytest.raises(SystemExit) as raised:
        main([str(argument) for argument in arguments])
    said = capsys.readouterr()
    return raised.value.code, said.out, said.err


def refused(capsys, *arguments: object) -> str:
    """What is said of a command that does nothing: one line, exit code 2, every file as it was."""
    before = {name: Path(name).read_bytes() for name in files(Path.cwd())}
    code, _, error = run(capsys, *arguments)
    assert code == 2 and error.startswith("physreal: ") and error.count("\n") == 1, error
    assert {name: Path(name).read_bytes() for name in files(Path.cwd())} == before
    return error


@pytest.mark.parametrize("flag", [[], ["--clip"]])
@pytest.mark.parametrize("name", ["new", "2026-11-23", "123", "true", "null"])
def test_add_changes_nothing_but_what_it_enters(project, capture, capsys, name, flag):
    shutil.copytree(capture, project.capture(name))
    code, said, _ = run(capsys, "add", name, *flag)
    assert code == 0 and f"entered {name}" in said
    lines = iter(project.parameters.read_text().splitlines())
    kept = [line for line in MINE.splitlines() if line != "clips: {}  # none yet" or not flag]
    assert all(line in lines for line in kept), "every line of mine is there, in my order"
    assert "# none yet" in project.parameters.read_text()
    before, after = yaml.safe_load(MINE), load_parameters(project.parameters)
    home, role = ("clips", "clips") if flag else ("sequences", "fits")
    assert {block: value for block, value in after.raw.items() if block not in (home, role)} == {
        block: value for block, value in before.items() if block not in (home, role)
    }
    for block in {home, role}:
        added = after.raw[block].pop(name)
        assert added and after.raw[block] == before[block]


def test_a_later_add_leaves_the_earlier_one_and_its_blank_lines(project, capture, capsys):
    for name in ("one", "two"):
        shutil.copytree(capture, project.capture(name))
        assert run(capsys, "add", name)[0] == 0
    text = project.parameters.read_text()
    assert "\n  two:\n    companion: two\n\n# how long I search\n" in text
    assert list(load_parameters(project.parameters).values.fits) == ["mug", "one", "two"]


@pytest.mark.parametrize(
    ("name", "flag", "words"),
    [
        ("mug", [], "params.yaml: mug is entered already, under fits; to mend it, change its values there"),
        ("mug", ["--clip"], "mug is under sequences; expected no name under sequences that is to be under clips"),
        ("jug", ["--clip"], "jug is under sequences"),
        ("clip", [], "clip is under clips; expected no name under clips that is to be under fits"),
        ("clip", ["--clip"], "clip is entered already, under clips"),
        ("told", [], "told is under predictions"),
        ("absent", [], "there is no folder"),
    ],
)
def test_an_entered_name_is_never_entered_over(project, capture, capsys, name, flag, words):
    told = "\n  told: {}\nclips:\n  clip: {parse_video: {max_frames: 3}}\npredictions:\n  told: {model_from: mug}\n"
    project.parameters.write_text(MINE.replace("\nclips: {}  # none yet\n", told))
    if name != "absent":
        shutil.copytree(capture, project.capture(name))
    error = refused(capsys, "add", name, *flag)
    assert words in error and "to mend it" in error


def test_a_sequence_without_the_role_gets_it_and_keeps_its_own_values(project, capture, capsys):
    project.parameters.write_text(
        MINE.replace('"jug": {}', '"jug": {geometry: planar, find_gap: {seconds: 4}}  # soft')
    )
    shutil.copytree(capture, project.capture("jug"))
    assert run(capsys, "add", "jug")[0] == 0
    parameters = load_parameters(project.parameters)
    assert parameters.raw["sequences"]["jug"] == {"geometry": "planar", "find_gap": {"seconds": 4}}
    assert parameters.values.fits["jug"].companion == "jug" and parameters.values.fits["mug"].companion == "jug"
    assert "# soft" in project.parameters.read_text()


@pytest.mark.parametrize(
    "text",
    [
        '{"seed": 0, "sequences": {"a": {}}}',
        "seed: 0",
        "seed: 0\nsequences:\nfits:\n",
        "seed: 0\r\nsequences:\r\n  a: {}\r\n",
        "%YAML 1.2\n---\nseed: 0  # mine\n",
        "sequences:\n    a:\n        fit_global: &own {device: cpu}\n    b: {fit_global: *own}\n",
        "\ufeffseed: 0\n",
    ],
)
def test_files_of_other_layouts_are_extended_or_left_alone(project, capture, capsys, text):
    project.parameters.write_text(text, newline="")
    before = yaml.safe_load(text)
    shutil.copytree(capture, project.capture("new"))
    code, _, error = run(capsys, "add", "new")
    if code:
        assert error.count("\n") == 1 and project.parameters.read_bytes() == text.encode()
    else:
        after = load_parameters(project.parameters)
        assert list(after.values.fits) == ["new"] and after.raw["sequences"].pop("new")
        assert after.raw["sequences"] == (before.get("sequences") or {})


def test_add_to_the_composed_file_costs_no_line_of_it(project, capture, capsys):
    composed = compose([])
    project.parameters.write_text(composed)
    shutil.copytree(capture, project.capture("new"))
    assert run(capsys, "add", "new")[0] == 0
    text = project.parameters.read_text().splitlines()
    rest = iter(text)
    assert all(line in rest for line in composed.splitlines())
    assert len(text) == len(composed.splitlines()) + 17, "15 stages and geometry under sequences, two lines under fits"


def test_add_enters_the_geometry_that_the_capture_states(project, capture, capsys):
    shutil.copytree(capture, project.capture("towel"))
    path = project.capture("towel") / "capture.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"geometry": "planar", "thickness": 0.001}))
    assert run(capsys, "add", "towel")[0] == 0
    assert load_parameters(project.parameters).sequence("towel").geometry == "planar"


def test_composing_says_which_entered_names_it_drops(project, capsys):
    code, said, _ = run(capsys, "compose", "seed=3")
    assert code == 0 and "warning: no longer in params.yaml: jug, mug" in said
    assert "lucky" not in project.parameters.read_text() and load_parameters(project.parameters).seed == 3
    project.parameters.write_text("seed: [")
    assert run(capsys, "compose")[0] == 0, "composing mends a file that cannot be read"


def command(project: Project, *arguments: str) -> subprocess.Popen:
    environment = {**os.environ, "PYTHONPATH": str(CODE_ROOT), "OMP_NUM_THREADS": "1"}
    call = [sys.executable, "-m", "pipeline.cli", *arguments]
    return subprocess.Popen(call, cwd=project.root, env=environment, stderr=subprocess.PIPE, text=True)


def test_adds_at_the_same_time_are_all_there(project, capture):
    names = [f"new{k}" for k in range(4)]
    for name in names:
        shutil.copytree(capture, project.capture(name))
    running = [command(project, "add", name) for name in [*names, names[0]]]
    codes = [process.wait(timeout=120) for process in running]
    errors = [process.stderr.read() for process in running]
    assert sorted(codes) == [0, 0, 0, 0, 2], errors
    assert "new0 is entered already, under fits" in "".join(errors)
    assert sorted(load_parameters(project.parameters).values.fits) == ["mug", *names]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["fps=abc"], "option fps: 'abc'; expected"),
        (["fps=0"], "option fps: '0'; expected greater than 0"),
        (["fps=-30"], "greater than 0"),
        (["fps=nan"], "finite number"),
        (["fps=inf"], "finite number"),
        (["fps=1e999"], "finite number"),
        (["fps=[1,2]"], "number"),
        (["fps="], "option fps: ''"),
        (["fps"], "fps has no value; expected fps=value"),
        (["fps=30", "fps=15"], "fps is given twice"),
        (["fsp=30"], "unknown key fsp; did you mean fps?"),
        (["zzz=1"], "unknown key zzz; expected one of fps, depth_unit, description, controller"),
        (["=3"], "unknown key"),
        (["depth_unit=0"], "option depth_unit: '0'; expected greater than 0"),
        (["depth_unit=mm"], "option depth_unit: 'mm'"),
    ],
)
def test_options_of_import(project, recording, capsys, options, words):
    error = refused(capsys, "import", "images", recording, "new", *options)
    assert words in error and "physreal import images" in error and "to mend it" in error
    assert run(capsys, "import", "images", recording, "new", "--clip", "fps=12.5")[0] == 0, "the next try works"
    assert json.loads((project.capture("new") / "capture.json").read_text())["fps"] == 12.5


@pytest.mark.parametrize(
    ("kind", "option", "words"),
    [
        ("phystwin", "camera=-1", "greater than or equal to 0"),
        ("phystwin", "camera=0.5", "integer"),
        ("phystwin", "results=perhaps", "'camera'"),
        ("realsense", "frames=0", "greater than or equal to 1"),
        ("realsense", "frames=many", "integer"),
        ("silicone_beam", "duration=-1", "greater than 0"),
        ("silicone_beam", "split=2", "less than or equal to 1"),
        ("silicone_beam", "split=nan", "finite"),
    ],
)
def test_options_of_the_other_kinds(project, recording, capsys, kind, option, words):
    error = refused(capsys, "import", kind, recording, "new", option)
    assert words in error and f"physreal import {kind}, option {option.partition('=')[0]}" in error


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["image", "SOURCE", "new"], "unknown key image; did you mean images?"),
        (["images"], "a recording and a name are missing"),
        (["images", "SOURCE"], "a name is missing"),
        (["images", "nowhere", "new"], "nowhere: there is no such file or folder"),
        (["images", "SOURCE", "there"], "data/captures/there exists; to mend it, choose another name"),
        (["images", "SOURCE", "mug"], "mug is entered already, under fits"),
        (["images", "SOURCE", "mug", "--clip"], "mug is under sequences"),
        (["images", "SOURCE", "../x"], "'../x' is no name for a sequence"),
        (["images", "SOURCE", "/tmp/x"], "is no name for a sequence"),
        (["images", "SOURCE", ""], "'' is no name for a sequence"),
    ],
)
def test_an_import_that_cannot_be(project, recording, capture, capsys, arguments, words):
    shutil.copytree(capture, project.capture("there"))
    arguments = [str(recording) if word == "SOURCE" else word for word in arguments]
    error = refused(capsys, "import", *arguments)
    assert words in error and "to mend it" in error


def spoil_no_images(source: Path) -> None:
    shutil.rmtree(source / "color")


def spoil_no_camera(source: Path) -> None:
    (source / "camera.json").unlink()


def spoil_frame(source: Path) -> None:
    (source / "color" / "1.png").write_bytes((source / "color" / "1.png").read_bytes()[:200])


def spoil_size(source: Path) -> None:
    Image.new("RGB", (10, 10)).save(source / "color" / "2.png")


def spoil_key(source: Path) -> None:
    camera = json.loads((source / "camera.json").read_text())
    (source / "camera.json").write_text(json.dumps({**camera, "T_world_camera": [1, 2, 3]}))


@pytest.mark.parametrize(
    "spoil",
    [spoil_no_images, spoil_no_camera, spoil_frame, spoil_size, spoil_key],
    ids=lambda f: f.__name__,
)
def test_a_recording_that_cannot_be_used_leaves_nothing(project, recording, tmp_path, capsys, spoil):
    source = shutil.copytree(recording, tmp_path / "source")
    spoil(source)
    error = refused(capsys, "import", "images", source, "new", "--clip")
    assert ".importing" not in error, "nobody will find the draft"
    assert not project.capture("new").exists() and not list((project.root / "data/captures").glob(".importing/*"))
    shutil.rmtree(source)
    shutil.copytree(recording, source)
    assert run(capsys, "import", "images", source, "new", "--clip")[0] == 0, "the next try works"


def test_an_import_that_cannot_be_entered_takes_its_capture_back(project, recording, monkeypatch, capsys):
    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device", "params.yaml")

    with monkeypatch.context() as patched:
        patched.setattr("pipeline.parameters_file.write_whole", fail)
        error = refused(capsys, "import", "images", recording, "new", "--clip")
    assert "params.yaml: the disk is full" in error and not project.capture("new").exists()
    assert run(capsys, "import", "images", recording, "new", "--clip")[0] == 0


def test_what_a_killed_import_left_is_no_hindrance(project, recording, capsys):
    draft = project.capture_draft("new")
    draft.mkdir(parents=True)
    (draft / "capture.json").write_text("{")
    assert run(capsys, "import", "images", recording, "new", "--clip")[0] == 0
    assert files(project.capture("new")) == {"capture.json", *(f"color/00000{k}.png" for k in range(3))}
    assert not draft.parent.exists()


def test_two_imports_under_one_name(project, recording, capsys):
    from filelock import FileLock

    project.import_lock("new").parent.mkdir(parents=True)
    with FileLock(project.import_lock("new")):
        assert "new is being imported by another process" in refused(capsys, "import", "images", recording, "new")
    assert run(capsys, "import", "images", recording, "new", "--clip")[0] == 0


def test_a_reader_that_has_seen_enough_ends_it_quietly(project):
    command = f"{sys.executable} -m pipeline.cli import | true; exit ${{PIPESTATUS[0]}}"
    ended = subprocess.run(
        ["bash", "-c", command],
        check=False,
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": str(CODE_ROOT)},
    )
    assert ended.returncode == 141 and ended.stderr == ""
