"""Full, read-only and forbidden disks: one sentence with the file and the remedy, the old file whole, nothing beside it."""

import errno
import os
import resource
import shutil
from contextlib import contextmanager
from pathlib import Path

import pytest

from physreal_core.errors import InputError, SimulationError
from pipeline.cli import main
from pipeline.compose import compose
from pipeline.faults import fault_of_system, one_sentence
from pipeline.project import Project
from pipeline.stage import main as stage_main
from pipeline.whole_files import write_whole
from tests.hard_use.test_names import files
from tests.pipeline import toy
from tests.pipeline.captures import write_capture

REFUSALS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file would be larger than this system allows",
    errno.EROFS: "the disk is read-only",
    errno.EACCES: "no permission",
    errno.EPERM: "no permission",
    errno.ENAMETOOLONG: "the path is too long",
    errno.EIO: "the disk cannot be read or written",
}
STEPS = ["open", "fsync", "replace"]


def refuse(monkeypatch, step: str, number: int) -> None:
    """Let a step of writing params.yaml fail as the system would let it."""
    owner, name = {"open": (Path, "open"), "fsync": (os, "fsync"), "replace": (os, "replace")}[step]
    real = getattr(owner, name)

    def fail(*arguments: object, **more: object) -> object:
        if step == "open" and ".params.yaml." not in str(arguments[0]):
            return real(*arguments, **more)
        raise OSError(number, os.strerror(number), None if step == "fsync" else str(arguments[0]))

    monkeypatch.setattr(owner, name, fail)


@contextmanager
def largest_file(size: int):
    """What a full disk does to a real write in the middle: the system takes `size` bytes of a file and no more."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture(scope="module")
def composed() -> str:
    return compose([])


@pytest.fixture
def project(tmp_path: Path, monkeypatch, composed) -> Project:
    (tmp_path / "params.yaml").write_text(composed)
    write_capture(tmp_path / "data/captures/new")
    monkeypatch.chdir(tmp_path)
    return Project(tmp_path)


def ends(capsys, call, *arguments: object) -> str:
    with pytest.raises(SystemExit) as raised:
        call(*arguments)
    error = capsys.readouterr().err
    assert raised.value.code == 2 and error.count("\n") == 1 and "Traceback" not in error
    return error


@pytest.mark.parametrize("number", REFUSALS, ids=errno.errorcode.get)
@pytest.mark.parametrize("step", STEPS)
def test_params_yaml_stays_whole_and_the_command_says_why(project, composed, monkeypatch, capsys, number, step):
    before = files(project.root)
    with monkeypatch.context() as patched:
        refuse(patched, step, number)
        error = ends(capsys, main, ["add", "new"])
    assert error.startswith("physreal: ") and REFUSALS[number] in error and "; to mend it, " in error
    assert "params.yaml" in error, "which file"
    assert project.parameters.read_text() == composed and files(project.root) == before
    if number == errno.ENOSPC:  # what is left behind does not depend on the reason
        with pytest.raises(SystemExit) as raised:
            main(["add", "new"])
        assert raised.value.code == 0, "the next try works"


@pytest.mark.parametrize("arguments", [["add", "new"], ["compose", "seed=3"]], ids=lambda words: words[0])
@pytest.mark.parametrize("size", [1, 4096, 8192])
def test_a_disk_that_fills_while_params_yaml_is_written(project, composed, capsys, arguments, size):
    before = files(project.root)
    with largest_file(size):
        error = ends(capsys, main, arguments)
    assert "params.yaml" in error and REFUSALS[errno.EFBIG] in error
    assert project.parameters.read_text() == composed and files(project.root) == before


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, MemoryError, SystemExit])
@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_an_interruption_leaves_the_old_file(tmp_path, monkeypatch, interruption, step):
    (tmp_path / "a.txt").write_text("old")

    def interrupt(*_: object) -> None:
        raise interruption

    monkeypatch.setattr(os, step, interrupt)
    with pytest.raises(interruption):
        write_whole(tmp_path / "a.txt", "new")
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("a.txt", "old")]


def test_links_and_permissions_stay(tmp_path):
    (tmp_path / "real.txt").write_text("old")
    (tmp_path / "real.txt").chmod(0o640)
    (tmp_path / "link.txt").symlink_to("real.txt")
    write_whole(tmp_path / "link.txt", "new\r\n")
    assert (tmp_path / "link.txt").is_symlink() and (tmp_path / "real.txt").read_bytes() == b"new\r\n"
    assert (tmp_path / "real.txt").stat().st_mode & 0o777 == 0o640


def wrapped(error: Exception) -> Exception:
    """As a library raises it: its own error, from the system's."""
    try:
        try:
            raise error
        except Exception as cause:
            raise RuntimeError("cannot save") from cause
    except RuntimeError as outer:
        return outer


@pytest.mark.parametrize("number", REFUSALS, ids=errno.errorcode.get)
@pytest.mark.parametrize("form", ["own", "wrapped", "words"])
def test_what_the_system_refuses_is_found_in_any_form(number, form):
    error = OSError(number, os.strerror(number), "/data/x.npz")
    forms = {
        "own": error,
        "wrapped": wrapped(error),
        "words": RuntimeError(f"Error while serializing: I/O error: {os.strerror(number)} (os error {number})"),
    }
    found = fault_of_system(forms[form])
    assert REFUSALS[number] in found.what and found.remedy and (form == "words" or found.where == "/data/x.npz")


@pytest.mark.parametrize("error", [ValueError("x"), KeyError("y"), OSError("bare"), FileNotFoundError(2, "no", "z")])
def test_faults_of_the_program_keep_their_traceback(error):
    assert fault_of_system(error) is None
    with pytest.raises(type(error)), one_sentence("physreal"):
        raise error


@pytest.mark.parametrize("error", [InputError("a", where="b"), SimulationError("c", frame=1, substep=2, particle=3)])
def test_faults_of_input_end_in_one_sentence(error, capsys):
    def fail() -> None:
        with one_sentence("fit_global mug"):
            raise error

    assert ends(capsys, fail) == f"fit_global mug: {error}\n"


def test_a_device_that_is_really_full(capsys):
    def write() -> None:
        with one_sentence("physreal"), open("/dev/full", "w") as file:
            file.write("x" * 100_000)

    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full on this system")
    assert "the disk is full" in ends(capsys, write)


@pytest.mark.parametrize("place", ["data/artifacts", ".scratch", "data/runs"])
def test_a_file_where_a_stage_wants_a_folder(tmp_path, monkeypatch, capsys, place):
    (tmp_path / "params.yaml").write_text("sequences: {mug: {}}")
    (tmp_path / "data/captures/mug").mkdir(parents=True)
    (tmp_path / "data/captures/mug/slope.txt").write_text("2.0")
    (tmp_path / place).write_text("mine")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["load", "mug"])
    error = ends(capsys, stage_main, "load", toy.load, toy.GRAPH)
    assert error.startswith("load mug: ") and place in error and "to mend it, move it away" in error
    assert (tmp_path / place).read_text() == "mine"


def test_a_disk_that_fills_while_a_stage_writes(tmp_path, monkeypatch, capsys):
    (tmp_path / "params.yaml").write_text("sequences: {mug: {}}\nload: {points: 5000}")
    (tmp_path / "data/captures/mug").mkdir(parents=True)
    (tmp_path / "data/captures/mug/slope.txt").write_text("2.0")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["load", "mug"])
    with largest_file(8192):
        error = ends(capsys, stage_main, "load", toy.load, toy.GRAPH)
    assert error.startswith("load mug: ") and "data/artifacts/.partial/load/mug" in error
    assert REFUSALS[errno.EFBIG] in error
    assert not (tmp_path / "data/artifacts/load/mug").exists()
    assert not files(tmp_path / "data/artifacts/.partial"), "nothing half written"
    stage_main("load", toy.load, toy.GRAPH)
    assert (tmp_path / "data/artifacts/load/mug/points.npz").is_file(), "the next try works"


def test_a_disk_that_fills_while_a_recording_is_imported(project, tmp_path_factory, capsys):
    source = tmp_path_factory.mktemp("recording") / "recording"
    capture = project.capture("new")
    shutil.copytree(capture / "color", source / "color")
    shutil.copy(capture / "capture.json", source / "camera.json")
    before = files(project.root)
    with largest_file(64):
        error = ends(capsys, main, ["import", "images", str(source), "mug", "--clip"])
    assert f"mug as imported from {source}" in error and REFUSALS[errno.EFBIG] in error
    assert files(project.root) == before and not project.capture("mug").exists()
    with pytest.raises(SystemExit) as raised:
        main(["import", "images", str(source), "mug", "--clip"])
    assert raised.value.code == 0, "the next try works"
