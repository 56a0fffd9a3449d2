"""Stage rig: makes a capture with known truth, by a simulator that is not ours."""

from data.rig.bars import BARS
from data.rig.capture import make_capture
from data.rig.case import record_motion
from data.rig.parameters import build_scene
from pipeline.stage import StageContext, main


def run(context: StageContext) -> None:
    """Simulate and film the scene that has the sequence's name; of a bar, record its points."""
    if bar := BARS.get(context.sequence):
        with context.timed("simulate and record"):
            record_motion(bar.case(context.params, context.seed), bar.motion, context.output, video=False)
        return
    params = context.params
    scene = build_scene(params.film or context.sequence, params)
    with context.timed("simulate and film"):
        make_capture(scene, context.output, seed=context.seed, timestep=params.timestep, shape=params.shape)


if __name__ == "__main__":
    main("rig", run)
