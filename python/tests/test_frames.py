"""Frames and safetensors documents: round trips and hostile input."""

from __future__ import annotations

import io
import json
import struct
from typing import Any, Dict, List

import numpy as np
import pytest
from reactsim.client import (
    Array,
    ProtocolError,
    build_safetensors,
    read_frame,
    read_safetensors,
    write_frame,
)

TYPES = ["bool", "u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f2", "f4", "f8"]


def samples() -> Dict[str, Array]:
    """Returns tensors of all types, also without elements and dimensions."""
    rng = np.random.Generator(np.random.PCG64(0))
    tensors: Dict[str, Array] = {f"t-{t}": (rng.random((2, 3)) * 2).astype(t) for t in TYPES}
    tensors["empty"] = np.zeros((0, 5))
    tensors["scalar"] = np.array(3.5)
    tensors["strided"] = np.arange(24.0).reshape(2, 3, 4)[:, ::2]
    tensors["big-endian"] = np.arange(3, dtype=">f8")
    return tensors


def join(metadata: Dict[str, str], tensors: Dict[str, Array]) -> bytes:
    return b"".join(build_safetensors(metadata, tensors))


def parse(document: Any) -> Any:
    return read_safetensors(io.BytesIO(document), len(document))


def document(header: Any, data: bytes = b"") -> bytes:
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + data


def test_round_trip() -> None:
    tensors = samples()
    metadata, read = parse(join({"a": "ü\n"}, tensors))
    assert metadata == {"a": "ü\n"}
    assert set(read) == set(tensors)
    for name, array in tensors.items():
        assert read[name].shape == array.shape
        assert read[name].flags.aligned
        np.testing.assert_array_equal(read[name], array)


def test_agrees_with_the_safetensors_package() -> None:
    package = pytest.importorskip("safetensors.numpy")
    tensors = {
        name: np.ascontiguousarray(t) for name, t in samples().items() if name != "big-endian"
    }
    tensors["scalar"] = np.array(3.5)
    for name, array in package.load(join({"a": "b"}, tensors)).items():
        np.testing.assert_array_equal(array, tensors[name])
    metadata, read = parse(package.save(tensors, {"a": "b"}))
    assert metadata == {"a": "b"}
    for name, array in read.items():
        np.testing.assert_array_equal(array, tensors[name])


F8 = {"dtype": "F64", "shape": [1], "data_offsets": [0, 8]}
HOSTILE: List[Any] = [
    ("too short", b""),
    ("too short", b"1234567"),
    ("header of", struct.pack("<Q", 1 << 63) + b"{}"),
    ("header of", struct.pack("<Q", 3) + b"{}"),
    ("JSON", document(b"{")),
    ("JSON", document(b"\xff\xff")),
    ("JSON", document(b"[" * 100_000)),
    ("not a JSON object", document([])),
    ("twice", document(b'{"a":{},"a":{}}')),
    ("strings", document({"__metadata__": {"a": 1}})),
    ("strings", document({"__metadata__": []})),
    ("incomplete", document({"a": []})),
    ("incomplete", document({"a": {"dtype": "F64"}})),
    ("unknown type", document({"a": {**F8, "dtype": "BF16"}}, bytes(8))),
    ("unknown type", document({"a": {**F8, "dtype": []}}, bytes(8))),
    ("bad shape", document({"a": {**F8, "shape": [-1]}}, bytes(8))),
    ("bad shape", document({"a": {**F8, "shape": [True]}}, bytes(8))),
    ("bad shape", document({"a": {**F8, "shape": [1.0]}}, bytes(8))),
    ("bad shape", document({"a": {**F8, "shape": 1}}, bytes(8))),
    ("bad shape", document({"a": {**F8, "shape": [1 << 62]}}, bytes(8))),
    ("does not fit", document({"a": {**F8, "shape": [2]}}, bytes(8))),
    ("does not fit", document({"a": {**F8, "shape": [1] * 9}}, bytes(8))),
    ("does not fit", document({"a": {**F8, "shape": [1 << 61, 8]}}, bytes(8))),
    ("does not fit", document({"a": {**F8, "data_offsets": [8, 0]}}, bytes(8))),
    ("does not fit", document({"a": {**F8, "data_offsets": [0, 8, 8]}}, bytes(8))),
    ("ends after", document({"a": F8}, bytes(7))),
    ("gap or overlap", document({"a": {**F8, "data_offsets": [8, 16]}}, bytes(16))),
    ("gap or overlap", document({"a": F8, "b": F8}, bytes(8))),
    ("after the last tensor", document({"a": F8}, bytes(9))),
]


@pytest.mark.parametrize(("message", "data"), HOSTILE, ids=range(len(HOSTILE)))
def test_hostile_documents(message: str, data: bytes) -> None:
    with pytest.raises(ProtocolError, match=message):
        parse(data)


def test_every_changed_byte_is_read_or_refused() -> None:
    good = join({"type": "x"}, {"a": np.arange(3.0), "b": np.arange(4, dtype=np.uint8)})
    for at in range(len(good)):
        for flip in (1, 0x20, 0x80, 0xFF):
            changed = bytearray(good)
            changed[at] ^= flip
            try:
                parse(changed)
            except ProtocolError:
                pass


def test_truncated_documents() -> None:
    good = join({"type": "x"}, {"a": np.arange(3.0)})
    for length in range(len(good)):
        with pytest.raises(ProtocolError):
            parse(good[:length])


def test_frames() -> None:
    stream = io.BytesIO()
    write_frame(stream, "plan", "7", {"frame": "10"}, {"a": np.arange(3.0)})
    write_frame(stream, "bye", "8")
    stream.seek(0)
    frame = read_frame(stream)
    assert frame is not None
    assert frame[0] == {"type": "plan", "protocol": "1", "seq": "7", "frame": "10"}
    np.testing.assert_array_equal(frame[1]["a"], [0.0, 1.0, 2.0])
    assert read_frame(stream) == ({"type": "bye", "protocol": "1", "seq": "8"}, {})
    assert read_frame(stream) is None
    whole = stream.getvalue()
    for length in range(1, 100):
        with pytest.raises(ProtocolError, match="ended within"):
            read_frame(io.BytesIO(whole[:length]))
    with pytest.raises(ProtocolError, match="limit"):
        read_frame(io.BytesIO(b"\xff" * 100))
    text = document({"__metadata__": {"type": "x", "protocol": "1"}})
    with pytest.raises(ProtocolError, match="without `seq`"):
        read_frame(io.BytesIO(struct.pack("<Q", len(text)) + text))


def test_tensors_are_read_into_arrays_that_fit() -> None:
    stream = io.BytesIO()
    tensors = samples()
    write_frame(stream, "plan", "7", {"frame": "10"}, tensors)
    write_frame(stream, "bye", "8")
    whole = stream.getvalue()
    block = np.full((5, 2, 3), 9.0)
    unfit = {"t-f4": np.zeros((3, 2), np.float32), "t-i4": np.zeros((2, 3)), "other": block[0]}
    room = {"t-f8": block[1], "t-u8": np.zeros((2, 6), np.uint64)[:, ::2], **unfit}
    stream.seek(0)
    found, plain = read_frame(stream, room), read_frame(io.BytesIO(whole))
    assert found is not None and plain is not None and found[0] == plain[0]
    assert set(found[1]) == set(plain[1])
    assert [name for name, array in room.items() if found[1].get(name) is array] == ["t-f8"]
    for name, array in plain[1].items():
        assert found[1][name].dtype == array.dtype
        np.testing.assert_array_equal(found[1][name], array)
    np.testing.assert_array_equal(block[1], tensors["t-f8"])
    assert (block[[0, 2, 3, 4]] == 9.0).all()
    assert read_frame(stream, room) == ({"type": "bye", "protocol": "1", "seq": "8"}, {})
    assert read_frame(stream, room) is None
    for length in range(1, len(whole) - 100, 7):
        with pytest.raises(ProtocolError, match="ended within"):
            read_frame(io.BytesIO(whole[:length]), room)


def test_unsupported_type() -> None:
    with pytest.raises(ProtocolError, match="complex128"):
        build_safetensors({}, {"a": np.zeros(2, complex)})
