"""find_gap and add_effect on the artifacts of the tiny scene: report written and read, the effect in the model and after it."""

import json

import numpy as np
import pytest
import yaml

from physreal_core.fitting.model import load_model, save_model
from pipeline.project import Project
from pipeline.stage import run_stage
from stages import add_effect, find_gap, fit_residual
from stages._gap import load_report, save_report
from tests.fitting import scene, test_stages as fitted
