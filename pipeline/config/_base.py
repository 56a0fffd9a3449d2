"""Base of every stage's parameters: frozen, and a key that does not exist is an error."""

import dataclasses
import typing
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, ValidationInfo, field_validator

Settings = TypeVar("Settings")


class StageParameters(BaseModel):
    """Parameters of one stage. Each field: default, range and `description` with its unit; compose writes them out."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True, allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _no_truth_value_for_a_number(cls, value: Any, info: ValidationInfo) -> Any:
        """YAML reads `yes` and `on` as true, which would be taken for 1."""
        annotation = cls.model_fields[info.field_name].annotation
        if isinstance(value, bool) and {int, float} & {annotation, *typing.get_args(annotation)}:
            raise ValueError("a number, not a truth value")
        return value

    def files(self) -> tuple[str, ...]:
        """Files that the parameters name, as paths from the project's root: their content counts as an input."""
        return ()

    def as_settings(self, kind: type[Settings], **given: Any) -> Settings:
        """The core's frozen dataclass `kind`, filled with what stands here under the names of its fields.

        So a setting of the core becomes a parameter by a field of the same name here, and by nothing else. A block here
        fills the settings within the settings that have its name.

        Args:
            kind: the dataclass; what neither stands here nor is given keeps its default.
            given: what does not stand here under its name, or not in the form that the core wants.
        """
        kinds = typing.get_type_hints(kind)
        fields = [field.name for field in dataclasses.fields(kind)]
        own = {name: getattr(self, name) for name in fields if name in type(self).model_fields and name not in given}
        filled = {
            name: value.as_settings(kinds[name]) if isinstance(value, StageParameters) else value
            for name, value in own.items()
        }
        return kind(**filled, **given)
