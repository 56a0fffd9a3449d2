"""Where things lie in a project folder: the one place that knows the layout of params.yaml, data/ and results/."""

from dataclasses import dataclass
from pathlib import Path

from physreal_core.errors import InputError

CODE_ROOT = Path(__file__).resolve().parent.parent


@dataclass(frozen=True)
class Project:
    """A folder with a params.yaml; every path of the pipeline hangs below it."""

    root: Path

    @classmethod
    def find(cls, start: Path | None = None) -> "Project":
        """The nearest folder at or above `start` (default: the working directory) that holds a params.yaml."""
        start = (start or Path.cwd()).resolve()
        for folder in (start, *start.parents):
            if (folder / "params.yaml").is_file():
                return cls(folder)
        raise InputError(
            "no params.yaml here or in any folder above", where=str(start), remedy="run this inside a PhysReal project"
        )

    @property
    def parameters(self) -> Path:
        return self.root / "params.yaml"

    @property
    def parameters_lock(self) -> Path:
        """Held by who writes params.yaml."""
        return self.root / ".scratch" / "params.lock"

    @property
    def results(self) -> Path:
        return self.root / "results"

    def capture(self, sequence: str) -> Path:
        return self.root / "data" / "captures" / sequence

    def capture_draft(self, sequence: str) -> Path:
        """Where a capture is written until it is whole: among the captures, so that one rename puts it in place."""
        return self.root / "data" / "captures" / ".importing" / sequence / "capture"

    def import_lock(self, sequence: str) -> Path:
        """Held by who imports a capture of this name."""
        return self.root / ".scratch" / "import" / f"{sequence}.lock"

    def description_lock(self, sequence: str) -> Path:
        """Held by who changes the capture.json of this sequence."""
        return self.root / ".scratch" / "description" / f"{sequence}.lock"

    def artifact(self, stage: str, sequence: str) -> Path:
        return self.root / "data" / "artifacts" / stage / sequence

    def output(self, stage: str, sequence: str, makes_capture: bool) -> Path:
        """Where a stage's output stands once it is whole."""
        return self.capture(sequence) if makes_capture else self.artifact(stage, sequence)

    def partial(self, stage: str, sequence: str) -> Path:
        """Where an output is written until it is whole: on the artifacts' own disk, outside every tracked folder."""
        return self.root / "data" / "artifacts" / ".partial" / stage / sequence

    def record(self, stage: str, sequence: str) -> Path:
        """Time, memory and code of the last run. Beside the artifact, not in it: an artifact holds nothing that
        differs between two runs with the same result, so that DVC need not rerun what follows."""
        return self.root / "data" / "runs" / stage / f"{sequence}.json"

    @property
    def kept(self) -> Path:
        """Parts of results that outlive their run, so that the next one is faster. It may be deleted at any time."""
        return self.root / ".scratch" / "kept"

    def scratch(self, stage: str, sequence: str) -> Path:
        return self.root / ".scratch" / stage / sequence
