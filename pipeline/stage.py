"""What a stage gets to see: its parameters, its inputs, a folder to write to, a folder that survives a kill.

An output is whole or absent, says what it was made from, and is refused by the next stage if that is no longer true.
"""

import argparse
import inspect
import json
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from physreal_core.checkpoints import Checkpoints, Lasting
from physreal_core.errors import InputError
from pipeline.config import Parameters, check_name, load_parameters
from pipeline.faults import one_sentence, writing_to
from pipeline.graph import STAGES, Graph
from pipeline.progress import Progress, Timings, show_progress
from pipeline.project import CODE_ROOT, Project
from pipeline.provenance import (
    digest_but_for,
    digest_code,
    digest_file,
    digest_folder,
    digest_of,
    read_provenance,
    versions,
    write_provenance,
)


class StageContext:
    """One run of one stage on one sequence.

    Attributes:
        stage, sequence: their names.
        params: the stage's parameters for this sequence (an instance of its class in pipeline/config).
        seed: the seed in params.yaml.
        output: folder to write to; put in place whole when the stage returns.
    """

    def __init__(self, stage: str, sequence: str, project: Project, parameters: Parameters, code: str) -> None:
        self.stage, self.sequence = stage, sequence
        self.params = parameters.stage(stage, sequence)
        self.seed = parameters.seed
        self.output = project.partial(stage, sequence)
        self.code = code
        self._project, self._parameters, self._spec = project, parameters, parameters.graph[stage]
        self._timings = Timings()

    @property
    def capture(self) -> Path:
        """The capture's folder; only for stages whose `reads_capture` is set in pipeline/graph.py."""
        if not self._spec.reads_capture:
            raise AssertionError(f"{self.stage} does not declare that it reads the capture (pipeline/graph.py)")
        folder = self._project.capture(self.sequence)
        if not folder.is_dir():
            raise InputError(
                "the capture's folder is missing",
                where=str(folder),
                remedy=f"put it there, or take {self.sequence} out of params.yaml",
            )
        return folder

    @property
    def geometry(self) -> str:
        """linear, planar or volumetric; only for stages whose `reads_geometry` is set in pipeline/graph.py."""
        if not self._spec.reads_geometry:
            raise AssertionError(f"{self.stage} does not declare that it reads the geometry (pipeline/graph.py)")
        return self._parameters.sequence(self.sequence).geometry

    def input(self, stage: str) -> Path:
        """Folder of an upstream stage's output for this sequence.

        Raises:
            InputError: it is missing, or was made from other parameters or inputs than stand there now.
        """
        if stage not in self._upstream:
            raise AssertionError(f"{self.stage} does not declare that it reads {stage} (pipeline/graph.py)")
        return checked_artifact(self._project, self._parameters, stage, self.sequence)

    def model_input(self, stage: str) -> Path:
        """Folder of a stage's output for the sequence that this one's models come from (`predictions` in params.yaml)."""
        if stage not in self._spec.of_model:
            raise AssertionError(f"{self.stage} does not declare that it reads the model's {stage} (pipeline/graph.py)")
        return checked_artifact(self._project, self._parameters, stage, self.model_sequence)

    def companion_input(self, stage: str) -> Path:
        """Folder of a stage's output for the companion."""
        if stage not in self._spec.of_companion:
            raise AssertionError(
                f"{self.stage} does not declare that it reads a companion's {stage} (pipeline/graph.py)"
            )
        return checked_artifact(self._project, self._parameters, stage, self.companion)

    @property
    def companion(self) -> str | None:
        """The other interaction with the same object that stands beside the sequence under `fits`; None without one."""
        fit = self._parameters.values.fits.get(self.sequence)
        return fit.companion if fit and fit.companion != self.sequence else None

    @property
    def model_sequence(self) -> str:
        """The sequence whose models this one is rolled out with: itself, unless it stands under `predictions`."""
        prediction = self._parameters.values.predictions.get(self.sequence)
        return prediction.model_from if prediction else self.sequence

    def models(self) -> dict[str, Path]:
        """Fit stage → folder with model.safetensors, model.json, rollout.npz, whether fitted or predicted."""
        if self.model_sequence == self.sequence:
            return {stage: self.input(stage) for stage in self._spec.fitted}
        return {stage: self.input("predict") / stage for stage in self._spec.fitted}

    @cached_property
    def provenance(self) -> dict[str, Any]:
        """What the output is made from: parameters, seed and the digests of all declared inputs."""
        inputs = {name: digest_folder(self.input(name)) for name in self._upstream}
        for name in self._spec.of_model:
            inputs[f"{self.model_sequence}/{name}"] = digest_folder(self.model_input(name))
        if self.companion:
            for name in self._spec.of_companion:
                inputs[f"{self.companion}/{name}"] = digest_folder(self.companion_input(name))
        if self._spec.reads_capture:
            inputs["capture"] = digest_folder(self.capture)
        for name in self.params.files():  # one that is missing is the stage's to name: it may not need it
            if (self._project.root / name).is_file():
                inputs[name] = digest_file(self._project.root / name)
        return {"stage": self.stage, "sequence": self.sequence, "inputs": inputs, **self._parameters_used()}

    @property
    def _upstream(self) -> tuple[str, ...]:
        values = self._parameters.values
        role = next((role for role in ("fits", "predictions") if self.sequence in getattr(values, role)), "sequences")
        return self._spec.inputs(role)

    @cached_property
    def scratch(self) -> Path:
        """Folder for checkpoints. Survives a kill; a run with the same parameters, code and inputs finds it again,
        any other starts with an empty one; removed once the stage has succeeded."""
        folder = self._project.scratch(self.stage, self.sequence) / digest_of([self.provenance, self.code])
        folder.mkdir(parents=True, exist_ok=True)
        return folder

    @property
    def lasting(self) -> Lasting | None:
        """Where parts of its work outlive the run; None unless the stage says what they depend on piece by piece."""
        if not self._spec.piecewise:
            return None
        folders = [
            self._project.capture(self.sequence),
            *(self._project.artifact(s, self.sequence) for s in self._upstream),
        ]
        inputs = [digest_but_for(folder, self._spec.piecewise) for folder in folders]
        models = [digest_folder(self._project.root / name) for name in self._spec.files]
        return Lasting(
            self._project.kept, digest_of([self.stage, self._parameters_used(), inputs, models, self.code, versions()])
        )

    @contextmanager
    def progress(self, description: str, total: int) -> Iterator[Progress]:
        """Shows how far a loop of `total` steps has come and what is left; its seconds count as a phase."""
        with self.timed(description), show_progress(f"{self.stage} {self.sequence}: {description}", total) as progress:
            yield progress

    def timed(self, label: str) -> Any:
        """Context manager: the seconds spent inside count as the phase `label` in the table of where the time went."""
        return self._timings.timed(label)

    def count(self, label: str, seconds: float) -> None:
        """The same for seconds measured elsewhere, e.g. what a phase consists of."""
        self._timings.count(label, seconds)

    def record(self) -> dict[str, Any]:
        """Seconds per phase, peak memory and code of this run."""
        return {"stage": self.stage, "sequence": self.sequence, "code": self.code, **self._timings.record()}

    def _parameters_used(self) -> dict[str, Any]:
        return _parameters_of(self._parameters, self.stage, self.sequence)


def _parameters_of(parameters: Parameters, stage: str, sequence: str) -> dict[str, Any]:
    """What a stage's output depends on of params.yaml, as provenance.json has it."""
    used = {"parameters": parameters.stage(stage, sequence).model_dump(mode="json"), "seed": parameters.seed}
    geometry = {"geometry": parameters.sequence(sequence).geometry} if parameters.graph[stage].reads_geometry else {}
    return used | geometry


def checked_artifact(project: Project, parameters: Parameters, stage: str, sequence: str) -> Path:
    """Folder of a stage's output, once it is certain that it belongs to the present parameters and inputs.

    Raises:
        InputError: the folder is missing; its parameters are not those of params.yaml (it was edited while the stage
            ran); or an input of it has changed since.
    """
    folder = project.artifact(stage, sequence)
    where = f"{stage} {sequence}"
    rerun = f"run `dvc repro -f -s {stage_target(parameters, stage, sequence)}`"
    if not folder.is_dir():
        raise InputError(f"its output {folder} is missing", where=where, remedy=f"run `dvc repro` or {rerun}")
    record = read_provenance(folder)
    made = {"geometry": "volumetric", **record}  # there was none when all bodies were volumes
    for key, value in _parameters_of(parameters, stage, sequence).items():
        if made[key] != value:
            raise InputError(
                f"its output was made with {_first_difference(key, made[key], value)}, params.yaml says otherwise",
                where=where,
                remedy=rerun,
            )
    for name, digest in record["inputs"].items():
        source = _input_place(project, name, sequence)
        if source.exists() and (digest_folder if source.is_dir() else digest_file)(source) != digest:
            raise InputError(f"its output was made from another version of {source}", where=where, remedy=rerun)
    return folder


def stage_target(parameters: Parameters, stage: str, sequence: str) -> str:
    """What `dvc repro` is given to run a stage for a sequence."""
    spec = parameters.graph[stage]
    role = next((role for role in spec.roles if sequence in getattr(parameters.values, role)), spec.roles[0])
    return spec.target(role, sequence)


def _input_place(project: Project, name: str, sequence: str) -> Path:
    """The folder or file that an entry under `inputs` in provenance.json stands for."""
    if name == "capture":
        return project.capture(sequence)
    if name.startswith("data/"):
        return project.root / name
    other, _, stage = name.rpartition("/")
    return project.artifact(stage, other or sequence)


def run_stage(
    stage: str,
    sequence: str,
    run: Callable[[StageContext], None],
    project: Project | None = None,
    graph: Graph = STAGES,
) -> Path:
    """Run a stage on a sequence and put its output in place.

    Returns:
        The output's folder.

    Raises:
        InputError: from the stage, from params.yaml, from stale inputs, or because a second copy is running.
    """
    project = project or Project.find()
    parameters = load_parameters(project.parameters, graph)
    parameters.sequence(sequence)
    _check_device(stage, sequence, parameters)
    source = Path(inspect.getsourcefile(run))
    destination = project.output(stage, sequence, graph[stage].makes_capture)
    with writing_to(project.scratch(stage, sequence)), _only_copy(project, stage, sequence):
        if graph[stage].makes_capture:
            _refuse_to_replace(destination, stage)
        context = StageContext(stage, sequence, project, parameters, digest_code(source, (project.root, CODE_ROOT)))
        provenance = context.provenance  # every input is read and checked before any work is done
        _empty(context.output)
        try:
            with writing_to(context.output):
                with Checkpoints(context.scratch, lasting=context.lasting):
                    run(context)
                write_provenance(context.output, provenance)
            output = _put_in_place(context.output, destination)
        finally:
            shutil.rmtree(context.output, ignore_errors=True)
        record = project.record(stage, sequence)
        record.parent.mkdir(parents=True, exist_ok=True)
        record.write_text(json.dumps(context.record(), indent=1) + "\n")
        for folder in project.scratch(stage, sequence).glob("*/"):
            shutil.rmtree(folder)
    return output


def main(stage: str, run: Callable[[StageContext], None], graph: Graph = STAGES) -> None:
    """`python -m stages.<stage> <sequence>`: exit code 2 and one plain sentence for what the user can mend.

    Under DVC no sequence is given: the stage's name there, <stage>@<sequence>, stands in the variable DVC_STAGE.
    """
    parser = argparse.ArgumentParser(prog=f"python -m stages.{stage}", description=inspect.getdoc(run))
    given_by_dvc = os.environ.get("DVC_STAGE", "").rpartition(":")[2].partition("@")[2]
    parser.add_argument(
        "sequence",
        nargs="?" if given_by_dvc else None,
        default=given_by_dvc,
        help="a name under `sequences` in params.yaml; default: that of the stage which DVC runs",
    )
    sequence = parser.parse_args().sequence
    with one_sentence(stage):
        check_name(sequence, "params.yaml")
    with one_sentence(f"{stage} {sequence}"):
        run_stage(stage, sequence, run, graph=graph)


@contextmanager
def _only_copy(project: Project, stage: str, sequence: str) -> Iterator[None]:
    """Holds the lock of this stage and sequence. The system drops it with the process, however that ends."""
    folder = project.scratch(stage, sequence)
    folder.mkdir(parents=True, exist_ok=True)
    holder = folder / "holder"
    lock = FileLock(folder / "lock")
    try:
        lock.acquire(timeout=0)
    except Timeout:
        process = holder.read_text().strip() if holder.is_file() else "unknown"
        raise InputError(
            f"another copy is running (process {process})",
            where=f"{stage} {sequence}",
            remedy=f"wait for it, or end it with `kill {process}` and start again: it goes on from its last checkpoint",
        ) from None
    try:
        holder.write_text(f"{os.getpid()}\n")
        yield
    finally:
        lock.release()


def _check_device(stage: str, sequence: str, parameters: Parameters) -> None:
    """A card that is asked for is there."""
    device = getattr(parameters.stage(stage, sequence), "device", "cpu")
    if not device.startswith("cuda"):
        return
    import torch

    if not torch.cuda.is_available():
        raise InputError(
            f"{stage}.device = {device}, but torch sees no such card",
            where="params.yaml",
            expected="cpu, or a machine with an NVIDIA card and a CUDA build of torch",
            remedy=f"set {stage}.device to cpu, there or under sequences.{sequence}",
        )


def _refuse_to_replace(capture: Path, stage: str) -> None:
    """A capture that `stage` did not make is its owner's: it is never deleted or overwritten."""
    if capture.exists() and not (
        (capture / "provenance.json").is_file() and read_provenance(capture)["stage"] == stage
    ):
        raise InputError(
            f"{capture} holds a capture that {stage} did not make",
            where=stage,
            remedy=f"take {capture.name} out of `rigged` in params.yaml, or move that folder away",
        )


def _empty(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)


def _put_in_place(written: Path, output: Path) -> Path:
    """Rename `written` to `output`; an older output (a run without DVC, which deletes it) steps aside first."""
    output.parent.mkdir(parents=True, exist_ok=True)
    if output.exists():
        old = written.with_name(written.name + ".old")
        shutil.rmtree(old, ignore_errors=True)
        os.replace(output, old)
        os.replace(written, output)
        shutil.rmtree(old)
    else:
        os.replace(written, output)
    return output


def _first_difference(key: str, made: Any, wanted: Any) -> str:
    if isinstance(made, dict) and isinstance(wanted, dict):
        for name in sorted(made.keys() | wanted.keys()):
            if made.get(name) != wanted.get(name):
                return _first_difference(f"{key}.{name}", made.get(name), wanted.get(name))
    return f"{key} = {made!r} where {wanted!r} is wanted"
