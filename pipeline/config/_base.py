"""Base of every stage's parameters: frozen, and a key that does not exist is an error."""

from pydantic import BaseModel, ConfigDict


class StageParameters(BaseModel):
    """Parameters of one stage. Each field: default, range and `description` with its unit; compose writes them out."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)
