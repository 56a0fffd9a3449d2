"""Names of sequences: one rule wherever a name comes in, read alike by the stages and by DVC, and never run by a shell."""

import datetime
import io
import shutil
from pathlib import Path

import pytest
import yaml
from ruamel.yaml import YAML

from physreal_core.errors import InputError
from pipeline.compose import render
from pipeline.config import RULE, check_name, validate_parameters
from pipeline.graph import STAGES
from pipeline.importing import add_sequence, import_capture
from pipeline.project import Project
from pipeline.stage import main, run_stage
from tests.pipeline import toy
from tests.pipeline.captures import write_capture
from tests.pipeline.test_rerun import PARAMETERS, Repository

SHELL = ["x;touch INJ;", "x'$(touch INJ)'", "$(touch INJ)", "`touch INJ`", "a\ntouch INJ\n", "x|touch INJ", "${seed}"]
PATHS = ["../x", "../../captures/mine", "a/b", "/tmp/x", ".", "..", ".hidden", "a\0b"]
OTHERS = ["", " ", "-rf", "_x", "a b", "a.b", "a@b", "a:b", "é", "a\n", "\x1b[31mred", "x" * 65]
BAD = SHELL + PATHS + OTHERS
GOOD = [
    "mug",
    "Mug-2_b",
    "2026-11-23",
    "123",
    "0",
    "1e3",
    "0x1f",
    "0o17",
    "1_000",
    "true",
    "null",
    "no",
    "On",
    "x" * 64,
]
OTHER_TYPES = [123, 1.5, True, None, datetime.date(2026, 11, 23)]


def files(folder: Path) -> set[str]:
    """All that lies in a folder, but for locks, which hold nothing."""
    found = (path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())
    return {name for name in found if not name.endswith("lock")}


@pytest.fixture
def project(tmp_path: Path) -> Project:
    (tmp_path / "params.yaml").write_text("seed: 0  # mine\nsequences: {}\n")
    return Project(tmp_path)


@pytest.mark.parametrize("name", BAD)
def test_no_name_is_refused_wherever_it_comes_in(project, name):
    (project.root / "source").mkdir()
    before = files(project.root)
    attempts = [
        lambda: check_name(name, "here"),
        lambda: add_sequence(name, "fits", project),
        lambda: import_capture("images", project.root / "source", name, [], "fits", project),
        lambda: run_stage("parse_video", name, lambda context: pytest.fail("it ran"), project),
        lambda: validate_parameters({"sequences": {name: {}}}),
        lambda: validate_parameters({"clips": {name: {}}}),
        lambda: validate_parameters({"sequences": {"a": {}}, "fits": {"a": {"companion": name}}}),
    ]
    for attempt in attempts:
        with pytest.raises(InputError) as raised:
            attempt()
        assert raised.value.expected.startswith(RULE) and raised.value.remedy and raised.value.where
        assert str(raised.value).isprintable(), "a name must not reach the terminal as it is"
    assert files(project.root) == before


@pytest.mark.parametrize("name", GOOD)
def test_a_name_is_read_as_text_by_stages_and_by_dvc(project, name):
    """However it looks: the stages read YAML 1.1, DVC reads YAML 1.2."""
    write_capture(project.capture(name))
    add_sequence(name, "fits", project)
    written = project.parameters.read_text()
    composed = render(validate_parameters(yaml.safe_load(written)))
    for text in (written, composed):
        for read in (yaml.safe_load, lambda text: YAML(typ="safe").load(io.StringIO(text))):
            values = read(text)
            assert list(values["sequences"]) == [name] and values["fits"] == {name: {"companion": name}}
            assert set(STAGES) < set(values["sequences"][name])


@pytest.mark.parametrize("name", OTHER_TYPES, ids=str)
@pytest.mark.parametrize("role", ["sequences", "clips", "fits"])
def test_a_name_without_quotes_that_yaml_reads_as_something_else(project, name, role):
    project.parameters.write_text(yaml.safe_dump({role: {name: {}}}))
    with pytest.raises(InputError) as raised:
        validate_parameters(yaml.safe_load(project.parameters.read_text()))
    error = raised.value
    assert error.what == f"{name!r} is no name under {role}" and "in quotes" in error.expected
    assert error.where == "params.yaml" and "change that name" in error.remedy


def test_two_roles_that_write_to_the_same_place_exclude_each_other():
    with pytest.raises(InputError, match="a is in clips and in sequences; expected one of the two"):
        validate_parameters({"sequences": {"a": {}}, "clips": {"a": {}}})


@pytest.mark.parametrize(
    ("told", "argument", "expected"),
    [
        ("pipeline/load/dvc.yaml:load@mug", [], "mug"),
        ("../a@b/pipeline/load/dvc.yaml:load_clip@2026-11-23", [], "2026-11-23"),
        ("pipeline/load/dvc.yaml:load@mug", ["jug"], "jug"),
        ("", ["jug"], "jug"),
    ],
)
def test_a_stage_takes_its_sequence_from_dvc_or_from_the_command_line(monkeypatch, told, argument, expected):
    ran = []
    monkeypatch.setenv("DVC_STAGE", told)
    monkeypatch.setattr("sys.argv", ["load", *argument])
    monkeypatch.setattr("pipeline.stage.run_stage", lambda stage, sequence, *_, **__: ran.append((stage, sequence)))
    main("load", toy.load, toy.GRAPH)
    assert ran == [("load", expected)]


def test_a_stage_that_nobody_tells_its_sequence_asks_for_it(monkeypatch, capsys):
    monkeypatch.delenv("DVC_STAGE", raising=False)
    monkeypatch.setattr("sys.argv", ["load"])
    with pytest.raises(SystemExit):
        main("load", toy.load, toy.GRAPH)
    assert "required: sequence" in capsys.readouterr().err


@pytest.fixture(scope="module")
def repository(tmp_path_factory) -> Repository:
    return Repository(tmp_path_factory.mktemp("repository"))


def named(*names: str) -> dict:
    return {**PARAMETERS, "sequences": {name: {stage: {} for stage in toy.GRAPH} for name in names}}


def test_dvc_runs_nothing_that_a_name_holds(repository):
    tried = SHELL[:5]
    for name in tried:
        shutil.copytree(repository.root / "data/captures/a", repository.root / "data/captures" / name)
    repository.write_parameters(named(*tried))
    result = repository.dvc("repro", "--keep-going", "--all-pipelines")
    assert result.returncode != 0
    for name in tried:
        assert f"load@{name}" in result.stdout, "DVC tried this one"
    assert result.stderr.count("is no name for a sequence") == len(tried)
    assert not list(repository.root.rglob("INJ*"))


def test_dvc_deletes_nothing_outside_the_artifacts(repository):
    """A name that leads out of the artifacts gives all stages of the sequence one output, which DVC refuses."""
    kept = repository.root / "data/captures/mine/keep.txt"
    kept.parent.mkdir()
    kept.write_text("precious")
    repository.write_parameters(named("../../captures/mine"))
    result = repository.dvc("repro", "--all-pipelines")
    assert result.returncode != 0 and "output 'data/captures/mine' is specified in" in result.stderr
    assert kept.read_text() == "precious"
    for role in {role for stage in STAGES.values() for role in stage.roles}:
        stages = [stage for stage in STAGES.values() if role in stage.roles]
        assert len(stages) > 1 or stages[0].makes_capture, "one stage alone: its output must persist, as captures do"


def test_dvc_runs_sequences_however_their_names_look(repository):
    names = ["2026-11-23", "1e3", "true"]
    for name in names:
        shutil.copytree(repository.root / "data/captures/a", repository.root / "data/captures" / name)
    repository.write_parameters(named(*names))
    assert repository.repro("pipeline/load/dvc.yaml") == (0, {f"load@{name}" for name in names})
