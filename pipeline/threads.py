"""How many threads numerical libraries start, as many as this process may really use, and that they sleep between jobs."""

import os

from physreal_core.cores import available_cores

VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def limit_threads() -> None:
    """Set the usual variables, unless the user has; to be called before numpy or torch is imported."""
    for name in VARIABLES:
        os.environ.setdefault(name, str(available_cores()))
    # torch's threads would spin after each small operation, on the cores that the simulator's own threads need.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
