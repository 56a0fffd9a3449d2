"""Stage measure_body: how large and how heavy the object is in frame 0, for comparison with a ruler and a scale."""

import json

import numpy as np

from pipeline.capture import read_capture
from pipeline.config.measure_body import MeasureBody
from pipeline.products.placed_object import PlacedObject
from pipeline.stage import StageContext, main


def run(context: StageContext) -> None:
    """body.json: extent [m] along the principal axes, longest first; volume [m3]; mass [kg] where a density is known."""
    params: MeasureBody = context.params
    mesh = PlacedObject.load(context.input("fit_pose")).mesh
    density = params.density or read_capture(context.input("parse_video")).density
    centred = mesh.vertices - mesh.vertices.mean(0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    record = {
        "extent": np.ptp(centred @ axes.T, axis=0).tolist(),
        "volume": mesh.volume,
        "mass": None if density is None else density * mesh.volume,
    }
    (context.output / "body.json").write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main("measure_body", run)
