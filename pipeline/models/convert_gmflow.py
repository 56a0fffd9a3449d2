"""GMFlow from torch to ONNX at one image size. The network's own files are loaded as a package of their own, so that
the frame interpolation package around them (which needs VapourSynth and CUDA) is never imported; weights only, no pickle
code."""

import importlib
import sys
from pathlib import Path

INPUT_NAMES, OUTPUT_NAME = ("img0", "img1"), "flow"


def convert_gmflow(code: str | Path, weights: str | Path, destination: str | Path, size: tuple[int, int]) -> None:
    """Export `img0`, `img1` [1, 3, h, w] in 0 to 1 -> `flow` [1, 2, h, w] [px].

    Args:
        code: folder `gmflow` with the network's modules (checked against its hash by the caller).
        weights: its state dict.
        destination: the .onnx to write.
        size: (h, w), multiples of 64.
    """
    import torch

    code = Path(code)
    sys.path.insert(0, str(code.parent))
    try:
        network = importlib.import_module(f"{code.name}.gmflow").GMFlow()
    finally:
        sys.path.remove(str(code.parent))
    network.load_state_dict(torch.load(weights, map_location="cpu", weights_only=True))
    network.eval()
    images = tuple(torch.rand(1, 3, *size) for _ in INPUT_NAMES)
    with torch.no_grad():
        torch.onnx.export(
            _two_images(network),
            images,
            str(destination),
            input_names=list(INPUT_NAMES),
            output_names=[OUTPUT_NAME],
            opset_version=17,
            dynamo=False,
        )


def _two_images(network):
    """The network as a function of its two images alone: the exporter would make inputs of its other arguments too."""
    import torch

    class TwoImages(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.network = network

        def forward(self, first, second):
            return self.network(first, second)

    return TwoImages()
