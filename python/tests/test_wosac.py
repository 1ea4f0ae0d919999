"""Tests of the realism metrics from Python."""

from __future__ import annotations

import numpy as np
import pytest
import reactsim
from fakes import ROOT
from reactsim.wosac import encode, varint

SHARED = ROOT.parent / "shared"


def test_numbers_have_the_variable_length_of_protocol_buffers() -> None:
    assert [varint(value).hex() for value in (0, 127, 128, 300)] == ["00", "7f", "8001", "ac02"]


def test_messages_have_the_length_that_they_state() -> None:
    states = np.zeros((2, 3, 80, 4), np.float32)
    message = encode(reactsim.WosacRollouts("abc", [1, 200, 3_000_000], states))
    assert message[:5] == b"\x0a\x03abc"
    rest = message[5:]
    for _ in range(2):
        assert rest[0] == 0x12
        length = rest[1] & 0x7F | rest[2] << 7
        assert rest[3] == 0x0A
        rest = rest[3 + length :]
    assert rest == b""


@pytest.mark.parametrize(
    ("ids", "shape", "fault"),
    [
        ([1], (1, 1, 79, 4), "expected \\[R, N, 80, 4\\]"),
        ([1, 2], (1, 1, 80, 4), "expected 1 integers"),
        ([0.5], (1, 1, 80, 4), "expected 1 integers"),
        ([-1], (1, 1, 80, 4), "between 0 and"),
    ],
)
def test_other_arrays_are_refused(ids: list[float], shape: tuple[int, ...], fault: str) -> None:
    with pytest.raises(ValueError, match=fault):
        encode(reactsim.WosacRollouts("a", ids, np.zeros(shape)))


@pytest.mark.usefixtures("with_program")
def test_scores_are_those_of_the_program() -> None:
    scenario = SHARED / "wosac_golden" / "637f20cafde22ff8.scenario.binproto.zst"
    if not scenario.is_file():
        pytest.skip("the shared data are missing")
    # Every object stays where the map's origin is: a wrong answer with defined scores.
    with pytest.raises(reactsim.ReactsimError, match="object_id"):
        reactsim.wosac(
            scenario,
            reactsim.WosacRollouts("637f20cafde22ff8", [1], np.zeros((1, 1, 80, 4))),
        )
    with pytest.raises(reactsim.ReactsimError, match="no scenario file has the scenario `other`"):
        reactsim.wosac(scenario, reactsim.WosacRollouts("other", [1], np.zeros((1, 1, 80, 4))))
