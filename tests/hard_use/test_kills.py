"""A tenth of the kills of `python -m benchmarks.kills`: at least one of every long stage, and one of `dvc repro`."""

import os
import subprocess
import sys

import pytest

from tests.conftest import ROOT


@pytest.mark.slow  # about ten minutes on two cores: the small project is made and run, and stages are killed and run again
def test_stages_and_dvc_killed_at_random_moments_end_in_the_same_bytes(tmp_path):
    command = [sys.executable, "-m", "benchmarks.kills", "--share", "0.1", "--folder", str(tmp_path / "project")]
    environment = {**os.environ, "OMP_NUM_THREADS": "2"}
    result = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout[-3000:] + result.stderr[-3000:]
    assert "`dvc repro`" in result.stdout
