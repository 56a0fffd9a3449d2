"""Files that are missing, damaged, forged or something else: every reader says so at once and unpacks nothing large."""

import io
import json
import os
import socket
import struct
import zipfile
import zlib

import numpy as np
import pytest
from PIL import Image

from physreal_core.geometry.mesh import load_mesh
from physreal_core.rendering.ply import load_gaussians
from pipeline.reading import arrays, images, text
from pipeline.reading.arrays import read_npy, read_npz
from pipeline.reading.files import read_bytes
from pipeline.reading.images import image_size, read_image
from pipeline.reading.tensors import read_tensors
from pipeline.reading.text import read_json, read_record, read_rows, read_text
from pipeline.reading.videos import read_video
from tests.hard_use.refusals import refused

READERS = {
    "text.txt": lambda path: read_text(path, remedy="write one"),
    "record.json": lambda path: read_record(path, remedy="write one"),
    "rows.csv": lambda path: read_rows(path, remedy="write one"),
    "arrays.npz": lambda path: read_npz(path, remedy="write one"),
    "array.npy": lambda path: read_npy(path, remedy="write one"),
    "image.png": lambda path: read_image(path, remedy="write one"),
    "video.mp4": lambda path: list(read_video(path, remedy="write one")),
    "tensors.safetensors": lambda path: read_tensors(path, remedy="write one"),
}


def nothing(path):
    pass


def link_to_nothing(path):
    path.symlink_to(path.with_name("nowhere"))


def link_to_itself(path):
    path.symlink_to(path)


def folder(path):
    path.mkdir()


def pipe(path):
    os.mkfifo(path)


def link_to_pipe(path):
    os.mkfifo(path.with_name("pipe"))
    path.symlink_to(path.with_name("pipe"))


def link_to_zeros(path):
    path.symlink_to("/dev/zero")


def unix_socket(path):
    with socket.socket(socket.AF_UNIX) as end:
        here = os.getcwd()
        os.chdir(path.parent)  # a socket's path is short
        try:
            end.bind(path.name)
        finally:
            os.chdir(here)


KINDS = (nothing, link_to_nothing, link_to_itself, folder, pipe, link_to_pipe, link_to_zeros, unix_socket)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", READERS)
def test_only_regular_files_are_opened(tmp_path, name, kind):
    path = tmp_path / name
    kind(path)
    refused(lambda: READERS[name](path), name)


@pytest.mark.parametrize("kind", [nothing, folder, pipe, link_to_zeros])
@pytest.mark.parametrize(
    ("name", "read"), [("mesh.glb", load_mesh), ("mesh.stl", load_mesh), ("g.ply", load_gaussians)]
)
def test_the_cores_own_readers_open_regular_files_alone(tmp_path, name, read, kind):
    kind(tmp_path / name)
    with pytest.raises(ValueError, match=f"{name}: file is missing"):
        read(tmp_path / name)


@pytest.mark.parametrize("data", [b"", b"\x00" * 100, b"something else entirely\n" * 20])
@pytest.mark.parametrize("name", [name for name in READERS if name not in ("text.txt", "rows.csv")])
def test_what_is_no_file_of_the_kind(tmp_path, name, data):
    (tmp_path / name).write_bytes(data)
    refused(lambda: READERS[name](tmp_path / name), name)


def test_a_name_that_no_file_can_have(tmp_path):
    refused(lambda: read_text(tmp_path / "a\0b", remedy="write one"), "a\0b")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
@pytest.mark.parametrize("name", READERS)
def test_a_file_that_may_not_be_read(tmp_path, name):
    (tmp_path / name).write_bytes(b"{}")
    (tmp_path / name).chmod(0)
    refused(lambda: READERS[name](tmp_path / name), name, "Permission denied", "chmod")


def test_the_size_is_looked_at_first(tmp_path):
    with (tmp_path / "sparse.bin").open("wb") as file:
        file.truncate(10**12)
    refused(lambda: read_bytes(tmp_path / "sparse.bin", limit=1000, expected="bytes"), "1000000000000 bytes", "1000")


# --- text, JSON, tables -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b'{"a": "\xff"}', "byte 7 is no UTF-8"),
        ('{"a": 1}'.encode("utf-16"), "no UTF-8"),
        (b'{"fps": 30', "not readable as JSON"),
        (b'{"fps": 30,}', "not readable as JSON"),
        (b"{'fps': 30}", "not readable as JSON"),
        (b"[" * 200_000, "nested too deeply"),
        (b'{"a":' * 100_000 + b"1" + b"}" * 100_000, "nested too deeply"),
        (b'{"fps": 30, "fps": 60}', "the key 'fps' stands there twice"),
        (b'{"a": {"b": 1, "b": 2}}', "the key 'b' stands there twice"),
        (b'{"a": ' + b"9" * 5000 + b"}", "not readable as JSON"),
        (b'{"description": "\\ud800"}', "not readable as JSON"),
        (b"[1, 2]", "the file holds a list"),
        (b'"words"', "the file holds a string"),
        (b"null", "the file holds null"),
        (b"true", "the file holds a truth value"),
        (b"3", "the file holds a number"),
        (b'{"a": 1}', "no key 'fps'"),
    ],
)
def test_json_that_cannot_be_used(tmp_path, data, words):
    (tmp_path / "capture.json").write_bytes(data)
    refused(lambda: read_record(tmp_path / "capture.json", ("fps",), "see the page"), words, "capture.json")


def test_json_is_not_read_beyond_a_size(tmp_path, monkeypatch):
    monkeypatch.setattr(text, "LIMIT", 100)
    (tmp_path / "a.json").write_text(json.dumps(list(range(100))))
    refused(lambda: read_json(tmp_path / "a.json"), "at most 100")


@pytest.mark.parametrize("data", [b'\xef\xbb\xbf{"fps": 30}', b'{"fps": 30}\r\n', b'{"fps": 30, "x": NaN, "y": 1e999}'])
def test_json_that_is_read(tmp_path, data):
    (tmp_path / "a.json").write_bytes(data)
    assert read_record(tmp_path / "a.json", ("fps",))["fps"] == 30


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ("frame,score\n0\n", "row 0: more or fewer cells"),
        ("frame,score\n0,1\n1,2,3\n", "row 1: more or fewer cells"),
        ("frame\n0\n", "no column 'score'"),
        ("", "no column 'frame'"),
        ('frame,score\n0,"1"2\n', "not readable as .csv"),
        ("frame,score\n0," + "1" * 200_000, "not readable as .csv"),
    ],
)
def test_tables_that_cannot_be_used(tmp_path, data, words):
    (tmp_path / "a.csv").write_text(data)
    refused(lambda: read_rows(tmp_path / "a.csv", ("frame", "score"), "run evaluate again"), words, "a.csv")


# --- arrays -------------------------------------------------------------------------------------------------------


def header(shape, descr="<f4", version=(1, 0)):
    """An .npy header that announces what it likes."""
    words = f"{{'descr': {descr!r}, 'fortran_order': False, 'shape': {shape!r}, }}".encode()
    size = struct.pack("<H" if version == (1, 0) else "<I", len(words))
    return np.lib.format.magic(*version) + size + words


def npz(path, **members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, data in members.items():
            file.writestr(f"{name}.npy", data)
    return path


FORGED = {
    "a shape of terabytes": (header((10**12,)) + b"\0" * 16, "announces 4000000000000 bytes"),
    "a shape beyond 64 bits": (header((2**40, 2**40)) + b"\0" * 16, "announces"),
    "more elements than there are": (header((5,)) + b"\0" * 16, "announces 20 bytes"),
    "fewer elements than there are": (header((3,)) + b"\0" * 16, "announces 12 bytes"),
    "a negative shape": (header((-4,)) + b"\0" * 16, "announces"),
    "two negative axes": (header((-2, -2)) + b"\0" * 16, "announces"),
    "a shape of words": (header(("a",)) + b"\0" * 16, "not readable"),
    "objects": (header((2,), "|O") + b"\0" * 16, "an array of type object"),
    "structures of objects": (header((1,), [("a", "|O"), ("b", "<f8")]) + b"\0" * 16, "an array of type"),
    "structures": (header((2,), [("a", "<f4"), ("b", "<f4")]) + b"\0" * 16, "an array of type"),
    "dates": (header((2,), "<M8[s]") + b"\0" * 16, "an array of type datetime64"),
    "raw bytes": (header((2,), "|V8") + b"\0" * 16, "an array of type"),
    "long strings": (header((), "<U100000000") + b"\0" * 16, "announces 400000000 bytes"),
    "a type that is none": (header((2,), "nonsense") + b"\0" * 16, "not readable"),
    "code in the header": (header((2,)).replace(b"'<f4'", b"open(") + b"\0" * 8, "not readable"),
    "a later version": (header((4,), version=(3, 0)) + b"\0" * 16, "version"),
    "no array": (b"a pickle, say", "not readable"),
    "nothing": (b"", "not readable"),
}


@pytest.mark.parametrize("member", FORGED.values(), ids=FORGED.keys())
@pytest.mark.parametrize("kind", [".npz", ".npy"])
def test_arrays_that_are_forged(tmp_path, member, kind):
    data, words = member
    path = tmp_path / f"tracks{kind}"
    if kind == ".npz":
        npz(path, points=data)
        refused(lambda: read_npz(path, ("points",), remedy="see the page"), words, "tracks.npz")
    else:
        path.write_bytes(data)
        refused(lambda: read_npy(path), words, "tracks.npy")


@pytest.fixture
def good(tmp_path):
    path = tmp_path / "good.npz"
    np.savez_compressed(path, points=np.random.default_rng(0).normal(size=(5, 40, 3)), names=np.array(["a", "bc"]))
    return path


def test_an_array_that_is_missing(good):
    refused(lambda: read_npz(good, ("points", "visible"), remedy="see the page"), "no array 'visible'", "good.npz")


def test_an_archive_that_unpacks_to_much_more_than_its_size(tmp_path, monkeypatch):
    monkeypatch.setattr(arrays, "UNPACKED_FREELY", 1000)
    np.savez_compressed(tmp_path / "bomb.npz", points=np.zeros(10**6))
    refused(lambda: read_npz(tmp_path / "bomb.npz", ("points",)), "8000128 bytes", "at most")


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.7, 0.9, 0.99])
def test_an_archive_that_is_truncated(good, share):
    good.write_bytes(good.read_bytes()[: int(share * good.stat().st_size)])
    refused(lambda: read_npz(good, ("points",)), "good.npz", "not readable as .npz")


def test_an_archive_whose_bytes_are_changed(good):
    data = good.read_bytes()
    good.write_bytes(data[:100] + bytes(byte ^ 255 for byte in data[100:200]) + data[200:])
    refused(lambda: read_npz(good, ("points",)), "good.npz", "not readable as .npz")


@pytest.mark.parametrize(("at", "value", "words"), [(6, 1, "not readable"), (8, 99, "not readable")])
def test_an_archive_that_is_encrypted_or_packed_in_an_unknown_way(good, at, value, words):
    data = bytearray(good.read_bytes())
    for signature, offset in ((b"PK\x03\x04", at), (b"PK\x01\x02", at + 2)):
        data[data.index(signature) + offset] = value
    good.write_bytes(data)
    refused(lambda: read_npz(good, ("points",)), words)


def test_what_numpy_writes_is_read_as_numpy_reads_it(tmp_path):
    written = {
        "floats": np.arange(6, dtype=np.float32).reshape(2, 3), "columns": np.asfortranarray(np.arange(6).reshape(2, 3)),
        "number": np.float64(2.5), "word": np.array("späť"), "none": np.zeros((0, 3)), "flags": np.array([True, False]),
    }  # fmt: skip
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "a.npz", **written)
        found = read_npz(tmp_path / "a.npz", list(written))
        for name, array in written.items():
            np.testing.assert_array_equal(found[name], array)
            assert found[name].dtype == np.asarray(array).dtype and found[name].flags.writeable


# --- images -------------------------------------------------------------------------------------------------------


def encoded(kind, size=(16, 12)):
    data = io.BytesIO()
    noise = np.random.default_rng(0).integers(0, 255, (size[1], size[0], 3), dtype=np.uint8)
    Image.fromarray(noise).save(data, kind)
    return data.getvalue()


def png_of_size(width, height, filling=b""):
    """A PNG that says how large it is, with whatever follows."""
    chunk = lambda name, data: struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
    start = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + start + chunk(b"IDAT", zlib.compress(filling)) + chunk(b"IEND", b"")


@pytest.mark.parametrize("kind", ["EPS", "GIF", "BMP", "TIFF", "WEBP", "PPM", "PDF", "ICO", "TGA", "PCX"])
def test_images_of_other_kinds_are_not_taken_for_png(tmp_path, kind):
    (tmp_path / "000000.png").write_bytes(encoded(kind))
    refused(lambda: read_image(tmp_path / "000000.png"), "000000.png: it is no PNG or JPEG image", "export it again")


def test_ghostscript_is_not_reached(tmp_path, monkeypatch):
    from PIL import EpsImagePlugin

    monkeypatch.setattr(EpsImagePlugin, "Ghostscript", lambda *_: pytest.fail("Ghostscript would have run"))
    (tmp_path / "000000.png").write_bytes(encoded("EPS"))
    refused(lambda: read_image(tmp_path / "000000.png"), "no PNG or JPEG")


@pytest.mark.parametrize("size", [(10_000, 9_000), (60_000, 60_000), (2**31 - 1, 2**31 - 1)])
@pytest.mark.parametrize("read", [read_image, image_size])
@pytest.mark.filterwarnings("ignore::PIL.Image.DecompressionBombWarning")
def test_images_too_large_are_known_by_their_header(tmp_path, size, read):
    (tmp_path / "000000.png").write_bytes(png_of_size(*size))
    refused(lambda: read(tmp_path / "000000.png"), "000000.png", f"at most {images.PIXELS} pixels")


@pytest.mark.parametrize("kind", ["PNG", "JPEG"])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.97])
def test_images_that_are_truncated(tmp_path, kind, share):
    data = encoded(kind)
    (tmp_path / "000000.png").write_bytes(data[: int(share * len(data))])
    refused(lambda: read_image(tmp_path / "000000.png"), "000000.png")


@pytest.mark.parametrize(
    "data",
    [
        png_of_size(16, 12),
        png_of_size(16, 12, b"\0" * 10),
        png_of_size(0, 12),
        encoded("PNG").replace(b"IDAT", b"IDAX"),
    ],
    ids=["no pixels", "few pixels", "no width", "a chunk of another name"],
)
def test_images_that_are_damaged(tmp_path, data):
    (tmp_path / "000000.png").write_bytes(data)
    refused(lambda: read_image(tmp_path / "000000.png"), "000000.png")


@pytest.mark.parametrize(("kind", "name"), [("PNG", "a.png"), ("JPEG", "a.jpg"), ("JPEG", "a.png")])
def test_images_and_links_to_them_are_read(tmp_path, kind, name):
    (tmp_path / name).write_bytes(encoded(kind))
    (tmp_path / "link.png").symlink_to(tmp_path / name)
    assert read_image(tmp_path / "link.png").size == image_size(tmp_path / name) == (16, 12)


# --- videos, tensors, meshes --------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def video(tmp_path_factory):
    import cv2

    path = tmp_path_factory.mktemp("video") / "color.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 30, (32, 24))
    for frame in range(5):
        writer.write(np.full((24, 32, 3), (0, 0, 40 * frame), np.uint8))
    writer.release()
    return path


def test_a_video_is_read(video):
    frames = list(read_video(video))
    assert (
        len(frames) == 5
        and frames[4].shape == (24, 32, 3)
        and frames[4][..., 0].mean() > 100 > frames[4][..., 2].mean()
    )


@pytest.mark.parametrize("share", [0.01, 0.1, 0.5, 0.9, 0.999])
def test_a_video_that_is_truncated(tmp_path, video, share):
    data = video.read_bytes()
    (tmp_path / "color.mp4").write_bytes(data[: int(share * len(data))])
    refused(lambda: list(read_video(tmp_path / "color.mp4")), "color.mp4")


@pytest.mark.parametrize(
    "data",
    [
        b"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nfile:///etc/passwd\n#EXT-X-ENDLIST\n",
        b"ffconcat version 1.0\nfile /etc/passwd\n",
        b"RIFF\x00\x00\x00\x00AVI LIST",
        struct.pack(">I4s4sI", 16, b"ftyp", b"isom", 0),
        struct.pack(">I4s4sI", 16, b"ftyp", b"isom", 0) + struct.pack(">I4s", 4, b"mdat"),
        struct.pack(">I4s4sI", 16, b"ftyp", b"isom", 0) + struct.pack(">I4sQ", 1, b"mdat", 2**60),
        struct.pack(">I4s4sI", 16, b"ftyp", b"isom", 0) + struct.pack(">I4s", 0, b"mdat") + b"\0" * 100,
    ],
    ids=["playlist", "list of files", "avi", "head alone", "box too short", "box too long", "no index"],
)
def test_what_is_no_video(tmp_path, data):
    (tmp_path / "color.mp4").write_bytes(data)
    refused(lambda: list(read_video(tmp_path / "color.mp4")), "color.mp4")


def test_a_videos_name_is_no_pattern(tmp_path, video):
    (tmp_path / "%d").mkdir()
    (tmp_path / "%d" / "color.mp4").write_bytes(video.read_bytes())
    assert len(list(read_video(tmp_path / "%d" / "color.mp4"))) == 5


@pytest.mark.parametrize("data", [struct.pack("<Q", 2**60) + b"{}", struct.pack("<Q", 2) + b"[]", struct.pack("<Q", 8)])
def test_tensors_that_are_forged(tmp_path, data):
    (tmp_path / "gap.safetensors").write_bytes(data)
    refused(lambda: read_tensors(tmp_path / "gap.safetensors", remedy="run find_gap again"), "gap.safetensors")


def box_as(path):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box().export(path)
    return path.read_bytes()


@pytest.mark.parametrize("name", ["prior.glb", "prior.stl", "prior.ply", "prior.obj"])
@pytest.mark.parametrize("share", [0.0, 0.05, 0.5])
def test_meshes_that_are_truncated(tmp_path, name, share):
    data = box_as(tmp_path / name)
    cut = data[: int(share * len(data))]
    if name == "prior.obj" and share == 0.5:
        cut = cut[: cut.rindex(b"\n")] + b"\nf 1 2 99\n"
    (tmp_path / name).write_bytes(cut)
    refused(lambda: load_mesh(tmp_path / name), name)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_mesh_whose_vertex_is_not_finite(tmp_path, value):
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box()
    vertices = box.vertices.copy()
    vertices[3] = value
    trimesh.Trimesh(vertices, box.faces, process=False).export(tmp_path / "prior.ply")
    refused(lambda: load_mesh(tmp_path / "prior.ply"), "prior.ply", "not finite")


@pytest.mark.parametrize("count", [10**12, -1])
def test_gaussians_whose_head_is_forged(tmp_path, count):
    lines = ["ply", "format ascii 1.0", f"element vertex {count}", "property float x", "end_header", "0", ""]
    (tmp_path / "gaussians.ply").write_text("\n".join(lines))
    refused(lambda: load_gaussians(tmp_path / "gaussians.ply"), "gaussians.ply")
