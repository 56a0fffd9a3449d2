"""A tiny pipeline of three toy stages on the real StageContext: load, descend (a real fit loop with checkpoints), report."""

import os
import signal
import sys
from pathlib import Path

import numpy as np
from pydantic import Field

from pipeline.config import StageParameters
from pipeline.graph import Stage, graph_of
from pipeline.stage import StageContext, main


class Load(StageParameters):
    points: int = Field(50, ge=3, description="number of points [1]")
    noise: float = Field(0.1, ge=0, description="their noise [m]")


class Descend(StageParameters):
    iterations: int = Field(60, ge=1, description="steps of gradient descent")
    rate: float = Field(0.05, gt=0, description="step size")


class Report(StageParameters):
    digits: int = Field(3, ge=0, description="decimals")


GRAPH = graph_of(
    Stage("load", reads_capture=True, model=lambda: Load),
    Stage("descend", ("load",), model=lambda: Descend),
    Stage("tell", ("descend",), model=lambda: Report),
)


def load(context: StageContext) -> None:
    """Noisy points of a parabola."""
    random = np.random.default_rng(context.seed)
    x = np.linspace(-1, 1, context.params.points)
    slope = float((context.capture / "slope.txt").read_text())
    np.savez(context.output / "points.npz", x=x, y=slope * x**2 + context.params.noise * random.normal(size=x.shape))


def descend(context: StageContext) -> None:
    """Fit a cubic by gradient descent with momentum, a checkpoint every fifth step; PHYSREAL_KILL_AT kills it there."""
    points = np.load(context.input("load") / "points.npz")
    basis = np.stack([points["x"] ** k for k in range(4)], axis=1)
    checkpoint = context.scratch / "checkpoint.npy"
    state = np.load(checkpoint) if checkpoint.exists() else np.zeros(9)
    with context.progress("descend", context.params.iterations) as bar:
        bar.resume_at(int(state[8]))
        while state[8] < context.params.iterations:
            coefficients, momentum = state[:4], state[4:8]
            gradient = basis.T @ (basis @ coefficients - points["y"]) / len(basis)
            momentum = 0.9 * momentum - context.params.rate * gradient
            state = np.concatenate([coefficients + momentum, momentum, [state[8] + 1]])
            bar.advance()
            if state[8] % 5 == 0:
                np.save(context.scratch / "new.npy", state)
                os.replace(context.scratch / "new.npy", checkpoint)
            np.save(context.output / "half_written.npy", state)
            if state[8] == int(os.environ.get("PHYSREAL_KILL_AT", "-1")):
                os.kill(os.getpid(), signal.SIGKILL)
    np.save(context.output / "coefficients.npy", state[:4])
    (context.output / "half_written.npy").unlink()


def tell(context: StageContext) -> None:
    """The coefficients in words."""
    coefficients = np.load(context.input("descend") / "coefficients.npy")
    (context.output / "words.txt").write_text(np.array2string(coefficients, precision=context.params.digits))


if __name__ == "__main__":
    stage = sys.argv.pop(1)
    sys.path.insert(0, str(Path(__file__).parent))
    main(stage, {"load": load, "descend": descend, "tell": tell}[stage], GRAPH)
