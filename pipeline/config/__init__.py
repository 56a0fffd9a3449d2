"""The typed view of params.yaml: one block per stage, the sequences and their roles.

A stage's owner writes pipeline/config/<stage>.py with one class named as the stage is (fit_global → `FitGlobal`),
derived from `StageParameters`; nothing else has to be registered.
"""

from pipeline.config._base import StageParameters
from pipeline.config._errors import as_input_error, as_input_errors, unknown_key
from pipeline.config._names import RULE, Name, check_name
from pipeline.config._parameters import (
    Parameters,
    Prediction,
    load_parameters,
    read_parameters,
    stage_model,
    validate_parameters,
)

__all__ = [
    "RULE",
    "Name",
    "Parameters",
    "Prediction",
    "StageParameters",
    "as_input_error",
    "as_input_errors",
    "check_name",
    "load_parameters",
    "read_parameters",
    "stage_model",
    "unknown_key",
    "validate_parameters",
]
