"""Trials for tests of what an experiment rolls out."""

from physreal_core.effects import Effect, Setting


def plain_values(effect: Effect, setting: Setting) -> dict[str, float]:
    """Of all coefficients: amplitudes of plain size, shapes as in the first start."""
    start = (effect.starts(setting) or ({},))[0]
    amplitudes = {c.name: c.dormant + c.scale for c in effect.coefficients if c.kind == "amplitude"}
    return {**effect.dormant, **amplitudes, **start}
