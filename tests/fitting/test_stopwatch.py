"""Seconds of a forward and a backward pass end in the parts that they belong to."""

import time

import pytest
import torch

from physreal_core.fitting.stopwatch import Stopwatch


class _Slow(torch.autograd.Function):
    """The identity, that takes 20 ms forward and 40 ms backward."""

    @staticmethod
    def forward(ctx, x):
        time.sleep(0.02)
        return x.clone()

    @staticmethod
    def backward(ctx, bar):
        time.sleep(0.04)
        return bar


def test_each_part_gets_its_own_seconds():
    watch = Stopwatch()
    given = torch.ones(3, requires_grad=True)
    begun = time.perf_counter()
    parameters = 2.0 * given
    watch.lap_in_backward("other", parameters)
    watch.lap("forward")
    states = _Slow.apply(parameters)
    watch.lap_in_backward("backward", states)
    watch.lap("loss")
    loss = _Slow.apply(states).sum()
    watch.lap_in_backward("loss", loss)
    watch.lap("other")
    loss.backward()
    seconds = watch.stop()
    assert sum(seconds.values()) == pytest.approx(time.perf_counter() - begun, abs=0.02)
    # Sleeps last at least as long as asked for, and on a busy machine longer.
    for part, least in {"forward": 0.02, "backward": 0.04, "loss": 0.06}.items():
        assert least <= seconds[part] < least + 0.1, seconds
    watch.restart()
    assert set(watch.stop()) == {"other"}
