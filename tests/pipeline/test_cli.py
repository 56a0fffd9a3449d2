"""The command line: light to start, clear when something is wrong, imports that end in a runnable params.yaml."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from physreal_core.cores import available_cores
from physreal_core.errors import InputError
from pipeline.cli import main
from pipeline.compose import compose
from pipeline.config import load_parameters
from pipeline.project import CODE_ROOT, Project
from tests.pipeline.captures import K, write_capture

HEAVY = "torch", "warp", "scipy", "cv2", "hydra", "dvc", "open3d", "onnxruntime", "matplotlib"


def heavy_after(code: str) -> str:
    script = f"import sys\n{code}\nprint([name for name in {HEAVY} if name in sys.modules])"
    result = subprocess.run([sys.executable, "-c", script], cwd=CODE_ROOT, capture_output=True, text=True, check=True)
    return result.stdout.strip().splitlines()[-1]


@pytest.mark.parametrize(
    "code",
    [
        "from pipeline.cli import _parser; _parser().format_help()",
        "from pipeline.config import load_parameters; from pathlib import Path; load_parameters(Path('params.yaml'))",
        "import stages.summarise",
        "import stages.parse_video",
    ],
)
def test_nothing_heavy_is_imported_for_little(code):
    assert heavy_after(code) == "[]"


def run(project: Project, *arguments: object) -> int:
    here = Path.cwd()
    os.chdir(project.root)
    try:
        with pytest.raises(SystemExit) as raised:
            main([str(argument) for argument in arguments])
    finally:
        os.chdir(here)
    return raised.value.code


@pytest.fixture
def project(tmp_path: Path) -> Project:
    (tmp_path / "params.yaml").write_text(compose([]))
    return Project(tmp_path)


def test_check_reads_captures_and_names_the_fault(project, capsys):
    capture = write_capture(project.capture("plush_lift"))
    assert run(project, "check") == 0
    said = capsys.readouterr().out
    assert "plush_lift: 4 frames of 48x36 at 30 Hz, depth in 4" in said and "`dvc repro` makes it" in said
    (capture / "depth" / "000002.png").write_bytes(b"")
    assert run(project, "check", capture) == 2
    assert "depth/000002.png" in capsys.readouterr().err


def test_compose_check_sees_an_edit(project):
    assert run(project, "compose", "--check") == 0
    project.parameters.write_text(project.parameters.read_text().replace("max_width: 640", "max_width: 320"))
    assert run(project, "compose", "--check") == 1
    assert run(project, "compose") == 0
    assert run(project, "compose", "--check") == 0


def test_compose_check_names_a_dvc_file_that_the_code_has_left_behind(project, monkeypatch, capsys):
    monkeypatch.setattr("pipeline.compose.CODE_ROOT", project.root)
    assert run(project, "compose", "--check") == 1
    assert run(project, "compose") == 0
    assert run(project, "compose", "--check") == 0
    for name in ("pipeline/find_gap/dvc.yaml", "dvc.yaml"):
        assert (project.root / name).read_text() == (CODE_ROOT / name).read_text()
    left = project.root / "pipeline/find_gap/dvc.yaml"
    left.write_text(left.read_text().replace("- stages/_gap.py\n", ""))
    capsys.readouterr()
    assert run(project, "compose", "--check") == 1
    assert capsys.readouterr().err == "stale: pipeline/find_gap/dvc.yaml; run `physreal compose`\n"


def test_import_writes_the_capture_and_enters_it(project, tmp_path, capsys):
    source = tmp_path / "recording"
    (source / "color").mkdir(parents=True)
    for frame in range(3):
        Image.fromarray(np.zeros((36, 48, 3), np.uint8)).save(source / "color" / f"{frame}.png")
    (source / "camera.json").write_text(json.dumps({"K": K.tolist(), "T_world_camera": np.eye(4).tolist()}))
    assert run(project, "import", "images", source, "mug", "fps=15", "--clip") == 0
    assert "mug" in load_parameters(project.parameters).values.clips
    assert json.loads((project.capture("mug") / "capture.json").read_text())["fps"] == 15
    capsys.readouterr()
    assert run(project, "import", "images", source, "mug") == 2
    assert "mug exists" in capsys.readouterr().err
    assert run(project, "import", "images", source, "jug", "fsp=15") == 2
    assert "did you mean fps?" in capsys.readouterr().err


def test_a_capture_folder_is_entered_with_every_key_that_dvc_needs(project, capsys):
    write_capture(project.capture("mug"))
    assert run(project, "add", "mug") == 0
    assert "evaluate@mug" in capsys.readouterr().out
    raw = yaml.safe_load(project.parameters.read_text())
    assert "mug" in raw["fits"] and raw["sequences"]["mug"].keys() == raw["sequences"]["plush_lift"].keys()
    assert run(project, "add", "jug") == 2


def test_status_and_run_name_what_is_missing(project, capsys):
    assert run(project, "status") == 0
    assert "no report yet" in capsys.readouterr().out
    assert run(project, "run", "fit_gobal", "plush_lift") == 2
    assert "did you mean fit_global?" in capsys.readouterr().err


def test_status_says_what_a_run_took(project, capsys):
    record = project.record("parse_video", "plush_lift")
    record.parent.mkdir(parents=True)
    record.write_text(json.dumps({"seconds": 123.44, "peak_memory_mb": 567.8}))
    assert run(project, "status") == 0
    said = capsys.readouterr().out
    assert "123.4" in said and "568" in said and "2.1 minutes" in said


def test_threads_follow_the_quota(tmp_path):
    (tmp_path / "cpu.max").write_text("100000 100000\n")
    assert available_cores(tmp_path / "cpu.max") == 1
    (tmp_path / "cpu.max").write_text("max 100000\n")
    assert available_cores(tmp_path / "cpu.max") == available_cores(tmp_path / "nothing") >= 1


def test_cores_are_no_more_than_the_share_that_is_given(monkeypatch):
    monkeypatch.setenv("PHYSREAL_CORES", "1")
    assert available_cores() == 1
    monkeypatch.setenv("PHYSREAL_CORES", "none")
    with pytest.raises(InputError, match="PHYSREAL_CORES is 'none'"):
        available_cores()
