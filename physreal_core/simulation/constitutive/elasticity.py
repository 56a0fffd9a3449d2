"""The elastic experts C_e(F, E, nu) by name. A new law is one file like `fixed_corotated.py` and one line here."""

import warp as wp

from physreal_core.errors import InputError
from physreal_core.simulation.constitutive.fixed_corotated import fixed_corotated
from physreal_core.simulation.constitutive.hencky import hencky
from physreal_core.simulation.constitutive.neo_hookean import neo_hookean

ELASTIC_LAWS = {
    "neo_hookean": neo_hookean,
    "fixed_corotated": fixed_corotated,
    "hencky": hencky,
}


def elastic_functions(law: str, scalar: type) -> tuple[wp.Function, wp.Function]:
    """Warp functions of one elastic law, to be called on one particle inside a kernel.

    `stress(F: mat33, E, nu) -> mat33`: Kirchhoff stress tau [Pa] of the deformation gradient F (det F > 0).
    `stress_adjoint(F, E, nu, tau_bar: mat33) -> struct`: fields `F`, `E`, `nu` hold the adjoints, `tau` the stress.

    Outside det F > 0 the stress is not a number, so that a rollout stops at the particle instead of going on.

    Args:
        law: a key of `ELASTIC_LAWS`.
        scalar: `wp.float32` or `wp.float64`.

    Raises:
        InputError: if the law is not known.
    """
    if law not in ELASTIC_LAWS:
        raise InputError(
            f"elastic law {law!r}",
            expected=f"one of {', '.join(sorted(ELASTIC_LAWS))}",
            remedy="change `elastic_law` of the simulation's configuration",
        )
    return ELASTIC_LAWS[law](scalar)
