"""How many substeps a frame takes, told before a long stage starts where these are many."""

import torch

from physreal_core.errors import InputError
from physreal_core.fitting.descent import Fields
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.fitting.variables import Variable
from physreal_core.simulation.timestep import USUAL_SUBSTEPS
from pipeline.stage import StageContext

STIFFNESS = ("youngs_modulus", "poissons_ratio", "tool_stiffness", "tool_friction")
"""Variables of a fit that shorten the time step as they grow."""


def tell_substeps(context: StageContext, rollouts: Rollouts, fields: Fields, variables: list[Variable] = ()) -> None:
    """Prints a line where a rollout takes unusually many substeps a frame, or may do so at the bounds of a fit.

    Raises:
        InputError: they are too many, from the start on or at the upper bounds.
    """
    start = most = rollouts.substeps(fields)
    stiff = {v.name: v.upper for v in variables if v.name in STIFFNESS}
    bounds = ", ".join(f"{name}.upper = {value:g}" for name, value in stiff.items())
    if stiff:
        most = _at_bounds(context, rollouts, fields, stiff, bounds)
    if most > USUAL_SUBSTEPS:
        said = f"{start} substeps a frame" + (f", up to {most} at {bounds}" if stiff else "")
        print(f"{context.stage} {context.sequence}: {said}; more than {USUAL_SUBSTEPS} take long", flush=True)


def _at_bounds(context: StageContext, rollouts: Rollouts, fields: Fields, stiff: dict[str, float], bounds: str) -> int:
    highest = {name: torch.full_like(fields[name], value) for name, value in stiff.items()}
    try:
        return rollouts.substeps({**fields, **highest})
    except InputError as error:
        raise InputError(
            f"the fit may go to {error.what}",
            where=f"params.yaml, {context.stage}: {bounds}",
            expected=error.expected,
            remedy=error.remedy,
        ) from None
