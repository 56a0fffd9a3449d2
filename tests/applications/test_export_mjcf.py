"""`physreal export --format mjcf`: the model is loaded and stepped by MuJoCo, and sags as the twin does."""

import dataclasses

import numpy as np
import pytest
import torch

from applications.export.body.hand import Hand
from applications.export.body.material import MUJOCO, Material
from applications.export.body.nodes import Nodes
from applications.export.body.solid import edge_of, tetrahedra
from applications.export.mjcf.spec import described
from applications.twin import Twin
from physreal_core.errors import InputError
from physreal_core.fitting.named_effects import effect_record
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.geometry.mesh import Mesh
from tests.applications.bodies import DENSITY, POISSON, clamped_bar, strip
from tests.applications.test_export import exported
from tests.fitting import scene

mujoco = pytest.importorskip("mujoco")
GRAVITY = 9.81


def test_the_command_writes_a_model_that_steps_with_the_material(project, twin, monkeypatch, tmp_path, capsys):
    folder = exported(project, monkeypatch, tmp_path, "mjcf")
    told = capsys.readouterr().out
    assert "wind is left out" in told and "fixed_corotated" in told
    model = mujoco.MjModel.from_xml_path(str(folder / "twin.xml"))
    assert model.body_mass.sum() == pytest.approx(twin.problem.body.mass.sum(), rel=1e-4)
    spec = mujoco.MjSpec.from_file(str(folder / "twin.xml"))
    (flex,) = spec.flexes
    assert flex.young == pytest.approx(1e5, rel=1e-4) and flex.poisson == pytest.approx(POISSON, rel=1e-4)
    assert model.geom("table").friction[0] == pytest.approx(0.5) and np.allclose(model.opt.gravity, [0, 0, -GRAVITY])
    path = np.genfromtxt(folder / "hand.csv", delimiter=",", names=True)
    hand = twin.problem.controllers.numpy().mean(1)
    assert np.allclose(np.stack([path["x"], path["y"], path["z"]], 1), hand, atol=1e-6)
    assert np.allclose(path["time"], np.arange(8) / scene.FPS)
    data = mujoco.MjData(model)
    held = [model.body(model.eq_obj2id[n]).id for n in range(model.neq)]
    start = model.body_pos[held].mean(0)
    for row in path:
        data.mocap_pos[0] = row["x"], row["y"], row["z"]
        mujoco.mj_step(model, data, 10)
    assert np.isfinite(data.qpos).all()
    assert np.allclose(data.xpos[held].mean(0) - start, hand[-1] - hand[0], atol=2e-3), (
        "what is held goes with the hand"
    )


def compiled(twin: Twin):
    """MuJoCo's model, and nodes and material that it was made from."""
    material = Material.of(twin, MUJOCO)
    nodes = Nodes.of(twin, material.density)
    return described(twin, nodes, material, Hand.of(material.hand)).compile(), nodes, material


def hung(model, seconds: float) -> np.ndarray:
    """Nodes after a while, [V, 3] m."""
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    while data.time < seconds:
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    return data.flexvert_xpos.copy()


@pytest.mark.slow
def test_a_clamped_bar_sags_as_in_our_simulator():
    """Viscous, so that it rests within a second. Linear tetrahedra are too stiff in bending by some per cent, and its hold ends at nodes."""
    twin = clamped_bar(effect_record("kelvin_voigt", {"time": 0.02}))
    rollouts = Rollouts(twin.problem, twin.model)
    with torch.no_grad():
        x = rollouts.simulate(rollouts.inputs(twin.model.fields)).x.numpy()
    end = twin.problem.body.x0[:, 0] > 0.15
    ours = (x[-1] - x[0])[end, 2].mean()
    model, nodes, material = compiled(twin)
    assert material.retardation == pytest.approx(0.02, rel=1e-3)
    tip = nodes.rest[:, 0] > 0.15
    theirs = (hung(model, 0.9) - nodes.rest)[tip, 2].mean()
    assert theirs == pytest.approx(ours, rel=0.1)


def test_a_field_becomes_its_mean_by_volume_and_is_told():
    twin = clamped_bar()
    front = torch.from_numpy((twin.problem.body.x0[:, :1] < 0.04).astype(float))
    fields = {
        **twin.model.fields,
        "youngs_modulus": torch.tensor([5e4, 1e4]).double(),
        "poissons_ratio": torch.tensor([0.3, 0.3]).double(),
    }
    fields["patch_positions"] = torch.zeros(2, 3).double()
    near = torch.tensor([[0, 1]]).expand(len(front), 2)
    problem = dataclasses.replace(twin.problem, patch_neighbours=near, patch_weights=torch.hstack([front, 1 - front]))
    material = Material.of(
        dataclasses.replace(twin, problem=problem, model=dataclasses.replace(twin.model, fields=fields)), MUJOCO
    )
    assert material.youngs_modulus == pytest.approx(0.25 * 5e4 + 0.75 * 1e4)
    assert any("from 1e+04 to 5e+04 Pa" in sentence for sentence in material.lost)


@pytest.mark.parametrize("kind", ["cloth", "rope"])
def test_thin_bodies_hang_from_a_clamp_by_their_stiffness(kind):
    """Clamped level, a strip sinks as a cantilever: rho A g L^4 / 8 E I, small against its length."""
    thickness = 0.006
    twin, inertia = strip(kind, thickness, modulus=1e6), thickness**2 / {"rope": 16, "cloth": 12}[kind]
    model = compiled(twin)[0]
    assert model.body_mass.sum() == pytest.approx(twin.problem.body.mass.sum(), rel=1e-3)
    sag = DENSITY * GRAVITY * 0.08**4 / (8 * 1e6 * inertia)
    data, lowest = mujoco.MjData(model), 0.0
    while data.time < 0.25:
        mujoco.mj_step(model, data)
        lowest = min(lowest, data.flexvert_xpos[-1, 2])
    assert -lowest == pytest.approx(2 * sag, rel=0.2), "let go at rest, it swings to twice its sag"


def test_a_body_too_thin_for_tetrahedra_is_refused():
    import trimesh

    skin = trimesh.creation.annulus(r_min=0.1, r_max=0.101, height=0.2)
    mesh = Mesh(np.array(skin.vertices), np.array(skin.faces))
    with pytest.raises(InputError, match="mm thick.*planar"):
        tetrahedra(mesh, edge_of(mesh))


def test_a_hand_that_turns_is_followed():
    from scipy.spatial.transform import Rotation

    points = np.random.default_rng(0).normal(0, 0.03, (20, 3))
    turns = Rotation.from_euler("z", np.linspace(0, 2, 9)[:, None])
    moved = np.stack([turn.apply(points) + [0, 0, 0.1 * n] for n, turn in enumerate(turns)])
    hand = Hand.of(moved)
    again = Rotation.from_quat(np.roll(hand.quaternions, -1, 1))
    assert np.allclose((again * turns.inv()).magnitude(), 0, atol=1e-6) and hand.stray < 1e-9
    assert np.allclose(Hand.of(moved[:, :1]).quaternions, [1, 0, 0, 0]), "one point does not tell a turn"
