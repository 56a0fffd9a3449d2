"""The DVC files say what the code does: stages, inputs, code, parameters and outputs."""

from pathlib import Path

import pytest
import yaml

from pipeline.graph import STAGES, Stage
from pipeline.project import CODE_ROOT
from pipeline.provenance import project_modules


def entries(stage: str) -> dict[str, dict]:
    """The stage's entries in its dvc.yaml, a `foreach` unfolded."""
    blocks = yaml.safe_load((CODE_ROOT / "pipeline" / stage / "dvc.yaml").read_text())["stages"]
    return {name: {**block, **block.get("do", {})} for name, block in blocks.items()}


def output_names(entry: dict) -> list[str]:
    return [name for out in entry["outs"] for name in ([out] if isinstance(out, str) else out)]


def item_of(stage: str) -> str:
    """What stands for the sequence in the stage's entries."""
    return "${key}" if stage in ("predict", "find_gap", "add_effect") else "${item.seq}"


def artifacts_of(stage: Stage, entry: str) -> set[str]:
    """Folders that the graph says this entry reads."""
    item = item_of(stage.name)
    more = stage.predicted if entry.endswith("_prediction") else stage.fitted
    names = {f"data/artifacts/{name}/{item}" for name in (*stage.upstream, *more)}
    names |= {f"data/artifacts/{name}/${{item.model_from}}" for name in stage.of_model}
    return names | ({f"data/captures/{item}"} if stage.reads_capture else set())


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
    light = {Path("physreal_core/errors.py"), Path("physreal_core/array_types.py")}
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
        item = item_of(stage)
        assert output_names(entry) == [f"{where}/{item}", f"data/runs/{stage}/{item}.json"]
        assert entry["cmd"] == f"python -m stages.{stage} {item}"
        assert entry["wdir"] == "../.."


def test_captures_survive_dvc():
    """DVC deletes outputs before a stage runs unless they persist; a capture may be somebody's own."""
    out = entries("rig")["rig"]["outs"][0]
    assert out == {"data/captures/${item.seq}": {"persist": True}}
