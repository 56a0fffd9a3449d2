"""The files of the MuJoCo model: `twin.xml`, `hand.csv`."""

from pathlib import Path

from applications.export.body.hand import Hand
from applications.export.body.material import MUJOCO, Material
from applications.export.body.nodes import Nodes
from applications.export.body.told import told
from applications.export.mjcf.spec import described
from applications.export.moving import Moving

FILE = "twin.xml"


def write(moving: Moving, folder: Path) -> list[str]:
    """`twin.xml`, a model with the body at frame 0, and `hand.csv`, the way of its mocap body; returns what the model does not hold."""
    twin = moving.twin
    material = Material.of(twin, MUJOCO)
    nodes, hand = Nodes.of(twin, material.density), Hand.of(material.hand)
    sentences = told(nodes, material, hand)
    if twin.problem.tool is not None:
        sentences.append(
            "The pushing hand has its shape, but MuJoCo does not know how fast a mocap body moves: its friction is not the twin's."
        )
    spec = described(twin, nodes, material, hand)
    spec.comment = "\n".join(sentences)
    spec.compile()
    (folder / FILE).write_text(spec.to_xml())
    if hand is not None:
        hand.save(folder, moving.fps)
    return sentences
