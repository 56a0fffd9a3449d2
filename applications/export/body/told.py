"""What a user is told of a model for another simulator: its numbers, and what of the hand it does not have."""

from collections.abc import Iterator

import numpy as np

from applications.export.body.hand import Hand
from applications.export.body.material import Material
from applications.export.body.nodes import Nodes


def told(nodes: Nodes, material: Material, hand: Hand | None) -> list[str]:
    """Sentences, the first with the numbers."""
    return [_summary(nodes, material), *_strays(nodes, hand), *material.lost]


def _summary(nodes: Nodes, material: Material) -> str:
    count, kinds = sum(map(len, nodes.parts)), {1: "segments", 2: "triangles", 3: "tetrahedra"}
    return (
        f"{len(nodes.rest)} nodes, {count} {kinds[nodes.dimension]}, {nodes.mass.sum():.4g} kg, {int(nodes.held.sum())} nodes held; "
        f"E = {material.youngs_modulus:.4g} Pa, nu = {material.poissons_ratio:.3f}, friction {material.friction_coefficient:.3g}, "
        f"retardation {material.retardation:.3g} s."
    )


def _strays(nodes: Nodes, hand: Hand | None) -> Iterator[str]:
    if hand is not None and hand.stray > 1e-3:
        yield f"The hand moves as one rigid body; its points stray from that by {1e3 * hand.stray:.1f} mm."
    bent = np.linalg.norm((nodes.rest - nodes.start)[nodes.held], axis=1).max(initial=0.0)
    if bent > 1e-3:
        yield f"What the hand holds is without stress in it: nodes there move by up to {1e3 * bent:.1f} mm."
