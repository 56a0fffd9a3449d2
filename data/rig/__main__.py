"""`python -m data.rig plush_lift --seed 0 --out data/captures/plush_lift`: makes a capture with known truth."""

import argparse
from pathlib import Path
from typing import get_args

from data.rig.bars import BARS
from data.rig.capture import make_capture, make_sequence
from data.rig.case import record_motion
from data.rig.parameters import Rig, build_scene
from data.rig.rig_scene import SCENES
from data.rig.sequences import SEQUENCES
from data.rig.thin_scenes import THIN_SCENES


def main() -> None:
    """Reads the command line; every knob of `Rig` is an option of the scenes that are no sequences for perception."""
    parser = argparse.ArgumentParser(prog="python -m data.rig", description=__doc__)
    parser.add_argument("scene", choices=sorted({**SCENES, **THIN_SCENES, **SEQUENCES, **BARS}))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="capture folder; default data/captures/<scene>")
    for name, field in Rig.model_fields.items():
        if name == "film":
            continue  # it is the scene
        option = "--" + name.replace("_", "-")
        choices = get_args(field.annotation)
        kind = str if choices else field.annotation
        text = (field.description or "").replace("%", "%%")  # argparse formats it
        parser.add_argument(option, type=kind, choices=choices or None, default=field.default, help=text)
    arguments = vars(parser.parse_args())
    name, seed, out = (arguments.pop(key) for key in ("scene", "seed", "out"))
    parameters = Rig(**arguments)
    destination = out or Path("data/captures") / name
    if name in BARS:
        record_motion(BARS[name].case(parameters, seed), BARS[name].motion, destination, video=False)
    elif name in SEQUENCES:
        make_sequence(name, seed, destination)
    else:
        scene = build_scene(name, parameters)
        make_capture(scene, destination, seed=seed, timestep=parameters.timestep, shape=parameters.shape)
    print(f"wrote {destination}")


if __name__ == "__main__":
    main()
