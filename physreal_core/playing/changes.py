"""What a user changes of a fitted model while it is played with."""

from dataclasses import dataclass, field, replace

from physreal_core.errors import InputError
from physreal_core.fitting.model import Model
from physreal_core.fitting.named_effects import effect_record
from physreal_core.fitting.rollouts import EffectValues, Fields

BRAKE = "linear_drag"
"""The effect that a user slows the body with where the model has none of its own."""


@dataclass(frozen=True)
class Changes:
    """Changes of a model; as made they change nothing.

    Attributes:
        stiffness: factor of Young's modulus.
        friction: of the ground; None as fitted.
        brake: drag per mass beside the model's effects [1/s].
        effects: coefficients by effect and name in place of the model's.
    """

    stiffness: float = 1.0
    friction: float | None = None
    brake: float = 0.0
    effects: dict[str, dict[str, float]] = field(default_factory=dict)

    def fields_of(self, model: Model) -> Fields:
        """The model's fields with these changes."""
        if not self.stiffness > 0:
            raise InputError(
                f"a stiffness of {self.stiffness:g} times the fitted one", where="Changes.stiffness", expected="above 0"
            )
        changed = {"youngs_modulus": model.fields["youngs_modulus"] * self.stiffness}
        if self.friction is not None:
            changed["friction_coefficient"] = model.fields["friction_coefficient"] * 0 + self.friction
        return model.fields | changed

    def values_of(self, model: Model) -> EffectValues:
        """Coefficients of the effects of `braked(model)`, of those that are changed."""
        known = {record["name"]: record["values"] for record in model.effects}
        for name, own in self.effects.items():
            if name not in known or not own.keys() <= known[name].keys():
                raise InputError(
                    f"effect {name} with {', '.join(own)}",
                    where="Changes.effects",
                    expected=f"effects of the model: {', '.join(known) or 'it has none'}",
                )
        merged = {name: known[name] | own for name, own in self.effects.items()}
        if self.brake:
            own = merged.get(BRAKE, known.get(BRAKE, {"rate": 0.0}))
            merged[BRAKE] = {"rate": own["rate"] + self.brake}
        return merged


def braked(model: Model) -> Model:
    """The model with a drag of zero where it has none, so that a user can slow the body while it moves."""
    if any(record["name"] == BRAKE for record in model.effects):
        return model
    return replace(model, effects=[*model.effects, effect_record(BRAKE, {"rate": 0.0})])
