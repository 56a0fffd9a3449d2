"""The stage run again from the page, as a process of its own: through DVC where the project has it, else by itself."""

import asyncio
import os
import re
import signal
import sys
from collections.abc import Callable

from pipeline.config import load_parameters
from pipeline.label.clip import STAGE
from pipeline.project import Project
from pipeline.stage import stage_target

_STEPS = re.compile(r"(\d+)/(\d+), ")


def commands(project: Project, sequence: str) -> list[list[str]]:
    """What brings the stage's output up to date, in order."""
    if (project.root / ".dvc").is_dir():
        target = stage_target(load_parameters(project.parameters), STAGE, sequence)
        return [[sys.executable, "-m", "dvc", "repro", target]]
    return [[sys.executable, "-m", f"stages.{stage}", sequence] for stage in ("parse_video", STAGE)]


def progress_of(line: str) -> float | None:
    """How far a line of a stage says that it is (0 to 1); None where it says nothing of that."""
    said = _STEPS.search(line)
    return int(said[1]) / max(int(said[2]), 1) if said else None


class Runner:
    """At most one run at a time."""

    def __init__(self, project: Project, sequence: str) -> None:
        self.project, self.sequence = project, sequence
        self._process: asyncio.subprocess.Process | None = None
        self.running = False

    async def run(self, tell: Callable[[str], None]) -> bool:
        """Run the stage, telling every line; whether it succeeded."""
        if self.running:
            tell("it is running already")
            return False
        self.running = True
        try:
            for command in commands(self.project, self.sequence):
                tell("$ " + " ".join(["python", *command[1:]]))
                if await self._one(command, tell) != 0:
                    return False
            return True
        finally:
            self.running, self._process = False, None

    async def _one(self, command: list[str], tell: Callable[[str], None]) -> int:
        self._process = await asyncio.create_subprocess_exec(
            *command,
            cwd=self.project.root,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
            start_new_session=True,
            limit=2**20,
        )
        async for line in self._process.stdout:
            tell(line.decode(errors="replace").rstrip())
        return await self._process.wait()

    def stop(self) -> None:
        """End the run; what it had done is taken up by the next one."""
        if self._process is not None and self._process.returncode is None:
            os.killpg(self._process.pid, signal.SIGTERM)
