"""Stage 1 on a real recording: a silicone cantilever let go under its own weight (motion capture, Dubied et al.)."""

import json

import numpy as np
import pytest
import torch

from data.importers.silicone_beam import import_capture
from physreal_core.fitting.curriculum import ScanConfig, fit_material, scan_youngs_modulus, uniform_start
from physreal_core.fitting.descent import DescentConfig
from physreal_core.fitting.losses import LossConfig, carried_tracks, settled_positions, windowed_mean
from physreal_core.fitting.model import uniform_model
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.problem import Problem, TrackObservations
from physreal_core.fitting.variables import Variable
from physreal_core.geometry import fill_mesh, load_mesh
from physreal_core.rendering import bind
from physreal_core.simulation import Body, Clamp
from pipeline.capture import read_capture
from pipeline.products.given_tracks import GivenTracks3d
from stages._problem import carry_payloads

pytestmark = pytest.mark.slow

SPACING = 0.005  # 720 particles, three grid cells across the beam
LOSSES = LossConfig(settled=1.0, track_scale=0.001)
MODULUS = Variable("youngs_modulus", "log", 0.1, 5e4, 1e6)


def _problem(real_data, folder, recording: str) -> Problem:
    source = real_data / "silicone_beam" / f"{recording}.npz"
    if not source.is_file():
        pytest.skip(f"no recording {source}")
    import_capture(source, folder)
    capture = json.loads((folder / "capture.json").read_text())
    tracks = {name: torch.from_numpy(array) for name, array in vars(GivenTracks3d.load(folder)).items()}
    x0, volume = fill_mesh(load_mesh(folder / "shape_prior.glb"), SPACING)
    body, loads = carry_payloads(Body(x0, volume, np.full(len(x0), capture["density"]), SPACING), read_capture(folder))
    points0 = tracks["points3d"][0].double()
    return Problem(
        body=body,
        fps=capture["fps"],
        controllers=torch.zeros(capture["frame_count"], 0, 3),
        observed=capture["split"]["train"][1],
        patch_neighbours=torch.zeros(len(x0), 1, dtype=torch.int64),
        patch_weights=torch.ones(len(x0), 1, dtype=torch.float64),
        clamps=tuple(Clamp(np.array(c["lower"]), np.array(c["upper"])) for c in capture["clamps"]),
        loads=loads,
        tracks=TrackObservations(points0, bind(points0, torch.from_numpy(x0), 8), **tracks),
    )


def _tip(objective: Objective, fields: dict) -> tuple[float, float]:
    """Static deflection of the tip's markers downwards [m], simulated and measured at the end of the recording."""
    problem = objective.problem
    with torch.no_grad():
        states = objective.rollout(fields, objective.full_horizon)
    x0 = torch.from_numpy(problem.body.x0).to(states.x)
    carried = carried_tracks(problem.tracks, x0, states.x, states.F)
    simulated = windowed_mean(carried, torch.ones(carried.shape[:2], dtype=torch.bool))[0]
    measured = settled_positions(problem.tracks, problem.frame_count, LOSSES.settled_measured)[0]
    return tuple(-(at - problem.tracks.points0).mean(0)[2].item() for at in (simulated, measured))


def test_stage_1_finds_the_silicone_s_stiffness_and_its_static_deflection(real_data, tmp_path):
    problem = _problem(real_data, tmp_path / "own_weight", "gravity_V2_a")
    values = {"youngs_modulus": 1.5e5, "poissons_ratio": 0.45, "friction_coefficient": 0.5}
    start = uniform_model(
        torch.tensor([[0.05, 0.0, 0.5]]),
        values,
        elastic_law="fixed_corotated",
        simulation={"courant": 0.4, "dtype": "float32"},
    )
    objective = Objective(problem, start, LOSSES)
    scan = scan_youngs_modulus(objective, start, MODULUS, ScanConfig(count=3, factor=2.5))
    start = start.with_fields(youngs_modulus=torch.tensor([min(scan, key=lambda entry: entry[1])[0]]))
    model, result = fit_material(
        objective, start, [MODULUS], uniform_start(start, [MODULUS]), DescentConfig(iterations=10)
    )
    modulus = model.fields["youngs_modulus"].item()
    simulated, measured = _tip(objective, model.fields)
    print(f"\nE = {modulus / 1e3:.0f} kPa after {len(result.history)} evaluations, loss {result.total:.4f}")
    print(f"own weight: static tip deflection {1e3 * simulated:.2f} mm, measured {1e3 * measured:.2f} mm")
    # Published finite elements: 264 to 294 kPa at nu near 0.5; ours at nu = 0.45 and three cells across.
    assert 200e3 <= modulus <= 350e3
    assert simulated == pytest.approx(measured, abs=1e-3)

    loaded = Objective(_problem(real_data, tmp_path / "loaded", "load52_V2_a"), model, LOSSES)
    simulated, measured = _tip(loaded, model.fields)
    print(f"tip load 0.51 N, not fitted: {1e3 * simulated:.2f} mm, measured {1e3 * measured:.2f} mm")
    # Fits of the two loads by finite elements differ by 11 % in E (264 and 294 kPa); so may a prediction from one to the other.
    assert simulated == pytest.approx(measured, rel=0.15)
