"""The model file: what is written is read, exactly, and what is not a model is refused."""

import json

import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.fitting.curriculum import with_residual
from physreal_core.fitting.model import load_model, particle_parameters, save_model
from physreal_core.simulation.laws.residual_config import ResidualConfig
from tests.fitting import scene


@pytest.fixture
def full_model():
    return with_residual(scene.model(), ResidualConfig(latent_size=2, hidden=4), seed=0)


def test_round_trip_is_exact(tmp_path, full_model):
    save_model(tmp_path, full_model)
    read = load_model(tmp_path)
    assert read.fields.keys() == full_model.fields.keys()
    assert all(torch.equal(read.fields[name], full_model.fields[name]) for name in read.fields)
    assert (read.elastic_law, read.plastic_law, read.residual) == ("fixed_corotated", "identity", full_model.residual)
    assert read.simulation == full_model.simulation and read.effects == []


def test_the_same_model_gives_the_same_bytes(tmp_path, full_model):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        save_model(tmp_path / name, full_model)
    for name in ("model.safetensors", "model.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_units_and_shapes_stand_in_the_json(tmp_path, full_model):
    save_model(tmp_path, full_model)
    record = json.loads((tmp_path / "model.json").read_text())
    assert record["tensors"]["youngs_modulus"] == {"shape": [4], "unit": "Pa"}


def test_a_missing_file_and_a_swapped_one_are_named(tmp_path, full_model):
    with pytest.raises(InputError, match="model.json"):
        load_model(tmp_path)
    (tmp_path / "other").mkdir()
    save_model(tmp_path, full_model)
    save_model(tmp_path / "other", scene.model())
    (tmp_path / "model.safetensors").write_bytes((tmp_path / "other" / "model.safetensors").read_bytes())
    with pytest.raises(InputError, match="model.safetensors"):
        load_model(tmp_path)


def test_particles_take_the_weighted_mean_of_their_patches():
    fields = {
        "youngs_modulus": torch.tensor([1.0, 3.0]),
        "poissons_ratio": torch.tensor([0.2]),
        "friction_coefficient": torch.tensor(0.5),
    }
    neighbours, weights = torch.tensor([[0, 1], [1, 0]]), torch.tensor([[0.25, 0.75], [1.0, 0.0]])
    parameters = particle_parameters(fields, neighbours, weights, dtype=torch.float64, device="cpu")
    assert parameters.youngs_modulus.tolist() == [2.5, 3.0]
    assert parameters.poissons_ratio.tolist() == pytest.approx([0.2, 0.2])
    assert parameters.latent_elastic is None
