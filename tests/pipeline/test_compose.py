"""params.yaml is what the option groups give: complete, validated, with meanings; and a wrong choice is named."""

from dataclasses import dataclass, replace
from pathlib import Path

import pytest
import yaml
from pydantic import Field

from physreal_core.errors import InputError
from pipeline.compose import CONF, compose, options_in, render
from pipeline.config import StageParameters, load_parameters, stage_model, validate_parameters
from pipeline.config.segment_and_track import SegmentAndTrack
from pipeline.graph import STAGES
from pipeline.project import CODE_ROOT

OPTIONS = [f"{group.name}={file.stem}" for group in CONF.iterdir() if group.is_dir() for file in group.glob("*.yaml")]


def test_the_committed_file_is_composed():
    path = CODE_ROOT / "params.yaml"
    assert path.read_text() == compose(options_in(path)), "run `physreal compose`"


@pytest.mark.parametrize("option", sorted(OPTIONS))
def test_every_option_validates_and_survives_writing(option):
    text = compose([option])
    raw = yaml.safe_load(text)
    assert raw["composed_from"] == [option]
    assert render(validate_parameters(raw)) == text


def test_every_knob_is_written_out_with_its_meaning():
    text = compose([])
    raw = yaml.safe_load(text)
    for name, stage in STAGES.items():
        assert set(raw[name]) == set(stage_model(stage).model_fields)
    assert "  max_depth: 8.0  # farthest plausible depth; farther readings are dropped [m]\n" in text
    for sequence in raw["sequences"].values():
        assert set(STAGES) < set(sequence), "DVC needs every key that a stage depends on"


def test_values_and_options_reach_the_file(tmp_path: Path):
    path = tmp_path / "params.yaml"
    path.write_text(compose(["parse_video.max_width=320", "seed=7"]))
    parameters = load_parameters(path)
    assert parameters.stage("parse_video", "plush_lift").max_width == 320 and parameters.seed == 7
    assert options_in(path) == ["parse_video.max_width=320", "seed=7"]


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("fit_global=steel", "fit_global/steel"),
        ("parse_video.max_width=1", "parse_video.max_width = 1; expected greater than or equal to 32"),
        ("parse_video.max_widht=320", "did you mean parse_video.max_width?"),
    ],
)
def test_a_wrong_choice_is_named(option, words):
    with pytest.raises(InputError) as raised:
        compose([option])
    assert words in str(raised.value)


@dataclass(frozen=True)
class Bending:
    """Settings of an imagined core."""

    stiffness: float = 1.0
    steps: int = 3


@dataclass(frozen=True)
class Core:
    """The same, with settings within."""

    count: int = 5
    noise: float = 0.1
    bending: Bending = Bending()


def test_a_parameter_reaches_the_setting_of_its_name():
    class Block(StageParameters):
        stiffness: float = Field(2.0, description="")

    class Parameters(StageParameters):
        count: int = Field(7, description="")
        noise: float = Field(0.5, description="")
        elsewhere: str = Field("", description="of no setting's name: the stage reads it itself")
        bending: Block = Field(Block(), description="")

    assert Parameters().as_settings(Core) == Core(7, 0.5, Bending(2.0, 3))
    assert Parameters(count=8).as_settings(Core, noise=0.2) == Core(8, 0.2, Bending(2.0, 3))


def test_the_parameters_of_perception_begin_where_the_core_does():
    from physreal_core.perception.settings import DEFAULTS
    from stages._networks import make_settings

    assert make_settings(SegmentAndTrack()) == DEFAULTS
    assert make_settings(SegmentAndTrack(track_count=50, controller_smoothing=0.0)) == replace(
        DEFAULTS, track_count=50, controller_smoothing=0.0
    )
