"""A real rope in colour alone, from pictures to scores."""

import numpy as np
import pytest

from benchmarks import colour_only
from pipeline.products.scores import Scores
from pipeline.project import CODE_ROOT


@pytest.mark.slow  # perception and fits of 50 frames, three minutes
def test_a_rope_is_covered_where_it_was_seen_and_where_it_was_not(real_data, tmp_path, monkeypatch):
    if not (real_data / colour_only.POSE).is_dir():
        pytest.skip(f"no {colour_only.POSE} at {real_data} (set PHYSREAL_REAL_DATA)")
    if not (CODE_ROOT / "data/models/manifest.json").is_file():
        pytest.skip("the networks are not installed (physreal models)")
    monkeypatch.setattr(colour_only, "CLIPS", {"rope": colour_only.CLIPS["rope"]})
    project = colour_only._project(tmp_path)
    assert colour_only._stopped(project, "rope") is None
    scores = Scores.load(project.artifact("evaluate", "rope")).metrics["fit_patches"]
    assert scores["observed"]["iou"] > 0.75 and scores["future"]["iou"] > 0.6
    assert np.median(colour_only.hand_errors(project)) < 0.015
