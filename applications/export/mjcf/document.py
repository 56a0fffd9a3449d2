"""The files of the MuJoCo model: `twin.xml`, `hand.csv`."""

from pathlib import Path

import numpy as np

from applications.export.mjcf.hand import Hand
from applications.export.mjcf.material import Material
from applications.export.mjcf.nodes import Nodes
from applications.export.mjcf.spec import described
from applications.export.moving import Moving

FILE = "twin.xml"


def write(moving: Moving, folder: Path) -> list[str]:
    """`twin.xml`, a model with the body at frame 0, and `hand.csv`, the way of its mocap body; returns what the model does not hold."""
    twin = moving.twin
    material = Material.of(twin)
    nodes, hand = Nodes.of(twin, material.density), Hand.of(material.hand)
    told = [_summary(nodes, material), *_strays(nodes, hand), *material.lost]
    spec = described(twin, nodes, material, hand)
    spec.comment = "\n".join(told)
    spec.compile()
    (folder / FILE).write_text(spec.to_xml())
    if hand is not None:
        hand.save(folder, moving.fps)
    return told


def _summary(nodes: Nodes, material: Material) -> str:
    count, kinds = sum(map(len, nodes.parts)), {1: "segments", 2: "triangles", 3: "tetrahedra"}
    return (
        f"{len(nodes.rest)} nodes, {count} {kinds[nodes.dimension]}, {nodes.mass.sum():.4g} kg, {int(nodes.held.sum())} nodes held; "
        f"E = {material.youngs_modulus:.4g} Pa, nu = {material.poissons_ratio:.3f}, friction {material.friction_coefficient:.3g}, "
        f"retardation {material.retardation:.3g} s."
    )


def _strays(nodes: Nodes, hand: Hand | None) -> list[str]:
    told = []
    if hand is not None and hand.stray > 1e-3:
        told.append(f"The hand moves as one rigid body; its points stray from that by {1e3 * hand.stray:.1f} mm.")
    bent = np.linalg.norm((nodes.rest - nodes.start)[nodes.held], axis=1).max(initial=0.0)
    if bent > 1e-3:
        told.append(f"What the hand holds is without stress in it: nodes there move by up to {1e3 * bent:.1f} mm.")
    return told
