"""build_object has a generator make the shape: by a command, or by a network."""

import sys
from pathlib import Path

import numpy as np
import pytest

from physreal_core.errors import InputError
from physreal_core.geometry import Mesh, save_mesh
from pipeline.config.build_object import BuildObject
from pipeline.config.fit_pose import FitPose
from pipeline.products.built_object import BuiltObject, read_facts
from pipeline.products.placed_object import PlacedObject
from stages import build_object
from stages._generator import MARGIN
from stages._observation import read_first_frame
from tests.geometry.scenes import ellipsoid
from tests.geometry.test_stages import Context, check_particles, run_all, write_capture

onnx = pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")
pytest.importorskip("skimage")
SCRIPT = Path(__file__).with_name("inflating_generator.py")
PLACES = "{image} {mask} {output}"
QUICK = FitPose(restarts=1, generations=50, candidates=1, coarse_iterations=50, fine_iterations=30, surface_points=1500)
helper, FLOAT, INT64 = onnx.helper, onnx.TensorProto.FLOAT, onnx.TensorProto.INT64


def with_generator(generator: str) -> BuildObject:
    return BuildObject(gaussians=500, generator=generator)


def network(path: Path, mesh: Mesh, columns: int = 3) -> str:
    """Gives `mesh`, as wide along x as the mask fills its square: a network that looks at what it is given."""
    vertices = mesh.vertices[:, :columns].astype(np.float32)
    nodes = [
        helper.make_node("ReduceMean", ["mask"], ["share"], keepdims=0),
        helper.make_node("Mul", ["shape", "share"], ["vertices"]),
        helper.make_node("ReduceMean", ["image"], ["unused"], keepdims=0),
        helper.make_node("Identity", ["triangles"], ["faces"]),
    ]
    known = [
        onnx.numpy_helper.from_array(vertices, "shape"),
        onnx.numpy_helper.from_array(mesh.faces.astype(np.int64), "triangles"),
    ]
    given = [helper.make_tensor_value_info(n, FLOAT, [1, c, 64, 64]) for n, c in (("image", 3), ("mask", 1))]
    found = [
        helper.make_tensor_value_info("vertices", FLOAT, [len(vertices), columns]),
        helper.make_tensor_value_info("faces", INT64, [len(mesh.faces), 3]),
    ]
    graph = helper.make_graph(nodes, "generator", given, found, known)
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8), str(path))
    return str(path)


def test_a_command_sees_picture_and_mask_and_its_shape_is_a_prior(tmp_path):
    body = ellipsoid()
    root = write_capture(tmp_path, body)
    particles = run_all(root, with_generator(f"{sys.executable} {SCRIPT} {PLACES}"), QUICK)
    placed, facts = PlacedObject.load(root / "fit_pose"), read_facts(root / "build_object")
    assert facts["source"] == "generated mesh" and max(facts["extents"]) == pytest.approx(1.0)
    check_particles(particles, placed.mesh)
    assert placed.notes["iou_frame0"] > 0.8 and placed.mesh.volume == pytest.approx(body.volume, rel=0.4)
    assert placed.far_side_guessed and particles.unseen.min() == 0.0 and particles.unseen.max() == 1.0


def test_a_given_shape_goes_before_a_generator(tmp_path):
    root = write_capture(tmp_path, ellipsoid())
    save_mesh(root / "capture/shape_prior.glb", ellipsoid())
    build_object.run(Context(root, "build_object", with_generator("never-started " + PLACES)))
    built = BuiltObject.load(root / "build_object")
    assert built.source == "prior mesh" and not built.far_side_guessed


def test_a_network_sees_the_object_in_the_middle_of_a_square(tmp_path):
    root, body = write_capture(tmp_path, ellipsoid()), ellipsoid()
    build_object.run(Context(root, "build_object", with_generator(network(tmp_path / "own.onnx", body))))
    built = BuiltObject.load(root / "build_object")
    size = 1.0 / built.T_object_prior[0, 0]  # longest side of what the network gave
    mask = read_first_frame(root / "parse_video", root / "segment_and_track").mask
    side = (1.0 + 2.0 * MARGIN) * max(np.ptp(np.nonzero(mask), axis=1))
    assert built.source == "generated mesh"
    assert size == pytest.approx(np.ptp(body.vertices, axis=0).max() * mask.sum() / side**2, rel=0.03)


@pytest.mark.parametrize(("command", "said"), [
    ("make-shape {image} {output}", r"no \{mask\} in the command"),
    ("no-such-generator-here " + PLACES, "cannot be started"),
    (f"{sys.executable} -c 'import sys; sys.exit(\"out of memory\")' " + PLACES, "ended with 1:\nout of memory"),
    (f"{sys.executable} -c 'pass' " + PLACES, "left no shape"),
])  # fmt: skip
def test_a_generator_that_leaves_nothing_is_told(tmp_path, command, said):
    root = write_capture(tmp_path, ellipsoid())
    with pytest.raises(InputError, match=said) as raised:
        build_object.run(Context(root, "build_object", with_generator(command)))
    assert "build_object.generator" in str(raised.value)


def test_a_network_with_other_outputs_is_told(tmp_path):
    root = write_capture(tmp_path, ellipsoid())
    flat = network(tmp_path / "flat.onnx", ellipsoid(), columns=2)
    with pytest.raises(InputError, match=r"vertices \(\d+, 2\).*expected vertices \[V, 3\]"):
        build_object.run(Context(root, "build_object", with_generator(flat)))


def test_a_capture_without_pictures_shows_a_generator_nothing(tmp_path):
    with pytest.raises(InputError, match="needs a shape"):
        build_object.run(Context(write_capture(tmp_path, None), "build_object", with_generator("any " + PLACES)))
