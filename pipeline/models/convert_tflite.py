"""TensorFlow Lite to ONNX for float networks of the MediaPipe kind: a dozen operators, channels last to channels first.

Needs the packages `tflite` (the flatbuffer schema in pure Python) and `onnx`; runs once, when the networks are fetched.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from physreal_core.errors import InputError

_TO_FIRST, _TO_LAST = [0, 3, 1, 2], [0, 2, 3, 1]


def convert_tflite(source: str | Path, destination: str | Path) -> None:
    """Write the ONNX twin of a .tflite network; inputs and outputs keep their layout (channels last).

    Raises:
        InputError: the network uses an operator that is not known here.
    """
    import onnx

    onnx.save(_Converter(Path(source)).model(), str(destination))


class _Converter:
    """Walks the one subgraph of a network; every tensor keeps TensorFlow's layout, nodes transpose where they must."""

    def __init__(self, path: Path) -> None:
        import tflite

        self.path, self.tflite = path, tflite
        self.file = tflite.Model.GetRootAsModel(path.read_bytes(), 0)
        self.graph = self.file.Subgraphs(0)
        self.nodes: list[Any] = []
        self.constants: dict[str, np.ndarray] = {}
        self.fresh = 0

    def model(self) -> Any:
        from onnx import TensorProto, checker, helper, numpy_helper

        for i in range(self.graph.TensorsLength()):
            value = self._constant(i)
            if value is not None:
                self.constants[self._name(i)] = value
        for i in range(self.graph.OperatorsLength()):
            self._operator(self.graph.Operators(i))
        used = {n for node in self.nodes for n in node.input}
        graph = helper.make_graph(
            self.nodes,
            self.path.stem,
            [self._info(i, TensorProto.FLOAT) for i in self.graph.InputsAsNumpy()],
            [self._info(i, TensorProto.FLOAT) for i in self.graph.OutputsAsNumpy()],
            [numpy_helper.from_array(v, n) for n, v in self.constants.items() if n in used],
        )
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
        checker.check_model(model)
        return model

    def _operator(self, operator: Any) -> None:
        code = self.file.OperatorCodes(operator.OpcodeIndex())
        number = max(code.BuiltinCode(), code.DeprecatedBuiltinCode())
        kinds = {v: k for k, v in vars(self.tflite.BuiltinOperator).items() if isinstance(v, int)}
        name = kinds.get(number, str(number))
        method: Callable | None = getattr(self, f"_op_{name.lower()}", None)
        if method is None:
            raise InputError(f"operator {name} is not known to the converter", where=str(self.path))
        inputs = [self._name(i) for i in operator.InputsAsNumpy() if i >= 0]
        method(operator, inputs, self._name(operator.Outputs(0)))

    # Operators, each from TensorFlow Lite's inputs (names) to its output (name).

    def _op_conv_2d(self, operator: Any, inputs: Sequence[str], output: str) -> None:
        options = self._options(operator, self.tflite.Conv2DOptions)
        self._convolve(options, inputs, output, self.constants[inputs[1]].transpose(0, 3, 1, 2), 1)

    def _op_depthwise_conv_2d(self, operator: Any, inputs: Sequence[str], output: str) -> None:
        options = self._options(operator, self.tflite.DepthwiseConv2DOptions)
        weights = self.constants[inputs[1]]  # [1, kh, kw, channels]
        self._convolve(options, inputs, output, weights.transpose(3, 0, 1, 2), weights.shape[3])

    def _convolve(self, options: Any, inputs: Sequence[str], output: str, weights: np.ndarray, groups: int) -> None:
        first = self._add("Transpose", [inputs[0]], perm=_TO_FIRST)
        kernel = self._keep(np.ascontiguousarray(weights))
        dilations = [options.DilationHFactor(), options.DilationWFactor()]
        window = {"strides": [options.StrideH(), options.StrideW()], "dilations": dilations}
        same = options.Padding() == self.tflite.Padding.SAME
        inner = self._add(
            "Conv", [first, kernel, *inputs[2:]], group=groups, auto_pad="SAME_UPPER" if same else "VALID", **window
        )
        self._activated(self._add("Transpose", [inner], perm=_TO_LAST), options, output)

    def _op_max_pool_2d(self, operator: Any, inputs: Sequence[str], output: str) -> None:
        options = self._options(operator, self.tflite.Pool2DOptions)
        same = options.Padding() == self.tflite.Padding.SAME
        first = self._add("Transpose", [inputs[0]], perm=_TO_FIRST)
        pooled = self._add(
            "MaxPool",
            [first],
            kernel_shape=[options.FilterHeight(), options.FilterWidth()],
            strides=[options.StrideH(), options.StrideW()],
            auto_pad="SAME_UPPER" if same else "VALID",
        )
        self._activated(self._add("Transpose", [pooled], perm=_TO_LAST), options, output)

    def _op_resize_bilinear(self, operator: Any, inputs: Sequence[str], output: str) -> None:
        options = self._options(operator, self.tflite.ResizeBilinearOptions)
        mode = "align_corners" if options.AlignCorners() else "asymmetric"
        mode = "half_pixel" if options.HalfPixelCenters() else mode
        shape = self._shape_of(operator.Inputs(0))
        size = self.constants[inputs[1]].astype(np.int64)
        first = self._add("Transpose", [inputs[0]], perm=_TO_FIRST)
        none = self._keep(np.zeros(0, np.float32))
        sizes = self._keep(np.array([shape[0], shape[3], *size], np.int64))
        resized = self._add("Resize", [first, none, none, sizes], mode="linear", coordinate_transformation_mode=mode)
        self._add("Transpose", [resized], output, perm=_TO_LAST)

    def _op_fully_connected(self, operator: Any, inputs: Sequence[str], output: str) -> None:
        options = self._options(operator, self.tflite.FullyConnectedOptions)
        weights = self.constants[inputs[1]]  # [out, in]
        flat = self._add("Reshape", [inputs[0], self._keep(np.array([-1, weights.shape[1]], np.int64))])
        self._activated(self._add("Gemm", [flat, self._keep(weights), *inputs[2:]], transB=1), options, output)

    def _op_prelu(self, operator: Any, inputs: Sequence[str], output: str) -> None:
        self._add("PRelu", inputs, output)

    def _op_add(self, operator: Any, inputs: Sequence[str], output: str) -> None:
        options = self._options(operator, self.tflite.AddOptions)
        self._activated(self._add("Add", inputs), options, output)

    def _op_pad(self, operator: Any, inputs: Sequence[str], output: str) -> None:
        pads = self.constants[inputs[1]].astype(np.int64).T.ravel()  # begins, then ends
        self._add("Pad", [inputs[0], self._keep(pads)], output)

    def _op_reshape(self, operator: Any, inputs: Sequence[str], output: str) -> None:
        shape = np.array(self._shape_of(operator.Outputs(0)), np.int64)
        self._add("Reshape", [inputs[0], self._keep(shape)], output)

    def _op_concatenation(self, operator: Any, inputs: Sequence[str], output: str) -> None:
        self._add("Concat", inputs, output, axis=self._options(operator, self.tflite.ConcatenationOptions).Axis())

    def _op_logistic(self, operator: Any, inputs: Sequence[str], output: str) -> None:
        self._add("Sigmoid", inputs, output)

    def _op_mean(self, operator: Any, inputs: Sequence[str], output: str) -> None:
        keep = self._options(operator, self.tflite.ReducerOptions).KeepDims()
        axes = [int(a) for a in self.constants[inputs[1]].ravel()]
        self._add("ReduceMean", [inputs[0]], output, axes=axes, keepdims=int(keep))

    def _op_dequantize(self, operator: Any, inputs: Sequence[str], output: str) -> None:
        # Half-precision weights: known already, so no node is needed.
        self.constants[output] = self.constants[inputs[0]].astype(np.float32)

    # Helpers.

    def _activated(self, name: str, options: Any, output: str) -> None:
        kinds = self.tflite.ActivationFunctionType
        kind = options.FusedActivationFunction()
        if kind == kinds.RELU:
            self._add("Relu", [name], output)
        elif kind == kinds.RELU6:
            self._add("Clip", [name, self._keep(np.float32(0)), self._keep(np.float32(6))], output)
        elif kind == kinds.NONE:
            self._add("Identity", [name], output)
        else:
            raise InputError(f"activation {kind} is not known to the converter", where=str(self.path))

    def _add(self, kind: str, inputs: Any, output: str | None = None, **attributes: Any) -> str:
        from onnx import helper

        output = output or self._fresh_name()
        self.nodes.append(helper.make_node(kind, list(inputs), [output], **attributes))
        return output

    def _keep(self, value: Any) -> str:
        name = self._fresh_name()
        self.constants[name] = np.asarray(value)
        return name

    def _fresh_name(self) -> str:
        self.fresh += 1
        return f"made_{self.fresh}"

    def _options(self, operator: Any, kind: Any) -> Any:
        options = kind()
        table = operator.BuiltinOptions()
        options.Init(table.Bytes, table.Pos)
        return options

    def _name(self, index: int) -> str:
        return f"{self.graph.Tensors(index).Name().decode()}:{index}"

    def _shape_of(self, index: int) -> list[int]:
        return [int(n) for n in self.graph.Tensors(index).ShapeAsNumpy()]

    def _constant(self, index: int) -> np.ndarray | None:
        tensor = self.graph.Tensors(index)
        data = self.file.Buffers(tensor.Buffer()).DataAsNumpy()
        if not isinstance(data, np.ndarray) or data.size == 0:
            return None
        kinds = self.tflite.TensorType
        types = {kinds.FLOAT32: np.float32, kinds.FLOAT16: np.float16, kinds.INT32: np.int32, kinds.INT64: np.int64}
        if tensor.Type() not in types:
            raise InputError(f"tensor {self._name(index)} has type {tensor.Type()}", where=str(self.path))
        shape = tensor.ShapeAsNumpy()
        return np.frombuffer(data.tobytes(), types[tensor.Type()]).reshape(
            shape if isinstance(shape, np.ndarray) else []
        )

    def _info(self, index: int, kind: int) -> Any:
        from onnx import helper

        return helper.make_tensor_value_info(self._name(index), kind, self._shape_of(index))
