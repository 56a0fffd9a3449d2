"""Stage report: one self-contained HTML page with videos, curves, tables and what it was made from."""

import json
from pathlib import Path
from typing import Any

import jinja2

from pipeline.capture import read_capture
from pipeline.faults import one_sentence
from pipeline.graph import FIT_STAGES, REPORT, STAGES, made_from
from pipeline.products.free_end import FreeEnd
from pipeline.products.particles import Particles
from pipeline.products.quality import PerceptionQuality, Quality
from pipeline.provenance import read_provenance
from pipeline.results import Results
from pipeline.status import stages_of
from pipeline.tables import SHOWN, tables
from stages._report_pictures import (
    embed,
    frame_errors,
    loss_curves,
    material_field,
    write_frame_strip,
    write_free_ends,
    write_moving_picture,
)

TEMPLATE = Path(__file__).with_name("report.html.jinja")


def run(results: Results) -> Path:
    """Write results/report.html and results/pictures, and say where the page is."""
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["quantity"] = lambda value: f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
    page = environment.from_string(TEMPLATE.read_text()).render(
        sequences=[describe_sequence(results, name) for name in results.sequences],
        tables=tables(results),
        fit_stages=FIT_STAGES,
        shown=SHOWN,
        seed=results.parameters.seed,
    )
    path = results.project.results / "report.html"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page)
    print(f"report: {path}")
    return path


def describe_sequence(results: Results, name: str) -> dict[str, Any]:
    """All that the page shows of one sequence; what does not apply to it is None."""
    parsed, evaluated = results.artifact("parse_video", name), results.artifact("evaluate", name)
    seen = results.artifact("segment_and_track", name)
    losses, scored = results.losses(name), results.evaluated(name)
    video, strip = evaluated / f"{FIT_STAGES[-1]}.mp4", results.project.results / "pictures" / f"{name}.jpg"
    if video.is_file():
        write_frame_strip(video, strip)
    return {
        "name": name,
        "capture": read_capture(parsed),
        "geometry": results.geometry(name),
        "free_end": _free_end(results, name),
        "moving": _moving(results, name),
        "model_from": results.model_from(name),
        "warnings": Quality.load(parsed).warnings + PerceptionQuality.load(seen).warnings,
        "choice": _embedded(seen / "choice.png"),
        "scores": {
            stage: {part: results.scores(name, stage, part) for part in ("observed", "future")} for stage in FIT_STAGES
        },
        "videos": {stage: embed(path) for stage in FIT_STAGES if (path := evaluated / f"{stage}.mp4").is_file()},
        "strip": embed(strip) if video.is_file() else None,
        "loss": loss_curves({stage: loss.of("total") for stage, loss in losses.items()}) if losses else None,
        "track_error": frame_errors(scored.curves("track_error", 1e3), "track error [mm]", scored.observed),
        "iou": frame_errors(scored.curves("iou", 1e2), "IoU [%]", scored.observed),
        "field": _field(results, name),
        "fits": _fits(results, name),
        "gap": _gap(results, name),
        "segmentation": _embedded(seen / "overlay.mp4"),
        "pose": _embedded(results.artifact("fit_pose", name) / "overlay.png"),
        "others": {stage: _other_numbers(results.metrics[name].get(stage, {})) for stage in FIT_STAGES},
        "provenance": _provenance(results, name),
    }


def _free_end(results: Results, name: str) -> str | None:
    """The free end of a fitted sequence and of those that are predicted with its models."""
    if results.model_from(name):
        return None
    shown = [name, *(other for other in results.sequences if results.model_from(other) == name)]
    shown = [other for other in shown if (results.artifact("evaluate", other) / FreeEnd.FILE).is_file()]
    if name not in shown:
        return None
    panels, searched = [], results.gap(name).interactions
    for other in shown:
        observed = results.evaluated(other).observed if other in searched else 0
        title = name if other == name else f"{other}, predicted"
        panels.append((title, FreeEnd.load(results.artifact("evaluate", other)), observed))
    path = results.project.results / "pictures" / f"{name}_free_end.svg"
    write_free_ends(path, panels, adopted=results.gap(name).after.adopted)
    return embed(path)


def _moving(results: Results, name: str) -> str | None:
    """Without and with the named effect, moving; where one was adopted and the capture has no images of its own."""
    capture = read_capture(results.artifact("parse_video", name))
    if capture.kind == "video" or results.model_from(name) or not results.gap(name).after.adopted:
        return None
    evaluated, path = results.artifact("evaluate", name), results.project.results / "pictures" / f"{name}.gif"
    videos = (evaluated / f"{stage}.mp4" for stage in ("fit_patches", "add_effect"))
    write_moving_picture(*videos, path, capture.fps)
    return embed(path)


def _field(results: Results, name: str) -> dict[str, Any] | None:
    """Young's modulus over the particles, from the patches of the last expert stage."""
    from physreal_core.fitting.model_file import read_model_file

    if results.model_from(name):
        return None
    _, fields = read_model_file(results.model("fit_patches", name))
    patches = fields["youngs_modulus"].numpy()
    particles = Particles.load(results.artifact("sample_particles", name))
    modulus = (patches[particles.patch_neighbours] * particles.patch_weights).sum(axis=1)
    picture = material_field(particles.x0, modulus / 1e3, "Young's modulus [kPa]")
    return {"picture": picture, "particles": len(modulus), "low": modulus.min(), "high": modulus.max()}


def _fits(results: Results, name: str) -> dict[str, dict[str, Any]]:
    """Fit stage → name of a quantity → its mean, range and unit."""
    if results.model_from(name):
        return {}
    return {stage: results.fit(stage, name).values for stage in FIT_STAGES}


def _gap(results: Results, name: str) -> dict[str, Any] | None:
    """What is missing: sentences, tables, figures, and how much the networks are left to do."""
    summary = results.gap(name)
    if summary is None:
        return None
    found, added = results.artifact("find_gap", name), results.artifact("add_effect", name)
    after = {"timeline.svg": "Gap per frame", "before_after.svg": "Tracks, measured and simulated"}
    figures = {
        "Gap over the object": found / "map.svg",
        **{title: (added if (added / file).is_file() else found) / file for file, title in after.items()},
        "Probabilities of the answers": found / "probabilities.svg",
    }
    return {
        "sentences": summary.sentences,
        "tables": summary.tables(),
        "figures": {title: embed(path) for title, path in figures.items() if path.is_file()},
        "residual": results.residual(name),
        "no_residual": results.fit("fit_residual", name).left_out,
    }


def _embedded(path: Path) -> str | None:
    return embed(path) if path.is_file() else None


def _other_numbers(block: dict[str, Any]) -> dict[str, float]:
    """What evaluate says beside the benchmark's numbers (truth, tip), flattened to "truth: observed: vertex_error"."""
    flat: dict[str, float] = {}

    def collect(prefix: str, value: Any) -> None:
        if isinstance(value, dict):
            for key, part in value.items():
                collect(f"{prefix}: {key}" if prefix else key, part)
        elif isinstance(value, (int, float)):
            flat[prefix] = value

    collect("", {key: value for key, value in block.items() if key not in ("observed", "future")})
    return flat


def _provenance(results: Results, name: str) -> dict[str, str]:
    """Stage → its provenance.json as text, of all that the report is made from."""
    read = made_from(REPORT.reads, STAGES)
    stages = [stage for stage in stages_of(results.parameters, name) if stage in read]
    return {stage: json.dumps(read_provenance(results.artifact(stage, name)), indent=1) for stage in stages}


if __name__ == "__main__":
    with one_sentence("report"):
        run(Results.open())
