"""The stages, what each reads, and where the parameters of each are defined: the artifact contract's skeleton.

`pipeline/<stage>/dvc.yaml` says the same to DVC; tests/pipeline/test_dvc_files.py holds the two together.
"""

import importlib
import importlib.util
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from pydantic import BaseModel


def _from_config_module(stage: str) -> type[BaseModel]:
    """The class of pipeline/config/<stage>.py, named as the stage is: fit_global → FitGlobal. No file: no parameters."""
    if importlib.util.find_spec(f"pipeline.config.{stage}") is None:
        return importlib.import_module("pipeline.config").StageParameters
    class_name = "".join(word.capitalize() for word in stage.split("_"))
    return getattr(importlib.import_module(f"pipeline.config.{stage}"), class_name)


@dataclass(frozen=True)
class Stage:
    """One stage and what it reads.

    Attributes:
        upstream: stages whose output for the same sequence it reads.
        fitted: further ones where the sequence stands under `fits`.
        predicted: further ones where it stands under `predictions`.
        of_model: stages whose output for the sequence under `model_from` it reads.
        of_companion: stages whose output it reads for the sequence's `companion`, where there is one.
        reads_capture: whether it reads the capture folder.
        makes_capture: whether its output is the capture folder.
        model: gives the class of its parameters; default: the one in pipeline/config/<name>.py.
    """

    name: str
    upstream: tuple[str, ...] = ()
    fitted: tuple[str, ...] = ()
    predicted: tuple[str, ...] = ()
    of_model: tuple[str, ...] = ()
    of_companion: tuple[str, ...] = ()
    reads_capture: bool = False
    makes_capture: bool = False
    model: Callable[[], type[BaseModel]] | None = None

    def parameters_model(self) -> type[BaseModel]:
        return self.model() if self.model else _from_config_module(self.name)


Graph = Mapping[str, Stage]


def graph_of(*stages: Stage) -> Graph:
    """Stages by name, in the order in which they run."""
    return {stage.name: stage for stage in stages}


FIT_STAGES = ("fit_global", "fit_patches", "add_effect", "fit_residual")
_OBSERVED = ("parse_video", "segment_and_track", "fit_pose", "sample_particles")
_TRACKED = ("parse_video", "segment_and_track", "sample_particles")

PERCEPTION = ("parse_video", "segment_and_track")

STAGES: Graph = graph_of(
    Stage("rig", makes_capture=True),
    Stage("parse_video", reads_capture=True),
    Stage("segment_and_track", ("parse_video",), reads_capture=True),
    Stage("build_object", ("parse_video", "segment_and_track"), reads_capture=True),
    Stage("fit_pose", ("parse_video", "segment_and_track", "build_object")),
    Stage("sample_particles", ("parse_video", "segment_and_track", "fit_pose")),
    Stage("fit_global", _OBSERVED),
    Stage("fit_patches", (*_OBSERVED, "fit_global")),
    Stage("find_gap", (*_TRACKED, "fit_patches"), of_companion=_TRACKED),
    Stage("add_effect", (*_TRACKED, "fit_patches", "find_gap"), of_companion=_TRACKED),
    Stage("fit_residual", (*_OBSERVED, "fit_patches", "add_effect")),
    Stage("predict", _OBSERVED, of_model=("fit_pose", "sample_particles", *FIT_STAGES)),
    Stage("evaluate", _OBSERVED, fitted=FIT_STAGES, predicted=("predict",), reads_capture=True),
)
