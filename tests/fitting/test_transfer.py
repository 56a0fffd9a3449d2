"""A material carried to the same object elsewhere."""

import dataclasses

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from physreal_core.effects import EFFECTS, Coefficient, Effect
from physreal_core.fitting.curriculum import NETWORK_FIELDS, with_residual
from physreal_core.fitting.model import Model, particle_parameters
from physreal_core.fitting.named_effects import effect_record
from physreal_core.fitting.transfer import register, transfer_model
from physreal_core.simulation import Body, SimulationConfig, Simulator
from physreal_core.simulation.laws import ResidualConfig
from tests.fitting import scene


def _shape(seed: int, count: int = 600) -> np.ndarray:
    """Points in a body with no symmetry: a plate with a block on one corner; another seed samples other points."""
    random = np.random.default_rng(seed)
    plate = random.uniform([0, 0, 0], [0.24, 0.15, 0.04], (count, 3))
    block = random.uniform([0.0, 0.0, 0.04], [0.06, 0.05, 0.10], (count // 4, 3))
    return np.concatenate([plate, block])


def test_registration_finds_a_turn_and_a_shift_of_other_samples_of_the_same_shape():
    turn = Rotation.from_euler("zyx", [75, 20, -15], degrees=True).as_matrix()
    target = _shape(1) @ turn.T + np.array([0.3, -0.2, 0.1])
    R, t = register(_shape(0), target)
    angle = np.degrees(Rotation.from_matrix(R @ turn.T).magnitude())
    corner = np.array([0.0, 0.0, 0.1])
    assert angle < 3.0
    assert np.linalg.norm(R @ corner + t - (turn @ corner + [0.3, -0.2, 0.1])) < 0.005


def test_a_symmetric_shape_keeps_the_orientation_it_is_seen_in():
    box = np.random.default_rng(0).uniform([-0.1, -0.05, -0.02], [0.1, 0.05, 0.02], (800, 3))
    R, t = register(box, box + np.array([0.05, 0.0, 0.0]))
    assert np.trace(R) > 2.99 and np.allclose(t, [0.05, 0, 0], atol=1e-3)


def test_the_soft_end_stays_the_soft_end():
    model = scene.model().with_fields(youngs_modulus=torch.tensor([1e4, 2e4, 3e4, 4e4]))
    source = scene.body().x0
    turn = Rotation.from_euler("z", 30, degrees=True).as_matrix()
    target = source @ turn.T + np.array([0.4, 0.1, 0.0])
    moved, neighbours, weights = transfer_model(model, source, target, 3)
    parameters = particle_parameters(
        moved.fields, torch.from_numpy(neighbours), torch.from_numpy(weights), dtype=torch.float64, device="cpu"
    )
    patches = model.fields["patch_positions"].numpy()
    at_patches = np.array([np.linalg.norm(source - patch, axis=1).argmin() for patch in patches])
    np.testing.assert_allclose(parameters.youngs_modulus[at_patches], [1e4, 2e4, 3e4, 4e4], rtol=1e-6)


class _Knot(Effect):
    """Sits at one place in the body: a stand-in for a local effect."""

    name, family = "knot", "material"
    coefficients = tuple(Coefficient(axis, "m", "place", 0.0, -1.0, 1.0, 0.1, "shape") for axis in "xyz")

    def carried(self, values, rotation, translation):
        place = rotation @ np.array([values[axis] for axis in "xyz"]) + translation
        return dict(zip("xyz", place.tolist(), strict=True))


def test_a_local_effect_moves_with_its_place_in_the_body(monkeypatch):
    monkeypatch.setitem(EFFECTS, "knot", _Knot())
    source = scene.body().x0
    place = source[5]
    record = effect_record(
        "knot", dict(zip("xyz", place.tolist(), strict=True)), intervals={"x": (0.0, 0.1)}, probability=0.8
    )
    target = source + np.array([0.4, 0.1, 0.0])
    moved, _, _ = transfer_model(dataclasses.replace(scene.model(), effects=[record]), source, target, 3)
    (found,) = moved.effects
    np.testing.assert_allclose(list(found["values"].values()), target[5], atol=1e-6)
    assert found["probability"] == 0.8 and "intervals" not in found


def test_networks_turn_with_the_body():
    """A quarter turn about the vertical, under which the grid and gravity are the same: the turned body moves as the first one did, turned."""
    config = ResidualConfig(latent_size=2, hidden=8, beta_elastic=0.5, beta_plastic=0.05)
    model = with_residual(scene.model(), config, 0)
    generator = torch.Generator().manual_seed(1)
    random = lambda name: torch.randn(model.fields[name].shape, generator=generator, dtype=torch.float64)
    model = model.with_fields(**{name: random(name) for name in NETWORK_FIELDS})
    whole = scene.body()
    kept = (whole.x0 < np.median(whole.x0, axis=0)).any(
        1
    )  # without a corner, so that it is alike to none of its turned selves
    body = Body(whole.x0[kept], whole.volume[kept], whole.density[kept], whole.spacing)
    source = body.x0
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    target = source @ quarter.T
    moved, neighbours, weights = transfer_model(model, source, target, 3)
    still, own, own_weights = transfer_model(model, source, source, 3)

    def motion(body: Body, there: Model, near, near_weights) -> torch.Tensor:
        parameters = particle_parameters(
            there.fields, torch.from_numpy(near), torch.from_numpy(near_weights), dtype=torch.float64, device="cpu"
        )
        squeezed = torch.tensor(body.x0) * torch.tensor([0.0, 0.0, -3.0], dtype=torch.float64)
        parameters = dataclasses.replace(parameters, initial_velocity=squeezed)
        own_config = SimulationConfig(30.0, dtype="float64", residual=config, ground_height=None)
        return Simulator(body, own_config).rollout(parameters, torch.zeros(4, 0, 3)).x

    first = motion(body, still, own, own_weights)
    turned_body = dataclasses.replace(body, x0=target)
    second = motion(turned_body, moved, neighbours, weights)
    untouched = motion(
        turned_body, dataclasses.replace(moved, fields={**moved.fields, **_networks(model)}), neighbours, weights
    )
    R = torch.tensor(quarter)
    assert (second - first @ R.mT).abs().max() < 1e-9
    assert (untouched - first @ R.mT).abs().max() > 1e-6


def _networks(model: Model) -> dict[str, torch.Tensor]:
    return {name: model.fields[name] for name in ("network_elastic", "network_plastic")}
