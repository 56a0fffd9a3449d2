"""Results that outlive their run: the same bytes, never for other inputs, no more of them than a disk should hold."""

import os

import numpy as np
import pytest

from physreal_core.checkpoints import Checkpoints, Lasting, remembered
from pipeline.provenance import digest_but_for


class Work:
    """A computation that counts how often it is done."""

    def __init__(self, folder, scope: str = "scope", limit: int = 2**20) -> None:
        self.lasting, self.done = Lasting(folder / "kept", scope, limit), 0

    def __call__(self, value: int) -> np.ndarray:
        def compute() -> dict[str, np.ndarray]:
            self.done += 1
            return {"squares": np.arange(100.0) * value}

        with Checkpoints(None, lasting=self.lasting):
            return remembered("squares", lambda: [value], {"squares": (100,)}, compute, lasting=True)["squares"]


def test_a_later_run_finds_the_result_of_an_earlier_one(tmp_path):
    first, second = Work(tmp_path), Work(tmp_path)
    assert np.array_equal(first(3), second(3)) and (first.done, second.done) == (1, 0)


@pytest.mark.parametrize("scope,value", [("another scope", 3), ("scope", 4)])
def test_other_inputs_find_nothing(tmp_path, scope, value):
    Work(tmp_path)(3)
    other = Work(tmp_path, scope)
    assert np.array_equal(other(value), np.arange(100.0) * value) and other.done == 1


def test_a_damaged_file_is_told_and_computed_again(tmp_path):
    Work(tmp_path)(3)
    (path,) = (tmp_path / "kept").iterdir()
    path.write_bytes(path.read_bytes()[:-5])
    again = Work(tmp_path)
    with pytest.warns(UserWarning, match="damaged"):
        assert np.array_equal(again(3), np.arange(100.0) * 3)
    assert again.done == 1 and Work(tmp_path)(3) is not None


def test_what_nobody_asked_for_longest_goes_first(tmp_path):
    size = _size_of_one(tmp_path / "one")
    work = Work(tmp_path, limit=3 * size)
    for age, value in enumerate((1, 2, 3)):
        work(value)
        for path in (tmp_path / "kept").iterdir():
            os.utime(path, ns=(path.stat().st_atime_ns, path.stat().st_mtime_ns - 10**9 * (age + 1)))
    work(1)  # asked for again: now the youngest
    work(4)
    assert len(list((tmp_path / "kept").iterdir())) == 3
    done = work.done
    work(1), work(3), work(4)
    assert work.done == done
    work(2)
    assert work.done == done + 1


def _size_of_one(folder) -> int:
    Work(folder)(1)
    (path,) = (folder / "kept").iterdir()
    return path.stat().st_size


def test_without_a_place_nothing_outlives_the_run(tmp_path):
    with Checkpoints(tmp_path / "run"):
        remembered("a", lambda: [1], {"a": ()}, lambda: {"a": np.float64(1)}, lasting=True)
    assert not (tmp_path / "kept").exists()


def test_the_scope_holds_all_of_a_folder_but_the_keys_that_are_left_out(tmp_path):
    def digest(text: str, mask: str = "a") -> str:
        (tmp_path / "capture.json").write_text(text)
        (tmp_path / "mask.png").write_text(mask)
        (tmp_path / "provenance.json").write_text(text)
        return digest_but_for(tmp_path, ("hints",))

    one = digest('{"fps": 30, "hints": 1}')
    assert one == digest('{"fps": 30, "hints": 2}')
    assert len({one, digest('{"fps": 31, "hints": 1}'), digest('{"fps": 30}', "b")}) == 3
