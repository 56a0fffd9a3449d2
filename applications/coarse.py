"""A twin of fewer particles, which simulates faster."""

from dataclasses import replace

from applications.twin import Twin
from physreal_core.errors import InputError
from physreal_core.fitting.thin import bind_to_body
from physreal_core.planning import quick_form, with_grip
from physreal_core.rendering import bind


def coarser(twin: Twin, factor: float, command: str) -> Twin:
    """The twin with particles `factor` times as far apart; itself for a factor of 1. `command` is named in errors.

    Raises:
        InputError: there is no such form of it.
    """
    if factor == 1.0:
        return twin
    found = quick_form(twin.problem, twin.model, factor)
    if found is None:
        raise InputError(
            f"{twin.sequence} cannot be simulated with fewer particles",
            where=f"{command} --coarser",
            expected="a solid body, several particles thick, that one hand holds from frame 0 on",
            remedy="leave the option out",
        )
    problem, share = found
    gaussians = twin.gaussians
    return replace(
        twin,
        problem=problem,
        model=replace(twin.model, fields=with_grip(twin.model.fields, share)),
        mesh_binding=bind_to_body(twin.mesh.vertices, problem.body),
        gaussian_binding=None if gaussians is None else bind(gaussians.means.double().cpu().numpy(), problem.body.x0),
    )
