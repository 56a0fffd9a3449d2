"""How many threads numerical libraries start, as many as this process may really use, and that they sleep between jobs."""

import os
from pathlib import Path

VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def limit_threads() -> None:
    """Set the usual variables, unless the user has; to be called before numpy or torch is imported."""
    for name in VARIABLES:
        os.environ.setdefault(name, str(available_cores()))
    # torch's threads would spin after each small operation, on the cores that the simulator's own threads need.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")


def available_cores(quota_file: Path = Path("/sys/fs/cgroup/cpu.max")) -> int:
    """Cores that the scheduler and the container's quota leave to this process, at least one."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    try:
        quota, period = quota_file.read_text().split()
        cores = min(cores, round(int(quota) / int(period)))
    except (OSError, ValueError):
        pass  # no cgroup, or "max": no quota
    return max(1, cores)
