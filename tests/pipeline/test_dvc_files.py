"""The DVC files say what the code does: stages, inputs, code, parameters and outputs; and how that follows from a tree."""

from pathlib import Path

import pytest
import yaml

from pipeline.dvc_files import code_dependencies, dvc_files
from pipeline.graph import FIT_STAGES, REPORT, STAGES, Aggregate, Stage, graph_of, made_from
from pipeline.project import CODE_ROOT
from pipeline.provenance import project_modules


def entries(stage: str) -> dict[str, dict]:
    """The stage's entries in its dvc.yaml, a `foreach` unfolded."""
    blocks = yaml.safe_load((CODE_ROOT / "pipeline" / stage / "dvc.yaml").read_text())["stages"]
    return {name: {**block, **block["do"]} for name, block in blocks.items()}


def output_names(entry: dict) -> list[str]:
    return [name for out in entry["outs"] for name in ([out] if isinstance(out, str) else out)]


def artifacts_of(stage: Stage, entry: str) -> set[str]:
    """Folders that the graph says this entry reads."""
    more = stage.predicted if entry.endswith("_prediction") else stage.fitted
    names = {f"data/artifacts/{name}/${{key}}" for name in (*stage.upstream, *more)}
    names |= {f"data/artifacts/{name}/${{item.model_from}}" for name in stage.of_model}
    return names | ({"data/captures/${key}"} if stage.reads_capture else set())


@pytest.mark.parametrize("name", dvc_files())
def test_the_committed_files_are_composed(name):
    assert (CODE_ROOT / name).read_text() == dvc_files()[name], "run `physreal compose`"


def test_every_folder_with_a_dvc_file_is_a_stage():
    found = {path.parent.name for path in (CODE_ROOT / "pipeline").glob("*/dvc.yaml")}
    assert found == {*STAGES, "models"}


@pytest.mark.parametrize("stage", STAGES.values(), ids=list(STAGES))
def test_inputs_are_those_of_the_graph(stage):
    for name, entry in entries(stage.name).items():
        read = {dep for dep in entry["deps"] if dep.startswith(("data/artifacts", "data/captures"))}
        of_companion = {dep for dep in read if "${item.companion}" in dep}
        assert read - of_companion == artifacts_of(stage, name), name
        assert {dep.split("/")[2] for dep in of_companion} == set(stage.of_companion), name


@pytest.mark.parametrize("stage", STAGES.values(), ids=list(STAGES))
def test_every_file_that_a_stage_imports_is_a_dependency(stage):
    """pipeline/ is left out but for products: its own changes do not alter a result (docs/pipeline.md)."""
    source = CODE_ROOT / "stages" / f"{stage.name}.py"
    files = {path.relative_to(CODE_ROOT) for path in project_modules(source)}
    products = Path("pipeline/products")
    counted = {path for path in files if path.parts[0] != "pipeline" or path.is_relative_to(products)}
    counted = {path for path in counted if path.name != "__init__.py"}
    light = {Path("physreal_core") / name for name in ("errors.py", "array_types.py", "evidence.py")}
    for name, entry in entries(stage.name).items():
        deps = [Path(dep) for dep in entry["deps"] if not dep.startswith("data/a")]
        uncovered = {path for path in counted - light if not any(path.is_relative_to(dep) for dep in deps)}
        assert not uncovered, f"{name}: add to deps {sorted(map(str, uncovered))}"
        unused = {
            dep
            for dep in deps
            if (dep.parts[0] == "physreal_core" or dep.is_relative_to(products))
            and not any(p.is_relative_to(dep) for p in files)
        }
        assert not unused, f"{name}: not imported {sorted(map(str, unused))}"


@pytest.mark.parametrize("stage", list(STAGES))
def test_parameters_and_outputs(stage):
    for name, entry in entries(stage).items():
        assert {"seed", stage} <= set(entry["params"])
        assert any(key.endswith(f".{stage}") for key in entry["params"]), name
        where = "data/captures" if STAGES[stage].makes_capture else f"data/artifacts/{stage}"
        assert output_names(entry) == [f"{where}/${{key}}"], "a run's record differs each time"
        assert entry["cmd"] == f"python -m stages.{stage}", "nothing of params.yaml reaches the shell"
        assert entry["wdir"] == "../.."


def test_captures_survive_dvc():
    """DVC deletes outputs before a stage runs unless they persist; a capture may be somebody's own."""
    out = entries("rig")["rig"]["outs"][0]
    assert out == {"data/captures/${key}": {"persist": True}}


@pytest.mark.parametrize(
    ("stage", "role", "entry"),
    [
        ("parse_video", "sequences", {"foreach": "${sequences}", "params": "sequences.${key}.parse_video"}),
        ("parse_video_clip", "clips", {"foreach": "${clips}", "params": "clips.${key}.parse_video"}),
        ("evaluate", "fits", {"foreach": "${fits}", "params": "sequences.${key}.evaluate"}),
        ("evaluate_prediction", "predictions", {"foreach": "${predictions}", "params": "sequences.${key}.evaluate"}),
    ],
)
def test_a_stage_has_an_entry_for_each_of_its_roles(stage, role, entry):
    spec = STAGES[stage.removesuffix("_clip").removesuffix("_prediction")]
    assert spec.target(role, "rope") == f"pipeline/{spec.name}/dvc.yaml:{stage}@rope"
    written = entries(spec.name)[stage]
    assert written["foreach"] == entry["foreach"] and written["params"][-1] == entry["params"]


def write(root: Path, **modules: str) -> None:
    """Modules from their dotted names, e.g. stages__bend, with their text."""
    for name, text in modules.items():
        path = root.joinpath(*name.split("__")).with_suffix(".py")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def test_how_code_becomes_dependencies(tmp_path):
    """Of a large package few modules: the files; of it many: the folder; beside headers: the folder; no light ones."""
    large = {f"physreal_core__large__part{k}": "" for k in range(6)}
    write(tmp_path, **large, physreal_core__errors="", physreal_core__cores="", pipeline__stage="", pipeline__frames="")
    write(tmp_path, physreal_core__native__build="", physreal_core__native__other="", physreal_core__native__third="")
    (tmp_path / "physreal_core/native/lanes.h").write_text("")
    write(
        tmp_path,
        stages___shared="from physreal_core.large.part1 import b\nfrom physreal_core import cores",
        stages__bend="from physreal_core.large.part0 import a\nfrom physreal_core.native.build import n\n"
        "from physreal_core.errors import e\nfrom pipeline import stage, frames\nfrom stages._shared import s",
    )
    code = ["stages/bend.py", "stages/_shared.py", "pipeline/frames.py", "physreal_core/cores.py"]
    files = ["physreal_core/large/part0.py", "physreal_core/large/part1.py"]
    assert code_dependencies("stages/bend.py", tmp_path) == [*code, *files, "physreal_core/native"]
    write(tmp_path, stages___shared="from physreal_core.large import part1, part2\nfrom physreal_core import cores")
    assert code_dependencies("stages/bend.py", tmp_path) == [*code, "physreal_core/large", "physreal_core/native"]


def test_what_outputs_are_made_from_is_followed_through_the_graph():
    assert made_from(["build_object"], STAGES) == {"build_object", "parse_video", "segment_and_track"}
    assert {*FIT_STAGES, "find_gap", "predict", "build_object"} < made_from(["evaluate"], STAGES)
    assert "rig" not in made_from(REPORT.reads, STAGES), "captures are nobody's output"


def test_a_new_stage_needs_its_module_and_a_line_of_the_graph(tmp_path):
    write(tmp_path, stages__bend="", stages__table="")
    graph = graph_of(Stage("bend", ("fit_pose",), roles=("fits",)))
    files = dvc_files(graph, (Aggregate("table", ("bend",), outputs=("results/bend.csv",)),), tmp_path)
    assert list(files) == ["pipeline/bend/dvc.yaml", "dvc.yaml"]
    assert all("Written by `physreal compose`" in text.splitlines()[0] for text in files.values())
    block = yaml.safe_load(files["pipeline/bend/dvc.yaml"])["stages"]["bend"]
    assert block["foreach"] == "${fits}"
    assert block["do"]["deps"] == ["stages/bend.py", "data/artifacts/fit_pose/${key}"]
    table = yaml.safe_load(files["dvc.yaml"])["stages"]["table"]
    assert table["deps"] == ["stages/table.py", "data/artifacts/bend"] and table["outs"] == ["results/bend.csv"]
