"""Tests of the realism metrics from Python."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
import reactsim
from fakes import ROOT
from reactsim.wosac import encode, score_run, varint

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


def recording(path: Path) -> Path:
    """Writes the recording of a shared scenario as a TFRecord."""
    scenario = SHARED / "wosac_golden" / "ee519cf571686d19.scenario.binproto.zst"
    if not scenario.is_file():
        pytest.skip("the shared data are missing")
    pyarrow = pytest.importorskip("pyarrow")
    data = pyarrow.input_stream(scenario, compression="zstd").read()
    length = struct.pack("<Q", len(data))
    path.write_bytes(length + masked_crc32c(length) + data + masked_crc32c(data))
    return path


def masked_crc32c(data: bytes) -> bytes:
    """Returns the checksum of TFRecords."""
    table = []
    for entry in range(256):
        for _ in range(8):
            entry = entry >> 1 ^ (0x82F63B78 if entry & 1 else 0)
        table.append(entry)
    checksum = 0xFFFFFFFF
    for byte in data:
        checksum = table[(checksum ^ byte) & 0xFF] ^ checksum >> 8
    checksum ^= 0xFFFFFFFF
    return struct.pack("<I", (checksum >> 15 | checksum << 17) + 0xA282EAD8 & 0xFFFFFFFF)


@pytest.mark.program
@pytest.mark.usefixtures("with_program")
def test_runs_arrays_and_submissions_have_the_same_scores(tmp_path: Path) -> None:
    scenario = recording(tmp_path / "scenario.tfrecord")
    run = reactsim.run(
        baselines=["constant-velocity"],
        scenarios=scenario,
        protocol="realism",
        rollouts=32,
        all_agents=True,
        progress=False,
    )
    scores = run.wosac(scenario)
    assert scores.failures == []
    metrics = scores.means["2025"]
    assert 0 < metrics["metametric"] < 1
    assert len(scores.rows) == 1

    metadata = tmp_path / "metadata.toml"
    metadata.write_text(
        'account_name = "a@example.org"\nunique_method_name = "a"\nnum_model_parameters = "1"\n'
        "uses_lidar_data = false\nuses_camera_data = false\n"
        "uses_public_model_pretraining = false\n"
    )
    archive = reactsim.export_wosac(
        run, tmp_path / "a.tar.gz", scenarios=scenario, metadata=metadata
    )
    submission = score_run(archive, scenario)
    assert submission.means["2025"]["metametric"] == pytest.approx(metrics["metametric"], abs=1e-3)

    with pytest.raises(reactsim.ReactsimError, match="realism"):
        reactsim.export_wosac(
            reactsim.run(baselines=["stop"], scenarios=scenario, av="log", progress=False),
            tmp_path / "b.tar.gz",
            scenarios=scenario,
            metadata=metadata,
        )


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
