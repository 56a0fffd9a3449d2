"""Checkpoints that are damaged, of other code, or cannot be written; long computations killed between any two of them.

A piece is a computation that remembers its parts, made small. Whatever happens to its files it ends in the same bytes.
"""

import dataclasses
import errno
import hashlib
import io
import warnings
from pathlib import Path

import numpy as np
import pytest
import torch

from physreal_core import checkpoints as module
from physreal_core.checkpoints import Checkpoints, checkpoints, digest_of, record_array, remembered
from physreal_core.effects import EFFECTS
from physreal_core.fitting.descent import Descent, DescentConfig
from physreal_core.gap import Experiment, GapSettings, Search, Trial
from physreal_core.gap.noise.model import ModelError
from physreal_core.geometry.pose_search import remembered_pose
from physreal_core.geometry.similarity import Similarity
from physreal_core.perception.association import Thing, follow_masks
from physreal_core.perception.flow_tracker import FlowTracker
from physreal_core.perception.mask_geometry import spread_points
from pipeline.provenance import digest_folder
from pipeline.stage import run_stage
from stages import predict
from tests.fitting import scene, test_stages
from tests.fitting.test_descent import FULL, VARIABLES, spring, start
from tests.gap.linear import ANSWERS, LinearExperiment, register
from tests.perception.scene import FilmSegmenter, film


@pytest.fixture(autouse=True)
def made_up_effects(monkeypatch):
    register(monkeypatch)


@pytest.fixture(autouse=True)
def state_after_every_step(monkeypatch):
    """A loop writes its state whenever it may."""
    monkeypatch.setattr(module, "SECONDS_BETWEEN", 0.0)


# --- pieces -----------------------------------------------------------------------------------------------------


def descent() -> list[np.ndarray]:
    """A fit whose objective draws random numbers."""
    torch.manual_seed(0)

    def noisy(values, horizon):
        total, terms = spring(values, horizon)
        return total * (1.0 + 0.01 * torch.rand((), dtype=torch.float64)), terms

    found = Descent(VARIABLES, start(), noisy, FULL, DescentConfig(8, warmup=3, checkpoint_every=2)).run()
    return [*(value.numpy() for value in found.values.values()), record_array(found.history)]


def search(second: float = 0.0) -> list[np.ndarray]:
    """A whole search for a missing effect, in a linear world where one or two are missing."""
    settings = GapSettings(candidates=("drift", "sink"), shortlist=1, model_error=ModelError(rms=3e-4, moved=1e-4))
    truth = {"sink": {"amount": 0.9}, "drift": {"east": second}}
    report = Search([LinearExperiment(ANSWERS, truth)], settings).run().report()
    return [record_array(repr(report.as_record()))]


_MODEL = scene.model()
_PROBLEM = dataclasses.replace(scene.problem(_MODEL, frames=5, observed=4), camera=None)


def rollouts() -> list[np.ndarray]:
    """Trials of two effects, in batches of their own, with our simulator."""
    experiment = Experiment(_PROBLEM, _MODEL)
    wind = [{"wind": {"x": 0.0, "y": size, "z": 0.0}} for size in (1.0, 3.0)]
    drag = [{"linear_drag": {"rate": rate}} for rate in (0.5, 2.0)]
    return [experiment.predict([Trial(_MODEL.fields, effects) for effects in ({}, *wind, *drag)])]


_FILM = film(4)


def tracks() -> list[np.ndarray]:
    """Points followed by the flow."""
    found = FlowTracker().track(_FILM.frames, spread_points(_FILM.objects[0], 15))
    return [found.points, found.visible]


def masks() -> list[np.ndarray]:
    """An object followed over keyframes."""
    tracker = FlowTracker()
    thing = Thing("object", _FILM.objects[0], tracker.track(_FILM.frames, spread_points(_FILM.objects[0], 15)))
    away = spread_points(~_FILM.objects[0], 20)
    background = dataclasses.replace(tracker, anchored=False).track(_FILM.frames, away)

    def flow(a, b):
        return tracker.flow_between(_FILM.frames, a, b)

    found = follow_masks(_FILM.frames, [thing], background, FilmSegmenter(_FILM), flow, stride=2)
    return [found.masks["object"], record_array(found.keyframes["object"])]


def poses() -> list[np.ndarray]:
    """Three improved poses, each a part of the whole."""
    found = [
        remembered_pose("pose", lambda n=n: (0.1 * n, Similarity(np.eye(3), np.full(3, n / 3), 1.0 + n)), n)
        for n in range(3)
    ]
    return [np.array([value for value, _ in found]), *(pose.matrix for _, pose in found)]


def nested() -> list[np.ndarray]:
    """A result of parts, which are deleted as soon as it is there."""

    def part(n):
        return remembered("part", lambda: [n], {"x": (4,)}, lambda: {"x": np.sqrt(np.arange(4.0) + n)})["x"]

    whole = [
        remembered("whole", list, {"sum": (4,)}, lambda k=k: {"sum": sum(part(k + n) for n in range(3))})
        for k in range(2)
    ]
    return [one["sum"] for one in whole]


def told() -> list[np.ndarray]:
    """A record and an image, as `evaluate` remembers of a frame."""
    shapes = {"scores": (None,), "picture": (None,)}
    frames = [
        remembered(
            "frame",
            lambda t=t: [t],
            shapes,
            lambda t=t: {"scores": record_array({"iou": t / 3}), "picture": np.full(20 + t, t, np.uint8)},
        )
        for t in range(3)
    ]
    return [array for frame in frames for array in frame.values()]


PIECES = {
    piece.__name__: piece for piece in (descent, search, rollouts, tracks, masks, poses, nested, told)
}  # the search's and the film's parts are those of find_gap, add_effect and segment_and_track


def packed(**arrays: object) -> bytes:
    """A file whose digest is right, whatever is in it."""
    archive = io.BytesIO()
    np.savez(archive, **arrays)
    return hashlib.sha256(archive.getvalue()).digest() + archive.getvalue()


def flipped(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


DAMAGES = {
    "empty": lambda content: b"",
    "cut off": lambda content: content[: len(content) // 2],
    "one bit": flipped,
    "garbage": lambda content: np.random.default_rng(0).bytes(len(content)),
    "no archive": lambda content: hashlib.sha256(b"no archive").digest() + b"no archive",
    "nothing but a digest": lambda content: hashlib.sha256(b"").digest(),
    "longer": lambda content: content + b"more",
    "other arrays": lambda content: packed(other=np.zeros(3)),
    "other shapes": lambda content: packed(
        **{name: np.zeros((3, *array.shape, 2)) for name, array in np.load(io.BytesIO(content[32:])).items()}
    ),
    "pickled objects": lambda content: packed(
        **{name: np.array([{}], object) for name in np.load(io.BytesIO(content[32:]))}
    ),
}


HEAVY, TYPICAL = ("search", "rollouts", "tracks", "masks"), ("cut off", "one bit", "other shapes", "no archive")
"""Pieces of a tenth of a second and more, and the damages that they are given."""


def same(one: list[np.ndarray], other: list[np.ndarray]) -> bool:
    return len(one) == len(other) and all(
        a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
        for a, b in zip(one, other, strict=True)
    )


@pytest.fixture(scope="module")
def undisturbed(request):
    """Results without any checkpoint."""
    known = {}

    def result(name: str) -> list[np.ndarray]:
        if name not in known:
            known[name] = PIECES[name]()
        return known[name]

    return result


def files(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.checkpoint"))


# --- damage -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("piece", "damage"),
    [(piece, damage) for piece in PIECES for damage in DAMAGES if piece not in HEAVY or damage in TYPICAL],
)
def test_a_damaged_checkpoint_is_told_and_discarded(piece, damage, tmp_path, undisturbed):
    expected = undisturbed(piece)
    with Checkpoints(tmp_path):
        PIECES[piece]()
    before = {path: path.read_bytes() for path in files(tmp_path)}
    assert before, "nothing was remembered, so nothing would be proved"
    for path, content in before.items():
        path.write_bytes(DAMAGES[damage](content))
    with (
        pytest.warns(UserWarning, match=r"\.checkpoint: a damaged checkpoint is discarded \(.+\)") as found,
        Checkpoints(tmp_path),
    ):
        again = PIECES[piece]()
    assert same(again, expected)
    assert len(found) == len(before), "each is told once"
    assert {path: path.read_bytes() for path in files(tmp_path)} == before, "each is made anew"


@pytest.mark.parametrize("piece", PIECES)
def test_one_damaged_checkpoint_costs_its_own_part_alone(piece, tmp_path, undisturbed, monkeypatch):
    with Checkpoints(tmp_path):
        PIECES[piece]()
    paths = files(tmp_path)
    last = max(paths, key=lambda path: path.stat().st_mtime_ns)
    last.write_bytes(last.read_bytes()[:-1])
    written = []
    put = Checkpoints.put
    monkeypatch.setattr(Checkpoints, "put", lambda self, name, arrays: written.append(name) or put(self, name, arrays))
    with pytest.warns(UserWarning, match="damaged checkpoint"), Checkpoints(tmp_path):
        assert same(PIECES[piece](), undisturbed(piece))
    others = {path.name for path in paths} - {last.name}
    assert not others & {f"{name}.checkpoint" for name in written}


# --- kills ------------------------------------------------------------------------------------------------------


class Killed(BaseException):
    """Stands for SIGKILL: nothing of the computation catches it."""


@pytest.mark.parametrize("after", [1, 2, 5])
@pytest.mark.parametrize("piece", PIECES)
def test_killed_after_a_checkpoint_and_run_again_it_ends_in_the_same_bytes(
    piece, after, tmp_path, undisturbed, monkeypatch
):
    put, counts = Checkpoints.put, [0]

    def killing(self, name, arrays):
        done = put(self, name, arrays)
        counts[0] += self.folder is not None
        if counts[0] == after:
            raise Killed
        return done

    with monkeypatch.context() as patched:
        patched.setattr(Checkpoints, "put", killing)
        try:
            with Checkpoints(tmp_path):
                PIECES[piece]()
        except Killed:
            pass
    assert len(files(tmp_path)) >= 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with Checkpoints(tmp_path):
            assert same(PIECES[piece](), undisturbed(piece))


@pytest.mark.parametrize("piece", PIECES)
def test_what_was_finished_is_not_computed_again(piece, tmp_path, monkeypatch):
    with Checkpoints(tmp_path):
        first = PIECES[piece]()
    monkeypatch.setattr(Checkpoints, "put", lambda self, name, arrays: pytest.fail(f"{name} was computed again"))
    with Checkpoints(tmp_path):
        assert same(PIECES[piece](), first)


def test_a_search_for_two_effects_killed_again_and_again_ends_in_the_same_bytes(tmp_path, monkeypatch):
    expected, put, counts = search(second=0.8), Checkpoints.put, [0]

    def killing(self, name, arrays):
        done = put(self, name, arrays)
        counts[0] += 1
        if counts[0] % 3 == 0:
            raise Killed
        return done

    monkeypatch.setattr(Checkpoints, "put", killing)
    kills, found = 0, None
    while found is None:
        try:
            with Checkpoints(tmp_path):
                found = search(second=0.8)
        except Killed:
            kills += 1
    assert kills >= 3 and same(found, expected)


def test_parts_are_deleted_once_the_whole_is_there(tmp_path):
    with Checkpoints(tmp_path):
        nested()
    assert [path.name.split()[0] for path in tmp_path.iterdir()] == ["whole", "whole"]


# --- stages -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A tiny project whose fits, search and predictions have run."""
    project = test_stages._project(tmp_path_factory.mktemp("stages"))
    for stage, run in test_stages.RUNS.items():
        run_stage(stage, "lift", run, project)
    run_stage("predict", "push", predict.run, project)
    return project


@pytest.mark.slow  # the stages themselves, half a minute; the pieces above are what they are made of
@pytest.mark.parametrize("stage", ["fit_global", "fit_patches", "find_gap", "fit_residual", "predict"])
def test_a_stage_whose_checkpoints_are_damaged_after_a_kill_writes_the_same_bytes(stage, project, monkeypatch):
    sequence, run = ("push", predict.run) if stage == "predict" else ("lift", test_stages.RUNS[stage])
    whole, put, counts = digest_folder(project.artifact(stage, sequence)), Checkpoints.put, [0]

    def killing(self, name, arrays):
        done = put(self, name, arrays)
        counts[0] += 1
        if counts[0] == 3:
            raise Killed
        return done

    with monkeypatch.context() as patched, pytest.raises(Killed):
        patched.setattr(Checkpoints, "put", killing)
        run_stage(stage, sequence, run, project)
    left = files(project.scratch(stage, sequence))
    assert left
    for path in left:
        path.write_bytes(path.read_bytes()[:-5])
    with pytest.warns(UserWarning, match="a damaged checkpoint is discarded"):
        folder = run_stage(stage, sequence, run, project)
    assert digest_folder(folder) == whole
    assert not [
        path for path in project.scratch(stage, sequence).rglob("*") if path.suffix in (".checkpoint", ".partial")
    ]


# --- disks and divergence ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS, errno.EACCES, errno.EDQUOT])
@pytest.mark.parametrize("piece", ["descent", "search", "tracks"])
def test_a_checkpoint_that_cannot_be_written_is_told_and_the_work_goes_on(
    piece, code, tmp_path, undisturbed, monkeypatch
):
    def full(source, target):
        raise OSError(code, "cannot be written")

    expected = undisturbed(piece)
    monkeypatch.setattr(module.os, "replace", full)
    with pytest.warns(UserWarning, match="checkpoints cannot be written .*; the work goes on"), Checkpoints(tmp_path):
        assert same(PIECES[piece](), expected)
    assert not [path for path in tmp_path.rglob("*") if path.is_file()], "no file is left behind"


def test_parts_stay_where_the_whole_cannot_be_written(tmp_path, monkeypatch):
    replace = module.os.replace

    def full(source, target):
        if target.name.startswith("whole"):
            raise OSError(errno.ENOSPC, "No space left on device")
        replace(source, target)

    monkeypatch.setattr(module.os, "replace", full)
    with pytest.warns(UserWarning, match=f"{tmp_path}: checkpoints cannot be written"), Checkpoints(tmp_path):
        nested()
    assert len(files(tmp_path)) == 6


def test_a_file_that_a_kill_left_half_written_is_no_checkpoint(tmp_path, undisturbed):
    with Checkpoints(tmp_path) as kept:
        kept.put("descent", {"x": np.zeros(3)})
    (tmp_path / "descent.checkpoint").rename(tmp_path / "descent.checkpoint.partial")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with Checkpoints(tmp_path):
            assert same(descent(), undisturbed("descent"))
    assert not (tmp_path / "descent.checkpoint.partial").exists()


def test_a_run_that_asks_for_something_else_is_not_given_what_was_remembered(tmp_path):
    def asked(value):
        with Checkpoints(tmp_path):
            return remembered("x", lambda: [value], {"x": ()}, lambda: {"x": np.array(value)})["x"]

    assert [float(asked(value)) for value in (1.0, 2.0, 1.0)] == [1.0, 2.0, 1.0]


def test_the_same_question_asked_twice_has_two_answers(tmp_path):
    for _ in range(2):
        answers = iter((1.0, 2.0))
        with Checkpoints(tmp_path):
            found = [
                float(remembered("x", list, {"x": ()}, lambda a=answers: {"x": np.array(next(a))})["x"])
                for _ in range(2)
            ]
        assert found == [1.0, 2.0]


def test_without_a_folder_nothing_is_kept():
    assert checkpoints().folder is None and checkpoints().get("x", {}) is None
    assert not checkpoints().due("x")


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ([1.0], [1]),
        ([np.zeros(3)], [np.zeros(3, np.float32)]),
        ([np.zeros((2, 3))], [np.zeros((3, 2))]),
        ([torch.ones(2)], [torch.zeros(2)]),
        (["a", "bc"], ["ab", "c"]),
        ([{"wind": {"x": 1.0}}], [{"wind": {"x": 1.0 + 2**-52}}]),
    ],
)
def test_digests_tell_apart_what_differs(one, other):
    assert digest_of(one) == digest_of(one) and digest_of(one) != digest_of(other)


def test_effects_that_the_pieces_need_are_there():
    assert {"wind", "linear_drag", "sink", "drift"} <= EFFECTS.keys()
