"""EfficientNet-Lite0 to ONNX against the same network in torch's own layers, with random weights."""

import numpy as np
import pytest
import torch
from torch import nn

from pipeline.models.convert_efficientnet import convert_efficientnet

pytest.importorskip("onnx", reason="writes the network")
ort = pytest.importorskip("onnxruntime", reason="runs the network")

# Kernel, stride, expansion, channels in and out of each block (the package's own table, one row per block).
BLOCKS = (
    (3, 1, 1, 32, 16), (3, 2, 6, 16, 24), (3, 1, 6, 24, 24), (5, 2, 6, 24, 40), (5, 1, 6, 40, 40), (3, 2, 6, 40, 80),
    (3, 1, 6, 80, 80), (3, 1, 6, 80, 80), (5, 1, 6, 80, 112), (5, 1, 6, 112, 112), (5, 1, 6, 112, 112),
    (5, 2, 6, 112, 192), (5, 1, 6, 192, 192), (5, 1, 6, 192, 192), (5, 1, 6, 192, 192), (3, 1, 6, 192, 320),
)  # fmt: skip


def _conv(channels_in, channels_out, kernel, stride, groups=1):
    """Convolution with TensorFlow's padding of an even-sized image."""
    extra = kernel - stride
    padding = nn.ZeroPad2d((extra // 2, extra - extra // 2) * 2)
    return nn.Sequential(padding, nn.Conv2d(channels_in, channels_out, kernel, stride, groups=groups, bias=False))


class Block(nn.Module):
    def __init__(self, kernel, stride, expansion, channels_in, channels_out):
        super().__init__()
        wide = channels_in * expansion
        self.layers = nn.ModuleDict()
        if expansion > 1:
            self.layers["_expand_conv"] = _conv(channels_in, wide, 1, 1)
            self.layers["_bn0"] = nn.BatchNorm2d(wide, eps=1e-3)
        layers = {
            "_depthwise_conv": _conv(wide, wide, kernel, stride, wide),
            "_bn1": nn.BatchNorm2d(wide, eps=1e-3),
            "_project_conv": _conv(wide, channels_out, 1, 1),
            "_bn2": nn.BatchNorm2d(channels_out, eps=1e-3),
        }
        self.layers.update(layers)
        self.added = stride == 1 and channels_in == channels_out

    def forward(self, x):
        y = x
        for name, layer in self.layers.items():
            y = layer(y)
            if name in ("_bn0", "_bn1"):
                y = nn.functional.relu6(y)
        return x + y if self.added else y


class Lite0(nn.Module):
    def __init__(self):
        super().__init__()
        self._conv_stem, self._bn0 = _conv(3, 32, 3, 2), nn.BatchNorm2d(32, eps=1e-3)
        self._blocks = nn.ModuleList([Block(*row) for row in BLOCKS])
        self._conv_head, self._bn1 = _conv(320, 1280, 1, 1), nn.BatchNorm2d(1280, eps=1e-3)
        self._fc = nn.Linear(1280, 1000)

    def forward(self, image):
        x = nn.functional.relu6(self._bn0(self._conv_stem((image * 255 - 127) / 128)))
        for block in self._blocks:
            x = block(x)
        x = nn.functional.relu6(self._bn1(self._conv_head(x)))
        return self._fc(x.mean((2, 3))).softmax(1)


def test_the_converted_network_says_what_torch_says(tmp_path):
    torch.manual_seed(0)
    network = Lite0()
    for layer in network.modules():
        if isinstance(layer, nn.BatchNorm2d):  # not the identity, so that taking it into the convolution is tested
            nn.init.uniform_(layer.weight, 1, 2), nn.init.uniform_(layer.bias, -0.5, 0.5)
            nn.init.uniform_(layer.running_mean, -0.2, 0.2), nn.init.uniform_(layer.running_var, 0.05, 0.5)
    nn.init.normal_(network._fc.weight, std=0.3)
    state = {n.replace(".layers.", ".").replace(".1.weight", ".weight"): v for n, v in network.state_dict().items()}
    torch.save(state, tmp_path / "weights.pth")
    convert_efficientnet(tmp_path / "weights.pth", tmp_path / "network.onnx")
    session = ort.InferenceSession(str(tmp_path / "network.onnx"), providers=["CPUExecutionProvider"])
    images = np.random.default_rng(0).uniform(size=(2, 3, 224, 224)).astype(np.float32)
    (found,) = session.run(None, {"image": images})
    with torch.no_grad():
        wanted = network.eval()(torch.from_numpy(images)).numpy()
    assert wanted.std() > 1e-4  # it does say something
    assert np.abs(found - wanted).max() < 1e-4 * wanted.max()
