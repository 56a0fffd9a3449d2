"""Every case's answer as a row of JSON lines: all that a score needs, so that it can be taken again without the cases.

`benchmarks/results/gap/<variant>-seed<seed>.jsonl`. A row is of one case and of the commit that searched it.
"""

import fcntl
import json
import os
from collections.abc import Iterable
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from benchmarks.gap.cases import GapCase
from benchmarks.gap.commit import searched_by
from benchmarks.gap.files import read_json

FOLDER = Path("benchmarks/results/gap")

Row = dict[str, Any]


def row_of(case: GapCase, own: Path, *, variant: str, seed: int) -> Row | None:
    """The row of a case in the folder `own`; None where it has neither an answer with its score nor failed.

    Args:
        case: which.
        own: its folder.
        variant, seed: of the set.
    """
    truth, answer, oracle = (read_json(own / f"{name}.json") for name in ("truth/case", "answer", "oracle"))
    failed = own / "failed.txt"
    if failed.is_file():
        lines = failed.read_text().strip().splitlines()
        found = {"verdict": "failed", "failed": lines[-1] if lines else "it failed"}
    elif answer is None or oracle is None:
        return None
    else:
        found = answered(case, answer, oracle)
    begun = {"case": case.name, "variant": variant, "set": seed, "commit": (answer or {}).get("commit", searched_by())}
    return {**begun, **hidden(case, truth or {}), **found}


def hidden(case: GapCase, truth: Row) -> Row:
    """What a case hides, how it was filmed, and how visible it is.

    Args:
        case: which.
        truth: as of `data.rig.case.told`; empty where the captures were not made.
    """
    visible = truth.get("visible")
    return {
        "effect": case.effect,
        "kind": case.kind,
        "strength": case.strength,
        "seed": case.seed,
        "body": case.body,
        "form": case.form,
        "forms": truth.get("forms", {}),
        "seen": truth.get("seen", []),
        "held_out": truth.get("held_out"),
        "fps": truth.get("fps"),
        "seconds_filmed": truth.get("seconds", {}),
        "unknowns": truth.get("unknowns", {}),
        "visibility": None if visible is None else max(visible[motion] for motion in truth["seen"]),
        "visibility_by_motion": visible or {},
        "truth": truth.get("values", {}),
    }


def answered(case: GapCase, answer: Row, oracle: Row) -> Row:
    """What the search said of it, and what that is worth on the motion that was kept out."""
    report, added = answer["report"], answer["added"]
    verdict, candidates = report["verdict"], report["candidates"]
    lead = report.get("lead") or {}
    return {
        "verdict": verdict["kind"],
        "names": verdict["names"],
        "members": verdict["members"],
        "probability": verdict["probability"],
        "candidates": [_candidate(c) for c in candidates if c["gain"] is not None],
        "rank": _rank(candidates, case.truth, "probability"),
        "screened": _rank(candidates, case.truth, "screened"),
        "coefficients": {e["name"]: _numbers(e) for e in _fitted(candidates, verdict["names"])},
        "test": report["test"],
        "numerical_floor": report["numerical_floor"],
        "lead": [entry["term"]["formula"] for entry in lead.get("terms", [])],
        "adopted": bool(added.get("adopted")),
        "closed": oracle.get("closed"),
        "oracle": oracle.get("oracle"),
        "seconds": answer.get("seconds"),
        "seconds_naming": answer.get("seconds_naming"),
    }


def rows_file(folder: Path, variant: str, seed: int) -> Path:
    """Where the rows of a set lie."""
    return folder / f"{variant}-seed{seed}.jsonl"


def read_rows(path: Path) -> list[Row]:
    """All rows of a file; none where there is no file."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.is_file() else []


def put_rows(path: Path, rows: Iterable[Row]) -> None:
    """Puts rows in a file, in place of those of the same case and commit. Whoever reads it finds the old rows or the new ones; of two
    that write at once one waits."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with _alone(path):
        kept = {_key(row): row for row in [*read_rows(path), *rows]}
        draft = path.with_name(f".{path.name}.{os.getpid()}")
        draft.write_text("".join(json.dumps(row) + "\n" for row in kept.values()))
        draft.replace(path)


@contextmanager
def _alone(path: Path):
    """Holds the lock on a file, which the system drops with the process."""
    with path.with_name(f".{path.name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _key(row: Row) -> tuple[str, str]:
    return row["case"], row["commit"]


def _candidate(candidate: Row) -> Row:
    own = {key: candidate[key] for key in ("gain", "held_out", "probability", "left")}
    return {"names": [effect["name"] for effect in candidate["effects"]], **own}


def _numbers(effect: Row) -> Row:
    """By coefficient: value and 90 % interval."""
    return {key: [value, effect["intervals"].get(key)] for key, value in effect["values"].items()}


def _fitted(candidates: list[Row], names: list[str]) -> list[Row]:
    """The effects of the candidate that has these names, as fitted."""
    for candidate in candidates:
        if sorted(effect["name"] for effect in candidate["effects"]) == sorted(names):
            return candidate["effects"]
    return []


def _rank(candidates: list[Row], truth: tuple[str, ...], key: str) -> int | None:
    """Place of the truth among the candidates by `key`, the largest first; those without it come last."""
    known = [c for c in candidates if c[key] is not None and (key != "probability" or c["gain"] is not None)]
    ordered = sorted(known, key=lambda c: -c[key])
    names = [tuple(sorted(effect["name"] for effect in candidate["effects"])) for candidate in ordered]
    return names.index(truth) + 1 if truth in names else None
