"""How fast a fitted twin is played with: `python -m benchmarks.playing --project FOLDER [--sequence plush_lift] [--model STAGE] [--device cuda:0]`

FOLDER is a project in which the sequence is fitted (after `scripts/run_example.sh`, this one). A handle is pulled up and down for `--frames` frames,
without waiting for real time, with a page that nobody looks at: simulated, carried, packed and handed to viser. Pull to picture is the time from an
event of the mouse to the end of the turn that shows it, where the loop is as busy as in real time: at worst a frame's wait and a turn.

Writes `results/use.json` (`play`) and `results/playing.md`.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import torch

from applications.play.page import Page
from applications.twin import Twin
from benchmarks.thin.results import RESULTS
from benchmarks.use import record
from pipeline.graph import FIT_STAGES
from pipeline.project import Project

WARM_UP = 20  # frames


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.playing", description=__doc__)
    parser.add_argument("--project", type=Path, default=Path())
    parser.add_argument("--sequence", default="plush_lift")
    parser.add_argument("--model", default=FIT_STAGES[-1], choices=FIT_STAGES)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--frames", type=int, default=200)
    arguments = parser.parse_args()
    found = measured(arguments)
    record("play", found)
    page = report(found)
    (RESULTS / "playing.md").write_text(page)
    print(page)


def measured(arguments: argparse.Namespace) -> dict[str, float | int | str]:
    """Times of the page's turns and their parts."""
    import viser

    begun = time.perf_counter()
    twin = Twin.load(Project(arguments.project.resolve()), arguments.sequence, arguments.model)
    session = twin.session(arguments.device)
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    page = Page(server, twin, [session], None)
    page.loop.once()
    opened = time.perf_counter() - begun
    place = twin.mesh.vertices[twin.mesh.vertices[:, 2].argmax()]
    page.loop.do(lambda s: s.take(place))
    turns, steps = [], []
    for frame in range(WARM_UP + arguments.frames):
        target = place + [0.0, 0.0, 0.05 * np.sin(0.2 * frame)]
        start = time.perf_counter()
        page.loop.do(lambda s, to=target: s.move(1, to))
        page.loop.once()
        turns.append(time.perf_counter() - start)
    for _ in range(arguments.frames):
        start = time.perf_counter()
        session.step()
        steps.append(time.perf_counter() - start)
    server.stop()
    turn, step = float(np.median(turns[WARM_UP:])), float(np.median(steps))
    cuda = torch.device(arguments.device).type == "cuda"
    return {
        "machine": torch.cuda.get_device_name() if cuda else f"CPU, {torch.get_num_threads()} threads",
        "sequence": arguments.sequence,
        "particles": len(twin.problem.body.x0),
        "splats": 0 if twin.gaussians is None else len(twin.gaussians),
        "frames_per_second": 1.0 / turn,
        "simulated_frames_per_second": 1.0 / step,
        "latency_ms": 1e3 * (1.0 / session.fps + turn),
        "opening_seconds": opened,
    }


def report(record: dict[str, float | int | str]) -> str:
    """The page."""
    rows = [
        ("frames a second, simulated and shown", f"{record['frames_per_second']:.0f}", "30"),
        ("frames a second, simulated alone", f"{record['simulated_frames_per_second']:.0f}", ""),
        ("pull to picture, at worst [ms]", f"{record['latency_ms']:.0f}", "100"),
        ("from the command to the first picture [s], without Python's start", f"{record['opening_seconds']:.1f}", "10"),
    ]
    head = [
        "# Playing with a twin",
        "",
        f"`python -m benchmarks.playing`: `{record['sequence']}`, {record['particles']} particles, {record['splats']} splats; {record['machine']}; medians.",
        "Nobody looks at the page: what a connection and a browser take comes on top.",
        "",
        "| | measured | wanted |",
        "|---|--:|--:|",
    ]
    return "\n".join([*head, *(f"| {what} | {value} | {wanted} |" for what, value, wanted in rows), ""])


if __name__ == "__main__":
    main()
