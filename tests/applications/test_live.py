"""`physreal live`: a recorded sequence as a stream, in time, followed and written."""

import json

import numpy as np
import pytest

from applications.live.pace import in_real_time
from applications.live.streams import recorded
from pipeline.cli import main


def run(project, monkeypatch, *arguments: str) -> int:
    monkeypatch.chdir(project.root)
    with pytest.raises(SystemExit) as ended:
        main(["live", "lift", *arguments])
    return ended.value.code


class Clock:
    """Time that goes on by what is slept, and by what each look takes."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


def looked_at(takes: float, count: int = 30, fps: float = 10.0, speed: float = 1.0) -> tuple[list[int], float]:
    """Frames for which there was time where a look takes so long [s], and when the last one came."""
    clock, seen = Clock(), []
    for frame, in_time in in_real_time(range(count), fps, speed, clock, clock.sleep):
        if in_time:
            seen.append(frame)
            clock.now += takes
    return seen, clock.now


def test_a_quick_follower_sees_every_frame_when_it_is_due():
    seen, ended = looked_at(0.02)
    assert seen == list(range(30)) and ended == pytest.approx(2.92)


def test_a_slow_follower_leaves_frames_out_and_keeps_up():
    seen, ended = looked_at(0.25)
    assert 10 <= len(seen) <= 16 and ended < 3.3


def test_without_a_pace_no_frame_is_late():
    seen, _ = looked_at(0.25, speed=0.0)
    assert seen == list(range(30))


def test_a_stream_has_the_tracks_of_the_sequence(twin):
    frames = list(recorded(twin.problem))
    assert len(frames) == twin.problem.frame_count - 1
    tracks = twin.problem.tracks
    valid = tracks.valid3d[1].numpy()
    assert np.array_equal(frames[0].valid, valid) and (frames[0].sigma > 0).all()
    np.testing.assert_allclose(frames[0].points[valid], tracks.points3d[1].double().numpy()[valid])
    np.testing.assert_allclose(frames[0].controllers, twin.problem.controllers[1].double().numpy())


def test_a_sequence_is_followed_and_written(project, twin, monkeypatch, tmp_path, capsys):
    folder = tmp_path / "followed"
    assert run(project, monkeypatch, "--speed", "0", "--record", "--to", str(folder)) == 0
    numbers, frames = json.loads((folder / "live.json").read_text()), twin.problem.frame_count - 1
    assert numbers["frames"] == numbers["looked_at"] == frames and numbers["alarm"] is None
    with np.load(folder / "states.npz") as states:
        assert states["x"].shape == (frames, len(twin.problem.body.x0), 3)
        assert states["frame"].tolist() == list(range(1, frames + 1))
        assert (states["deviation"] > 0).all()
    assert (folder / "live.mp4").stat().st_size > 500
    assert f"{frames} frames" in capsys.readouterr().out
    assert run(project, monkeypatch, "--to", str(folder)) == 2


def test_the_modulus_is_learnt_where_that_is_asked_for(project, monkeypatch, tmp_path, capsys):
    folder = tmp_path / "learnt"
    assert run(project, monkeypatch, "--speed", "0", "--learn", "0.3", "--to", str(folder)) == 0
    (learnt,) = json.loads((folder / "live.json").read_text())["material"].values()
    assert 0.3 < learnt["factor"] < 3.0 and 0.0 < learnt["log_deviation"] <= 0.3
    assert f"youngs modulus: {learnt['factor']:.2f} times the fit's" in capsys.readouterr().out


@pytest.mark.parametrize(("option", "value"), [("--speed", "-1"), ("--coarser", "30"), ("--learn", "0")])
def test_what_cannot_be_is_refused(project, monkeypatch, capsys, option, value):
    assert run(project, monkeypatch, option, value) == 2
    assert option in capsys.readouterr().err
