"""params.yaml with nonsense in it: numbers, effects, devices, networks and the file as such."""

import importlib
import typing
from pathlib import Path

import pytest
from pydantic import BaseModel

from physreal_core.errors import InputError
from pipeline.capture import capture_of
from pipeline.compose import options_in
from pipeline.config import load_parameters, stage_model, validate_parameters
from pipeline.config._effects import effect_names
from pipeline.graph import STAGES
from pipeline.project import Project
from pipeline.provenance import digest_file
from pipeline.stage import run_stage
from tests.pipeline.captures import write_capture, write_project

NOT_FINITE = [float("inf"), float("-inf"), float("nan"), "1e999"]


def numbers(model: type[BaseModel], path: tuple[str, ...] = ()) -> typing.Iterator[tuple[str, ...]]:
    """Paths of all numbers among a stage's parameters."""
    for name, field in model.model_fields.items():
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            yield from numbers(field.annotation, (*path, name))
        elif {int, float} & {field.annotation, *typing.get_args(field.annotation)}:
            yield (*path, name)


BLOCKS = [
    (stage.name, path[:-1], [p[-1] for p in numbers(stage_model(stage)) if p[:-1] == path[:-1]])
    for stage in STAGES.values()
    for path in {path[:-1]: path for path in numbers(stage_model(stage))}.values()
]


def nested(path: tuple[str, ...], value: object) -> dict:
    for name in reversed(path):
        value = {name: value}
    return value


@pytest.mark.parametrize(
    ("stage", "block", "names"), BLOCKS, ids=[".".join((stage, *block)) for stage, block, _ in BLOCKS]
)
def test_numbers_are_finite_and_no_truth_values(stage, block, names):
    for name in names:
        for value in [*NOT_FINITE, True]:
            with pytest.raises(InputError) as raised:
                validate_parameters(nested((stage, *block, name), value))
            error, key = raised.value, ".".join((stage, *block, name))
            assert error.what == f"{key} = {value!r}" and error.where == "params.yaml"
            assert error.expected and error.remedy == f"change {key} in params.yaml"


@pytest.mark.parametrize("value", [*NOT_FINITE[:3], [1.0, float("inf")]])
def test_a_sequence_own_value_is_finite(value):
    own = {"fit_global": {"scan": {"grips": value if isinstance(value, list) else [value]}}}
    with pytest.raises(InputError, match=r"sequences\.mug\.fit_global\.scan\.grips\.\d = .*finite number"):
        validate_parameters({"sequences": {"mug": own}})


@pytest.mark.parametrize("key", ["fps", "density"])
@pytest.mark.parametrize("value", NOT_FINITE[:3])
def test_numbers_of_a_capture_are_finite(key, value):
    with pytest.raises(InputError) as raised:
        capture_of({"kind": "tracks", "fps": 30.0, key: value}, "capture.json")
    assert raised.value.what == f"{key} = {value!r}" and "capture.json" in raised.value.remedy


def test_names_of_effects_are_those_of_the_library():
    library = list(importlib.import_module("physreal_core.effects").EFFECTS)
    assert sorted(effect_names()) == sorted(library)
    validate_parameters({"find_gap": {"candidates": library}, "add_effect": {"effects": ["wind"]}})


@pytest.mark.parametrize("key", ["find_gap.candidates", "add_effect.effects"])
@pytest.mark.parametrize(
    ("name", "nearest"), [("wnd", "wind"), ("Wind", "wind"), ("plastic_yeld", "plastic_yield"), ("", "")]
)
def test_an_effect_that_does_not_exist(key, name, nearest):
    stage, _, block = key.partition(".")
    for own in (False, True):
        values = {stage: {block: ["wind", name]}}
        with pytest.raises(InputError) as raised:
            validate_parameters({"sequences": {"mug": values}} if own else values)
        error = raised.value
        assert error.what == f"{'sequences.mug.' if own else ''}{key}.1 = {name!r}"
        assert "one of gravity" in error.expected and (not nearest or f"did you mean {nearest}?" in error.expected)


def doubling(levels: int) -> str:
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{k + 1}: &a{k + 1} [{', '.join([f'*a{k}'] * 10)}]" for k in range(levels)]
    return "\n".join(lines)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "holds no mapping"),
        ("- seed", "holds no mapping"),
        ("seed: [", "not readable as YAML"),
        ("\tseed: 0", "not readable as YAML"),
        ("seed: 0\nseed: 1", "the key seed stands twice"),
        ("sequences: {mug: {}, mug: {}}", "the key mug stands twice"),
        ("sequences: {2026-13-45: {}}", "month must be in 1..12"),
        ("{? [1, 2] : 3}", "unhashable key"),
        ("seed: " + "9" * 5000, "not readable as YAML: Exceeds the limit"),
        ("seed: " + "[" * 1000, "recursion"),
        ("seed: &seed [*seed]", "more than 200000 values by its aliases"),
        (doubling(9), "more than 200000 values by its aliases"),
        ("seed: 0\n---\nseed: 1", "expected a single document"),
        ("seed: \x07", "special characters are not allowed"),
        ("seed: !!python/object/apply:os.system [touch INJ]", "could not determine a constructor"),
        ("sede: 0", "did you mean seed?"),
        ("\x1b[31m: 0".replace("\x1b", '"\\x1b').replace("m:", 'm":'), "unknown key \\x1b[31m"),
        ("sequences: null", "sequences = None"),
        ("sequences: {mug: null}", "sequences.mug = None"),
        ("fits: {mug: {}}", "unknown key fits.mug"),
    ],
)
def test_a_file_that_is_no_params_yaml(tmp_path, text, words):
    path = tmp_path / "params.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as raised:
        load_parameters(path)
    error = raised.value
    assert words in error.what and path.name in error.where and error.remedy
    assert str(error).isprintable() and len(str(error)) < 1000
    assert [file.name for file in tmp_path.iterdir()] == ["params.yaml"] and not Path("INJ").exists()


@pytest.mark.parametrize("value", ["5", "seed=3", "[5]", "{a: b}"])
def test_options_that_are_no_list_of_text(tmp_path, value):
    (tmp_path / "params.yaml").write_text(f"composed_from: {value}\n")
    with pytest.raises(InputError, match="composed_from = .*expected the options .* a list of text"):
        options_in(tmp_path / "params.yaml")


def test_a_file_that_is_no_text(tmp_path):
    (tmp_path / "params.yaml").write_bytes(b"seed: \xff\n")
    with pytest.raises(InputError, match="byte 6 is no text; expected UTF-8"):
        load_parameters(tmp_path / "params.yaml")


def test_aliases_that_abbreviate_are_read(tmp_path):
    (tmp_path / "params.yaml").write_text(
        "sequences:\n  a: {fit_global: &own {device: cpu}}\n  b: {fit_global: *own}\n  c: {fit_global: {<<: *own}}\n"
    )
    assert set(load_parameters(tmp_path / "params.yaml").sequences) == {"a", "b", "c"}


WITH_DEVICE = [name for name, stage in STAGES.items() if "device" in stage_model(stage).model_fields]


@pytest.mark.parametrize("stage", WITH_DEVICE)
@pytest.mark.parametrize("own", [False, True])
def test_a_card_that_is_not_there_is_told_before_any_work(tmp_path, monkeypatch, stage, own):
    monkeypatch.setattr("torch.cuda.is_available", lambda: False)
    values = {stage: {"device": "cuda:0"}}
    write_project(tmp_path, "mug", **({"sequences": {"mug": values}} if own else values))
    with pytest.raises(InputError) as raised:
        run_stage(stage, "mug", lambda context: pytest.fail("it ran"), Project(tmp_path))
    error = raised.value
    assert error.what == f"{stage}.device = cuda:0, but torch sees no such card" and error.where == "params.yaml"
    assert "cpu" in error.expected and error.remedy.startswith(f"set {stage}.device to cpu")
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize("device", ["cuda", "cuda:1", "gpu", "", None, 0])
def test_a_device_that_does_not_exist(device):
    with pytest.raises(InputError, match=r"fit_global\.device = .*'cpu' or 'cuda:0'"):
        validate_parameters({"fit_global": {"device": device}})


@pytest.mark.parametrize(
    "path",
    ["/opt/net.onnx", "net.onnx", "data/models/../../net.onnx", "data/models/optional/net.onnx", "data/models", ""],
)
def test_an_own_network_lies_where_dvc_watches_it(path):
    with pytest.raises(InputError) as raised:
        validate_parameters({"segment_and_track": {"tracker_onnx": path}})
    assert raised.value.what == f"segment_and_track.tracker_onnx = {path!r}"
    assert "data/models" in STAGES["segment_and_track"].files, "DVC is told to watch it"
    assert raised.value.expected.startswith("a file in data/models/") and "link" in raised.value.expected


def test_the_content_of_an_own_network_counts_as_an_input(tmp_path):
    """By its content, wherever the link in data/models leads to."""
    write_capture(tmp_path / "data/captures/mug")
    (tmp_path / "data/models").mkdir()
    (tmp_path / "net").write_bytes(b"one")
    (tmp_path / "data/models/net.onnx").symlink_to(tmp_path / "net")
    write_project(tmp_path, "mug", segment_and_track={"tracker_onnx": "data/models/net.onnx"})
    project, seen = Project(tmp_path), []

    def take_note(context):
        seen.append(context.provenance["inputs"])
        (context.output / "capture.json").write_text("{}")

    run_stage("parse_video", "mug", take_note, project)
    run_stage("segment_and_track", "mug", take_note, project)
    assert seen[1]["data/models/net.onnx"] == digest_file(tmp_path / "net") and "data/models/net.onnx" not in seen[0]
    run_stage("build_object", "mug", take_note, project)
    (tmp_path / "net").write_bytes(b"another")
    with pytest.raises(
        InputError, match=r"segment_and_track mug: its output was made from another version of .*net\.onnx"
    ):
        run_stage("build_object", "mug", take_note, project)
