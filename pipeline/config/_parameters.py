"""params.yaml as typed blocks. Reading is light: yaml and pydantic, nothing numerical."""

import importlib
import importlib.util
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import BaseModel, Field, ValidationError, create_model, field_validator

from physreal_core.errors import InputError
from pipeline.config._base import StageParameters
from pipeline.config._errors import as_input_error, unknown_key
from pipeline.config._names import Name, check_name
from pipeline.graph import PERCEPTION, STAGES, Graph, Stage

MAX_BYTES = 10_000_000
"""A params.yaml beyond this is none."""

MAX_NODES = 200_000
"""Values in a params.yaml, each alias counted as all that it stands for."""


class Prediction(StageParameters):
    """A sequence that no model is fitted on: it is rolled out with another sequence's."""

    model_from: Name = Field(description="sequence of `fits` whose fitted models are used, without any refit")


class Fit(StageParameters):
    """A sequence that models are fitted on."""

    companion: Name = Field(description="another interaction with the same object, for find_gap; itself: there is none")


class _Member(StageParameters):
    """A name in a role that has nothing to say about it; a sequence's own values stand under `sequences`."""


class _SequenceBase(StageParameters):
    geometry: Literal["linear", "planar", "volumetric"] = Field(
        "volumetric",
        description="kind of the body: linear, a rod (rope); planar, a shell (cloth); volumetric, filled with particles (plush)",
    )


class _Header(StageParameters):
    seed: int = Field(0, ge=0, description="the only source of randomness")
    composed_from: list[str] = Field(
        default_factory=list, description="what `physreal compose` was given, e.g. [fit_global=von_mises]"
    )


def stage_model(stage: Stage) -> type[BaseModel]:
    """The class of a stage's parameters: the one that the stage names, else that of pipeline/config/<stage>.py.

    It is named as the stage is, fit_global → FitGlobal. A stage without such a file has no parameters.
    """
    if stage.model:
        return stage.model()
    module = f"pipeline.config.{stage.name}"
    if importlib.util.find_spec(module) is None:
        return StageParameters
    class_name = "".join(word.capitalize() for word in stage.name.split("_"))
    return getattr(importlib.import_module(module), class_name)


def parameters_model(graph: Graph = STAGES) -> type[BaseModel]:
    """The model of the whole file: the sequences with their roles, and one block per stage of `graph`."""
    overrides = {name: (dict[str, Any], Field(default_factory=dict)) for name in graph}
    sequence = create_model("Sequence", __base__=_SequenceBase, **overrides)
    clip = create_model("Clip", __base__=StageParameters, **{k: v for k, v in overrides.items() if k in PERCEPTION})
    roles = {
        "sequences": (sequence, "captures that become objects; a stage's name holds values laid over its block below"),
        "clips": (clip, "captures that go through perception only"),
        "rigged": (_Member, "sequences whose capture data/rig makes; any other is yours and is only read"),
        "fits": (Fit, "sequences that models are fitted on"),
        "predictions": (Prediction, "sequences predicted with another one's models, without any refit"),
    }
    fields = {
        name: (dict[Name, model], Field(default_factory=dict, description=text))
        for name, (model, text) in roles.items()
    }
    for name, stage in graph.items():
        model = stage_model(stage)
        fields[name] = (model, Field(default_factory=model, description=_first_line(model)))
    validators = {"companions": field_validator("fits", mode="before")(_with_companions)}
    return create_model("ParametersFile", __base__=_Header, __validators__=validators, **fields)


def _with_companions(fits: Any) -> Any:
    """A fitted sequence that names no companion is its own: DVC needs the key, and has no word for none."""
    if not isinstance(fits, dict):
        return fits
    return {name: {"companion": name, **fit} if isinstance(fit, dict) else fit for name, fit in fits.items()}


def _first_line(model: type[BaseModel]) -> str:
    return (model.__doc__ or "").strip().partition("\n")[0]


@dataclass(frozen=True)
class Parameters:
    """The validated file.

    Attributes:
        values: the parsed and validated file (an instance of `parameters_model(graph)`).
        raw: the mapping as it stood in the file.
        file: its path, for messages.
        graph: the stages it was validated for.
    """

    values: Any
    raw: dict[str, Any]
    file: str
    graph: Graph

    @property
    def seed(self) -> int:
        return self.values.seed

    @cached_property
    def sequences(self) -> dict[str, Any]:
        """Every sequence, whatever its role."""
        return {**self.values.sequences, **self.values.clips}

    def sequence(self, name: str) -> Any:
        """The block of one sequence, InputError if there is none."""
        check_name(name, self.file)
        if name not in self.sequences:
            raise unknown_key(f"sequences.{name}", name, list(self.sequences), self.file)
        return self.sequences[name]

    def stage(self, stage: str, sequence: str) -> Any:
        """The parameters of `stage` for `sequence`: the stage's block with the sequence's own values laid over it."""
        model = stage_model(self.graph[stage])
        own = getattr(self.sequence(sequence), stage, {})
        merged = _overlay(self.raw.get(stage) or {}, own)
        try:
            return model.model_validate(merged)
        except ValidationError as error:
            role = "sequences" if sequence in self.values.sequences else "clips"
            raise as_input_error(error, model, self.file, f"{role}.{sequence}.{stage}") from None


def read_parameters(path: Path) -> dict[str, Any]:
    """The mapping in a YAML file, InputError where it is no mapping or no YAML."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(
                f"the file has {path.stat().st_size} bytes", where=str(path), expected=f"at most {MAX_BYTES}"
            )
        raw = yaml.load(path.read_text(encoding="utf-8"), Loader=_Loader)
    except FileNotFoundError:
        raise InputError("the file is missing", where=str(path), remedy="run `physreal compose`") from None
    except UnicodeDecodeError as error:
        raise InputError(
            f"byte {error.start} is no text", where=str(path), expected="UTF-8", remedy="save the file as UTF-8"
        ) from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        said = " ".join(str(error).split())
        raise InputError(f"not readable as YAML: {said}", where=str(path), remedy="mend it at that place") from None
    if not isinstance(raw, dict):
        raise InputError(
            "the file holds no mapping",
            where=str(path),
            expected="one block per stage",
            remedy="run `physreal compose`",
        )
    return raw


class _Loader(yaml.SafeLoader):
    """Refuses what would be lost in silence, a key that stands twice, and what aliases of aliases blow up."""

    def get_single_node(self) -> yaml.Node | None:
        node = super().get_single_node()
        if node is not None and _expanded(node, {}) > MAX_NODES:
            raise yaml.MarkedYAMLError(problem=f"more than {MAX_NODES} values by its aliases")
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[str] = set()
        for key in (key for key, _ in node.value if isinstance(key, yaml.ScalarNode)):
            if key.value in seen:
                raise yaml.MarkedYAMLError(problem=f"the key {key.value} stands twice", problem_mark=key.start_mark)
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def _expanded(node: yaml.Node, known: dict[int, int]) -> int:
    """How many values a node stands for, each alias counted as what it stands for; no bound where it holds itself."""
    if id(node) not in known:
        known[id(node)] = MAX_NODES + 1
        pairs = node.value if isinstance(node, yaml.MappingNode) else []
        parts = node.value if isinstance(node, yaml.SequenceNode) else [part for pair in pairs for part in pair]
        known[id(node)] = 1 + sum(_expanded(part, known) for part in parts)
    return known[id(node)]


def validate_parameters(raw: dict[str, Any], file: str = "params.yaml", graph: Graph = STAGES) -> Parameters:
    """Check a whole file: every block, every sequence's own values, and the roles.

    Raises:
        InputError: naming the key; for a misspelt one, the nearest that exists.
    """
    model = parameters_model(graph)
    try:
        values = model.model_validate(raw)
    except ValidationError as error:
        raise as_input_error(error, model, file) from None
    parameters = Parameters(values, raw, file, graph)
    _check_roles(parameters)
    for name in parameters.sequences:
        for stage in graph:
            parameters.stage(stage, name)
    return parameters


def load_parameters(path: Path, graph: Graph = STAGES) -> Parameters:
    """`validate_parameters` of the file at `path`."""
    return validate_parameters(read_parameters(path), path.name, graph)


def _check_roles(parameters: Parameters) -> None:
    values, file = parameters.values, parameters.file
    for name in values.clips:
        if name in values.sequences:
            raise InputError(f"{name} is in clips and in sequences", where=file, expected="one of the two")
    for role in ("rigged", "fits", "predictions"):
        for name in getattr(values, role):
            if name not in values.sequences:
                raise unknown_key(f"{role}.{name}", name, list(values.sequences), file)
    for name, fit in values.fits.items():
        if fit.companion not in values.sequences:
            raise InputError(
                f"fits.{name}.companion = {fit.companion!r} is no sequence",
                where=file,
                expected=f"one of {', '.join(values.sequences)}",
            )
    for name, prediction in values.predictions.items():
        if name in values.fits:
            raise InputError(f"{name} is in fits and in predictions", where=file, expected="one of the two")
        if prediction.model_from not in values.fits:
            raise InputError(
                f"predictions.{name}.model_from = {prediction.model_from!r} is not a fitted sequence",
                where=file,
                expected=f"one of {', '.join(values.fits)}",
            )


def _overlay(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """`base` with `over` laid on it, mapping by mapping."""
    merged = dict(base)
    for key, value in over.items():
        both = isinstance(merged.get(key), dict) and isinstance(value, dict)
        merged[key] = _overlay(merged[key], value) if both else value
    return merged
