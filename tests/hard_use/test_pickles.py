"""Pickles made to harm: refused by name, without running anything and without taking more memory than the file allows."""

import os
import pickle
import pickletools
import struct
import tracemalloc

import numpy as np
import pytest

from data.importers.safe_pickle import load_pickle
from physreal_core.errors import InputError
from tests.hard_use.refusals import refused


class Call:
    """Is pickled as a call of `function`, with a state to be set on what that returns."""

    def __init__(self, function, *arguments, state=None):
        self.parts = (function, arguments) if state is None else (function, arguments, state)

    def __reduce__(self):
        return self.parts


RECONSTRUCT = np.zeros(0).__reduce__()[0]
SCALAR = np.float64(0).__reduce__()[0]
PLAIN = (3, "<", None, None, None, -1, -1, 0)


def array_of(dtype, data=b"\x41" * 16, shape=(2,)):
    return Call(RECONSTRUCT, np.ndarray, (0,), b"b", state=(1, shape, dtype, False, data))


def global_(module, name):
    return b"c" + module.encode() + b"\n" + name.encode() + b"\n"


def word(text):
    return b"X" + struct.pack("<I", len(text)) + text.encode()


OBJECTS_WITHOUT_FLAG = Call(
    np.dtype, "V8", False, True, state=(3, "|", None, ("a",), {"a": (np.dtype("O"), 0)}, 8, 1, 0)
)
MADE = {
    "pointers in a structure": array_of(OBJECTS_WITHOUT_FLAG),
    "an object type without its flag": array_of(Call(np.dtype, "O8", False, True, state=(3, "|", None, None, None, -1, -1, 0))),
    "objects": np.array([None, {}], dtype=object),
    "a structure": np.zeros(2, dtype=[("a", "f4"), ("b", "f4")]),
    "dates": np.zeros(2, dtype="M8[s]"),
    "durations": np.zeros(2, dtype="m8[s]"),
    "raw bytes": np.zeros(2, dtype="V4"),
    "fields set on floats": array_of(Call(np.dtype, "f8", False, True, state=(3, "<", None, ("a",), {}, 8, 1, 0))),
    "a subarray set on floats": array_of(Call(np.dtype, "f8", False, True, state=(3, "<", (np.dtype("f8"), (9,)), None, None, -1, -1, 0))),
    "an order that is none": array_of(Call(np.dtype, "f8", False, True, state=(3, "O", None, None, None, -1, -1, 0))),
    "a type by a dict": Call(np.dtype, {"names": ["a"], "formats": ["O"]}),
    "a type by a list": Call(np.dtype, [("a", "O")]),
    "a type of no width": Call(np.dtype, "S0"),
    "long floats": Call(np.dtype, "f16"),
    "a bare type": np.dtype("f8"),
    "a class": np.ndarray,
    "fewer bytes than the shape says": array_of(Call(np.dtype, "f8", False, True, state=PLAIN), b"\0" * 8),
    "more bytes than the shape says": array_of(Call(np.dtype, "f8", False, True, state=PLAIN), b"\0" * 80),
    "a shape of terabytes": array_of(Call(np.dtype, "f8", False, True, state=PLAIN), b"", (2**39, 2)),
    "a negative shape": array_of(Call(np.dtype, "f8", False, True, state=PLAIN), b"\0" * 16, (-2,)),
    "a shape that is no tuple": array_of(Call(np.dtype, "f8", False, True, state=PLAIN), b"\0" * 16, [2]),
    "many axes": array_of(Call(np.dtype, "f8", False, True, state=PLAIN), b"\0" * 8, (1,) * 60),
    "a list of objects as data": array_of(Call(np.dtype, "O8", False, True, state=PLAIN), [1, 2]),
    "a list as data of floats": array_of(Call(np.dtype, "f8", False, True, state=PLAIN), [1.0, 2.0]),
    "an array without elements": Call(RECONSTRUCT, np.ndarray, (0,), b"b"),
    "a matrix": Call(RECONSTRUCT, np.matrix, (0,), b"b"),
    "a number of objects": Call(SCALAR, np.dtype("O"), b"\x41" * 8),
    "a call of ndarray": Call(np.ndarray, (10**9,)),
    "six gigabytes of bytes": Call(bytearray, 6 * 10**9),
    "bytes of a length": Call(bytes, 6 * 10**9),
    "a set of a range": Call(set, 10**9),
    "a decompression": Call(__import__("_codecs").encode, "ab", "rot13"),
    "os.system": Call(os.system, "touch ran"),
    "eval": Call(eval, "open('ran', 'w')"),
    "exec": Call(exec, "open('ran', 'w')"),
    "getattr": Call(getattr, "text", "upper"),
    "open": Call(open, "ran", "w"),
    "__import__": Call(__import__, "antigravity"),
    "numpy.load": Call(np.load, "x.npy"),
    "an instance": InputError("x"),
    "a range": range(10**9),
    "a slice": slice(0, 10),
    "a tuple nested as a key": {((1, (2, 3)),): 1},
}  # fmt: skip


@pytest.mark.parametrize("protocol", [2, 4])
@pytest.mark.parametrize("value", MADE.values(), ids=MADE.keys())
def test_what_is_no_plain_array_is_refused(tmp_path, monkeypatch, value, protocol):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "calibrate.pkl"
    path.write_bytes(pickle.dumps(value, protocol))
    size = path.stat().st_size
    tracemalloc.start()
    try:
        refused(lambda: load_pickle(path), "calibrate.pkl")
        assert tracemalloc.get_traced_memory()[1] < 2**20 + 100 * size
    finally:
        tracemalloc.stop()
    assert [entry.name for entry in tmp_path.iterdir()] == ["calibrate.pkl"]


FROM_BUFFER = global_("numpy.core.numeric", "_frombuffer")
FLOATS = global_("numpy", "dtype") + b"(" + word("f8") + b"\x89\x88tR"
HANDMADE = {
    "defaults set on a builder": FROM_BUFFER + b"(N}" + word("__defaults__") + b"(" + word("F") + b"tstb",
    "code set on a builder": FROM_BUFFER + b"}" + word("__code__") + b"Nsb",
    "state set on a type's class": global_("numpy", "dtype") + b"}" + word("x") + b"Nsb",
    "state set on a list": b"]}" + word("x") + b"Nsb",
    "state set on a set": b"\x8f}" + word("x") + b"Nsb",
    "items set on a list": b"](K\x00Nu",
    "items appended to a dict": b"}Na",
    "items added to a list": b"](K\x01\x90",
    "a call of a list": b"])R",
    "a call of words": word("os.system") + b")R",
    "an instance by its class": b"(ios\nsystem\n",
    "an object by its class": b"(" + global_("os", "system") + word("true") + b"o",
    "a class called anew": global_("numpy", "ndarray") + b")\x81",
    "an extension": b"\x82\x01",
    "a reference outside": word("x") + b"Q",
    "a named reference outside": b"Pname\n",
    "a buffer outside": b"\x97",
    "a dotted name": word("numpy") + word("ndarray.tofile") + b"\x93",
    "a name of numbers": b"K\x01K\x02\x93",
    "a name within numpy": global_("numpy.core.multiarray", "fromfile"),
    "numpy's own opener": global_("numpy", "memmap") + b"(" + word("x") + b"tR",
    "a memo that is empty": b"h\x05",
    "a mark that is missing": b"K\x01t",
    "an empty stack": b"0",
    "nothing": b"",
    "a mark alone": b"(",
    "a frame of exabytes": b"\x95" + struct.pack("<Q", 2**62) + b"N0h\x00",
    "bytes of exabytes": b"\x8e" + struct.pack("<Q", 2**62) + b"x",
    "a bytearray of gigabytes": b"\x96" + struct.pack("<Q", 6 * 10**9) + b"x",
    "words of gigabytes": b"X" + struct.pack("<I", 2**32 - 1) + b"x",
    "a number of gigabytes": b"\x8b" + struct.pack("<i", 2**31 - 1) + b"x",
    "a number of many digits": b"I" + b"9" * 5000 + b"\n",
    "a key nested deeply": b"}" + b")" + b"\x85" * 20_000 + b"Ns",
    "a set of what is nested deeply": b"\x8f(" + b")" + b"\x85" * 20_000 + b"\x90",
    "a set made of what is nested deeply": global_("builtins", "set") + b"](" + b")" + b"\x85" * 20_000 + b"e\x85R",
    "a frozenset of what is nested deeply": b"(" + b")" + b"\x85" * 20_000 + b"\x91",
    "lists nested deeply": b"]" * 20_000 + b"a" * 19_999,
    "a list in itself": b"]q\x00h\x00a",
    "a list as a key": b"}]Ns",
    "an array as a key": b"}" + FROM_BUFFER + b"(C\x08" + b"\0" * 8 + FLOATS + b"K\x01\x85" + word("C") + b"tRNs",
    "an array's state set twice over": b"]" + FROM_BUFFER + b"(C\x08" + b"\0" * 8 + FLOATS + b"K\x01\x85" + word("C") + b"tRNb",
    "axes beyond the array's": FROM_BUFFER + b"(C\x08" + b"\0" * 8 + FLOATS + b"K\x01\x85" + word("K") + b"K\x05\x85tR",
}  # fmt: skip


@pytest.mark.parametrize("body", HANDMADE.values(), ids=HANDMADE.keys())
def test_what_no_array_needs_is_refused(tmp_path, body):
    path = tmp_path / "final_data.pkl"
    path.write_bytes(b"\x80\x04" + body + b".")
    tracemalloc.start()
    try:
        refused(lambda: load_pickle(path), "final_data.pkl")
        assert tracemalloc.get_traced_memory()[1] < 2**21 + 200 * len(body)
    finally:
        tracemalloc.stop()


def repeated(body, times, references=2):
    """Lists that each hold the one before several times: 2^times of `body` in a few bytes a level."""
    laughs = body
    for level in range(times):
        laughs += b"q" + bytes([level]) + b"0](" + (b"h" + bytes([level])) * references + b"e"
    return laughs


@pytest.mark.parametrize(
    "body",
    [
        repeated(b"](K\x01K\x01e", 40),
        repeated(FROM_BUFFER + b"(C\x80" + b"\0" * 128 + FLOATS + b"K\x10\x85" + word("C") + b"tR", 40),
        b"](" + b"N" * 20_000 + b"eq\x000]q\x010" + (global_("builtins", "set") + b"h\x00\x85R0") * 2_000 + b"h\x01",
        b"]q\x000" + b"(" + b"N" * 20_000 + b"tq\x010" + (global_("numpy", "dtype") + b"h\x01R0") * 2_000 + b"N",
    ],
    ids=["lists of lists", "an array again and again", "sets of one list", "calls with one tuple"],
)
def test_references_do_not_multiply(tmp_path, body):
    (tmp_path / "final_data.pkl").write_bytes(b"\x80\x04" + body + b".")
    refused(lambda: load_pickle(tmp_path / "final_data.pkl"), "refused")


def test_a_memo_with_a_large_number_takes_no_memory(tmp_path):
    (tmp_path / "a.pkl").write_bytes(b"\x80\x02Nr\xff\xff\xff\x7f.")
    tracemalloc.start()
    try:
        assert load_pickle(tmp_path / "a.pkl") is None and tracemalloc.get_traced_memory()[1] < 2**20
    finally:
        tracemalloc.stop()


ARRAYS = {
    "floats": np.linspace(0, 1, 24).reshape(2, 3, 4), "single": np.float32([[1.5]]), "half": np.float16([1, 2]),
    "whole": np.arange(6).reshape(2, 3), "flags": np.array([True, False]), "bytes": np.arange(4, dtype=np.uint8),
    "transposed": np.arange(6).reshape(2, 3).T, "moved axes": np.arange(24.0).reshape(2, 3, 4).transpose(1, 0, 2),
    "every second": np.arange(10)[::2], "backwards": np.arange(5)[::-1], "other order": np.arange(4, dtype=">i4"),
    "number": np.array(3.0), "empty": np.zeros((0, 3)), "names": np.array(["a", "bc"]), "strings": np.array([b"ab"]),
    "complex": np.array([1 + 2j]),
}  # fmt: skip


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
@pytest.mark.parametrize("array", ARRAYS.values(), ids=ARRAYS.keys())
def test_arrays_of_every_kind_come_through(tmp_path, array, protocol):
    (tmp_path / "a.pkl").write_bytes(pickle.dumps({"one": array, "again": [array]}, protocol))
    found = load_pickle(tmp_path / "a.pkl")
    for copy in (found["one"], found["again"][0]):
        np.testing.assert_array_equal(copy, array)
        assert copy.dtype == array.dtype and copy.flags.writeable


def as_numpy_1(data, protocol):
    """The same pickle with the names that numpy 1 writes."""
    if protocol < 4:
        return data.replace(b"numpy._core.", b"numpy.core.")
    names = (b"numpy._core.multiarray", b"numpy._core.numeric")
    for name in names:
        old = name.replace(b"_core", b"core")
        data = data.replace(bytes([len(name)]) + name, bytes([len(old)]) + old)
    return data[:2] + data[11:] if data[2:3] == b"\x95" else data  # without the frame, whose length has changed


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_arrays_of_numpy_1_come_through(tmp_path, protocol):
    value = {"object_points": np.arange(12.0).reshape(2, 2, 3), "frames": np.int64(2), "poses": [np.eye(4), np.eye(4)]}
    data = as_numpy_1(pickle.dumps(value, protocol), protocol)
    assert b"numpy.core" in data and b"_core" not in data
    (tmp_path / "old.pkl").write_bytes(data)
    found = load_pickle(tmp_path / "old.pkl")
    np.testing.assert_array_equal(found["object_points"], value["object_points"])
    np.testing.assert_array_equal(found["poses"], value["poses"])
    assert found["frames"] == 2


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_numbers_and_containers_come_through(tmp_path, protocol):
    value = [1, -(10**30), 1.5, True, None, "späť", b"ab", b"", bytearray(b"ab"), bytearray(), 1 + 2j, {1, 2}, frozenset("a"),
             {(1, "a"): [()]}, np.float32(1.5), np.bool_(True), np.str_("ab"), (1,), (1, 2), (1, 2, 3, 4)]  # fmt: skip
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(value, protocol))
    assert load_pickle(tmp_path / "a.pkl") == value


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_every_cut_is_refused(tmp_path, protocol):
    whole = pickle.dumps({"points": np.arange(12.0).reshape(4, 3), "names": ["a", "b"]}, protocol)
    for end in range(0, len(whole), 7):
        (tmp_path / "cut.pkl").write_bytes(whole[:end])
        refused(lambda: load_pickle(tmp_path / "cut.pkl"), "cut.pkl")


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of escapes in words
@pytest.mark.parametrize("seed", range(6))
def test_changed_bytes_end_in_an_error_or_in_plain_values(tmp_path, seed):
    random = np.random.default_rng(seed)
    whole = pickle.dumps({"points": np.arange(12.0).reshape(4, 3), "names": {"a", "b"}}, seed)
    for _ in range(150):
        data = bytearray(whole)
        for at in random.integers(0, len(data), 3):
            data[at] = random.integers(256)
        (tmp_path / "changed.pkl").write_bytes(data)
        try:
            load_pickle(tmp_path / "changed.pkl")
        except InputError as error:
            assert "changed.pkl" in str(error)


def test_the_names_that_harm_are_in_the_tests_pickles():
    """The pickles above hold what they say: the tests would pass on empty ones."""
    assert "BUILD" in {op.name for op, _, _ in pickletools.genops(pickle.dumps(MADE["pointers in a structure"], 2))}
    assert b"system" in pickle.dumps(MADE["os.system"])
