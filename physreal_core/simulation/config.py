"""Settings of a simulation that stay fixed during a fit: laws, gravity, ground, time step, precision and device."""

from dataclasses import dataclass

import torch

from physreal_core.errors import InputError
from physreal_core.simulation.laws import ELASTIC_LAWS, PLASTIC_LAWS, ResidualConfig
from physreal_core.simulation.terms import TERMS


@dataclass(frozen=True)
class SimulationConfig:
    """Fixed settings of a simulator.

    Args:
        fps: frames per second of the rollout.
        elastic_law: expert elasticity, one of `ELASTIC_LAWS`.
        plastic_law: expert plasticity, one of `PLASTIC_LAWS`.
        gravity: acceleration [m/s2].
        ground_height: z of the support plane [m]; None for no ground.
        courant: Courant number of the elastic wave. Steps are stable up to 0.8 at a Poisson's ratio of 0.3, up to 0.65 at 0.45
            (tests/simulation/test_stability.py).
        residual: neural residuals beside the expert laws; None for none. A bound beta of zero leaves that one out.
        terms: optional terms in use, of `terms.TERMS`; each switches parameters of `Parameters` on.
        self_contact: whether the body touches itself: layers of a sheet, strands of a rope, parts and pieces of a volume (`contact/`).
        dtype: "float32", or "float64" for gradient proofs.
        device: "cpu" or "cuda:0".
    """

    fps: float | int
    elastic_law: str = "fixed_corotated"
    plastic_law: str = "identity"
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    ground_height: float | None = 0.0
    courant: float = 0.4
    residual: ResidualConfig | None = None
    terms: tuple[str, ...] = ()
    self_contact: bool = False
    dtype: str = "float32"
    device: str = "cpu"

    def __post_init__(self) -> None:
        for name, known in (
            ("elastic_law", ELASTIC_LAWS),
            ("plastic_law", PLASTIC_LAWS),
            ("dtype", ("float32", "float64")),
        ):
            if getattr(self, name) not in known:
                raise InputError(
                    f"{getattr(self, name)!r}", where=f"SimulationConfig.{name}", expected=" or ".join(known)
                )
        self._check_terms()
        if self.device.startswith("cuda") and not torch.cuda.is_available():
            raise InputError(
                f"{self.device!r}, but torch sees no CUDA device",
                where="SimulationConfig.device",
                expected="cpu, or a machine with an NVIDIA GPU and a CUDA build of torch",
                remedy="set `device: cpu` in the stage's block of params.yaml",
            )
        for name in ("fps", "courant"):
            if not getattr(self, name) > 0:
                raise InputError(
                    f"{getattr(self, name)}", where=f"SimulationConfig.{name}", expected="a positive number"
                )

    def _check_terms(self) -> None:
        where = "SimulationConfig.terms"
        for term in self.terms:
            if term not in TERMS:
                raise InputError(f"{term!r}", where=where, expected=" or ".join(TERMS))
        if len(set(self.terms)) < len(self.terms):
            raise InputError(f"{self.terms}", where=where, expected="each term once")

    @property
    def torch_dtype(self) -> torch.dtype:
        """`dtype` as torch names it."""
        return getattr(torch, self.dtype)

    @property
    def shaped(self) -> bool:
        """Whether the shape without stress may differ from that in which the body lies on the grid (laws/shape.h)."""
        flows = self.plastic_law != "identity" or self.plastic_residual is not None
        return flows or "initial_deformation" in self.terms

    @property
    def elastic_residual(self) -> ResidualConfig | None:
        """Residual of the stress, None if its bound leaves no room for one."""
        return self.residual if self.residual is not None and self.residual.beta_elastic > 0 else None

    @property
    def plastic_residual(self) -> ResidualConfig | None:
        """Residual of the plastic flow, None if its bound leaves no room for one; a thin body has none."""
        here = self.residual is not None and self.residual.beta_plastic > 0 and not self.residual.thin
        return self.residual if here else None
