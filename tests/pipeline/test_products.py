"""What stages hand each other: read back as it was written, one clear error for what is missing, names in one place."""

import ast
import dataclasses
import hashlib
import re
from pathlib import Path

import numpy as np
import pytest

from physreal_core.errors import InputError
from pipeline.products._files import write_arrays
from pipeline.products.camera import RecordedCamera
from pipeline.products.controllers import Controllers
from pipeline.products.fit import Descent, Fit, ResidualShare, Valley
from pipeline.products.gap import load_added, load_gap, save_added, save_gap
from pipeline.products.given_tracks import GivenTracks2d, GivenTracks3d
from pipeline.products.images import FrameImages
from pipeline.products.loss_curve import LossCurve
from pipeline.products.masks import Masks
from pipeline.products.particles import Particles
from pipeline.products.placed_object import PlacedObject
from pipeline.products.quality import PerceptionQuality, Quality
from pipeline.products.rollout import Rollout
from pipeline.products.scores import Scores
from pipeline.products.tracks import MeasuredTracks
from pipeline.products.truth import CaptureTruth
from pipeline.project import CODE_ROOT
from tests.pipeline.finished import AFTER, GAP

RANDOM = np.random.default_rng(0)
PRODUCTS = CODE_ROOT / "pipeline" / "products"
CHECKPOINTS = CODE_ROOT / "physreal_core" / "checkpoints.py"
MODEL_FILE = CODE_ROOT / "physreal_core" / "fitting" / "model_file.py"


def noise(*shape: int) -> np.ndarray:
    return RANDOM.normal(size=shape)


def seen(*shape: int) -> np.ndarray:
    return RANDOM.random(shape) > 0.5


def ids(*shape: int) -> np.ndarray:
    return RANDOM.integers(0, 5, shape)


def particles() -> Particles:
    body = {"x0": noise(5, 3), "volume": noise(5), "spacing": 0.01, "density": noise(5)}
    patches = {"patches": ids(2), "patch_neighbours": ids(5, 2), "patch_weights": noise(5, 2)}
    drawn = {"gaussian_neighbours": ids(7, 4), "gaussian_weights": noise(7, 4)}
    tracks = {"track_ids": ids(3), "track_points0": noise(3, 3)}
    tracks |= {"track_neighbours": ids(3, 4), "track_weights": noise(3, 4)}
    grip = {"grip_particles": ids(6), "grip_controllers": ids(6)}
    grip |= {"grip_weights": noise(6), "grip_rest_lengths": noise(6)}
    return Particles(**body, **patches, **drawn, **tracks, **grip)


ARRAY_FILES = [
    particles(),
    MeasuredTracks(noise(4, 3, 2), seen(4, 3), noise(4, 3, 3), seen(4, 3), noise(4, 3)),
    dataclasses.replace(particles(), tool_ends=ids(3, 2), tool_radius=seen(3) + 0.5, tool_spared=ids(2)),
    dataclasses.replace(particles(), unseen=noise(5)),
    Controllers(noise(4, 2, 3)),
    Controllers(noise(4, 2, 3), np.array([[0, 1], [1, 1]]), np.array([0.01, 0.02])),
    Rollout(noise(4, 5, 3), noise(4, 5, 3, 3)),
    Rollout(noise(4, 5, 3), noise(4, 5, 3, 3), x_seen=noise(4, 5, 3)),
    GivenTracks3d(noise(4, 3, 3)),
    GivenTracks3d(noise(4, 3, 3), seen(4, 3), noise(4, 3)),
    GivenTracks2d(noise(4, 3, 2), seen(4, 3)),
]
DESCENT = Descent(0.5, 12, None, observed_frames=7, fitted_frames=7, particles=27, patches=2)
SHARE = ResidualShare(stress_share=None, objective_before=0.5, objective_after=0.25)
RECORDS = [
    RecordedCamera(30.0, 48, 36, np.eye(3), np.eye(4), 12),
    RecordedCamera(100.0, None, None, None, None, 12),
    Quality("video", 2, {"fitted": False}, ["dark"], [3.0, 4.0], [1.0, 2.0], [0.5, 0.25], [1]),
    PerceptionQuality(["look"], [{"kind": "area", "frames": [3], "sentence": "look"}], 0.6, [{"point": [3, 4]}], {}),
    Fit({"youngs_modulus": {"mean": 6e4, "unit": "Pa"}}),
    Fit({}, DESCENT, scan=[{"youngs_modulus": 1e4, "objective": None}]),
    Fit({}, dataclasses.replace(DESCENT, objective=None), residual=SHARE, residual_without_effect=SHARE),
    Fit({}, DESCENT, valley=Valley(["youngs_modulus", "grip_stiffness"], -0.9, [[5e4, 60.0], [7e4, 12.0]])),
    LossCurve([{"iteration": 0.0, "total": 2.5}, {"iteration": 1.0, "total": float("inf"), "track": 0.125}]),
]


def same(a: object, b: object) -> bool:
    """Field by field, arrays of `a` in the precision of those of `b`."""
    pairs = [(getattr(a, field.name), getattr(b, field.name)) for field in dataclasses.fields(a)]
    return all(
        np.array_equal(np.asarray(one, two.dtype), two) if isinstance(two, np.ndarray) else one == two
        for one, two in pairs
    )


@pytest.mark.parametrize("product", ARRAY_FILES, ids=lambda product: type(product).__name__)
def test_arrays_come_back_in_the_precision_of_the_file(product, tmp_path):
    product.save(tmp_path)
    back = type(product).load(tmp_path)
    arrays = [value for value in vars(back).values() if isinstance(value, np.ndarray)]
    assert {array.dtype.name for array in arrays} <= {"float32", "int32", "bool"}
    single = {name: np.float32(v).item() if isinstance(v, float) else v for name, v in vars(product).items()}
    assert same(type(product)(**single), back)
    written = (tmp_path / product.FILE).read_bytes()
    back.save(tmp_path)
    assert (tmp_path / product.FILE).read_bytes() == written


@pytest.mark.parametrize("product", RECORDS, ids=lambda product: type(product).__name__)
def test_records_come_back_as_they_were(product, tmp_path):
    product.save(tmp_path)
    assert same(product, type(product).load(tmp_path))


def test_truth_keeps_the_types_that_its_maker_gave(tmp_path):
    truth = CaptureTruth(youngs_modulus=6e4, vertices=noise(4, 5, 3), hand=noise(4, 3).astype(np.float32))
    truth = dataclasses.replace(truth, effect_names=np.array(["wind"]), strength="high")
    truth.save(tmp_path)
    back = CaptureTruth.load(tmp_path)
    assert same(truth, back) and (back.youngs_modulus, back.strength, back.tets) == (6e4, "high", None)
    assert back.vertices.dtype == np.float64 and back.hand.dtype == np.float32
    assert "E" in np.load(tmp_path / CaptureTruth.FILE)


def test_frames_and_masks_are_read_one_by_one(tmp_path):
    colour, depth = ids(6, 8, 3).astype(np.uint8), ids(6, 8).astype(np.uint16) + 700
    for frame, measured in enumerate((depth, depth + 1)):
        FrameImages(tmp_path).save(frame, colour, measured)
    images = FrameImages(tmp_path)
    assert np.array_equal(images.colour(1), colour) and np.array_equal(images.depth(1), depth + 1)
    masks = Masks(seen(3, 6, 8), seen(3, 6, 8))
    masks.save(tmp_path)
    some = Masks.load(tmp_path, [2, 0])
    assert np.array_equal(some.object, masks.object[[2, 0]])
    assert np.array_equal(some.controller, masks.controller[[2, 0]])
    with pytest.raises(InputError, match=r"masks/object: there is no 000003\.png"):
        Masks.load(tmp_path, [3])


def test_the_answer_comes_back_with_its_fields(tmp_path):
    save_gap(tmp_path, GAP)
    save_added(tmp_path, AFTER)
    report = load_gap(tmp_path)
    assert report.fields.keys() == GAP.fields.keys()
    assert dataclasses.replace(report, fields={}) == dataclasses.replace(GAP, fields={})
    assert load_added(tmp_path) == AFTER


LOADS = [
    (Particles.load, "particles.npz", "sample_particles"),
    (MeasuredTracks.load, "tracks.npz", "segment_and_track"),
    (Controllers.load, "controllers.npz", "segment_and_track"),
    (Rollout.load, "rollout.npz", "fit stage"),
    (RecordedCamera.load, "camera.json", "parse_video"),
    (Quality.load, "quality.json", "parse_video"),
    (PlacedObject.load, "pose.json", "fit_pose"),
    (Fit.load, "fit.json", "fit stage"),
    (LossCurve.load, "loss.csv", "fit stage"),
    (load_gap, "gap.json", "find_gap"),
    (load_added, "gap_after.json", "add_effect"),
    (Scores.load, "metrics.json", "evaluate"),
    (GivenTracks3d.load, "tracks3d.npz", "docs/captures.md"),
]


@pytest.mark.parametrize("load,file,remedy", LOADS, ids=[file for _, file, _ in LOADS])
def test_a_missing_file_is_named_with_what_writes_it(load, file, remedy, tmp_path):
    with pytest.raises(InputError, match=rf"there is no {re.escape(file)}.*{re.escape(remedy)}") as raised:
        load(tmp_path)
    assert str(tmp_path) in str(raised.value)


def test_arrays_are_the_same_bytes_with_every_version_of_python(tmp_path):
    """A member's header says when and by what it was written, which would differ from run to run."""
    write_arrays(tmp_path / "a.npz", {"x": np.arange(6.0).reshape(2, 3), "one": np.ones(())}, compressed=False)
    digest = hashlib.sha256((tmp_path / "a.npz").read_bytes()).hexdigest()
    assert digest == "90999b216dd941c8e5bf3ebb345d1b8a88895c1a4a33654e9a46b93285a5b804"  # 3.11.2 and 3.11.7
    with np.load(tmp_path / "a.npz") as file:
        assert file["x"].tolist() == [[0, 1, 2], [3, 4, 5]] and file["one"].item() == 1


def test_a_missing_array_key_or_a_broken_file_is_named(tmp_path):
    np.savez(tmp_path / Particles.FILE, x0=noise(5, 3))
    with pytest.raises(InputError, match=r"particles\.npz: no array 'volume'.*sample_particles"):
        Particles.load(tmp_path)
    (tmp_path / Particles.FILE).write_bytes(b"PK\x03\x04 cut off")
    with pytest.raises(InputError, match=r"particles\.npz: not readable as \.npz"):
        Particles.load(tmp_path)
    (tmp_path / "camera.json").write_text('{"fps": 30}')
    with pytest.raises(InputError, match=r"camera\.json: no key 'width'.*parse_video"):
        RecordedCamera.load(tmp_path)
    (tmp_path / "camera.json").write_text("{")
    with pytest.raises(InputError, match=r"camera\.json: not readable as JSON"):
        RecordedCamera.load(tmp_path)


@pytest.mark.parametrize("shape", [(4, 3), (4, 3, 2), (0, 3, 3)])
def test_given_points_of_another_shape_are_refused(shape, tmp_path):
    np.savez(tmp_path / GivenTracks3d.FILE, points3d=np.zeros(shape))
    np.savez(tmp_path / Controllers.FILE, points=np.zeros(shape))
    for product in (GivenTracks3d, Controllers):
        with pytest.raises(InputError, match=rf"{product.FILE}: points(3d)? has the shape"):
            product.load(tmp_path)


def file_names(source: Path) -> set[str]:
    """Names of files that a module's constants, class variables included, assign."""
    nodes = [node for node in ast.walk(ast.parse(source.read_text())) if isinstance(node, ast.Assign)]
    texts = {leaf.value for node in nodes for leaf in ast.walk(node.value) if isinstance(leaf, ast.Constant)}
    return {
        text
        for text in texts
        if isinstance(text, str) and re.fullmatch(r"\w+\.(npz|json|csv|ply|glb|safetensors)", text)
    }


def code_texts(source: Path) -> set[str]:
    """Texts in a module's code that are a file's name; docstrings and sentences are not."""
    constants = (node.value for node in ast.walk(ast.parse(source.read_text())) if isinstance(node, ast.Constant))
    return {text for text in constants if isinstance(text, str)}


def test_a_products_file_is_named_in_one_module():
    owners = {name: file for file in (*PRODUCTS.glob("*.py"), MODEL_FILE) for name in file_names(file)}
    assert {"particles.npz", "tracks.npz", "rollout.npz", "gap.json", "model.safetensors", "truth.npz"} <= owners.keys()
    for folder in ("physreal_core", "pipeline", "stages", "data", "benchmarks"):
        for file in (CODE_ROOT / folder).rglob("*.py"):
            texts = code_texts(file)
            named = {name for name in owners if any(text == name or text.endswith("/" + name) for text in texts)}
            others = {name for name in named if owners[name] != file}
            assert not others - FOREIGN.get(file.relative_to(CODE_ROOT).as_posix(), set()), file


FOREIGN = {
    "data/importers/images.py": {"camera.json"},  # of the recording that is imported
    "benchmarks/filmed.py": {"camera.json"},  # of the filmed clips
    "benchmarks/colour_only.py": {"camera.json"},  # of the rig that filmed them
    "physreal_core/fitting/grip.py": {"controllers.npz"},  # says where an error comes from
    "stages/summarise.py": {"loss.csv", "frames.csv"},  # plots, means over sequences
    # what DVC watches of a companion, and plots; it must not import numpy for a name
    "pipeline/graph.py": {"tracks.npz", "controllers.npz", "particles.npz", "loss.csv", "frames.csv"},
}


def test_the_elements_of_a_thin_body_are_whole_or_absent(tmp_path):
    plain = Particles(**_three_particles())
    shell = {"triangles": np.array([[0, 1, 2]]), "thickness": 0.001, "warp": np.array([1.0, 0.0, 0.0])}
    rod = {"rows": np.array([3]), "radius": 0.005}
    for given, geometry in (({}, "volumetric"), (shell, "planar"), (rod, "linear")):
        dataclasses.replace(plain, **given).save(tmp_path)
        found = Particles.load(tmp_path)
        assert found.geometry == geometry
        for name in (*shell, *rod):
            assert (getattr(found, name) is None) == (name not in given)
    for partial in ({**shell, "thickness": None}, {"radius": 0.005}, {**shell, **rod}):
        with pytest.raises(InputError, match="not whole.*run sample_particles again"):
            dataclasses.replace(plain, **partial)


def _three_particles() -> dict:
    whole, numbers, none = np.zeros((3, 1), int), np.ones((3, 1)), np.zeros(0, int)
    return {
        "x0": np.eye(3), "volume": np.ones(3), "spacing": 1.0, "density": np.ones(3), "patches": np.zeros(1, int),
        "patch_neighbours": whole, "patch_weights": numbers, "gaussian_neighbours": whole, "gaussian_weights": numbers,
        "track_ids": none, "track_points0": np.zeros((0, 3)), "track_neighbours": np.zeros((0, 1), int),
        "track_weights": np.zeros((0, 1)), "grip_particles": none, "grip_controllers": none,
        "grip_weights": np.zeros(0), "grip_rest_lengths": np.zeros(0),
    }  # fmt: skip


def test_arrays_are_opened_in_products_alone():
    for folder in ("physreal_core", "pipeline", "stages"):
        for file in (CODE_ROOT / folder).rglob("*.py"):
            opens = re.search(r"np\.(load|savez|savez_compressed)\b", file.read_text())
            assert not opens or file.is_relative_to(PRODUCTS) or file == CHECKPOINTS, file
