"""Fetched networks: pinned hashes, what is said when a file is missing or another one, the conversion from TFLite."""

import importlib
import io
import json
import tarfile

import pytest

from physreal_core.errors import InputError
from pipeline.models import catalogue, fetch
from pipeline.models.convert import CONVERTERS
from pipeline.models.fetch import MANIFEST, _unpack, check_files, require, sha256_of
from pipeline.project import CODE_ROOT


def test_every_pin_is_a_whole_sha256_and_every_conversion_is_known():
    for network in catalogue.NETWORKS.values():
        assert all(len(digest) == 64 and int(digest, 16) >= 0 for digest in network.members.values())
        assert set(network.files.values()) <= network.members.keys()
        assert set(network.converted) <= CONVERTERS.keys()


def test_a_missing_network_names_the_command(tmp_path):
    with pytest.raises(InputError, match=r"sam2_encoder\.ort.*missing.*physreal models"):
        require("sam2", tmp_path)
    with pytest.raises(InputError, match="physreal models gmflow"):
        require("gmflow", tmp_path)


def test_a_network_with_another_hash_is_refused(tmp_path):
    for file in ("sam2_encoder.ort", "sam2_decoder.onnx"):
        (tmp_path / file).write_bytes(b"something else")
    with pytest.raises(InputError, match=f"SHA-256 {sha256_of(tmp_path / 'sam2_encoder.ort')}.*physreal models"):
        require("sam2", tmp_path)


def test_a_converted_network_is_held_to_the_catalogue_whatever_the_manifest_says(tmp_path):
    """The manifest lies beside the file: who changes one can change the other."""
    recorded = {}
    for file in ("palm.onnx", "hand_landmark.onnx"):
        (tmp_path / file).write_bytes(file.encode())
        recorded[file] = {"sha256": sha256_of(tmp_path / file)}
    (tmp_path / MANIFEST).write_text(json.dumps(recorded))
    assert check_files("hands", tmp_path)["palm.onnx"] == sha256_of(tmp_path / "palm.onnx")
    with pytest.raises(InputError, match=r"palm\.onnx: the network file has SHA-256 .* as pinned.*physreal models"):
        require("hands", tmp_path)


def test_a_conversion_that_depends_on_torch_is_held_to_what_it_was_made_from(tmp_path, monkeypatch):
    module, name = importlib.import_module("pipeline.models.fetch"), "gmflow_256x384.onnx"
    place = tmp_path / "optional"
    place.mkdir()
    (place / name).write_bytes(b"weights")
    module._record(place, "gmflow", [name])
    assert require("gmflow", tmp_path) == {name: place / name}
    monkeypatch.setattr(module, "digest_code", lambda source: "another converter")
    with pytest.raises(InputError, match="missing.*physreal models gmflow"):
        require("gmflow", tmp_path)
    monkeypatch.undo()
    (place / name).write_bytes(b"other weights")
    with pytest.raises(InputError, match="SHA-256"):
        require("gmflow", tmp_path)


def test_a_conversion_with_other_bytes_is_not_put_in_place(tmp_path):
    module = importlib.import_module("pipeline.models.fetch")
    (tmp_path / "palm.onnx").write_bytes(b"other")
    with pytest.raises(InputError, match=r"palm\.onnx: its conversion gave SHA-256 .*expected 442204641a.*onnx"):
        module._check_conversions({"palm.onnx": tmp_path / "palm.onnx"}, catalogue.NETWORKS["hands"])


def test_an_archive_with_another_file_in_it_is_refused(tmp_path):
    with tarfile.open(tmp_path / "package.tgz", "w:gz") as archive:
        info = tarfile.TarInfo("package/weights.onnx")
        info.size = 4
        archive.addfile(info, io.BytesIO(b"evil"))
    with pytest.raises(InputError, match=r"weights\.onnx: SHA-256"):
        _unpack(tmp_path / "package.tgz", {"package/weights.onnx": "0" * 64}, tmp_path / "out")
    with pytest.raises(InputError, match="no package/other"):
        _unpack(tmp_path / "package.tgz", {"package/other": "0" * 64}, tmp_path / "out")


def test_a_group_is_fetched_by_its_name_beside_what_dvc_watches(tmp_path, monkeypatch):
    """What the default run needs lies in the folder itself, all else in a part of it that .dvcignore leaves out."""
    installed = []
    module = importlib.import_module("pipeline.models.fetch")  # the package gives the function this name
    monkeypatch.setattr(module, "_install", lambda name, place: installed.append((name, place)))
    fetch(("text",), tmp_path)
    assert installed == [(n, tmp_path / "optional") for n in ("minilm", "efficientnet", "imagenet_names")]
    fetch((), tmp_path)
    assert installed[3:] == [("sam2", tmp_path), ("hands", tmp_path)]
    assert "/data/models/optional/" in (CODE_ROOT / ".dvcignore").read_text().splitlines()
    with pytest.raises(InputError, match="physreal models text"):
        require("efficientnet", tmp_path)


def test_imagenets_names_come_in_the_order_of_the_classes(tmp_path):
    folder = tmp_path / "timm/data/_info"
    folder.mkdir(parents=True)
    (folder / "imagenet_synsets.txt").write_text("n2\nn1\n")
    (folder / "imagenet_synset_to_lemma.txt").write_text("n1\ttabby, tabby cat\nn2\ttench\nn3\tbenthos\n")
    CONVERTERS["imagenet_names.txt"](tmp_path, tmp_path / "names.txt")
    assert (tmp_path / "names.txt").read_text() == "tench\ntabby, tabby cat\n"


def test_an_unknown_network_is_named():
    with pytest.raises(InputError, match="sam3"):
        fetch(("sam3",))
