"""Steps a session in real time on a thread of its own; what others want done is done between two frames."""

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from physreal_core.errors import InputError, SimulationError
from physreal_core.playing import Session

Deed = Callable[[Session], object]
SMOOTHING = 0.9
"""Weight of the past in the mean frame rate."""


@dataclass
class Pace:
    """How fast time goes by.

    Attributes:
        running: false while paused.
        speed: of simulated time over real time, at most 1.
        rate: frames per second of late, as they were simulated and shown.
    """

    running: bool = True
    speed: float = 1.0
    rate: float = 0.0


class Loop:
    """One or two sessions that do the same things side by side.

    Args:
        sessions: the first is what the user sees and pulls; the others do the same.
        show: called after every frame, and after something was done while time stands.
        told: called with what could not be done, in a sentence.
        leaving: called before all begin anew.
    """

    def __init__(
        self,
        sessions: list[Session],
        show: Callable[[], None],
        told: Callable[[str], None],
        leaving: Callable[[], None] = lambda: None,
    ) -> None:
        self.sessions, self.pace, self._show, self._told, self._leaving = sessions, Pace(), show, told, leaving
        self._waiting: deque[Deed] = deque()
        self._wake, self._ending = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        """Begin to step."""
        self._thread.start()

    def stop(self) -> None:
        """End after the frame that is being made."""
        self._ending.set()
        self._wake.set()
        self._thread.join()

    def do(self, deed: Deed) -> None:
        """Have it done to all sessions, before the next frame."""
        self._waiting.append(deed)
        self._wake.set()

    def begin_anew(self) -> None:
        """Have all sessions begin anew, before the next frame."""

        def begin(session: Session) -> None:
            if session is self.sessions[0]:
                self._leaving()
            session.reset()

        self.do(begin)

    def go(self, running: bool) -> None:
        """Let time go on, or stop it."""
        self.pace.running = running
        self._wake.set()

    def once(self) -> None:
        """One turn: what waits is done, then a frame is made where time goes on."""
        done, running = bool(self._waiting), self.pace.running
        try:
            while self._waiting:
                self._do(self._waiting.popleft())
            for session in self.sessions if running else ():
                session.step()
        except SimulationError as error:
            self._told(f"the simulation broke off and begins anew: {error}")
            self._leaving()
            for session in self.sessions:
                session.reset()
        if running or done:
            self._show()

    def _do(self, deed: Deed) -> None:
        for session in self.sessions:
            try:
                deed(session)
            except InputError as error:
                self._told(str(error))

    def _run(self) -> None:
        due = time.perf_counter()
        while not self._ending.is_set():
            begun = time.perf_counter()
            self._wake.clear()
            self.once()
            now = time.perf_counter()
            if not self.pace.running:
                self._wake.wait(0.5)
                due = time.perf_counter()
                continue
            frame = 1.0 / (self.sessions[0].fps * self.pace.speed)
            due = max(due + frame, now)  # what was missed is not made up for
            if due > now:
                time.sleep(due - now)
            spent = max(time.perf_counter() - begun, 1e-9)
            self.pace.rate = SMOOTHING * self.pace.rate + (1 - SMOOTHING) / spent
