"""The fitted twin's material: laws, patch-level parameters and residual networks."""

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from physreal_core.array_types import Float
from physreal_core.effects import configured
from physreal_core.errors import InputError
from physreal_core.fitting.model_file import RECORD, TENSORS, read_model_file, write_model_file
from physreal_core.fitting.named_effects import registered
from physreal_core.simulation import Body, Parameters, SimulationConfig
from physreal_core.simulation.laws.residual_config import ResidualConfig
from physreal_core.simulation.terms import TERM_OF

UNITS = {
    "youngs_modulus": "Pa",
    "poissons_ratio": "1",
    "friction_coefficient": "1",
    "grip_stiffness": "N",
    "grip_damping": "N s/m",
    "tool_stiffness": "1/s2",
    "tool_friction": "1",
    "layer_friction": "1",
    "bending_ratio": "1",
    "weft_ratio": "1",
    "shear_ratio": "1",
    "patch_positions": "m",
    "plastic": "von_mises: Pa, Pa s; drucker_prager: rad, Pa",
    "latent_elastic": "1",
    "latent_plastic": "1",
    "network_elastic": "1",
    "network_plastic": "1",
}
"""Every tensor a model file can hold, with its unit."""

THIN_FIELDS = ("bending_ratio", "weft_ratio", "shear_ratio")
"""Tensors that only the model of a thin body has."""

TOOL_FIELDS = ("tool_stiffness", "tool_friction")
"""Numbers that only the model of a body has that a hand pushes without holding it."""

WHOLE_FIELDS = ("friction_coefficient", "layer_friction", "grip_stiffness", "grip_damping", *TOOL_FIELDS)
"""Numbers of the contacts."""

PATCH_FIELDS = ("youngs_modulus", "poissons_ratio", "plastic", "latent_elastic", "latent_plastic", *THIN_FIELDS)
"""Tensors with one row per patch; the others hold for the whole object."""


@dataclass(frozen=True)
class Model:
    """A material on patches; `fields` maps the names in `UNITS` to float64 tensors.

    Args:
        elastic_law, plastic_law: names of the expert laws.
        fields: youngs_modulus [K], poissons_ratio [K], friction_coefficient [], grip_stiffness [], grip_damping [],
            patch_positions [K,3] (world frame, frame 0), and where they apply plastic [K,2], latent_elastic [K,L],
            latent_plastic [K,L], network_elastic [W], network_plastic [W]. Of a thin body bending_ratio [K], of a fabric weft_ratio and
            shear_ratio [K]; Young's modulus is then that of stretching. Where a hand pushes tool_stiffness [] and tool_friction [],
            where the object touches itself layer_friction [].
        residual: sizes and bounds of the residual networks, None before Stage 3.
        simulation: what else the parameters hold for, as `SimulationConfig` takes it: `gravity`, `ground_height`, `courant`,
            `dtype`, `self_contact`.
        grip_reach: how far the hand reaches to hold a particle, in the sense of `Grip.reach` [m]; None: all that are bound are held.
        effects: named effects that act in every rollout, one after another; records as of `named_effects`.

    Raises:
        InputError: for effects that `named_effects.registered` refuses.
    """

    elastic_law: str
    plastic_law: str
    fields: dict[str, Tensor]
    residual: ResidualConfig | None = None
    simulation: dict[str, Any] = field(default_factory=dict)
    effects: list[dict[str, Any]] = field(default_factory=list)
    grip_reach: float | None = None

    def __post_init__(self) -> None:
        registered(self.effects)

    @property
    def patch_count(self) -> int:
        """Number of patches K."""
        return self.fields["patch_positions"].shape[0]

    def simulation_config(self, fps: float, device: str = "cpu", body: Body | None = None) -> SimulationConfig:
        """The simulator's configuration for a sequence of `fps` frames per second, with what the effects need on a body; None: a volume."""
        laws = {"elastic_law": self.elastic_law, "plastic_law": self.plastic_law, "residual": self.residual}
        terms = tuple(sorted({TERM_OF[name] for name in THIN_FIELDS if name in self.fields}))
        config = SimulationConfig(fps=fps, device=device, terms=terms, **laws, **self.simulation)
        return configured(config, registered(self.effects), body)

    def with_fields(self, **fields: Tensor) -> "Model":
        """This model with some tensors replaced; patch fields of one row are given to all patches."""
        merged = dict(self.fields)
        for name, tensor in fields.items():
            tensor = tensor.detach().to(torch.float64)
            rows = self.patch_count
            if name in PATCH_FIELDS and tensor.shape[0] != rows:
                tensor = tensor.expand(rows, *tensor.shape[1:])
            merged[name] = tensor.clone()
        return dataclasses.replace(self, fields=merged)


def uniform_model(
    patch_positions: Float[Tensor, "patches 3"],
    values: dict[str, float],
    *,
    elastic_law: str,
    plastic_law: str = "identity",
    plastic: tuple[float, float] | None = None,
    simulation: dict[str, Any] | None = None,
) -> Model:
    """The same material everywhere.

    Args:
        patch_positions: [m], world frame at frame 0.
        values: youngs_modulus [Pa], poissons_ratio, friction_coefficient, grip_stiffness [N], grip_damping [N s/m], of a thin body
            those of `THIN_FIELDS` that differ from 1 or may, and of one that a hand pushes those of `TOOL_FIELDS`.
        plastic: the plastic law's two parameters; None for `identity`.
        simulation: see `Model`.
    """
    patches = patch_positions.to(torch.float64)
    fields = {
        name: torch.full((len(patches),) if name in PATCH_FIELDS else (), v, dtype=torch.float64)
        for name, v in values.items()
    }
    if plastic_law != "identity":
        fields["plastic"] = torch.tensor(plastic, dtype=torch.float64).expand(len(patches), 2).clone()
    return Model(elastic_law, plastic_law, {"patch_positions": patches, **fields}, simulation=simulation or {})


def particle_parameters(
    fields: dict[str, Tensor], neighbours: Tensor, weights: Tensor, *, dtype: torch.dtype, device: str
) -> Parameters:
    """Patch fields interpolated to particles (eq. patch_to_particle), ready for a rollout; differentiable.

    Args:
        fields: as in `Model.fields`; a patch field of one row holds for every patch.
        neighbours: [N,k] patch indices of each particle, on `device`.
        weights: [N,k], rows summing to one, on `device`.
    """

    def spread(name: str) -> Tensor | None:
        value = fields.get(name)
        if value is None:
            return None
        value = value.to(device)  # the few values of the patches travel, not the many of the particles
        if value.shape[0] == 1:
            return value.expand(neighbours.shape[0], *value.shape[1:]).to(dtype).contiguous()
        near = value[neighbours]  # [N,k] or [N,k,L]
        shaped = weights.to(value.dtype).reshape(*weights.shape, *([1] * (near.ndim - 2)))
        return (near * shaped).sum(1).to(dtype)

    def whole(name: str) -> Tensor | None:
        value = fields.get(name)
        return None if value is None else value.to(device, dtype)

    return Parameters(
        **{name: spread(name) for name in PATCH_FIELDS},
        **{name: whole(name) for name in (*WHOLE_FIELDS, "network_elastic", "network_plastic")},
        initial_velocity=torch.zeros(neighbours.shape[0], 3, dtype=dtype, device=device),
    )


def save_model(folder: Path, model: Model) -> None:
    """Writes the model's two files into `folder` (`model_file`)."""
    record = {
        "elastic_law": model.elastic_law,
        "plastic_law": model.plastic_law,
        "residual": None if model.residual is None else dataclasses.asdict(model.residual),
        "simulation": model.simulation,
        "effects": model.effects,
        "grip_reach": model.grip_reach,
    }
    write_model_file(folder, record, model.fields, UNITS)


def load_model(folder: Path) -> Model:
    """The model in `folder`, InputError where a file is missing, of another format, or holds what no model has."""
    record, fields = read_model_file(folder)
    registered(record["effects"], where=f"{folder / RECORD}, effects")
    if unknown := sorted(set(fields) - set(UNITS)):
        raise InputError(f"tensors {unknown}", where=str(folder / TENSORS), expected=f"some of {', '.join(UNITS)}")
    residual = None if record["residual"] is None else _residual_config(record["residual"])
    laws = {name: record[name] for name in ("elastic_law", "plastic_law", "simulation", "effects")}
    return Model(fields=fields, residual=residual, grip_reach=record.get("grip_reach"), **laws)


def _residual_config(entry: dict[str, Any]) -> ResidualConfig:
    return ResidualConfig(**{name: tuple(v) if isinstance(v, list) else v for name, v in entry.items()})
