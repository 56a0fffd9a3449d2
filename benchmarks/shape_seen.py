"""What of a body is built from frame 0 alone, and what is not the body: `python -m benchmarks.shape_seen FOLDER`.

FOLDER holds cases of the rig that have been filmed and perceived (`python -m benchmarks.gap --rgbd-seen --film --out FOLDER`). A hand holds one end of
each body and hides it. The mesh that stands for the body is made anew by the code that runs, and set against the rig's own.

Writes `results/shape_seen.md`.
"""

import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh

from benchmarks.gap.cases import GapCase
from benchmarks.gap.commit import searched_by
from benchmarks.gap.filming import PERCEIVED
from benchmarks.gap.rgbd import kept_out_project, project_of
from benchmarks.thin.results import RESULTS
from physreal_core.geometry import mesh_from_view
from pipeline.project import Project
from stages._observation import read_first_frame

Shares = tuple[float, float, float]
"""Of one recording, as shares of the true volume: the whole that was built, what of the body is missing in it, what of it is not the body."""


def main(folder: Path) -> None:
    """Prints a line per recording, and writes a table of medians over the recordings of each body."""
    found: dict[str, list[Shares]] = defaultdict(list)
    for body, recording, shares in _recordings(folder):
        found[body].append(shares)
        print(f"{recording}: " + ", ".join(f"{share:.2f}" for share in shares), flush=True)
    found = dict(sorted(found.items())) | {"all": [shares for own in found.values() for shares in own]}
    page = "\n".join([*_HEAD, *(_row(body, own) for body, own in found.items()), ""])
    (RESULTS / "shape_seen.md").write_text(page)
    print(page)


_HEAD = f"""# The shape that a camera sees

A hand holds one end of a body of the rig and hides it; the body is built from frame 0 alone. Given: RGB-D with noise, camera, table, one click on the hand; masks are
those that were found. Shares of the true volume, medians over recordings, the worst in brackets. The rules of `mesh_from_view` for hands and flat tops were
chosen on the recordings of seed 118. `python -m benchmarks.shape_seen FOLDER`, commit {searched_by()}.

| body | recordings | built | missing | not the body |
|---|--:|--:|--:|--:|""".splitlines()


def _row(body: str, own: list[Shares]) -> str:
    shares = np.array(own)
    built, missing, beyond = np.median(shares, axis=0)
    _, most_missing, most_beyond = shares.max(0)
    return (
        f"| {body} | {len(own)} | {built:.2f} | {missing:.2f} ({most_missing:.2f}) | {beyond:.2f} ({most_beyond:.2f}) |"
    )


def _recordings(folder: Path) -> Iterator[tuple[str, str, Shares]]:
    """Body, name and shares of every recording that has been perceived."""
    for own in sorted(path.parent for path in folder.glob(f"rgbd_seen/*/{PERCEIVED}")):
        for project in (project_of(own, "seen"), kept_out_project(own, "seen")):
            for capture in sorted((project.root / "data" / "captures").iterdir()):
                with np.load(own / "truth" / f"{capture.name}.npz") as truth:
                    true = trimesh.Trimesh(truth["vertices"][0], truth["faces"])
                yield GapCase.named(own.name).body, f"{own.name} {capture.name}", _shares(project, capture.name, true)


def _shares(project: Project, recording: str, true: trimesh.Trimesh) -> Shares:
    seen = read_first_frame(*(project.artifact(stage, recording) for stage in ("parse_video", "segment_and_track")))
    mesh = mesh_from_view(seen)
    built = trimesh.Trimesh(mesh.vertices, mesh.faces)
    missing, beyond = (
        trimesh.boolean.difference(both, engine="manifold", check_volume=False).volume
        for both in ([true, built], [built, true])
    )
    return built.volume / true.volume, missing / true.volume, beyond / true.volume


if __name__ == "__main__":
    main(Path(sys.argv[1]))
