"""Made-up answers of the search, as they lie in a case's folder, and rows of them."""

from benchmarks.gap.rows import answered, hidden


def effect(name, values, width=0.1):
    """One effect as fitted, with intervals of plus and minus `width`."""
    intervals = {key: [value - width, value + width] for key, value in values.items()}
    return {"name": name, "values": values, "intervals": intervals, "units": {}}


NOTHING = {"effects": [], "screened": None, "gain": 0.0, "held_out": 0.0, "probability": 0.01, "left": 4e-4}


def answer(kind, members, probability, fitted=(), closed=0.5, seconds=100.0, lead=()):
    """Members by names; the first is the best. Candidates: the members, then "none"."""
    by_name = {entry["name"]: entry for entry in fitted}
    candidates = [
        {
            "effects": [by_name.get(n, effect(n, {})) for n in names],
            "screened": 5.0 - i,
            "gain": 4.0,
            "held_out": 1.0,
            "probability": 0.9 / (i + 1),
            "left": 3e-4,
        }
        for i, names in enumerate(members)
    ]
    candidates.append(NOTHING)
    verdict = {"kind": kind, "names": members[0] if members else [], "members": members, "probability": probability}
    report = {"verdict": verdict, "candidates": candidates, "test": {"left": 4e-4}, "numerical_floor": [2e-4]}
    if lead:
        report["lead"] = {"terms": [{"term": {"formula": formula}} for formula in lead]}
    return {"report": report, "added": {"adopted": bool(members), "closed": closed}, "seconds": seconds}


def oracle(closed=0.6, true=0.8):
    """Shares of the gap on the motion that was kept out that the answer and the true model close."""
    return {"closed": closed, "oracle": true}


def told(values=None, visible=0.005, held_out=0.004, seen=("shake", "press_drag")):
    """What the rig knows of a case; `visible` [m] in what was seen, `held_out` [m] in the motion that was kept out."""
    return {
        "forms": {},
        "seen": list(seen),
        "held_out": "lift_swing",
        "fps": 50.0,
        "seconds": {},
        "unknowns": {},
        "values": values or {},
        "visible": {seen[0]: visible, seen[1]: visible / 2, "lift_swing": held_out},
    }


def row(case, found, true=None, truth=None, commit="abc", seed=7):
    """A row of a made-up answer; `found` None for a case that failed."""
    begun = {"case": case.name, "variant": "tracks_only", "set": seed, "commit": commit}
    said = (
        {"verdict": "failed", "failed": "no convergence"} if found is None else answered(case, found, true or oracle())
    )
    return {**begun, **hidden(case, truth or told()), **said}
