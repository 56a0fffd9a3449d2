"""CUDA's multi-process service, with which the processes of many cases run on a card at once; without it they take turns."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

CONTROL = "nvidia-cuda-mps-control"
PIPES, LOGS = "CUDA_MPS_PIPE_DIRECTORY", "CUDA_MPS_LOG_DIRECTORY"
USUAL = Path("/tmp/nvidia-mps/control")  # of a service that somebody has started
PATIENCE = 60  # [s]


@contextmanager
def multi_process_service(wanted: bool) -> Iterator[dict[str, str]]:
    """Starts a service of our own, which ends with the block; gives the environment variables that lead a process to it.

    None are needed where one runs already, and there are none where it cannot be had: processes take turns then.

    Args:
        wanted: whether processes share a card.
    """
    if not wanted or PIPES in os.environ or USUAL.exists() or shutil.which(CONTROL) is None:
        yield {}
        return
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        here = {PIPES: folder, LOGS: folder}
        # It serves all cards, so that a process names its card as it would without it.
        seen = {name: value for name, value in os.environ.items() if name != "CUDA_VISIBLE_DEVICES"} | here
        with Path(folder, "begun.txt").open("w+") as said:  # a daemon would hold a pipe open
            begun = subprocess.run(
                [CONTROL, "-d"], env=seen, stdin=subprocess.DEVNULL, stdout=said, stderr=said, check=False
            )
            said.seek(0)
            message = said.read().strip()
        if begun.returncode != 0:
            print(f"no multi-process service, cases take turns on a card: {message}", flush=True)
            yield {}
            return
        try:
            yield here
        finally:
            _quit(seen)


def _quit(environment: dict[str, str]) -> None:
    """Ends the service, which waits for processes that use it; one that the time limit has stopped may be slow to go."""
    how = {"env": environment, "text": True, "capture_output": True, "timeout": PATIENCE}
    try:
        subprocess.run([CONTROL], input="quit\n", check=False, **how)
    except subprocess.TimeoutExpired:
        print(f"the multi-process service has not ended after {PATIENCE:g} s: a case still uses it", flush=True)
