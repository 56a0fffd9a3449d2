"""ROS recordings, written here by rosbags in every container: pixels, pairing in time, intrinsics, and what is refused."""

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from data.importers import ros
from physreal_core.errors import InputError
from pipeline.capture import read_capture

rosbags = pytest.importorskip("rosbags")

WIDTH, HEIGHT, RATE = 32, 24, 30.0
K = np.array([[40.0, 0, 15.5], [0, 40.0, 11.5], [0, 0, 1]])
COLOUR, DEPTH = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"
CONTAINERS = ("sqlite", "mcap", "ros1")


def colour(frame: int) -> np.ndarray:
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    image[..., 0], image[..., 1], image[..., 2] = 10 + frame, np.arange(WIDTH), np.arange(HEIGHT)[:, None]
    return image


def depth(frame: int) -> np.ndarray:
    """Millimetres."""
    return (500 + frame + np.arange(HEIGHT)[:, None] * np.ones(WIDTH)).astype(np.uint16)


class Recording:
    """Messages of a camera, to be written."""

    def __init__(self, container: str) -> None:
        from rosbags.typesys import Stores, get_typestore

        self.container = container
        self.types = get_typestore(Stores.ROS1_NOETIC if container == "ros1" else Stores.ROS2_HUMBLE)
        self.messages: list[tuple[float, str, object]] = []

    def _header(self, time: float):
        Time, Header = self.types.types["builtin_interfaces/msg/Time"], self.types.types["std_msgs/msg/Header"]
        stamp = Time(sec=int(time), nanosec=round(1e9 * (time % 1)))
        own = {"seq": 0} if self.container == "ros1" else {}
        return Header(stamp=stamp, frame_id="camera", **own)

    def image(
        self, time: float, topic: str, encoding: str, pixels: np.ndarray, spare: int = 0, big: bool = False
    ) -> None:
        rows = np.ascontiguousarray(pixels.astype(pixels.dtype.newbyteorder(">") if big else pixels.dtype))
        rows = rows.reshape(HEIGHT, -1).view(np.uint8)
        data = np.pad(rows, ((0, 0), (0, spare))).ravel()
        message = self.types.types["sensor_msgs/msg/Image"](
            self._header(time), HEIGHT, WIDTH, encoding, int(big), rows.shape[1] + spare, data
        )
        self.messages.append((time, topic, message))

    def compressed(self, time: float, topic: str, kind: str, data: bytes) -> None:
        packed = np.frombuffer(data, np.uint8)
        self.messages.append(
            (time, topic, self.types.types["sensor_msgs/msg/CompressedImage"](self._header(time), kind, packed))
        )

    def info(self, topic: str, matrix: np.ndarray = K, lens: tuple = (0.0,) * 5) -> None:
        region = self.types.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
        numbers = [np.array(lens), matrix.ravel(), np.eye(3).ravel(), np.eye(3, 4).ravel()]
        kind, model = self.types.types["sensor_msgs/msg/CameraInfo"], "equidistant" if len(lens) == 4 else "plumb_bob"
        self.messages.append((1.0, topic, kind(self._header(1.0), HEIGHT, WIDTH, model, *numbers, 0, 0, region)))

    def write(self, folder: Path) -> Path:
        if self.container == "ros1":
            from rosbags.rosbag1 import Writer

            path, serialise = folder / "clip.bag", self.types.serialize_ros1
            writer = Writer(path)
        else:
            from rosbags.rosbag2 import StoragePlugin, Writer

            plugin = StoragePlugin.MCAP if self.container == "mcap" else StoragePlugin.SQLITE3
            path, serialise = folder / "clip", self.types.serialize_cdr
            writer = Writer(path, version=9, storage_plugin=plugin)
        with writer:
            connections = {}
            for time, topic, message in sorted(self.messages, key=lambda entry: entry[0]):
                kind = message.__msgtype__
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=self.types)
                writer.write(connections[topic], round(1e9 * time), serialise(message, kind))
        return path


def usual(container: str = "mcap", frames: int = 6, missing: tuple[int, ...] = ()) -> Recording:
    """Colour and aligned depth, which is 4 ms late, with their intrinsics."""
    made = Recording(container)
    for frame in set(range(frames)) - set(missing):
        made.image(10 + frame / RATE, COLOUR, "rgb8", colour(frame))
        made.image(10.004 + frame / RATE, DEPTH, "16UC1", depth(frame))
    made.info("/camera/color/camera_info")
    made.info("/camera/aligned_depth_to_color/camera_info")
    return made


@pytest.mark.parametrize("container", CONTAINERS)
def test_a_recording_becomes_a_capture(container, tmp_path):
    source = usual(container).write(tmp_path)
    if container == "mcap":  # the file by itself, too
        (source,) = source.glob("*.mcap")
    ros.import_capture(source, tmp_path / "capture", description="a sloth")
    described = read_capture(tmp_path / "capture")
    assert described.fps == pytest.approx(RATE, rel=1e-6) and described.description == "a sloth"
    assert (described.width, described.height) == (WIDTH, HEIGHT) and np.allclose(described.K, K)
    assert described.frame_count == 6 and len(list((tmp_path / "capture/depth").iterdir())) == 6
    for frame in range(6):
        assert np.array_equal(np.asarray(Image.open(tmp_path / f"capture/color/{frame:06d}.png")), colour(frame))
        assert np.array_equal(np.asarray(Image.open(tmp_path / f"capture/depth/{frame:06d}.png")), depth(frame))


def test_every_encoding_gives_the_same_pixels(tmp_path):
    metres = depth(0).astype(np.float32) / 1000
    metres[0, 0] = np.nan
    made = Recording("mcap")
    alpha = np.full((HEIGHT, WIDTH, 1), 255, np.uint8)
    jpeg, png = io.BytesIO(), io.BytesIO()
    Image.fromarray(colour(0)).save(jpeg, "PNG")
    Image.fromarray(depth(0)).save(png, "PNG")
    for number, (encoding, pixels) in enumerate(
        [("rgb8", colour(0)), ("bgr8", colour(0)[..., ::-1]), ("rgba8", np.concatenate([colour(0), alpha], -1))]
        + [("bgra8", np.concatenate([colour(0)[..., ::-1], alpha], -1))]
    ):
        made.image(10 + number / RATE, COLOUR, encoding, pixels, spare=7)
    for number, (encoding, pixels, big) in enumerate(
        [("16UC1", depth(0), False), ("16UC1", depth(0), True), ("32FC1", metres, False), ("mono16", depth(0), False)]
    ):
        made.image(10 + number / RATE, DEPTH, encoding, pixels, big=big)
    made.info("/camera/color/camera_info")
    ros.import_capture(made.write(tmp_path), tmp_path / "capture")
    for frame in range(4):
        assert np.array_equal(np.asarray(Image.open(tmp_path / f"capture/color/{frame:06d}.png")), colour(0))
        found = np.asarray(Image.open(tmp_path / f"capture/depth/{frame:06d}.png"))
        assert np.array_equal(found[1:], depth(0)[1:])
    assert found.dtype == np.uint16

    packed = Recording("mcap")
    for frame in range(2):
        packed.compressed(10 + frame / RATE, f"{COLOUR}/compressed", "rgb8; png compressed bgr8", jpeg.getvalue())
        packed.compressed(
            10 + frame / RATE, f"{DEPTH}/compressedDepth", "16UC1; compressedDepth png", bytes(12) + png.getvalue()
        )
    packed.info("/camera/color/camera_info")
    (tmp_path / "second").mkdir()
    ros.import_capture(packed.write(tmp_path / "second"), tmp_path / "packed")
    assert np.array_equal(np.asarray(Image.open(tmp_path / "packed/color/000001.png")), colour(0))
    assert np.array_equal(np.asarray(Image.open(tmp_path / "packed/depth/000001.png")), depth(0))


def test_a_part_at_another_rate_skips_what_is_missing(tmp_path):
    source = usual(frames=31, missing=(7, 15)).write(tmp_path)
    with pytest.raises(InputError, match=r"missing around 0\.20 s, 0\.47 s.*begin= and end="):
        ros.import_capture(source, tmp_path / "capture")
    ros.import_capture(source, tmp_path / "slow", begin=0.1, fps=10.0)
    taken = [int(np.asarray(Image.open(path))[0, 0, 0]) - 10 for path in sorted((tmp_path / "slow/color").iterdir())]
    assert taken == [3, 6, 9, 12, 16, 18, 21, 24, 27, 30] or taken == [3, 6, 9, 12, 14, 18, 21, 24, 27, 30]
    assert read_capture(tmp_path / "slow").fps == 10.0
    ros.import_capture(source, tmp_path / "part", begin=0.53)
    assert len(list((tmp_path / "part/color").iterdir())) == 15


def test_depth_may_be_left_out_and_topics_named(tmp_path):
    made = usual(frames=3)
    for frame in range(3):
        made.image(10 + frame / RATE, "/other/rgb/image", "rgb8", colour(frame))
    source = made.write(tmp_path)
    with pytest.raises(InputError, match=r"2 topics of images may be the one of color.*say color=TOPIC"):
        ros.import_capture(source, tmp_path / "capture")
    ros.import_capture(source, tmp_path / "capture", color=COLOUR, depth="none")
    assert not (tmp_path / "capture/depth").exists()
    with pytest.raises(InputError, match=r"no images under depth=/nothing.*/camera/aligned"):
        ros.import_capture(source, tmp_path / "again", color=COLOUR, depth="/nothing")
    assert not (tmp_path / "again").exists()


def changed(what: str) -> Recording:
    made = Recording("mcap")
    lens, matrix, late, deep = (0.0,) * 5, K, 0.0, depth(0)
    if what == "lens":
        lens = (0.3, 0.0, 0.0, 0.0, 0.0)
    if what == "fisheye":
        lens = (0.1, 0.0, 0.0, 0.0)
    if what == "own camera":
        matrix = K * [[1.2], [1.2], [1.0]]
    if what == "late":
        late = 0.03
    for frame in range(3):
        made.image(10 + frame / RATE, COLOUR, "mono8" if what == "grey" else "rgb8", colour(frame))
        made.image(10 + late + frame / RATE, DEPTH, "16UC1", deep)
    if what != "no camera":
        made.info("/camera/color/camera_info", lens=lens)
    made.info("/camera/aligned_depth_to_color/camera_info", matrix)
    return made


@pytest.mark.parametrize(
    ("what", "told"),
    [
        ("lens", r"moves the corner of the picture by .* px.*rectified"),
        ("fisheye", r"a lens of the model 'equidistant'.*plumb_bob.*rectified"),
        ("own camera", r"has a camera of its own.*align_depth"),
        ("late", r"nearest depth to frame 0 is 30 ms away"),
        ("grey", r"encoding 'mono8'.*rgb8"),
        ("no camera", r"no /camera/color/camera_info"),
    ],
)
def test_what_cannot_be_a_capture_is_refused(what, told, tmp_path):
    with pytest.raises(InputError, match=told):
        ros.import_capture(changed(what).write(tmp_path), tmp_path / "capture")
    assert not (tmp_path / "capture").exists()


def test_what_is_no_recording_is_refused(tmp_path):
    (tmp_path / "clip.mcap").write_bytes(b"no bag")
    for path in (tmp_path / "clip.mcap", tmp_path / "nothing.bag", tmp_path):
        with pytest.raises(InputError, match=r"cannot be read.*rosbag2 folder"):
            ros.import_capture(path, tmp_path / "capture")
