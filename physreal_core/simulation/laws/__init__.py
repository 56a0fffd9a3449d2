"""The laws, written once: C++ headers that serve a CPU's lanes and a GPU's threads, their names here, their twins in torch.

A law of elasticity is `elastic/<name>.h`, one of plastic flow `plastic/<name>.h`, an optional law of particles
`terms/<name>.h` (its table is `simulation.terms`); the class has the name without underscores, FixedCorotated.
"""

from pathlib import Path

from physreal_core.simulation.laws.residual_config import ResidualConfig, initial_weights, split_weights, turned_weights

ELASTIC_LAWS = tuple(sorted(header.stem for header in Path(__file__).with_name("elastic").glob("*.h")))
"""Kirchhoff stress [Pa] from F, E, nu: every header in `elastic/`. Outside det F > 0 it is not a number, so that a
rollout stops there."""

PLASTIC_LAWS = {
    "identity": (),
    "von_mises": ("yield_stress [Pa]", "viscosity [Pa s]"),
    "drucker_prager": ("friction_angle [rad]", "cohesion [Pa]"),
}
"""Trial F to F after flow over a substep, by what the two numbers `plastic` of each law are.

The yield criterion is measured in the Hencky stress of (E, nu): exact with "hencky" elasticity, and right to first order in
strain with the other elastic laws."""

__all__ = ["ELASTIC_LAWS", "PLASTIC_LAWS", "ResidualConfig", "initial_weights", "split_weights", "turned_weights"]
