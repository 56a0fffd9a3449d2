"""How near a twin follows a stream, how sure it rightly is, how fast, and when it notices that something is missing.

`OPENBLAS_NUM_THREADS=1 python -m benchmarks.following --project FOLDER`; FOLDER is a project in which the sequences are fitted (after `scripts/run_example.sh`, this one).

Streams are the tracks of the recorded sequences, whose truth the rig knows. Every third point is kept from the follower, and it is scored at these.
The same with a modulus that is wrong by a factor, learnt or not. Then streams of the twin itself, with noise: an effect begins to act in the middle of
the filmed motion, or none does. Writes `results/use.json` (`live`) and `results/following.md`.
"""

import argparse
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from scipy.spatial import cKDTree

from applications.coarse import coarser
from applications.live import streams
from applications.live.following import INTERVAL
from applications.twin import Twin
from benchmarks.thin.results import RESULTS
from benchmarks.use import record
from physreal_core.array_types import Array, Float
from physreal_core.cores import available_cores
from physreal_core.fitting.losses import carried_tracks
from physreal_core.fitting.named_effects import effect_record
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.following import FollowConfig, Seen, follower_of
from physreal_core.playing import Changes, Session
from pipeline.config import load_parameters
from pipeline.products.truth import CaptureTruth
from pipeline.project import Project

HIDDEN = 3
"""Every so many-th point is kept from the follower."""

BEGINS = 30
"""Frame in which an effect begins to act."""

EFFECTS = {
    "wind": {"x": 0.0, "y": 2.0, "z": 0.0},
    "linear_drag": {"rate": 3.0},
    "gravity": {"tilt_x": 0.2, "tilt_y": 0.0, "excess": 0.0},
}
"""That begin to act, with their numbers; those before are dormant."""

WRONG, OPEN = (0.6, 1.0, 1.6), 0.4
"""Factors on Young's modulus with which the material is learnt, and the deviation of its logarithm that is stated then."""

SEEDS, SIGMA = 5, 1e-3
"""Streams of each effect, and their noise [m]."""


@dataclass(frozen=True)
class Run:
    """A stream, followed.

    Attributes:
        truth: where the points are [m].
        alone: where the model has them without looking [m].
        forecast, points, deviation: as of `Followed`, stacked.
        alarm: frame of the first alarm; None for none.
        seconds: of each frame.
        material: what was learnt, as of `LearntMaterial.told`.
    """

    truth: Float[Array, "frames tracks 3"]
    alone: Float[Array, "frames tracks 3"]
    forecast: Float[Array, "frames tracks 3"]
    points: Float[Array, "frames tracks 3"]
    deviation: Float[Array, "frames tracks"]
    alarm: int | None
    seconds: Float[Array, " frames"]
    material: dict[str, dict[str, float]]


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.following", description=__doc__)
    parser.add_argument("--project", type=Path, default=Path())
    parser.add_argument(
        "--coarser", type=float, default=1.26, help="spacing of the particles in the second rows; half as many"
    )
    arguments = parser.parse_args()
    project = Project(arguments.project.resolve())
    values = load_parameters(project.parameters).values
    names = [*values.fits, *values.predictions]
    twins = {name: Twin.load(project, name) for name in names}
    rows = {name: scored(twin, recorded(project, twin)) for name, twin in twins.items()}
    first = next(iter(twins.values()))
    quick = {name: scored(t, recorded(project, t)) for name, t in _coarse(twins, arguments.coarser).items()}
    learnt = [learning(project, twin, factor) for twin in twins.values() for factor in WRONG]
    switched = [noticed(first, effect, seed) for effect in (None, *EFFECTS) for seed in range(SEEDS)]
    block = {
        "machine": f"CPU, {available_cores()} cores",
        "sequences": rows,
        f"coarser_{arguments.coarser:g}": quick,
        "learning": learnt,
        "switched": {"sequence": first.sequence, "rows": switched},
    }
    record("live", {**headline(block, arguments.coarser), **block})
    (RESULTS / "following.md").write_text(report(block, arguments.coarser))
    print(report(block, arguments.coarser))


def _coarse(twins: dict[str, Twin], factor: float) -> dict[str, Twin]:
    """The filmed ones with fewer particles."""
    return {name: coarser(twin, factor, "following") for name, twin in twins.items() if twin.camera is not None}


def recorded(project: Project, twin: Twin, config: FollowConfig | None = None) -> Run:
    """The recorded sequence, some of its points hidden."""
    points0 = twin.problem.tracks.points0.double().numpy()
    truth = _truth(CaptureTruth.load(project.capture(twin.sequence)).vertices.astype(float), points0)
    shown = np.arange(len(points0)) % HIDDEN > 0
    stream = [replace(seen, valid=seen.valid & shown) for seen in streams.recorded(twin.problem)]
    return _run(twin, stream, truth[1:], config)


def learning(project: Project, twin: Twin, factor: float) -> dict[str, str | float]:
    """A recorded sequence followed by a model whose modulus is `factor` times the fitted one: forecasts [m] without and with learning it, and the
    modulus at the end over the fitted one, with the deviation of its logarithm."""
    fields = {**twin.model.fields, "youngs_modulus": factor * twin.model.fields["youngs_modulus"]}
    wrong = replace(twin, model=replace(twin.model, fields=fields))
    plain = scored(wrong, recorded(project, wrong))
    run = recorded(project, wrong, FollowConfig(learns={"youngs_modulus": OPEN}))
    found = run.material["youngs_modulus"]
    return {
        "sequence": twin.sequence,
        "begins": factor,
        "ends": factor * found["factor"],
        "deviation": found["log_deviation"],
        "forecast": plain["forecast"],
        "forecast_learning": scored(wrong, run)["forecast"],
    }


def _truth(vertices: Float[Array, "frames V 3"], points0: Float[Array, "P 3"]) -> Float[Array, "frames P 3"]:
    """Where points go that lie at the surface in frame 0: with the mean of their nearest vertices."""
    far, near = cKDTree(vertices[0]).query(points0, k=6)
    weights = 1.0 / np.maximum(far, 1e-6)
    weights /= weights.sum(1, keepdims=True)
    carried = np.einsum("pk,tpkc->tpc", weights, vertices[:, near])
    return carried + points0 - carried[0]


def _run(
    twin: Twin, stream: list[Seen], truth: Float[Array, "frames tracks 3"], config: FollowConfig | None = None
) -> Run:
    follower, found, seconds = follower_of(twin.problem, twin.model, config), [], []
    for seen in stream:
        begun = time.perf_counter()
        found.append(follower.step(seen))
        seconds.append(time.perf_counter() - begun)
    columns = {name: np.stack([getattr(f, name) for f in found]) for name in ("forecast", "points", "deviation")}
    alarms = [frame for frame, f in enumerate(found, start=1) if f.alarm]
    alarm = alarms[0] if alarms else None
    material = {} if follower.material is None else follower.material.told()
    return Run(truth, _alone(twin), **columns, alarm=alarm, seconds=np.array(seconds), material=material)


def _alone(twin: Twin) -> Float[Array, "frames tracks 3"]:
    rollouts = Rollouts(twin.problem, twin.model)
    with torch.no_grad():
        states = rollouts.simulate_batch([rollouts.inputs(twin.model.fields)], twin.problem.frame_count)
    x0 = torch.as_tensor(twin.problem.body.x0).to(states.x)
    return carried_tracks(rollouts.problem.tracks, x0, states.x[0], states.F[0]).double().numpy()[1:]


def scored(twin: Twin, run: Run) -> dict[str, float | int | None]:
    """Root mean square distances [m] at the hidden points in the frames that no fit saw, coverage there, and speed."""
    frames, hidden = slice(twin.problem.observed - 1, None), np.arange(run.truth.shape[1]) % HIDDEN == 0

    def off(places: Array) -> float:
        return float(np.sqrt(((places - run.truth)[frames, hidden] ** 2).sum(-1).mean()))

    within = np.abs(run.points - run.truth) <= INTERVAL * run.deviation[..., None]
    return {
        "particles": len(twin.problem.body.x0),
        "alone": off(run.alone),
        "forecast": off(run.forecast),
        "state_error": off(run.points),
        "coverage": float(within[frames, hidden].mean()),
        "alarm": run.alarm,
        "frames_per_second": float(1.0 / np.median(run.seconds)),
    }


def noticed(twin: Twin, effect: str | None, seed: int) -> dict[str, str | int | float | None]:
    """A stream of the twin itself in which an effect begins to act, or none: when that is noticed, and how far it moves the body [m]."""
    places, random = _switched(twin, effect), np.random.default_rng(seed)
    everything, sigma = np.ones(places.shape[1], bool), np.full(places.shape[1], SIGMA)
    stream = [
        Seen(
            twin.problem.controllers[frame].double().numpy(), p + SIGMA * random.normal(size=p.shape), everything, sigma
        )
        for frame, p in enumerate(places, start=1)
    ]
    run = _run(twin, stream, places)
    moved = np.sqrt(((places - _switched(twin, None)) ** 2).sum(-1).mean(1))
    return {"effect": effect or "none", "seed": seed, "alarm": run.alarm, "moves": float(moved.max())}


def _switched(twin: Twin, effect: str | None) -> Float[Array, "frames tracks 3"]:
    """Where the twin's tracked points go [m] where an effect begins to act in frame `BEGINS`."""
    model, changes = twin.model, None
    if effect is not None:
        strength = EFFECTS[effect]
        known = {r["name"]: r["values"] for r in model.effects}.get(effect, dict.fromkeys(strength, 0.0))
        others = [r for r in model.effects if r["name"] != effect]
        model = replace(model, effects=[*others, effect_record(effect, known)])
        changes = Changes(effects={effect: {name: known[name] + more for name, more in strength.items()}})
    session, found = Session(twin.problem, model), []
    for frame in range(1, twin.problem.frame_count):
        if changes is not None and frame == BEGINS:
            session.change(changes)
        session.step()
        found.append(twin.carried(twin.problem.tracks.points0.numpy(), twin.problem.tracks.binding, session.state))
    return np.array(found)


def headline(block: dict, factor: float) -> dict[str, float | int | None]:
    """The numbers of the filmed sequence with fewer particles, coverage over all sequences, and the latest alarm after an effect began."""
    quick, everything = block[f"coarser_{factor:g}"], block["sequences"]
    first = next(iter(quick))
    late = [row["alarm"] and row["alarm"] - BEGINS for row in block["switched"]["rows"] if row["effect"] != "none"]
    return {
        "frames_per_second": quick[first]["frames_per_second"],
        "state_error": quick[first]["state_error"],
        "coverage": float(np.mean([row["coverage"] for row in everything.values()])),
        "detected_after_frames": None if None in late else max(late),
    }


def report(block: dict, factor: float) -> str:
    """The page."""
    lines = [
        "# A twin that follows a stream",
        "",
        f"`OPENBLAS_NUM_THREADS=1 python -m benchmarks.following --project FOLDER`; {block['machine']}. Root mean square distances from the truth in mm, at points that the follower",
        "did not see, in the frames that no fit saw. Alone: the model without a look. Forecast: before each look. State: after it. Coverage of the 90 %",
        "intervals is counted there, too (0.85 to 0.95 is wanted).",
        "",
        "| sequence | particles | alone | forecast | state | coverage | alarm in frame | frames a second |",
        "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for rows in (block["sequences"], block[f"coarser_{factor:g}"]):
        for name, row in rows.items():
            far = " | ".join(f"{1e3 * row[key]:.2f}" for key in ("alone", "forecast", "state_error"))
            alarm = "none" if row["alarm"] is None else row["alarm"]
            lines.append(
                f"| `{name}` | {row['particles']} | {far} | {row['coverage']:.2f} | {alarm} | {row['frames_per_second']:.0f} |"
            )
    own = block["switched"]
    lines += [
        "",
        f"A modulus that begins wrong by a factor, and is learnt (`--learn {OPEN:g}`): the modulus at the end over the fitted one, with an interval of 90 %; and forecasts in mm, as",
        "above, of the follower that does not learn it and of the one that does. What is true is one where the fit is right.",
        "",
        "| sequence | begins at | ends at | forecast, not learning | forecast, learning |",
        "|---|--:|--:|--:|--:|",
    ]
    for row in block["learning"]:
        width = np.exp(INTERVAL * row["deviation"])
        lines.append(
            f"| `{row['sequence']}` | {row['begins']:g} | {row['ends']:.2f} ({row['ends'] / width:.2f} to {row['ends'] * width:.2f}) | "
            f"{1e3 * row['forecast']:.2f} | {1e3 * row['forecast_learning']:.2f} |"
        )
    lines += [
        "",
        f"Streams of the twin of `{own['sequence']}` itself, with {1e3 * SIGMA:.0f} mm of noise; an effect begins to act in frame {BEGINS}, {SEEDS} times.",
        "Wanted is an alarm within 20 frames, and none before.",
        "",
        "| effect | moves the body by at most [mm] | alarms in frames |",
        "|---|--:|---|",
    ]
    for effect in dict.fromkeys(row["effect"] for row in own["rows"]):
        rows = [row for row in own["rows"] if row["effect"] == effect]
        alarms = ", ".join("none" if row["alarm"] is None else str(row["alarm"]) for row in rows)
        lines.append(f"| {effect} | {1e3 * rows[0]['moves']:.1f} | {alarms} |")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    main()
