"""EfficientNet-Lite0 from its torch weights to ONNX. The network (Tan and Le 2019, the Lite variant: no squeeze and
excitation, ReLU6) is written out here, so that no program file of a foreign package is run; weights only, no pickle code.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

# Repeats, stride of the first, expansion of each run of inverted bottlenecks; all else is in the weights.
_RUNS = ((1, 1, 1), (2, 2, 6), (2, 2, 6), (3, 2, 6), (3, 1, 6), (4, 2, 6), (1, 1, 6))
_EPSILON = 1e-3  # of the batch normalisation
_MEAN, _STD = 127 / 255, 128 / 255  # as the Lite networks were trained


def convert_efficientnet(weights: str | Path, destination: str | Path) -> None:
    """Write `image` [N, 3, 224, 224] RGB in 0 to 1 -> `probabilities` [N, 1000] of ImageNet's classes."""
    import onnx
    import torch

    state = torch.load(weights, map_location="cpu", weights_only=True)
    arrays = {name: value.numpy().astype(np.float32) for name, value in state.items()}
    onnx.save(_Writer(arrays).model(), str(destination))


class _Writer:
    """Nodes one after another; every convolution takes its batch normalisation in."""

    def __init__(self, arrays: Mapping[str, np.ndarray]) -> None:
        self.arrays, self.nodes, self.constants = arrays, [], {}

    def model(self) -> Any:
        from onnx import TensorProto, checker, helper, numpy_helper

        x = self._add("Sub", "image", self._keep(np.array(_MEAN, np.float32)))
        x = self._add("Div", x, self._keep(np.array(_STD, np.float32)))
        x = self._relu6(self._convolve(x, "_conv_stem", "_bn0", stride=2))
        index = 0
        for repeats, stride, expansion in _RUNS:
            for i in range(repeats):
                x = self._bottleneck(x, f"_blocks.{index}.", stride if i == 0 else 1, expansion, added=i > 0)
                index += 1
        x = self._relu6(self._convolve(x, "_conv_head", "_bn1"))
        x = self._add("Flatten", self._add("GlobalAveragePool", x))
        x = self._add("Gemm", x, *(self._keep(self.arrays[f"_fc.{n}"]) for n in ("weight", "bias")), transB=1)
        self._add("Softmax", x, output="probabilities", axis=1)
        graph = helper.make_graph(
            self.nodes,
            "efficientnet_lite0",
            [helper.make_tensor_value_info("image", TensorProto.FLOAT, ["N", 3, 224, 224])],
            [helper.make_tensor_value_info("probabilities", TensorProto.FLOAT, ["N", 1000])],
            [numpy_helper.from_array(v, n) for n, v in self.constants.items()],
        )
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
        checker.check_model(model)
        return model

    def _bottleneck(self, x: str, name: str, stride: int, expansion: int, added: bool) -> str:
        inner = x
        if expansion > 1:
            inner = self._relu6(self._convolve(inner, f"{name}_expand_conv", f"{name}_bn0"))
        inner = self._relu6(
            self._convolve(inner, f"{name}_depthwise_conv", f"{name}_bn1", stride=stride, depthwise=True)
        )
        inner = self._convolve(inner, f"{name}_project_conv", f"{name}_bn2")
        return self._add("Add", inner, x) if added else inner

    def _convolve(self, x: str, name: str, norm: str, *, stride: int = 1, depthwise: bool = False) -> str:
        weights = self.arrays[f"{name}.weight"]
        scale, shift, mean, variance = (
            self.arrays[f"{norm}.{n}"] for n in ("weight", "bias", "running_mean", "running_var")
        )
        scale = scale / np.sqrt(variance + _EPSILON)
        kernel, bias = self._keep(weights * scale[:, None, None, None]), self._keep(shift - mean * scale)
        groups = len(weights) if depthwise else 1
        # TensorFlow's padding: what is odd goes to the right and to the bottom.
        return self._add("Conv", x, kernel, bias, group=groups, strides=[stride, stride], auto_pad="SAME_UPPER")

    def _relu6(self, x: str) -> str:
        return self._add("Clip", x, self._keep(np.array(0, np.float32)), self._keep(np.array(6, np.float32)))

    def _keep(self, value: np.ndarray) -> str:
        name = f"constant_{len(self.constants)}"
        self.constants[name] = np.ascontiguousarray(value, np.float32)
        return name

    def _add(self, kind: str, *inputs: str, output: str | None = None, **attributes: Any) -> str:
        from onnx import helper

        output = output or f"{kind.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, list(inputs), [output], **attributes))
        return output
