"""Where the time of a fit goes: seconds per part, in the forward pass and, by hooks on tensors, in the backward pass."""

import time

import torch
from torch import Tensor


class Stopwatch:
    """One part runs at a time; `lap` ends it and begins the next. It runs from the start, as part "other".

    Args:
        device: waited for at every lap, so that work on a GPU counts where it was asked for.
    """

    def __init__(self, device: str = "cpu") -> None:
        self._device = torch.device(device)
        self.restart()

    def restart(self) -> None:
        """Forgets all that was counted."""
        self._seconds: dict[str, float] = {}
        self._part, self._since = "other", time.perf_counter()

    def lap(self, part: str) -> None:
        """From here on the seconds count as `part`."""
        if self._device.type == "cuda":
            torch.cuda.synchronize(self._device)
        now = time.perf_counter()
        self._seconds[self._part] = self._seconds.get(self._part, 0.0) + now - self._since
        self._part, self._since = part, now

    def stop(self) -> dict[str, float]:
        """Seconds since the restart, by part, in the order in which they first ran."""
        self.lap("other")
        return dict(self._seconds)

    def lap_in_backward(self, part: str, tensor: Tensor | None) -> None:
        """The same whenever a backward pass has found the whole gradient of `tensor`, which is no leaf."""
        if tensor is not None and tensor.grad_fn is not None:
            tensor.register_hook(lambda gradient: self.lap(part))
