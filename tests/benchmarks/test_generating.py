"""The benchmark of data made with a twin: a part that is measured alone leaves the others as they are."""

import json
import sys

import pytest

from benchmarks import generating

TIMES = {
    "machine": "CPU, 2 cores",
    "sequence": "plush_lift",
    "episodes": 100,
    "seconds": 3.0,
    **{key: dict.fromkeys(generating.FORMS, 2.0) for key in ("real_time_factor", "megabytes", "lifted")},
}
ARM_TIMES = {
    "machine": "CPU, 2 cores, which other work shared",
    "episodes": 12,
    "forms": {form: {"without": 1.0, "with": 1.5, "ratio": 1.5, "single": [1.2, 1.7]} for form in generating.FORMS},
}


def read(arm: bool) -> dict:
    """What `scripts/read_back.py` prints."""
    names = ["waist", "gripper"] if arm else ["x", "closed"]
    return {
        "lerobot": {"version": "0.4.4", "frames": 180, "episodes": 2},
        "robomimic": {"version": "0.3.0", "sequences": 180},
        "robot": "viperx" if arm else "gripper",
        "sizes": {"observation.state": 2, "action": 2} | ({"observation.hand": 4} if arm else {}),
        "names": names,
        "pictures": 40,
        "difference": 3.0,
    }


@pytest.fixture
def run(tmp_path, monkeypatch):
    """The command with a known file, without simulation and readers: options -> what `use.json` has of it afterwards."""
    monkeypatch.setattr(generating, "RESULTS", tmp_path)
    monkeypatch.setattr("benchmarks.use.RESULTS", tmp_path)
    (tmp_path / "use.json").write_text(json.dumps({"playing": 1, "generate": TIMES | {"arm_times": ARM_TIMES}}))
    asked = []

    def measured(arguments, options):
        asked.append(options)
        return {"real_time_factor": 9.0, "megabytes": 9.0, "lifted": 2}

    monkeypatch.setattr(generating, "_measured", measured)
    monkeypatch.setattr(generating, "_read", lambda python, folder: read("--arm" in asked[-1]))

    def command(*options: str) -> dict:
        monkeypatch.setattr(sys, "argv", ["generating", *options])
        generating.main()
        known = json.loads((tmp_path / "use.json").read_text())
        assert known["playing"] == 1
        return known["generate"]

    return command


def test_reading_back_alone_leaves_the_times_as_they_are(run, tmp_path):
    block = run("--reader", "python", "--part", "read_back")
    assert {key: block[key] for key in TIMES} == TIMES and block["arm_times"] == ARM_TIMES
    assert block["read_back"]["robot"] == "gripper" and block["read_back_arm"]["robot"] == "viperx"
    page = (tmp_path / "generating.md").read_text()
    assert "(`--arm viperx --coarser 1.5 --scale 0.5`)" in page and "2 numbers: waist, gripper." in page
    assert "which other work shared" in page and "| 1.00 | 1.50 | 1.50 | 1.20 to 1.70 |" in page


def test_without_a_reader_nothing_is_read_back(run, tmp_path, capsys):
    block = run("--part", "times")
    assert "read_back" not in block and block["real_time_factor"] == dict.fromkeys(generating.FORMS, 9.0)
    assert "Read back" not in (tmp_path / "generating.md").read_text()
    with pytest.raises(SystemExit):
        run("--part", "read_back")
    assert "--part read_back needs --reader" in capsys.readouterr().err


def test_data_that_the_readers_refuse_end_the_benchmark(tmp_path):
    script = tmp_path / "read_back.py"
    script.write_text("import sys; sys.exit('action differs')")
    with pytest.MonkeyPatch.context() as patch, pytest.raises(SystemExit, match="failed with code 1"):
        patch.setattr(generating, "READER", script)
        generating._read(sys.executable, tmp_path)
