"""How many processor cores this process may really use."""

import os
from pathlib import Path

from physreal_core.errors import InputError

SHARE = "PHYSREAL_CORES"
"""Environment variable with the most cores that a process takes, where several run side by side."""


def available_cores(quota_file: Path = Path("/sys/fs/cgroup/cpu.max")) -> int:
    """Cores that the scheduler, the container's quota and `PHYSREAL_CORES` leave to this process, at least one.

    Raises:
        InputError: `PHYSREAL_CORES` is no whole number above zero.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    try:
        quota, period = quota_file.read_text().split()
        cores = min(cores, round(int(quota) / int(period)))
    except (OSError, ValueError):
        pass  # no cgroup, or "max": no quota
    return max(1, min(cores, _share(default=cores)))


def _share(default: int) -> int:
    given = os.environ.get(SHARE)
    if given is None:
        return default
    if not given.isdecimal() or int(given) == 0:
        raise InputError(f"{SHARE} is {given!r}", where="the environment", expected="a whole number above zero")
    return int(given)
