"""The page docs/effects.md, written from the registry: `python -m physreal_core.effects.page > docs/effects.md`."""

from physreal_core.effects.effect import ANYWHERE, Coefficient, Effect
from physreal_core.effects.registry import EFFECTS

FAMILIES = {
    "around": "Around the object",
    "material": "In the material",
    "mass": "Mass",
    "contact": "Contact",
    "grip": "Grip",
    "measurement": "Measurement, not physics",
}

HEAD = """# Effects that a simulation may be missing
Written from the registry by `python -m physreal_core.effects.page > docs/effects.md`; a test holds it to be fresh.

Each effect is a term of the simulator, or of the observation, that is switched off by default. At the *dormant* values of its
coefficients the rollout is that of the model without it. An *amplitude* switches the effect on. A *shape* (a place, a direction, a
length) means nothing without an amplitude. Coefficients are in SI units. Many are relative to the object (per mass, over Young's
modulus), so their scales suit objects of any size. A *scale* is the size of a plainly visible effect, and the width of the prior.
*Shows* says where and when an effect is visible. *Told apart by* names the motion that shows it best and distinguishes it from
others.

[CONTRIBUTING](../CONTRIBUTING.md) says how to add an effect: four files where it acts on what the simulator already takes.
"""


def effects_page() -> str:
    """The page as markdown."""
    return "\n".join([HEAD, *(_family(key, title) for key, title in FAMILIES.items())])


def _family(family: str, title: str) -> str:
    members = [effect for effect in EFFECTS.values() if effect.family == family]
    return "\n".join([f"## {title}", *map(_section, members)])


def _section(effect: Effect) -> str:
    lines = [
        f"### `{effect.name}`",
        f"{effect.words}",
        "",
        f"    {effect.formula}",
        "",
        f"*Shows* {effect.shows}. *Told apart by* {effect.distinguished_by}.",
        "",
        "| coefficient | unit | meaning | dormant | range | scale | kind |",
        "|---|---|---|---|---|---|---|",
        *map(_row, effect.coefficients),
        "",
    ]
    return "\n".join(lines)


def _row(c: Coefficient) -> str:
    span = "any" if c.upper == ANYWHERE else f"{c.lower:g} … {c.upper:g}"
    cells = (f"`{c.name}`", c.unit, c.meaning, f"{c.dormant:g}", span, f"{c.scale:g}", c.kind)
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    print(effects_page(), end="")
