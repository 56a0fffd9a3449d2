"""DVC on a tiny repository of toy stages: one parameter changed, and only its stage and what follows run again."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pipeline.dvc_files import dvc_files
from pipeline.graph import Aggregate
from pipeline.project import CODE_ROOT
from tests.pipeline import toy

PARAMETERS = {
    "seed": 0,
    "load": {"points": 30},
    "descend": {"iterations": 60},
    "tell": {"digits": 3},
    "sequences": {name: {stage: {} for stage in toy.GRAPH} for name in ("a", "b")},
    "fits": {},
    "predictions": {},
}
ALL = Aggregate("all", ("tell",), outputs=("all.txt",))
STAGE = """
from tests.pipeline import toy
if __name__ == "__main__":
    toy.main("{name}", toy.{name}, toy.GRAPH)
"""
AGGREGATE = """
from pathlib import Path
Path("all.txt").write_text("".join(file.read_text() for file in sorted(Path("data/artifacts/tell").glob("*/words.txt"))))
"""


class Repository:
    """A git and DVC repository with two sequences and three stages, its DVC files written as the project's own are."""

    def __init__(self, root: Path) -> None:
        self.root = root
        for name, slope in (("a", "2.0"), ("b", "3.0")):
            (root / "data/captures" / name).mkdir(parents=True)
            (root / "data/captures" / name / "slope.txt").write_text(slope)
        self.write_parameters(PARAMETERS)
        (root / "stages").mkdir()
        (root / "stages" / "__init__.py").touch()
        (root / "stages" / "all.py").write_text(AGGREGATE)
        for name in toy.GRAPH:
            (root / "stages" / f"{name}.py").write_text(STAGE.format(name=name))
        for name, text in dvc_files(toy.GRAPH, (ALL,), root).items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(text)
        (root / ".gitignore").write_text("/data/artifacts/\n/data/runs/\n/all.txt\n.scratch/\n__pycache__/\n")
        subprocess.run(["git", "init", "-q"], cwd=root, check=True)
        self.dvc("init", "-q")
        self.dvc("config", "core.analytics", "false")

    def write_parameters(self, values: dict) -> None:
        (self.root / "params.yaml").write_text(json.dumps(values))

    def dvc(self, *arguments: str, **environment: str) -> subprocess.CompletedProcess:
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        env = {**os.environ, **environment, "PYTHONPATH": str(CODE_ROOT), "PATH": path}
        command = [sys.executable, "-m", "dvc", *arguments]
        return subprocess.run(command, cwd=self.root, env=env, capture_output=True, text=True, check=False)

    def repro(self, *options: str, **environment: str) -> tuple[int, set[str]]:
        """Exit code and the stages that ran."""
        result = self.dvc("repro", *options, **environment)
        lines = [line for line in result.stdout.splitlines() if line.startswith("Running stage")]
        return result.returncode, {line.split("'")[1].rpartition(":")[2] for line in lines}


@pytest.fixture(scope="module")
def repository(tmp_path_factory) -> Repository:
    repository = Repository(tmp_path_factory.mktemp("repository"))
    code, ran = repository.repro()
    assert code == 0 and len(ran) == 7
    return repository


def changed(**blocks: dict) -> dict:
    return {**PARAMETERS, **blocks}


def test_nothing_changed_nothing_runs(repository):
    assert repository.repro() == (0, set())


def test_one_parameter_of_one_stage_reruns_it_and_what_follows(repository):
    repository.write_parameters(changed(descend={"iterations": 61}))
    assert repository.repro() == (0, {"descend@a", "descend@b", "tell@a", "tell@b", "all"})
    repository.write_parameters(PARAMETERS)
    assert repository.repro()[0] == 0


def test_one_sequence_own_value_reruns_that_sequence_only(repository):
    sequences = {**PARAMETERS["sequences"], "b": {**PARAMETERS["sequences"]["b"], "descend": {"rate": 0.04}}}
    repository.write_parameters(changed(sequences=sequences))
    assert repository.repro() == (0, {"descend@b", "tell@b", "all"})
    repository.write_parameters(PARAMETERS)
    assert repository.repro()[0] == 0


def test_the_same_result_stops_the_chain(repository):
    """A stage that runs again and writes the same bytes makes nothing after it run: its record lies elsewhere."""
    record = repository.root / "data/runs/load/a.json"
    before = record.stat().st_mtime_ns
    assert repository.repro("-f", "-s", "pipeline/load/dvc.yaml:load@a") == (0, {"load@a"})
    assert record.stat().st_mtime_ns > before, "it did run"
    assert repository.repro() == (0, set())


def test_killed_under_dvc_and_started_again(repository):
    whole = (repository.root / "data/artifacts/descend/a/coefficients.npy").read_bytes()
    forget(repository, "data/artifacts/descend/a", ".dvc/cache")
    code, _ = repository.repro(PHYSREAL_KILL_AT="33")
    assert code != 0
    assert not (repository.root / "data/artifacts/descend/a").exists()
    code, ran = repository.repro()
    assert code == 0 and "descend@a" in ran
    assert (repository.root / "data/artifacts/descend/a/coefficients.npy").read_bytes() == whole


def test_a_first_run_in_a_clone_changes_no_tracked_file(repository, tmp_path):
    """A lock holds what a stage made, not how long it took: the same result leaves the tree clean."""
    git = ("git", "-c", "user.name=tests", "-c", "user.email=tests@localhost")
    subprocess.run([*git, "add", "-A"], cwd=repository.root, check=True)
    subprocess.run([*git, "commit", "-qm", "all"], cwd=repository.root, check=True)
    subprocess.run(["git", "clone", "-q", repository.root, tmp_path / "clone"], check=True)
    clone = Repository.__new__(Repository)
    clone.root = tmp_path / "clone"
    code, ran = clone.repro()
    assert code == 0 and len(ran) == 7
    assert (clone.root / "data/runs/load/a.json").is_file()
    status = subprocess.run(["git", "status", "--short"], cwd=clone.root, capture_output=True, text=True, check=True)
    assert status.stdout == ""


def test_a_clone_without_data_sees_whether_the_lock_is_fresh(repository):
    """What CI runs: only the exit code can be relied on."""
    forget(repository, "data", ".dvc/cache", "all.txt")
    check = ("repro", "--allow-missing", "--dry")
    assert repository.dvc(*check).returncode == 0
    repository.write_parameters(changed(descend={"iterations": 59}))
    assert repository.dvc(*check).returncode != 0


def forget(repository: Repository, *paths: str) -> None:
    for path in paths:
        target = repository.root / path
        target.unlink() if target.is_file() else shutil.rmtree(target)
