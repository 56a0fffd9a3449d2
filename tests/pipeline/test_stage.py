"""The stage machinery on toy stages: whole or absent, resumed to the same bytes, one copy only, never stale inputs."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from physreal_core.errors import InputError
from pipeline.progress import Progress
from pipeline.project import CODE_ROOT, Project
from pipeline.provenance import digest_code, digest_folder, project_modules
from pipeline.stage import run_stage
from tests.pipeline import toy

TOY = Path(toy.__file__)


@pytest.fixture
def project(tmp_path: Path) -> Project:
    (tmp_path / "data/captures/a").mkdir(parents=True)
    (tmp_path / "data/captures/a/slope.txt").write_text("2.0")
    return parameters(tmp_path)


def parameters(root: Path, **blocks: object) -> Project:
    (root / "params.yaml").write_text(json.dumps({"seed": 0, "sequences": {"a": {}}, **blocks}))
    return Project(root)


def run(stage: str, project: Project) -> Path:
    return run_stage(stage, "a", getattr(toy, stage), project, toy.GRAPH)


def in_a_process(stage: str, project: Project, **environment: str) -> subprocess.Popen:
    paths = os.pathsep.join([str(CODE_ROOT), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [sys.executable, str(TOY), stage, "a"],
        cwd=project.root,
        env={**os.environ, **environment, "PYTHONPATH": paths},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_killed_in_the_fit_and_started_again_gives_the_same_bytes(project, tmp_path_factory):
    run("load", project)
    killed = in_a_process("descend", project, PHYSREAL_KILL_AT="33")
    killed.communicate(timeout=60)
    assert killed.returncode == -9
    assert not project.artifact("descend", "a").exists()
    assert list(project.scratch("descend", "a").glob("*/checkpoint.npy"))
    resumed = digest_folder(run("descend", project))
    assert not list(project.scratch("descend", "a").glob("*/")), "scratch is removed on success"

    other = tmp_path_factory.mktemp("unbroken")
    (other / "data/captures/a").mkdir(parents=True)
    (other / "data/captures/a/slope.txt").write_text("2.0")
    unbroken = parameters(other)
    run("load", unbroken)
    assert resumed == digest_folder(run("descend", unbroken))


def test_a_checkpoint_of_other_parameters_is_not_taken_up(project):
    run("load", project)
    in_a_process("descend", project, PHYSREAL_KILL_AT="33").communicate(timeout=60)
    changed = parameters(project.root, descend={"rate": 0.01})
    broken = digest_folder(run("descend", changed))
    assert broken == digest_folder(run("descend", changed))


def test_a_second_copy_is_refused_and_the_first_is_named(project):
    run("load", project)
    slow = {"descend": {"iterations": 10_000_000}}
    first = in_a_process("descend", parameters(project.root, **slow))
    try:
        holder = project.scratch("descend", "a") / "holder"
        deadline = time.monotonic() + 30
        while not (holder.exists() and holder.read_text().strip()) and time.monotonic() < deadline:
            time.sleep(0.05)
        with pytest.raises(InputError, match=f"another copy is running \\(process {first.pid}\\)"):
            run("descend", project)
    finally:
        first.kill()
        first.communicate()
    run("descend", parameters(project.root))  # the lock went with the process


def test_a_stage_that_fails_leaves_no_output_and_keeps_the_old_one(project):
    def fails(context):
        (context.output / "half.txt").write_text("half")
        raise InputError("no good")

    with pytest.raises(InputError):
        run_stage("load", "a", fails, project, toy.GRAPH)
    assert not project.artifact("load", "a").exists()
    before = digest_folder(run("load", project))
    with pytest.raises(InputError):
        run_stage("load", "a", fails, project, toy.GRAPH)
    assert digest_folder(project.artifact("load", "a")) == before


def test_an_input_made_with_other_parameters_is_refused(project):
    run("load", project)
    with pytest.raises(InputError, match=r"parameters.noise = 0.1 where 0.2 is wanted"):
        run("descend", parameters(project.root, load={"noise": 0.2}))
    with pytest.raises(InputError, match=r"seed = 0 where 1 is wanted"):
        run("descend", parameters(project.root, seed=1))


def test_an_input_made_from_another_version_of_its_own_input_is_refused(project):
    run("load", project)
    run("descend", project)
    (project.capture("a") / "slope.txt").write_text("3.0")
    run("load", project)
    with pytest.raises(InputError, match="descend a: its output was made from another version of .*load/a"):
        run("tell", project)


def test_a_missing_input_names_the_stage(project):
    with pytest.raises(InputError, match="load a: its output .* is missing"):
        run("descend", project)


def test_an_undeclared_input_is_a_mistake_of_the_programmer(project):
    run("load", project)
    run("descend", project)
    with pytest.raises(AssertionError, match="tell does not declare that it reads load"):
        run_stage("tell", "a", lambda context: context.input("load"), project, toy.GRAPH)


def test_two_runs_give_the_same_artifact_and_the_record_stands_beside_it(project):
    first = digest_folder(run("load", project))
    assert digest_folder(run("load", project)) == first
    record = json.loads(project.record("load", "a").read_text())
    assert record["seconds"] >= 0 and record["peak_memory_mb"] > 1


def test_comments_and_docstrings_do_not_count_as_code(tmp_path):
    (tmp_path / "helper.py").write_text("def f(x):\n    return x + 1\n")
    main = tmp_path / "main.py"
    main.write_text("import helper\n\nprint(helper.f(1))\n")
    before = digest_code(main, (tmp_path,))
    (tmp_path / "helper.py").write_text('"""Adds."""\n\n\ndef f(x):\n    """One more."""\n    return x + 1  # one\n')
    assert digest_code(main, (tmp_path,)) == before
    (tmp_path / "helper.py").write_text("def f(x):\n    return x + 2\n")
    assert digest_code(main, (tmp_path,)) != before


def test_code_is_what_is_imported_and_not_what_lies_beside_it(tmp_path):
    (tmp_path / "box").mkdir()
    (tmp_path / "box/__init__.py").write_text("from box import lid, key\n")
    for name in ("lid", "key"):
        (tmp_path / "box" / f"{name}.py").write_text("value = 1\n")
    main = tmp_path / "main.py"
    main.write_text("from box.lid import value\n")
    assert [path.name for path in project_modules(main, (tmp_path,))] == ["lid.py", "main.py"]
    main.write_text("from box import lid\n")
    assert [path.name for path in project_modules(main, (tmp_path,))] == ["__init__.py", "key.py", "lid.py", "main.py"]


def test_progress_without_a_terminal_prints_few_lines(capsys):
    bar = Progress("fit", 1000)
    for _ in range(1000):
        bar.advance()
    assert capsys.readouterr().out.count("\n") == 1


def test_a_capture_that_the_rig_did_not_make_is_never_replaced(tmp_path):
    from stages.rig import run as rig

    capture = tmp_path / "data/captures/a"
    capture.mkdir(parents=True)
    (capture / "mine.txt").write_text("mine")
    (tmp_path / "params.yaml").write_text(json.dumps({"sequences": {"a": {}}, "rigged": {"a": {}}}))
    with pytest.raises(InputError, match="holds a capture that rig did not make"):
        run_stage("rig", "a", rig, Project(tmp_path))
    assert (capture / "mine.txt").read_text() == "mine"
