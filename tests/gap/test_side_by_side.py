"""Rollouts side by side: at the same time, in order, and with checkpoints that do not depend on which comes first."""

from functools import partial
from threading import Barrier

import numpy as np
import pytest
import torch

from physreal_core.checkpoints import Checkpoints, remembered
from physreal_core.gap import Experiment, Trial
from physreal_core.gap.interactions.side_by_side import side_by_side
from physreal_core.simulation.native import stepper
from tests.fitting import scene

PATIENCE = 20.0  # s


def test_calls_run_at_the_same_time_and_answer_in_order():
    both = Barrier(2)

    def call(number: int) -> int:
        both.wait(PATIENCE)  # of calls one after another the first would wait in vain
        return number

    assert side_by_side([partial(call, n) for n in range(2)], "cpu") == [0, 1]


def test_on_a_gpu_they_run_one_after_another():
    begun = []
    assert side_by_side([partial(begun.append, n) for n in range(3)], "cuda:0") == [None] * 3
    assert begun == [0, 1, 2]


def test_what_one_raises_is_raised():
    def fail() -> None:
        raise ValueError("broken")

    with pytest.raises(ValueError, match="broken"):
        side_by_side([lambda: None, fail], "cpu")


def test_each_finds_its_own_results_again_whichever_was_first(tmp_path):
    computed = []

    def call(number: int, first: Barrier | None) -> float:
        if first is not None and number == 0:
            first.wait(PATIENCE)

        def compute() -> dict:
            computed.append(number)
            return {"value": np.array(float(number))}

        value = float(remembered("value", list, {"value": ()}, compute)["value"])
        if first is not None and number == 1:
            first.wait(PATIENCE)
        return value

    def run(first: Barrier | None) -> list[float]:
        with Checkpoints(tmp_path):
            return side_by_side([partial(call, n, first) for n in range(2)], "cpu")

    assert run(Barrier(2)) == [0.0, 1.0] and computed == [1, 0]
    assert run(None) == [0.0, 1.0] and computed == [1, 0]


def test_a_rollout_by_itself_does_not_depend_on_the_number_of_threads(monkeypatch):
    monkeypatch.setattr(stepper, "PARTICLES_PER_THREAD", 8)  # of a bar of 42
    model, before, found = scene.model(), torch.get_num_threads(), []
    for threads in (1, 2):
        torch.set_num_threads(threads)
        own = Experiment(scene.problem(model, frames=8, observed=8, with_masks=False), model)
        found.append(own.predict([Trial(model.fields)]))
    torch.set_num_threads(before)
    np.testing.assert_array_equal(*found)
