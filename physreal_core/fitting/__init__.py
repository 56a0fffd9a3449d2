"""Fitting a material to what was measured: the problem, the objective, the descent, the three stages, the model file.

```python
objective = Objective(problem, model, LossConfig())
variables = [Variable("youngs_modulus", "log", rate=0.1, lower=1e3, upper=5e6)]
model, result = fit_material(objective, model, variables, uniform_start(model, variables), DescentConfig(iterations=20))
save_model(folder, model)
```
"""

from physreal_core.fitting.curriculum import (
    ScanConfig,
    fit_material,
    patch_start,
    scan_youngs_modulus,
    start_from_scan,
    uniform_start,
    with_residual,
)
from physreal_core.fitting.descent import Descent, DescentConfig, DescentResult
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.model import Model, load_model, particle_parameters, save_model, uniform_model
from physreal_core.fitting.named_effects import effect_record
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.problem import MaskObservations, Problem, TrackObservations, reduce_masks
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.fitting.transfer import transfer_model
from physreal_core.fitting.variables import TRANSFORMS, Variable

__all__ = [
    "TRANSFORMS",
    "Descent",
    "DescentConfig",
    "DescentResult",
    "LossConfig",
    "MaskObservations",
    "Model",
    "Objective",
    "Problem",
    "Rollouts",
    "ScanConfig",
    "TrackObservations",
    "Variable",
    "effect_record",
    "fit_material",
    "load_model",
    "particle_parameters",
    "patch_start",
    "reduce_masks",
    "save_model",
    "scan_youngs_modulus",
    "start_from_scan",
    "transfer_model",
    "uniform_model",
    "uniform_start",
    "with_residual",
]
