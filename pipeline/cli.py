"""`physreal`: compose and check the parameters, bring captures in, run one stage, say how far things are.

Every command imports what it needs when it runs, so that help and checks start in a fraction of a second.
"""

import argparse
import os
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path

from physreal_core.errors import InputError
from pipeline.faults import one_sentence


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command; exit code 2 and one plain sentence for what the user can mend."""
    parser = _parser()
    parsed, more = parser.parse_known_args(arguments)
    if more and not (hasattr(parsed, "options") and all("=" in word and word[0] != "-" for word in more)):
        parser.error(f"unrecognized arguments: {' '.join(more)}")
    if more:  # key=value after a flag, which argparse leaves over
        parsed.options += more
    with one_sentence("physreal"):
        code = parsed.command(parsed)
    sys.exit(code)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="physreal", description="From one RGB-D video to a simulatable twin.")
    commands = parser.add_subparsers(required=True, metavar="command")

    command = commands.add_parser(
        "compose", help="write params.yaml, by the options in pipeline/conf, and the dvc.yaml files"
    )
    command.add_argument("options", nargs="*", help="group=option (fit_global=von_mises) or key=value")
    command.add_argument("--check", action="store_true", help="write nothing; fail if a file is not what they give")
    command.set_defaults(command=_compose)

    command = commands.add_parser("check", help="validate params.yaml and the captures, without running anything")
    command.add_argument("captures", nargs="*", help="capture folders; default: those of the sequences in params.yaml")
    command.set_defaults(command=_check)

    command = commands.add_parser("import", help="turn a recording into a capture; without arguments: which kinds")
    command.add_argument("kind", nargs="?")
    command.add_argument("source", nargs="?", type=Path, help="the recording's folder or file")
    command.add_argument("name", nargs="?", help="name of the new sequence")
    command.add_argument("options", nargs="*", help="key=value for the importer, e.g. fps=30 camera=1")
    command.add_argument("--clip", action="store_true", help="perception only: no model will be fitted")
    command.set_defaults(command=_import)

    command = commands.add_parser("add", help="enter a capture folder that is there already in params.yaml")
    command.add_argument("name", help="its name in data/captures")
    command.add_argument("--clip", action="store_true", help="perception only: no model will be fitted")
    command.set_defaults(command=_add)

    command = commands.add_parser("models", help="fetch and convert the pretrained networks into data/models")
    command.add_argument("names", nargs="*", help="which; default: those the default configuration needs; text; all")
    command.set_defaults(command=_models)

    command = commands.add_parser("status", help="how far every sequence is, and where the report lies")
    command.set_defaults(command=_status)

    command = commands.add_parser(
        "gap", help="where a fitted sequence's model is wrong, what is missing, what it helps"
    )
    command.add_argument("sequence", help="a name under `fits` in params.yaml")
    command.add_argument("--again", action="store_true", help="search anew, even if the result at hand is up to date")
    command.set_defaults(command=_gap)

    command = commands.add_parser("label", help="a page to click object and hand in any frame, and to mend masks")
    command.add_argument("sequence", help="a name under `sequences` or `clips` in params.yaml")
    _page_options(command, 8765)
    command.set_defaults(command=_label)

    command = commands.add_parser(
        "play",
        help="a page to pull, pin and change a fitted twin; or a video of that, without a browser",
        description="The fitted twin in the browser: drag to pull it, with Shift to pin it; change its stiffness, its friction and every "
        "effect while it moves. Every pull is written as a capture.",
        epilog="examples: physreal play plush_lift; physreal play bar_lift --beside; physreal play plush_lift --record lift.mp4; "
        "physreal play plush_lift --backdrop filmed; "
        "physreal play --replay data/played/plush_lift/pull_001 --record again.mp4",
    )
    command.add_argument(
        "sequence", nargs="?", help="a name under `fits` or `predictions` in params.yaml; with --replay that of the log"
    )
    command.add_argument(
        "--model", default=None, help="the fit stage whose model it is; default: the last, fit_residual"
    )
    command.add_argument("--beside", action="store_true", help="the twin without its named effects beside it")
    command.add_argument(
        "--interval",
        action="store_true",
        help="intervals of the forces: the softest and the stiffest body that the fit leaves open are pulled along",
    )
    command.add_argument("--ball", type=float, metavar="RADIUS", help="a ball of this radius [m] to push the body with")
    _scene_option(command)
    _backdrop_option(command)
    command.add_argument("--device", default="cpu", help="of the simulator: cpu or cuda:0")
    command.add_argument("--captures", type=Path, help="folder of the pulls' captures; default: data/played/SEQUENCE")
    command.add_argument(
        "--replay", type=Path, metavar="LOG", help="do what a log.json says, or that of a pull's folder"
    )
    command.add_argument("--record", type=Path, metavar="MP4", help="no page: write a video, and the states beside it")
    command.add_argument("--frames", type=int, help="of the video; default: those of the log, or of the filmed motion")
    _page_options(command, 8080)
    command.set_defaults(command=_application("play"))

    command = commands.add_parser(
        "plan",
        help="where the hand has to go so that a fitted twin comes to be where it is wanted",
        description="Plans with the fitted model and others that the fit leaves open. The goal is points and their places (.json), a mask in the "
        "filmed camera (.png), or a shape (.ply, .glb, .obj).",
        epilog="examples: physreal plan plush_lift --goal points.json; physreal plan plush_lift --goal shape.ply --bounds -0.1 -0.1 0 0.2 0.2 0.2; "
        "physreal plan plush_lift --goal mask.png --open --grasp 0.08 0 0.05 --grasp -0.1 0 0.03",
    )
    command.add_argument("sequence", help="a name under `fits` or `predictions` in params.yaml")
    command.add_argument("--goal", type=Path, required=True, metavar="FILE", help="points.json, mask.png or shape.ply")
    command.add_argument(
        "--model", default=None, help="the fit stage whose model it is; default: the last, fit_residual"
    )
    command.add_argument("--seconds", type=float, default=1.5, help="of the plan; default: 1.5")
    command.add_argument(
        "--bounds",
        type=float,
        nargs=6,
        metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"),
        help="box in which the centre of each hand stays [m]; default: 25 cm around where it begins, and not below",
    )
    command.add_argument("--speed", type=float, default=0.6, help="largest of the hand [m/s]; default: 0.6")
    command.add_argument(
        "--grasp",
        type=float,
        nargs=3,
        action="append",
        default=[],
        metavar=("X", "Y", "Z"),
        help="a further hand that takes the body at this place in frame 0 [m]; may be given twice",
    )
    command.add_argument("--open", action="store_true", help="the filmed hand does not hold; needs --grasp")
    command.add_argument("--models", type=int, default=3, help="how many, the fit among them; default: 3")
    command.add_argument(
        "--quantile", type=float, help="of the models' costs that counts, 1 for the dearest; default: their mean"
    )
    command.add_argument("--rounds", type=int, help="of the search; default: 6")
    _scene_option(command)
    command.add_argument("--seed", type=int, default=0, help="of the search and of the models; default: 0")
    command.add_argument("--device", default="cpu", help="of the simulator: cpu or cuda:0")
    command.add_argument("--record", action="store_true", help="a video of what the fitted model does beside the plan")
    command.add_argument("--to", type=Path, metavar="FOLDER", help="default: data/planned/SEQUENCE/GOAL")
    command.set_defaults(command=_application("plan"))

    command = commands.add_parser(
        "live",
        help="a fitted twin that follows a stream of measurements, and tells when it no longer understands them",
        description="Replays a recorded sequence in real time and has the twin follow it. Frames for which there is no time are not looked at.",
        epilog="examples: physreal live plush_push; physreal live plush_lift --coarser 1.5 --record; physreal live bar_press --speed 0; "
        "physreal live plush_push --learn 0.3",
    )
    command.add_argument("sequence", help="a name under `fits` or `predictions` in params.yaml")
    command.add_argument(
        "--model", default=None, help="the fit stage whose model it is; default: the last, fit_residual"
    )
    command.add_argument(
        "--speed", type=float, default=1.0, help="of the stream over real time; 0: as fast as it goes; default: 1"
    )
    command.add_argument("--coarser", type=float, default=1.0, help="factor of the particles' spacing; default: 1")
    command.add_argument(
        "--learn",
        type=float,
        metavar="SPREAD",
        help="learn a factor on Young's modulus from the stream, too; SPREAD is how far the fit's may be off (0.3: by 30 %%)",
    )
    command.add_argument("--device", default="cpu", help="of the simulator: cpu or cuda:0")
    command.add_argument("--record", action="store_true", help="a video of the twin as the filmed camera would see it")
    command.add_argument("--to", type=Path, metavar="FOLDER", help="default: data/followed/SEQUENCE")
    command.set_defaults(command=_live)

    command = commands.add_parser(
        "generate",
        help="episodes of a hand that takes a fitted twin and moves it, as data for robots",
        description="Random grasps and ways of a hand, with material, camera, light and background drawn anew each time. Written as a "
        "LeRobotDataset v3.0 and as robomimic's HDF5. A killed run goes on where it was.",
        epilog="examples: physreal generate plush_lift --episodes 100; physreal generate plush_lift --episodes 10 --plain --to /tmp/plain; "
        "physreal generate plush_lift --episodes 1000 --coarser 1.5 --scale 0.5 --task 'lift the plush animal'; "
        "physreal generate plush_lift --episodes 100 --arm viperx; physreal generate plush_lift --episodes 100 --backdrop room.ply",
    )
    command.add_argument("sequence", help="a name under `fits` or `predictions` in params.yaml")
    command.add_argument("--episodes", type=int, default=10, help="how many; default: 10")
    command.add_argument("--seconds", type=float, default=3.0, help="of an episode; default: 3")
    command.add_argument(
        "--model", default=None, help="the fit stage whose model it is; default: the last, fit_residual"
    )
    command.add_argument("--scale", type=float, default=1.0, help="of the pictures over the filmed ones; default: 1")
    command.add_argument(
        "--coarser",
        type=float,
        default=1.0,
        help="factor of the particles' spacing; 1.5 is 1.6 times as fast; default: 1",
    )
    command.add_argument(
        "--pushes",
        type=float,
        default=0.0,
        help="share of the episodes in which the closed hand pushes the body; default: 0",
    )
    command.add_argument("--squeeze", type=float, default=10.0, help="force of each finger [N]; default: 10")
    command.add_argument(
        "--arm",
        choices=["viperx"],
        help="a robot arm that has the hand: joints as states and actions, the arm in the pictures",
    )
    _scene_option(command)
    _backdrop_option(command)
    command.add_argument("--plain", action="store_true", help="the fitted material, in the filmed view and light")
    command.add_argument(
        "--around",
        type=float,
        default=0.0,
        metavar="DEGREES",
        help="how far the camera goes around the body, at most, to either side; default: 0",
    )
    command.add_argument("--task", default="take the soft object, move it and let it go", help="what is done, in words")
    command.add_argument("--seed", type=int, default=0, help="of all that is drawn; default: 0")
    command.add_argument("--jobs", type=int, help="processes; default: one a core")
    command.add_argument("--device", default="cpu", help="of the simulator: cpu or cuda:0")
    command.add_argument("--to", type=Path, metavar="FOLDER", help="default: data/generated/SEQUENCE")
    command.set_defaults(command=_application("generate"))

    command = commands.add_parser(
        "export",
        help="the twin for other tools: splats, glTF, USD, a web page, MuJoCo",
        description="What a fitted model makes of the filmed hand's way, in a folder of its own; mjcf, newton: the model itself, to be simulated on.",
        epilog="examples: physreal export plush_lift --format gltf; physreal export plush_push --format usd --to /tmp/plush; "
        "physreal export plush_lift --format page; physreal export bar_lift --format mjcf",
    )
    command.add_argument("sequence", help="a name under `fits` or `predictions` in params.yaml")
    command.add_argument(
        "--format",
        choices=("splats", "gltf", "usd", "mjcf", "newton", "page"),
        required=True,
        help="a .ply a frame; a .glb; a .usdc; a MuJoCo model with the material; an .html that plays the splats",
    )
    command.add_argument(
        "--model", default=None, help="the fit stage whose model it is; default: the last, fit_residual"
    )
    command.add_argument("--to", type=Path, metavar="FOLDER", help="default: data/exported/SEQUENCE/FORMAT")
    command.set_defaults(command=_application("export"))

    command = commands.add_parser("clean", help="delete what is kept so that the next runs are faster")
    command.set_defaults(command=_clean)

    command = commands.add_parser("run", help="run one stage on one sequence, without DVC")
    command.add_argument("stage")
    command.add_argument("sequence")
    command.set_defaults(command=_run)
    return parser


def _scene_option(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--scene",
        type=Path,
        metavar="MESH",
        help="what stands around the twin, as a box or a shelf: closed meshes in a .glb, .obj, .stl or .ply, in the world's frame [m]",
    )


def _backdrop_option(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--backdrop",
        metavar="SPLATS",
        help="what is seen behind the twin and touches nothing: `filmed`, for what the recording shows beside object and hand, or splats in a "
        ".ply, in the world's frame [m]",
    )


def _page_options(command: argparse.ArgumentParser, port: int) -> None:
    """Where a page is served, `port` by default."""
    command.add_argument("--port", type=int, help=f"default: {port}")
    command.add_argument("--host", help="address to listen on; default: 127.0.0.1, so this machine alone")
    command.add_argument("--no-browser", action="store_true", help="open no browser; print the address alone")


def _compose(parsed: argparse.Namespace) -> int:
    from pipeline.compose import composed_files, options_in, stale_files, write_composed
    from pipeline.project import Project

    project = Project.find()
    options = parsed.options or (options_in(project.parameters) if parsed.check else [])
    command = " ".join(["physreal compose", *options])
    files = composed_files(options, project)
    if parsed.check:
        stale = stale_files(files)
        names = ", ".join(str(path.relative_to(project.root)) for path in stale)
        if stale:
            print(f"stale: {names}; run `{command}`", file=sys.stderr)
            return 1
    else:
        for line in write_composed(files, project):
            print(line)
    print(f"{len(files)} files are what `{command}` gives")
    return 0


def _check(parsed: argparse.Namespace) -> int:
    from pipeline.check import examine, purpose_of, tell
    from pipeline.config import load_parameters
    from pipeline.project import Project

    project = Project.find()
    parameters = load_parameters(project.parameters)
    print(f"{project.parameters}: {len(parameters.sequences)} sequences, every key known and in range")
    folders = [Path(name) for name in parsed.captures] or [project.capture(name) for name in parameters.sequences]
    faults = 0
    for folder in folders:
        if not folder.exists() and folder.name in parameters.values.rigged:
            print(f"{folder}: not there yet; `dvc repro` makes it")
            continue
        summary, found = examine(folder, purpose_of(folder, project, parameters))
        tell(found.warnings)
        for fault in found.faults:
            print(f"physreal: {fault}", file=sys.stderr)
        faults += len(found.faults)
        count = f"{len(found.faults)} fault{'s'[: len(found.faults) - 1]}; " if found.faults else ""
        print(f"{folder}: {count}{summary or 'not read any further'}")
    return 2 if faults else 0


def _import(parsed: argparse.Namespace) -> int:
    from pipeline.importing import import_capture, kinds
    from pipeline.project import Project

    if parsed.kind is None:
        print("\n".join(f"{name:14} {text}" for name, text in kinds().items()))
        return 0
    if parsed.name is None:
        raise InputError(
            "a recording and a name are missing" if parsed.source is None else "a name is missing",
            where=f"physreal import {parsed.kind}",
            expected="physreal import KIND SOURCE NAME [key=value ...]",
            remedy="name the kind, the recording and the new sequence",
        )
    role = "clips" if parsed.clip else "fits"
    print(import_capture(parsed.kind, parsed.source, parsed.name, parsed.options, role, Project.find()))
    return 0


def _add(parsed: argparse.Namespace) -> int:
    from pipeline.importing import add_sequence
    from pipeline.project import Project

    print(add_sequence(parsed.name, "clips" if parsed.clip else "fits", Project.find()))
    return 0


def _models(parsed: argparse.Namespace) -> int:
    from pipeline.models import fetch

    fetch(parsed.names)
    return 0


def _status(_: argparse.Namespace) -> int:
    from pipeline.status import print_status

    print_status()
    return 0


def _gap(parsed: argparse.Namespace) -> int:
    from pipeline.gap_command import find_and_add

    find_and_add(parsed.sequence, again=parsed.again)
    return 0


def _label(parsed: argparse.Namespace) -> int:
    from pipeline.label.serve import HOST, PORT, serve

    serve(parsed.sequence, host=parsed.host or HOST, port=parsed.port or PORT, browser=not parsed.no_browser)
    return 0


def _application(name: str) -> Callable[[argparse.Namespace], int]:
    """Runs a command that stands above the pipeline, and is imported by its name for that."""

    def run(parsed: argparse.Namespace) -> int:
        getattr(import_module(f"applications.{name}.command"), name)(parsed)
        return 0

    return run


def _live(parsed: argparse.Namespace) -> int:
    # Before numpy is there: threads of OpenBLAS wait by spinning, on the cores that the simulator needs.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    return _application("live")(parsed)


def _clean(_: argparse.Namespace) -> int:
    import shutil

    from pipeline.project import Project

    kept = Project.find().kept
    size = sum(path.stat().st_size for path in kept.glob("*"))
    shutil.rmtree(kept, ignore_errors=True)
    print(f"{kept}: {size / 2**20:.1f} MiB deleted")
    return 0


def _run(parsed: argparse.Namespace) -> int:
    import runpy

    from pipeline.config import unknown_key
    from pipeline.graph import STAGES

    if parsed.stage not in STAGES:
        raise unknown_key(parsed.stage, parsed.stage, list(STAGES), "physreal run")
    sys.argv = [parsed.stage, parsed.sequence]
    runpy.run_module(f"stages.{parsed.stage}", run_name="__main__")
    return 0


if __name__ == "__main__":
    main()
