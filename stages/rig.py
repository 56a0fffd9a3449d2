"""Stage rig: makes a capture with known truth, by a simulator that is not ours."""

from data.rig.capture import make_capture
from data.rig.parameters import build_scene
from pipeline.stage import StageContext, main


def run(context: StageContext) -> None:
    """Simulate and film the scene that has the sequence's name."""
    scene = build_scene(context.sequence, context.params)
    with context.timed("simulate and film"):
        make_capture(scene, context.output, seed=context.seed, timestep=context.params.timestep)


if __name__ == "__main__":
    main("rig", run)
