"""Tables of results: scores averaged as the benchmark does, and what the models were missing."""

from collections.abc import Iterable

from pipeline.graph import FIT_STAGES
from pipeline.products.fit import ResidualShare
from pipeline.results import IMAGE_METRICS, INTERVALS, METRICS, Results
from pipeline.table import Table

# Heading, factor from SI, digits.
SHOWN = {
    "track_error": ("track error [mm]", 1e3, 2),
    "cd_l1_oneway": ("CD, L1 one-way [mm]", 1e3, 2),
    "cd_l2_twoway": ("CD, L2 two-way [mm]", 1e3, 2),
    "iou": ("IoU [%]", 1e2, 1),
    "psnr": ("PSNR [dB]", 1.0, 2),
}


def tables(results: Results) -> dict[str, Table]:
    """Name → table: every sequence; means by fit stage, by object geometry and by whether its shape was given, fitted and predicted apart; the
    gaps; and where they were measured, other methods and parts of ours."""
    own = {
        "by_sequence": _by_sequence(results),
        "by_stage": _by_stage(results),
        "by_geometry": _by_geometry(results),
        "by_shape": _by_shape(results),
        "gaps": _gaps(results),
    }
    if not results.baselines:
        return own
    return own | {
        "baselines": _baselines(results, "Other methods on the same sequences.", part=False),
        "by_loss": _baselines(results, "Ours with parts of the objective or the patches left out.", part=True),
    }


def mean_scores(results: Results, sequences: Iterable[str], fit_stage: str, interval: str) -> dict[str, float]:
    """As the benchmark averages: distances per sequence and then over sequences, image scores over all frames."""
    collected: dict[str, list[tuple[float, float]]] = {name: [] for name in METRICS}
    for sequence in sequences:
        block = results.metrics[sequence].get(fit_stage, {}).get(interval, {})
        first, last = block.get("frames", (0, 1))
        for name, value in results.scores(sequence, fit_stage, interval).items():
            collected[name].append((value, last - first if name in IMAGE_METRICS else 1))
    return {
        name: sum(value * weight for value, weight in pairs) / sum(weight for _, weight in pairs)
        for name, pairs in collected.items()
        if pairs
    }


def cells(scores: dict[str, float]) -> list[str]:
    """The scores as text, an empty cell where one does not apply."""
    return [
        f"{scores[name] * factor:.{digits}f}" if name in scores else "" for name, (_, factor, digits) in SHOWN.items()
    ]


def _headings() -> list[str]:
    return [heading for heading, _, _ in SHOWN.values()]


def _kind(results: Results, sequence: str) -> str:
    source = results.model_from(sequence)
    return f"predicted from {source}" if source else "fitted"


def _by_sequence(results: Results) -> Table:
    rows = [
        [sequence, _kind(results, sequence), stage, interval, *cells(scores)]
        for sequence in results.sequences
        for interval in INTERVALS
        for stage in FIT_STAGES
        if (scores := results.scores(sequence, stage, interval))
    ]
    return Table("Every sequence.", ["sequence", "model", "fit stage", "frames", *_headings()], rows)


def _by_stage(results: Results) -> Table:
    rows = [row for names in _fitted_and_predicted(results) for row in _mean_rows(results, names)]
    return Table("Mean over sequences, by fit stage.", [*_MEAN_HEADINGS, *_headings()], rows)


def _by_geometry(results: Results) -> Table:
    rows = [
        [geometry, *row]
        for names in _fitted_and_predicted(results)
        for geometry in sorted({results.geometry(name) for name in names})
        for row in _mean_rows(results, [name for name in names if results.geometry(name) == geometry])
    ]
    return Table("Mean over sequences, by geometry of the object.", ["geometry", *_MEAN_HEADINGS, *_headings()], rows)


def _by_shape(results: Results) -> Table:
    rows = [
        [geometry, shape, *row[: -len(SHOWN)], _true_error(results, names, *row[1:3]), *row[-len(SHOWN) :]]
        for sequences in _fitted_and_predicted(results)
        for geometry in sorted({results.geometry(name) for name in sequences})
        for shape in ("given", "seen")
        if (names := [n for n in sequences if (results.geometry(n), results.shape(n)) == (geometry, shape)])
        for row in _mean_rows(results, names)
    ]
    caption = "Mean over sequences, by whether the shape was given or made from frame 0."
    return Table(caption, ["geometry", "shape", *_MEAN_HEADINGS, "true vertices [mm]", *_headings()], rows)


def _true_error(results: Results, names: list[str], stage: str, interval: str) -> str:
    """Mean over those of the sequences whose truth is known [mm], as text."""
    known = [error for name in names if (error := results.vertex_error(name, stage, interval)) is not None]
    return f"{1e3 * sum(known) / len(known):.2f}" if known else ""


_MEAN_HEADINGS = ["model", "fit stage", "frames", "sequences"]


def _mean_rows(results: Results, names: list[str]) -> list[list[str]]:
    kind = "predicted" if names and results.model_from(names[0]) else "fitted"
    return [
        [kind, stage, interval, str(len(names)), *cells(scores)]
        for interval in INTERVALS
        for stage in FIT_STAGES
        if (scores := mean_scores(results, names, stage, interval))
    ]


def _fitted_and_predicted(results: Results) -> tuple[list[str], list[str]]:
    predicted = [name for name in results.sequences if results.model_from(name)]
    return [name for name in results.sequences if name not in predicted], predicted


def _gaps(results: Results) -> Table:
    """What is missing in the model of every fitted sequence, and how much the networks are left to do."""
    rows = [
        [
            sequence,
            gap.verdict.kind,
            " or ".join(" + ".join(names) for names in gap.verdict.members if names),
            "" if gap.verdict.probability is None else f"{gap.verdict.probability:.2f}",
            gap.closed,
            "" if (on_other := gap.closed_on_other_motion) is None else f"{on_other:.0%}",
            *(_stress_share(results.residual(sequence).get(kind)) for kind in ("with", "without")),
        ]
        for sequence in results.sequences
        if (gap := results.gap(sequence))
    ]
    headings = ["sequence", "verdict", "missing", "probability", "held-out gap closed", "on the other motion"]
    shares = ["networks' stress [%]", "without the effect [%]"]
    return Table("What the fitted models were missing, and what it leaves to the networks.", [*headings, *shares], rows)


def _stress_share(residual: ResidualShare | None) -> str:
    """The networks' share of the expert's stress as text, empty where they were not fitted."""
    return "" if residual is None or residual.stress_share is None else f"{100 * residual.stress_share:.1f}"


def _baselines(results: Results, caption: str, *, part: bool) -> Table:
    """Whole methods, or parts of ours beside the whole."""
    rows = [
        [
            row["sequence"],
            row["words"],
            *(f"{1e3 * row[span]['track_error']:.2f}" for span in INTERVALS),
            *(f"{1e3 * row[span]['vertex_error']:.2f}" for span in INTERVALS),
            ", ".join(f"{1e3 * own['vertex_error']:.2f}" for own in row["other_motions"].values()),
            f"{row['seconds']:.0f}",
            f"{row['memory'] / 1e9:.1f}",
        ]
        for row in results.baselines
        if row["part"] is part or row["method"] == "ours"
    ]
    errors = [f"{kind}, {span} [mm]" for kind in ("track error", "true vertices") for span in INTERVALS]
    headings = ["sequence", "method", *errors, "true vertices, other motion [mm]", "time [s]", "memory [GB]"]
    return Table(caption, headings, rows)
