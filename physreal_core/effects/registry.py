"""All candidate effects by name. A new one is a file in its family's folder and a line here."""

from physreal_core.effects.effect import Effect

EFFECTS: dict[str, Effect] = {effect.name: effect for effect in ()}
