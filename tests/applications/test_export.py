"""`physreal export`: every format read back by its own library, against the rollout."""

import numpy as np
import pytest
import torch

from applications.export.moving import Moving, ellipsoids
from physreal_core.rendering import carry_gaussians
from physreal_core.rendering.ply import load_gaussians
from pipeline.cli import main


@pytest.fixture
def moving(twin) -> Moving:
    return Moving.of(twin)


def exported(project, monkeypatch, tmp_path, kind: str):
    """The folder that the command writes."""
    monkeypatch.chdir(project.root)
    folder = tmp_path / "exported"
    with pytest.raises(SystemExit) as ended:
        main(["export", "lift", "--format", kind, "--to", str(folder)])
    assert ended.value.code == 0
    return folder


def test_splats_have_the_carried_covariances(project, moving, monkeypatch, tmp_path):
    folder = exported(project, monkeypatch, tmp_path, "splats")
    files = sorted(folder.iterdir())
    assert [file.name for file in files] == [f"frame_{frame:04d}.ply" for frame in range(8)]
    twin, last = moving.twin, load_gaussians(files[-1])
    x0 = torch.as_tensor(twin.problem.body.x0, dtype=torch.float32)
    state = moving.rollout.x[-1], moving.rollout.F[-1]
    means, covariances = carry_gaussians(twin.gaussian_binding, twin.gaussians, x0, *map(torch.from_numpy, state))
    assert torch.allclose(last.means, means, atol=1e-6)
    assert torch.allclose(last.covariances(), covariances, atol=1e-3 * float(covariances.abs().max()))
    assert torch.equal(last.harmonics, twin.gaussians.harmonics)


def test_axes_of_an_ellipsoid_turn_right_handed():
    random = torch.Generator().manual_seed(0)
    A = torch.randn(50, 3, 3, generator=random, dtype=torch.float64)
    scales, rotations = ellipsoids(A @ A.transpose(1, 2))
    assert torch.allclose(rotations.norm(dim=1), torch.ones(50), atol=1e-6)
    w, x, y, z = rotations.double().T
    R = torch.stack(
        [
            1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
            2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
            2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
        ], 1,
    ).reshape(-1, 3, 3)  # fmt: skip
    again = R @ torch.diag_embed(scales.double() ** 2) @ R.transpose(1, 2)
    assert torch.allclose(again, A @ A.transpose(1, 2), atol=1e-5)


def test_gltf_plays_the_motion(project, moving, monkeypatch, tmp_path):
    gltf = pytest.importorskip("pygltflib")
    import trimesh

    file = exported(project, monkeypatch, tmp_path, "gltf") / "motion.glb"
    document = gltf.GLTF2().load(str(file))
    blob = document.binary_blob()

    def read(accessor: int, columns: int, kind=np.float32) -> np.ndarray:
        found = document.accessors[accessor]
        view = document.bufferViews[found.bufferView]
        array = np.frombuffer(blob[view.byteOffset : view.byteOffset + view.byteLength], kind)
        assert len(array) == columns * found.count
        return array.reshape(-1, columns) if columns > 1 else array

    (primitive,) = document.meshes[0].primitives
    first = read(primitive.attributes.POSITION, 3)
    (sampler,) = document.animations[0].samplers
    times, weights = read(sampler.input, 1), read(sampler.output, 1).reshape(8, 7)
    assert np.allclose(times, np.arange(8) / 30.0)
    moved = np.stack([read(target["POSITION"], 3) for target in primitive.targets])
    for frame in range(8):
        now = first + np.einsum("t,tvc->vc", weights[frame], moved)
        there = moving.vertices[frame]
        assert np.allclose(now, np.stack([there[:, 0], there[:, 2], -there[:, 1]], 1), atol=1e-6), "y up"
    assert np.array_equal(read(primitive.indices, 1, np.uint32).reshape(-1, 3), moving.twin.mesh.faces)
    assert trimesh.load(file, force="mesh").is_watertight


def test_usd_has_a_sample_a_frame_in_metres(project, moving, monkeypatch, tmp_path):
    pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(exported(project, monkeypatch, tmp_path, "usd") / "motion.usdc"))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0 and UsdGeom.GetStageUpAxis(stage) == "Z"
    assert stage.GetTimeCodesPerSecond() == 30.0 and stage.GetEndTimeCode() == 7
    mesh = UsdGeom.Mesh(stage.GetDefaultPrim())
    for frame in range(8):
        assert np.allclose(np.array(mesh.GetPointsAttr().Get(frame)), moving.vertices[frame], atol=1e-6)
    modulus = stage.GetDefaultPrim().GetAttribute("physreal:youngs_modulus")
    assert modulus.Get() == pytest.approx(1e5) and modulus.GetDocumentation() == "Pa"


def test_what_is_there_is_not_overwritten_and_a_failure_leaves_nothing(project, monkeypatch, tmp_path, capsys):
    folder = exported(project, monkeypatch, tmp_path, "splats")
    with pytest.raises(SystemExit) as ended:
        main(["export", "lift", "--format", "splats", "--to", str(folder)])
    assert ended.value.code == 2 and "is there already" in capsys.readouterr().err

    def broken(moving, draft):
        (draft / "half").write_text("")
        raise OSError("the disk is full")

    monkeypatch.setitem(__import__("applications.export.command", fromlist=["FORMATS"]).FORMATS, "splats", broken)
    with pytest.raises((SystemExit, OSError)):
        main(["export", "lift", "--format", "splats", "--to", str(tmp_path / "other")])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["exported"]
