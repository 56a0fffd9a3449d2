"""Speed and memory of the simulator beside its peers: `python -m benchmarks.simulation [--device cuda:0] [--json FILE]`

Every implementation runs the same scene (benchmarks/scene.py) in a process of its own, round after round in turn, so
that a busy machine hits all alike. `--sweep` adds how cost grows with particles, substeps and frames; `--quick`
compares ours with the Warp tape alone, within 50 s on two cores; `--before FOLDER` with an earlier checkout of this project.
Peers that are not installed are left out with a line.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from dataclasses import replace
from pathlib import Path
from statistics import median

from benchmarks.workers import Job, Unavailable, Worker
from benchmarks.workload import Workload

OURS, BEFORE, TAPE = "ours", "ours before", "Warp tape"
WORK = ("forward", "forward_backward")
TURN = 0.5  # s; short runs are repeated for so long when it is an implementation's turn
QUICK_UNTIL = 28.0  # s after the start no new round begins
SIZES = (1_000, 2_000, 5_000, 10_000, 20_000, 50_000, 100_000)
CUDA_SIZES = (*SIZES, 200_000, 500_000, 1_000_000)
RATED = (20_000, 100_000, 1_000_000)  # on CUDA, where 20 000 particles do not fill the card
MEMORY_FRAMES = (2, 4, 8, 16)
TAPE_SUBSTEPS = 400  # in the sweeps the tape goes no further, for its memory
BATCH = (32, 5_000)  # rollouts at once, particles of each

Times = dict[str, list[tuple[float, float]]]
"""Wall and processor time [s] of each run, by kind of work."""


def earlier(before: Path | None, threads: tuple[int, ...]) -> list[Job]:
    """Ours as it was in another checkout, if there is one."""
    return [] if before is None else [Job(BEFORE, "ours", t, checkout=before.resolve()) for t in threads]


def jobs(device: str, warp_mpm: str, before: Path | None) -> list[Job]:
    """All implementations for a device, ours first."""
    path = {"path": warp_mpm}
    if device != "cpu":
        return [Job(OURS, "ours"), *earlier(before, (1,)), Job("warp-mpm", "warp_mpm", options=path)]
    both = [(OURS, "ours"), ("plain C++", "plain_cpp"), ("Taichi mpm3d", "taichi_mpm3d"), ("Genesis", "genesis")]
    return [
        *(Job(label, module, threads) for threads in (1, 2) for label, module in both),
        *earlier(before, (1, 2)),
        Job(TAPE, "warp_tape"),
        Job("Warp tape, Newton's rotation", "warp_tape", options={"rotation": "newton"}),
        Job("warp-mpm", "warp_mpm", options=path),
    ]


def contact_jobs(device: str) -> list[Job]:
    """Ours with ground, friction, grip and differing stiffness, and without."""
    threads = (1, 2) if device == "cpu" else (1,)
    return [Job(OURS, "ours", t, contact=contact) for t in threads for contact in (False, True)]


# --- measuring ------------------------------------------------------------------------------------------------------


def start(wanted: list[Job], scene: Workload, device: str) -> list[Worker]:
    """Workers of the jobs that run here, compiled and warm; the others are named with the reason."""
    started, ready = [Worker(job, scene, device) for job in wanted], []
    for worker in started:
        try:
            worker.wait()
            ready.append(worker)
        except Unavailable as reason:
            print(f"- left out: {worker.job.label}, {threads_of(worker.job)}: {reason}", flush=True)
    return ready


def measure(workers: list[Worker], rounds: int, until: float = float("inf")) -> list[Times]:
    """Times of every worker, taken in turn; no round after the first begins past `until` (of time.monotonic)."""
    found = [{what: [] for what in worker.abilities} for worker in workers]
    for done in range(rounds):
        if done and time.monotonic() > until:
            break
        for worker, times in zip(workers, found, strict=True):
            for what in worker.abilities:
                times[what] += worker.time(what, TURN)
    return found


def run(wanted: list[Job], scene: Workload, device: str, rounds: int, until: float = float("inf")) -> list[dict]:
    """One row per job that runs here: rates [particle-substeps/s] by processor time, median and best wall time."""
    workers = start(wanted, scene, device)
    found = measure(workers, rounds, until)
    rows = []
    for worker, times in zip(workers, found, strict=True):
        worker.close()
        row = {"label": worker.job.label, "threads": worker.job.threads, "contact": worker.job.contact}
        rows.append(row | {what: rates(scene.work * worker.job.rollouts, taken) for what, taken in times.items()})
    return rows


def rates(work: int, taken: list[tuple[float, float]]) -> dict[str, float]:
    """Millions of particle-substeps per second: of processor time, of wall time (medians), and the best wall time's."""
    wall, processor = zip(*taken, strict=True)
    million = work / 1e6
    return {
        "processor": million / max(median(processor), 1e-9),
        "wall": million / median(wall),
        "best": million / min(wall),
    }


def memory(job: Job, scene: Workload, device: str) -> int | None:
    """Peak memory [B] of a job's forward + backward in a fresh process, beyond what it holds after a warm-up."""
    worker = Worker(job, scene, device)
    try:
        worker.wait()
        found = worker.memory()
    except Unavailable:
        return None
    worker.close()
    return found


def single(job: Job, scene: Workload, device: str, rounds: int) -> dict | None:
    """Best seconds of one job's forward and forward + backward, on the CPU of processor time, and its memory [B]."""
    workers = start([job], scene, device)
    if not workers:
        return None
    (times,) = measure(workers, rounds)
    workers[0].close()
    best = {what: min(run[device == "cpu"] for run in taken) for what, taken in times.items()}
    return best | {"bytes": memory(job, scene, device)}


# --- tables ---------------------------------------------------------------------------------------------------------


def threads_of(job: Job) -> str:
    return f"{job.threads} thread" + "s" * (job.threads > 1)


def table(head: list[str], rows: list[list[str]]) -> None:
    """Print a markdown table; the first column is text."""
    print("\n| " + " | ".join(head) + " |\n|---" + "|--:" * (len(head) - 1) + "|")
    for row in rows:
        print("| " + " | ".join(row) + " |")
    print(flush=True)


def number(value: float | None, digits: int = 3) -> str:
    if value is None:
        return "–"
    return f"{value:.0f}" if value >= 10 ** (digits - 1) else f"{value:.{digits}g}"


def basis(row: dict, device: str) -> str:
    """Which of a row's rates is compared: processor time for one thread of the CPU, else median wall time."""
    return "processor" if device == "cpu" and row["threads"] == 1 else "wall"


def faster(row: dict, ours: dict | None, what: str, kind: str) -> float | None:
    """How many times faster ours is, by one kind of rate."""
    return None if ours is None or what not in row or what not in ours else ours[what][kind] / row[what][kind]


def rate_tables(rows: list[dict], device: str) -> None:
    """Rates of every implementation, and how many times faster ours is on as many threads."""
    columns = {"processor": "processor time", "wall": "wall time, median", "best": "best"}
    if device != "cpu":
        del columns["processor"]
    for what in WORK:
        print(f"**{what.replace('_', ' + ')}**, millions of particle-substeps per second, and ours over it")
        body = []
        for row in (r for r in rows if what in r):
            ours = next((r for r in rows if r["label"] == OURS and r["threads"] == row["threads"]), None)
            ratios = [number(faster(row, ours, what, kind)) for kind in columns]
            body.append([row["label"], str(row["threads"]), *(number(row[what][k]) for k in columns), *ratios])
        table(["", "threads", *columns.values(), *(f"ours / it, {name}" for name in columns.values())], body)
    two = next((r for r in rows if r["label"] == OURS and r["threads"] == 2), None)
    tape = next((r for r in rows if r["label"] == TAPE), None)
    if two and tape:
        ratios = [number(faster(tape, two, "forward_backward", kind)) for kind in ("wall", "best")]
        print(f"Ours on two threads against the tape, which has one: median {ratios[0]}, best {ratios[1]}\n")


def memory_table(device: str, scene: Workload) -> dict[str, list[int | None]]:
    """Peak memory of forward + backward of everything that is differentiable, over the length of the rollout."""
    wanted = [Job(OURS, "ours")]
    if device == "cpu":
        wanted += [Job(OURS, "ours", 2), Job(TAPE, "warp_tape")]
    scenes = [replace(scene, frames=frames) for frames in MEMORY_FRAMES]
    found = {f"{job.label}, {threads_of(job)}": [memory(job, s, device) for s in scenes] for job in wanted}
    size = f"{scene.particles} particles, {scene.substeps_per_frame} substeps a frame"
    print(f"**Memory** [MB] of forward + backward, {size}")
    rows = [[name, *(number(b and b / 1e6) for b in sizes)] for name, sizes in found.items()]
    table(["", *(f"{frames} frames" for frames in MEMORY_FRAMES)], rows)
    return found


def contact_table(scene: Workload, device: str, rounds: int) -> dict[str, float]:
    """How many times slower ours is with ground, friction, grip and differing stiffness."""
    rows = run(contact_jobs(device), scene, device, rounds)
    slower, body = {}, []
    for free, held in zip(rows[::2], rows[1::2], strict=True):
        kind = basis(free, device)
        ratios = {what: free[what][kind] / held[what][kind] for what in WORK}
        slower[str(free["threads"])] = ratios
        body.append([str(free["threads"]), *(number(r[w][kind]) for w in WORK for r in (free, held)),
                     *(number(ratios[w]) for w in WORK)])  # fmt: skip
    print("**Standing on the ground** (friction 0.4) with eight stiffnesses and a grip of 240 bonds, against free")
    head = [
        "threads",
        "forward, free",
        "held",
        "forward + backward, free",
        "held",
        "forward slower by",
        "both slower by",
    ]
    table(head, body)
    return slower


def batch_table(scene: Workload, device: str, rounds: int) -> dict[str, float]:
    """How many times the rate of one small rollout many of them reach at once."""
    rollouts, particles = BATCH
    threads = 1 if device != "cpu" else 2
    wanted = [Job(f"{n} of {particles} particles", "ours", threads, rollouts=n) for n in (1, rollouts)]
    rows = run(wanted, replace(scene, particles=particles), device, rounds)
    if len(rows) < len(wanted):
        return {}
    ratios = {what: rows[1][what]["wall"] / rows[0][what]["wall"] for what in WORK}
    print(f"**{rollouts} rollouts at once**, millions of particle-substeps per second of wall time")
    body = [[r["label"], *(number(r[what]["wall"]) for what in WORK)] for r in rows]
    table(["", "forward", "forward + backward"], [*body, ["ratio", *(number(ratios[what]) for what in WORK)]])
    return ratios


def sweeps(device: str, rounds: int) -> dict[str, list[dict]]:
    """How time and memory grow with particles, with substeps per frame and with frames; ours beside the tape."""
    base = Workload(frames=4)
    sizes = SIZES if device == "cpu" else CUDA_SIZES
    grids = {
        "particles": [replace(base, particles=n, frames=2) for n in sizes],
        "substeps_per_frame": [replace(base, substeps_per_frame=s) for s in (25, 50, 100, 200)],
        "frames": [replace(base, frames=f) for f in (2, 4, 8, 16)],
    }
    found = {}
    for name, scenes in grids.items():
        found[name], body = [], []
        for scene in scenes:
            ours = single(Job(OURS, "ours"), scene, device, rounds)
            small = device == "cpu" and scene.work <= TAPE_SUBSTEPS * base.particles and scene.substeps <= TAPE_SUBSTEPS
            tape = single(Job(TAPE, "warp_tape"), scene, device, 1) if small else None
            found[name].append({name: getattr(scene, name), "ours": ours, "tape": tape})
            columns = [s and s[k] for k in (*WORK, "bytes") for s in (ours, tape)]
            columns[4:] = [b and b / 1e6 for b in columns[4:]]
            body.append([str(getattr(scene, name)), *map(number, columns)])
        fixed = ", ".join(f"{getattr(scenes[0], k)} {k.replace('_', ' ')}" for k in grids if k != name)
        print(f"**{name.replace('_', ' ')}**, one thread, {fixed}")
        head = ["", "forward [s]", "tape", "forward + backward [s]", "tape", "memory [MB]", "tape"]
        table(head, body)
    return found


def machine(device: str) -> str:
    """Name of the processor or card that does the work, and of the software."""
    import torch
    import warp as wp

    software = f"torch {torch.__version__}, warp {wp.__version__}"
    if device != "cpu":
        return f"{torch.cuda.get_device_name(device)}, {software}"
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    load = f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
    return f"{names[0] if names else platform.processor()}, {load}, {software}"


# --- what is run ----------------------------------------------------------------------------------------------------


def quick(scene: Workload, began: float, before: Path | None) -> dict:
    """Ours against the tape on one thread, as many rounds as fit."""
    rows = run(
        [Job(OURS, "ours"), Job(TAPE, "warp_tape"), *earlier(before, (1,))], scene, "cpu", 5, began + QUICK_UNTIL
    )
    rate_tables(rows, "cpu")
    ours, tape = rows[:2]
    ratio = faster(tape, ours, "forward_backward", "processor")
    print(f"forward + backward, tape's time over ours: {ratio:.3g}")
    by_count = {what: {str(scene.particles): ours[what]["processor"]} for what in WORK}
    return {
        "particles": scene.particles, "substeps": scene.substeps, "ratio_tape_over_ours": ratio,
        "forward_mpss": by_count["forward"], "forward_backward_mpss": by_count["forward_backward"],
        "tape_forward_mpss": tape["forward"]["processor"],
        "tape_forward_backward_mpss": tape["forward_backward"]["processor"],
    }  # fmt: skip


def full(scene: Workload, device: str, rounds: int, warp_mpm: str, before: Path | None, rates_only: bool) -> dict:
    """Rates, memory, contact and batch; on CUDA the rates at several sizes."""
    by_size = {}
    for particles in (scene.particles,) if device == "cpu" else RATED:
        print(f"## {particles} particles, {scene.substeps} substeps")
        by_size[particles] = run(jobs(device, warp_mpm, before), replace(scene, particles=particles), device, rounds)
        rate_tables(by_size[particles], device)
    result = {"rows": {str(n): rows for n, rows in by_size.items()}, "substeps": scene.substeps}
    for what in WORK:
        ours = {str(n): rows[0][what][basis(rows[0], device)] for n, rows in by_size.items()}
        result[f"{what}_mpss"] = ours
    if rates_only:
        return result
    result["memory_bytes"] = memory_table(device, scene)
    result["contact_slower"] = contact_table(scene, device, rounds)
    result["batch_faster"] = batch_table(scene, device, rounds)
    return result


def main() -> None:
    began = time.monotonic()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu", help="cpu or cuda:0")
    parser.add_argument("--quick", action="store_true", help="ours against the Warp tape, one thread, within 50 s")
    parser.add_argument("--sweep", action="store_true", help="how cost grows with particles, substeps and frames")
    parser.add_argument("--warp-mpm", default="", metavar="PATH", help="a checkout of the public warp-mpm repository")
    parser.add_argument(
        "--before", type=Path, metavar="FOLDER", help="an earlier checkout of this project, measured in turn"
    )
    parser.add_argument("--rates-only", action="store_true", help="no memory, contact and batches")
    parser.add_argument("--particles", type=int, default=20_000)
    parser.add_argument("--frames", type=int, help="of 50 substeps; 2 on the CPU, 8 on CUDA if not given")
    parser.add_argument("--rounds", type=int, default=5, help="measurements of each implementation")
    parser.add_argument("--json", type=Path, help="write the numbers there as well")
    args = parser.parse_args()
    print(f"{machine(args.device)}\n", flush=True)
    if args.quick:
        result = quick(Workload(args.particles, frames=1, substeps_per_frame=50), began, args.before)
    else:
        frames = args.frames or (2 if args.device == "cpu" else 8)
        result = full(
            Workload(args.particles, frames), args.device, args.rounds, args.warp_mpm, args.before, args.rates_only
        )
        if args.sweep:
            result["sweeps"] = sweeps(args.device, rounds=2)
    if args.json:
        result = {"machine": machine(args.device), "device": args.device} | result
        args.json.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
