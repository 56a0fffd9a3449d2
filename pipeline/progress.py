"""What a running stage says: a bar with the time left on a terminal, sparse lines elsewhere; and where the time went."""

import resource
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

LINE_EVERY = 10.0  # seconds between two lines where there is no terminal


class Timings:
    """Seconds per phase and the process's peak memory."""

    def __init__(self) -> None:
        self.phases: dict[str, float] = {}
        self._started = time.perf_counter()

    @contextmanager
    def timed(self, label: str) -> Iterator[None]:
        """Adds the seconds spent inside to the phase `label`."""
        started = time.perf_counter()
        try:
            yield
        finally:
            self.count(label, time.perf_counter() - started)

    def count(self, label: str, seconds: float) -> None:
        """Adds `seconds` to the phase `label`."""
        self.phases[label] = self.phases.get(label, 0.0) + seconds

    def record(self) -> dict:
        """Seconds in all and per phase [s], and the largest resident memory of this process or a child [MB]."""
        peak = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
        scale = 1024**2 if sys.platform == "darwin" else 1024
        return {
            "seconds": round(time.perf_counter() - self._started, 3),
            "phases": {label: round(seconds, 3) for label, seconds in self.phases.items()},
            "peak_memory_mb": round(peak / scale, 1),
        }


class Progress:
    """One running phase; `advance` as the work is done. `note` is shown behind the bar (a loss, a frame's name)."""

    def __init__(self, description: str, total: int) -> None:
        self.description, self.total, self.done = description, total, 0
        self._started = self._printed = time.perf_counter()
        self._resumed_at = 0

    def resume_at(self, done: int) -> None:
        """Start at `done` of `total`, as a fit does that goes on from a checkpoint; not counted in the time left."""
        self.done = self._resumed_at = done
        self._show("")

    def advance(self, n: int = 1, note: str = "") -> None:
        self.done += n
        self._show(note)

    def _show(self, note: str) -> None:
        now = time.perf_counter()
        if now - self._printed < LINE_EVERY and self.done < self.total:
            return
        self._printed = now
        print(
            f"{self.description}: {self.done}/{self.total}, {self._left(now)}{', ' + note if note else ''}", flush=True
        )

    def _left(self, now: float) -> str:
        worked = self.done - self._resumed_at
        spent = now - self._started
        if self.done >= self.total or worked <= 0:
            return f"{spent:.0f} s"
        return f"{spent:.0f} s, about {spent / worked * (self.total - self.done):.0f} s left"


class _TerminalProgress(Progress):
    """The same on a terminal, drawn by rich."""

    def __init__(self, description: str, total: int) -> None:
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
        from rich.progress import Progress as Bars

        super().__init__(description, total)
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        self.bars = Bars(*columns, TextColumn("left"), TimeRemainingColumn(), TextColumn("{task.fields[note]}"))
        self._task = self.bars.add_task(description, total=total, note="")

    def _show(self, note: str) -> None:
        self.bars.update(self._task, completed=self.done, note=note)


@contextmanager
def show_progress(description: str, total: int) -> Iterator[Progress]:
    """A `Progress` for the work inside, on whichever kind of output there is."""
    if not sys.stdout.isatty():
        yield Progress(description, total)
        return
    progress = _TerminalProgress(description, total)
    with progress.bars:
        yield progress
