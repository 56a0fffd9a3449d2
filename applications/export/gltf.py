"""The surface as glTF 2.0 (.glb) with a morph target a frame, which Blender, three.js and game engines play."""

from pathlib import Path

import numpy as np

from applications.export.moving import Moving
from physreal_core.array_types import Array

FILE = "motion.glb"
_TO_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""glTF has y up, we have z."""


def write(moving: Moving, folder: Path) -> None:
    """`motion.glb`: vertices of frame 0, for each later frame their displacement as a morph target, and an animation that goes from one
    to the next linearly, at the film's pace."""
    import pygltflib as gltf

    made, mesh = _Buffers(), moving.twin.mesh
    vertices = (moving.vertices @ _TO_Y_UP.T).astype(np.float32)
    frames = len(vertices)
    attributes = {"POSITION": made.points(vertices[0])}
    if mesh.colours is not None:
        attributes["COLOR_0"] = made.add(mesh.colours.astype(np.float32), gltf.FLOAT, gltf.VEC3, gltf.ARRAY_BUFFER)
    faces = made.add(mesh.faces.astype(np.uint32).ravel(), gltf.UNSIGNED_INT, gltf.SCALAR, gltf.ELEMENT_ARRAY_BUFFER)
    targets = [{"POSITION": made.points(now - vertices[0])} for now in vertices[1:]]
    times = made.add((np.arange(frames) / moving.fps).astype(np.float32), gltf.FLOAT, gltf.SCALAR, None)
    weights = np.concatenate([np.zeros((1, frames - 1)), np.eye(frames - 1)]).astype(np.float32)
    shares = made.add(weights.ravel(), gltf.FLOAT, gltf.SCALAR, None)
    primitive = gltf.Primitive(attributes=gltf.Attributes(**attributes), indices=faces, targets=targets, material=0)
    channel = gltf.AnimationChannel(sampler=0, target=gltf.AnimationChannelTarget(node=0, path="weights"))
    document = gltf.GLTF2(
        asset=gltf.Asset(generator="PhysReal"),
        scene=0,
        scenes=[gltf.Scene(nodes=[0])],
        nodes=[gltf.Node(mesh=0, name=moving.twin.sequence)],
        meshes=[gltf.Mesh(primitives=[primitive], weights=[0.0] * (frames - 1))],
        materials=[gltf.Material(doubleSided=True)],
        animations=[
            gltf.Animation(
                name="filmed motion",
                channels=[channel],
                samplers=[gltf.AnimationSampler(input=times, output=shares, interpolation="LINEAR")],
            )
        ],
        accessors=made.accessors,
        bufferViews=made.views,
        buffers=[gltf.Buffer(byteLength=len(made.content))],
    )
    document.set_binary_blob(bytes(made.content))
    document.save_binary(str(folder / FILE))


class _Buffers:
    """The binary part of a glTF file, with what says where each array lies."""

    def __init__(self) -> None:
        self.content, self.views, self.accessors = bytearray(), [], []

    def points(self, array: Array) -> int:
        """Number of the accessor of points, [V, 3] float32."""
        import pygltflib as gltf

        return self.add(array, gltf.FLOAT, gltf.VEC3, gltf.ARRAY_BUFFER)

    def add(self, array: Array, component: int, kind: str, target: int | None) -> int:
        """Number of the accessor of an array."""
        import pygltflib as gltf

        content = np.ascontiguousarray(array).tobytes()
        self.views.append(
            gltf.BufferView(buffer=0, byteOffset=len(self.content), byteLength=len(content), target=target)
        )
        self.content += content  # all arrays are of four-byte numbers, so each begins where glTF wants it
        rows = array if array.ndim > 1 else array[:, None]
        low, high = (getattr(rows, end)(0).tolist() for end in ("min", "max"))
        self.accessors.append(
            gltf.Accessor(
                bufferView=len(self.views) - 1, componentType=component, count=len(rows), type=kind, min=low, max=high
            )
        )
        return len(self.accessors) - 1
