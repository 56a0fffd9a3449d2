"""The plastic experts C_p(F_trial) by name. A new isotropic law is one file like `von_mises.py` and one line here."""

import warp as wp

from physreal_core.errors import InputError
from physreal_core.simulation.constitutive.drucker_prager import drucker_prager
from physreal_core.simulation.constitutive.return_map import return_functions
from physreal_core.simulation.constitutive.von_mises import von_mises

PLASTIC_LAWS = {
    "identity": None,
    "von_mises": von_mises,
    "drucker_prager": drucker_prager,
}

PLASTIC_PARAMETERS = {
    "identity": (),
    "von_mises": ("yield_stress [Pa]", "viscosity [Pa s]"),
    "drucker_prager": ("friction_angle [rad]", "cohesion [Pa]"),
}
"""What the two numbers `y` of each law are."""


def plastic_functions(law: str, scalar: type) -> tuple[wp.Function, wp.Function] | None:
    """Warp functions of one plastic law, to be called on one particle inside a kernel; `None` for "identity".

    `return_map(F_trial: mat33, E, nu, y: vec2, dt) -> mat33`: the deformation gradient after plastic flow over dt [s];
    `F_trial` itself, bit for bit, inside the yield surface. y holds `PLASTIC_PARAMETERS[law]`.
    `return_map_adjoint(F_trial, E, nu, y, dt, F_bar: mat33) -> struct` with the adjoints `F`, `E`, `nu`, `y`.

    The yield criterion is measured in the Hencky stress of (E, nu): exact with "hencky" elasticity, and right to first
    order in strain with the other elastic laws.

    Args:
        law: a key of `PLASTIC_LAWS`.
        scalar: `wp.float32` or `wp.float64`.

    Raises:
        InputError: if the law is not known.
    """
    if law not in PLASTIC_LAWS:
        raise InputError(
            f"plastic law {law!r}",
            expected=f"one of {', '.join(sorted(PLASTIC_LAWS))}",
            remedy="change `plastic_law` of the simulation's configuration",
        )
    radial = PLASTIC_LAWS[law]
    return None if radial is None else return_functions(radial, scalar)
