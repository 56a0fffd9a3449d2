"""Cases run in processes of their own, go on where they were cut off, and end in the files of the results."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from benchmarks.gap import case as one_case
from benchmarks.gap import filming, multi_process, rgbd
from benchmarks.gap.cases import GapCase
from benchmarks.gap.command import main
from benchmarks.gap.files import read_json, write_json
from benchmarks.gap.filming import PERCEIVED
from benchmarks.gap.multi_process import CONTROL, PIPES
from benchmarks.gap.results import collect, write_results
from benchmarks.gap.run import Run, card_share, core_share, environment, run_cases
from benchmarks.gap.settings import load_settings
from physreal_core.checkpoints import checkpoints
from physreal_core.errors import InputError
from physreal_core.simulation.cuda.stepper import CARD_SHARE
from pipeline.products.gap import save_added, save_gap
from pipeline.project import Project
from tests.pipeline.finished import AFTER, GAP

NONE, DRAG, WIND, SLOW = (GapCase(e, "high", 1) for e in ("none", "linear_drag", "wind", "gravity"))
FAKE = "tests.benchmarks.gap_fake_case"


def test_each_case_runs_once_and_the_results_are_written(tmp_path, capsys):
    run = Run(tmp_path / "cases", jobs=2, module=FAKE)
    ended = []
    for _ in range(2):
        run_cases([NONE, DRAG, WIND], run, ended.append)
    assert sorted(case.name for case in ended) == sorted(case.name for case in (NONE, DRAG, WIND))
    assert "3 of 3 cases are done; 0 to go" in capsys.readouterr().out
    for case in (NONE, DRAG, WIND):
        assert len((run.folder / case.name / "runs.txt").read_text().splitlines()) == 1
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "gap_benchmark.json").write_text('{"rgbd": {"named_first": 0.5}}')
    rows = collect([NONE, DRAG, WIND, SLOW], run.folder, tmp_path / "rows", "tracks_only", 7)
    text = write_results("tracks_only", rows, tmp_path / "results", not_run=1)
    record = json.loads((tmp_path / "results" / "gap_benchmark.json").read_text())
    assert record["rgbd"] == {"named_first": 0.5}
    found = record["tracks_only"]
    assert found["seed"] == 7
    assert (found["named_first"], found["false_alarm_rate"]) == (0.5, 0.0)  # drag right, wind failed
    assert (found["counts"]["failed"], found["counts"]["not_run"]) == (1, 1)
    assert text in (tmp_path / "results" / "gap_benchmark_tracks_only.md").read_text()


def test_when_time_is_up_what_runs_is_stopped_and_nothing_more_begins(tmp_path, capsys):
    run_cases([SLOW, NONE], Run(tmp_path, jobs=1, module=FAKE, minutes=0.1))
    told = capsys.readouterr().out
    assert "stopped, time is up" in told and "not begun" in told
    assert not (tmp_path / SLOW.name / "answer.json").exists() and not (tmp_path / NONE.name).exists()


def test_a_search_that_was_stopped_goes_on_from_its_last_step(tmp_path, monkeypatch):
    monkeypatch.setattr(one_case, "searched_by", lambda: "abc")
    monkeypatch.setattr(one_case, "capture", lambda case, own: None)
    monkeypatch.setattr(one_case, "experiments_of", lambda *folders: [])
    monkeypatch.setattr(one_case, "kept_out", lambda own: own)
    monkeypatch.setattr(one_case, "scored", lambda *given: {})
    worked = []

    def stopped(*given):
        if checkpoints().get("first step", {"found": (1,)}) is None:
            worked.append("first step")
            checkpoints().put("first step", {"found": np.ones(1)})
            raise KeyboardInterrupt
        return {"seconds": 1.0, "seconds_naming": 1.0}

    monkeypatch.setattr(one_case, "answer", stopped)
    with pytest.raises(KeyboardInterrupt):
        one_case.run_case(DRAG, tmp_path, load_settings(None))
    one_case.run_case(DRAG, tmp_path, load_settings(None))
    own = tmp_path / DRAG.name
    assert worked == ["first step"]
    assert json.loads((own / "answer.json").read_text()) == {"seconds": None, "seconds_naming": None, "commit": "abc"}
    assert not (own / "search").exists()


SERVICE = """#!/bin/sh
echo "$@ $(cat) $CUDA_VISIBLE_DEVICES" >> "$TOLD"
echo "$CUDA_MPS_PIPE_DIRECTORY" >> "$PLACES"
exit "$ENDS"
"""


@pytest.mark.parametrize(
    ("cards", "jobs", "ends", "expected"), [(1, 2, 0, 2), (1, 2, 1, 1), (2, 2, 0, 0), (0, 2, 0, 0)]
)
def test_cases_that_share_a_card_have_a_multi_process_service(
    tmp_path, monkeypatch, capsys, cards, jobs, ends, expected
):
    """It is started and ended, sees all cards, and where it does not start the cases run without."""
    control = tmp_path / "bin" / CONTROL
    control.parent.mkdir()
    control.write_text(SERVICE)
    control.chmod(0o755)
    for name, value in {"TOLD": tmp_path / "told", "PLACES": tmp_path / "places", "ENDS": ends}.items():
        monkeypatch.setenv(name, str(value))
    monkeypatch.setenv("PATH", f"{control.parent}:{os.environ['PATH']}")
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "5")
    monkeypatch.delenv(PIPES, raising=False)
    monkeypatch.setattr(multi_process, "USUAL", tmp_path / "nobody")
    run = Run(tmp_path / "cases", jobs=jobs, module=FAKE, cards=cards)
    run_cases([NONE, DRAG], run)
    told = (tmp_path / "told").read_text().splitlines() if expected else []
    assert [line.split() for line in told] == [["-d"], ["quit"]][:expected]
    assert len(set((tmp_path / "places").read_text().splitlines() if expected else [])) == min(expected, 1)
    assert ("no multi-process service" in capsys.readouterr().out) == (ends == 1)
    assert all((run.folder / case.name / "answer.json").is_file() for case in (NONE, DRAG))


def test_a_service_that_does_not_end_is_told_and_no_error(tmp_path, monkeypatch, capsys):
    control = tmp_path / CONTROL
    control.write_text('#!/bin/sh\n[ "$1" = -d ] || sleep 20\n')
    control.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.delenv(PIPES, raising=False)
    monkeypatch.setattr(multi_process, "USUAL", tmp_path / "nobody")
    monkeypatch.setattr(multi_process, "PATIENCE", 0.2)
    with multi_process.multi_process_service(True) as where:
        assert where
    assert "has not ended after 0.2 s" in capsys.readouterr().out


def test_cores_are_shared_out(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 1, 2, 3, 8})
    assert [core_share(number, 2) for number in range(2)] == [[0, 2, 8], [1, 3]]
    assert [core_share(number, 7) for number in range(7)] == [[0], [1], [2], [3], [8], [0], [1]]


@pytest.mark.parametrize(
    ("visible", "cards", "expected"),
    [(None, 2, ["0", "1", "0"]), ("2,3", 2, ["2", "3", "2"]), ("5", 2, ["5", "5", "5"]), ("2,3", 0, ["", "", ""])],
)
def test_jobs_share_the_cards_that_are_visible(monkeypatch, visible, cards, expected):
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    if visible:
        monkeypatch.setenv("CUDA_VISIBLE_DEVICES", visible)
    assert [card_share(number, cards) for number in range(3)] == expected


def test_jobs_share_the_memory_of_their_card(monkeypatch):
    monkeypatch.delenv(CARD_SHARE, raising=False)
    assert environment(3, "1", 2 / 44)[CARD_SHARE] == "0.0455"
    assert environment(3, "1", 2 / 44)["CUDA_VISIBLE_DEVICES"] == "1"
    assert CARD_SHARE not in environment(3, "", 0.0)
    monkeypatch.setenv(CARD_SHARE, "0.02")
    assert environment(3, "1", 2 / 44)[CARD_SHARE] == "0.02"


def test_the_search_is_called_when_the_truth_is_out_of_its_sight(tmp_path, monkeypatch):
    """The rig's truth, and the motion that is kept out, are laid aside before the answer is asked for, and read when it is on disk."""
    own = tmp_path / DRAG.name

    class Case:
        @staticmethod
        def blind(effect, strength, seed, body, form):
            return GapCase(effect, strength, seed, body, form)

    def make_case(case, destination, *, video):
        for motion in ("lift_swing", "press_drag", "shake"):
            (destination / motion).mkdir(parents=True)
            (destination / motion / "capture.json").write_text("{}")
            (destination / motion / "truth.npz").write_bytes(b"secret")
        (destination / "case.json").write_text('{"held_out": "shake", "values": {"linear_drag": {"rate": 1.0}}}')

    def answer(captures, settings, tell):
        seen = sorted(str(file.relative_to(captures)) for file in captures.rglob("*") if file.is_file())
        assert seen == ["lift_swing/capture.json", "press_drag/capture.json"]
        return {"report": {"verdict": {"kind": "none", "names": []}}, "models": {"baseline": {}, "found": None}}

    def experiments_of(captures, *further):
        assert (own / "answer.json").is_file() and further == (own / "held_out" / "shake",)
        return ["first", "second", "kept out"]

    rig = type(sys)("data.rig.case")
    rig.Case, rig.make_case, rig.TRUTH = Case, make_case, "case.json"
    monkeypatch.setitem(sys.modules, "data.rig.case", rig)
    for name, stand_in in {
        "answer": answer,
        "experiments_of": experiments_of,
        "trial_of": lambda model: model,
        "gap": lambda experiment, trial: 4.0,
        "searched_by": lambda: "abc",
    }.items():
        monkeypatch.setattr(one_case, name, stand_in)
    one_case.run_case(DRAG, tmp_path, load_settings(None))
    laid_aside = sorted(file.name for file in (own / "truth").iterdir())
    assert laid_aside == ["case.json", "lift_swing.npz", "press_drag.npz", "shake.npz"]
    assert json.loads((own / "answer.json").read_text())["commit"] == "abc"
    assert json.loads((own / "oracle.json").read_text()) == {"gaps": {"baseline": 4.0}, "closed": 0.0, "oracle": None}


def test_a_step_that_raises_is_recorded(tmp_path, monkeypatch):
    monkeypatch.setattr(one_case, "capture", lambda case, own: (_ for _ in ()).throw(RuntimeError("no rig here")))
    with pytest.raises(RuntimeError):
        one_case.run_case(DRAG, tmp_path, load_settings(None))
    assert "no rig here" in (tmp_path / DRAG.name / "failed.txt").read_text()


def test_cases_are_filmed_without_a_search(tmp_path, monkeypatch, capsys):
    """The command asks for captures alone, of cases that have none; the process of one case makes them or says why not."""
    asked = []
    monkeypatch.setattr("benchmarks.gap.command.run_cases", lambda cases, run: asked.append(([*cases], run)))
    main(["--seed", "10", "--film", "--out", str(tmp_path), "--cases", "linear_drag-high-*"])
    (((case, *_), run),) = asked
    assert (run.folder, run.module, run.arguments) == (tmp_path / "tracks_only", "benchmarks.gap.filming", ())
    monkeypatch.setattr(filming, "capture", lambda case, own: (own / "captures").mkdir())
    filming.film_case(case, run.folder)
    run_cases([case], run)
    assert "1 of 1 cases are done" in capsys.readouterr().out
    with pytest.raises(FileExistsError):
        filming.film_case(case, run.folder)
    assert "FileExistsError" in (run.folder / case.name / "failed.txt").read_text()


def test_settings_from_a_file_are_laid_over_the_librarys(tmp_path):
    path = tmp_path / "settings.json"
    path.write_text('{"temperature": 3.5, "candidates": ["wind"], "model_error": {"rms": 0.002}}')
    found, plain = load_settings(path), load_settings(None)
    assert (found.temperature, found.candidates, found.model_error.rms) == (3.5, ("wind",), 0.002)
    assert (found.shortlist, found.model_error.time) == (plain.shortlist, plain.model_error.time)
    path.write_text('{"model_error": {"size": 0.002}}')
    with pytest.raises(InputError, match="size"):
        load_settings(path)


def test_a_case_from_rgbd_is_a_project_of_its_own_whose_stages_run_in_order(tmp_path, monkeypatch):
    for motion in ("press_drag", "lift_swing"):
        (tmp_path / "captures" / motion).mkdir(parents=True)
    project, ran = rgbd.project_of(tmp_path), []
    assert project.capture("lift_swing").is_dir()

    def stage(command, cwd, **_):
        name, sequence = command[-2:]
        ran.append((name, sequence))
        output = Project.find(cwd).artifact(name, sequence)
        output.mkdir(parents=True)
        if name == "find_gap":
            save_gap(output, GAP)
        if name == "add_effect":
            save_added(output, AFTER)

    monkeypatch.setattr(subprocess, "run", stage)
    found = rgbd._answer(project)
    assert (found["report"], found["added"]) == (GAP.as_record(), AFTER.as_record())
    assert ran[: len(rgbd.SEEN)] == [(name, "press_drag") for name in rgbd.SEEN]
    assert ran[len(rgbd.SEEN) :] == [(name, "lift_swing") for name in rgbd.FITTED]
    rgbd._answer(project)
    assert len(ran) == len(rgbd.SEEN) + len(rgbd.FITTED)  # what is there is not run again


def test_perception_comes_before_the_search_and_what_is_kept_out_stays_apart(tmp_path, monkeypatch):
    """Three recordings go through perception; the project that is searched has two of them until there is an answer."""
    own = tmp_path / DRAG.name
    for motion in ("captures/press_drag", "captures/lift_swing", "held_out/shake"):
        (own / motion).mkdir(parents=True)
    write_json(own / "truth" / "case.json", {"held_out": "shake"})
    ran = []

    def stage(command, cwd, **_):
        name, sequence = command[-2:]
        ran.append((name, sequence))
        Project.find(cwd).artifact(name, sequence).mkdir(parents=True)

    monkeypatch.setattr(subprocess, "run", stage)
    rgbd.perceive_case(DRAG, tmp_path)
    assert len(ran) == 3 * len(rgbd.SEEN) and {name for name, _ in ran} == set(rgbd.SEEN)
    searched = rgbd.project_of(own)
    seen = searched.root / "data" / "artifacts" / "fit_pose"
    assert sorted(folder.name for folder in seen.iterdir()) == ["lift_swing", "press_drag"]
    assert list(read_json(own / PERCEIVED)) == [f"{name} {motion}" for name, motion in ran]
    rgbd._perceived_beside(own, searched, "given")
    assert sorted(folder.name for folder in seen.iterdir()) == ["lift_swing", "press_drag", "shake"]
    rgbd.perceive_case(DRAG, tmp_path)
    assert len(ran) == 3 * len(rgbd.SEEN)  # what is there is not run again


def test_the_command_lists_the_cases_that_patterns_choose(capsys):
    main(["--list", "--cases", "kelvin_voigt-*", "none-*"])
    names = capsys.readouterr().out.split()
    assert 2 + 20 <= len(names) <= 4 + 20 and all(
        GapCase.named(name).effect in ("kelvin_voigt", "none") for name in names
    )
