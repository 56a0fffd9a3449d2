"""The restricted unpickler: arrays and containers come through, everything else is refused by name."""

import os
import pickle
from collections import OrderedDict

import numpy as np
import pytest

from data.importers.safe_pickle import load_pickle
from physreal_core.errors import InputError


def write(path, value, protocol=None):
    with path.open("wb") as file:
        pickle.dump(value, file, protocol=protocol)
    return path


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_arrays_and_containers_of_every_protocol(tmp_path, protocol):
    value = {
        "points": np.arange(12.0).reshape(2, 2, 3),
        "transposed": np.arange(6).reshape(2, 3).T,
        "flags": np.array([True, False]),
        "scalar": np.float32(1.5),
        "list": [np.eye(4), (1, 2.5, "text", None, b"bytes")],
        "ordered": OrderedDict(a={1, 2}),
    }
    read = load_pickle(write(tmp_path / "a.pkl", value, protocol))
    np.testing.assert_array_equal(read["points"], value["points"])
    np.testing.assert_array_equal(read["transposed"], value["transposed"])
    np.testing.assert_array_equal(read["list"][0], np.eye(4))
    assert read["list"][1] == (1, 2.5, "text", None, b"bytes") and read["ordered"] == value["ordered"]
    assert read["scalar"] == np.float32(1.5) and read["flags"].tolist() == [True, False]


def test_numpy_1_names_are_admitted(tmp_path):
    text = pickle.dumps(np.arange(3), protocol=2).replace(b"numpy._core.multiarray", b"numpy.core.multiarray")
    assert b"numpy.core.multiarray" in text
    (tmp_path / "old.pkl").write_bytes(text)
    np.testing.assert_array_equal(load_pickle(tmp_path / "old.pkl"), [0, 1, 2])


class Evil:
    def __init__(self, function, *arguments):
        self.call = function, arguments

    def __reduce__(self):
        return self.call


@pytest.mark.parametrize(
    ("function", "argument", "name"),
    [(os.system, "touch {}", "system"), (eval, "open({!r}, 'w')", "builtins.eval"), (getattr, "", "builtins.getattr")],
)
def test_code_is_refused_and_not_run(tmp_path, function, argument, name):
    marker = tmp_path / "ran"
    arguments = (argument.format(str(marker)),) if argument else (np, "load")
    if function is getattr:
        arguments = ("text", "upper")
    path = write(tmp_path / "evil.pkl", {"object_points": Evil(function, *arguments)})
    with pytest.raises(InputError) as caught:
        load_pickle(path)
    assert name in str(caught.value) and "evil.pkl" in str(caught.value)
    assert not marker.exists()


def test_dotted_names_do_not_reach_attributes(tmp_path):
    # Protocol 4 may ask for "ndarray.tofile" of numpy; only whole admitted names are looked up.
    payload = pickle.PROTO + b"\x04" + b"\x8c\x05numpy\x8c\x0endarray.tofile\x93."
    (tmp_path / "dotted.pkl").write_bytes(payload)
    with pytest.raises(InputError, match=r"numpy\.ndarray\.tofile"):
        load_pickle(tmp_path / "dotted.pkl")


def test_truncated_and_missing(tmp_path):
    whole = pickle.dumps(np.zeros(100))
    (tmp_path / "cut.pkl").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"cut\.pkl.*truncated"):
        load_pickle(tmp_path / "cut.pkl")
    with pytest.raises(InputError, match="missing"):
        load_pickle(tmp_path / "none.pkl")
