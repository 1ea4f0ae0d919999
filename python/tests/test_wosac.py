"""Tests of the realism metrics from Python."""

from __future__ import annotations

import dataclasses
import struct
import sys
import tarfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import reactsim
from fakes import ROOT
from reactsim.wosac import score_run

SHARED = ROOT.parent / "shared"


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
        reactsim.wosac([], reactsim.WosacRollouts("a", ids, np.zeros(shape)))


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


def rollouts_of(archive: Path) -> Iterator[reactsim.WosacRollouts]:
    """Returns the rollouts of a submission."""
    with tarfile.open(archive) as files:
        contents = [member.read() for member in map(files.extractfile, files) if member]
    for content in contents:
        for scenario in fields(content)[1]:
            message = fields(scenario)
            scenes = [fields(scene)[1] for scene in message[2]]
            objects = [[fields(trajectory) for trajectory in scene] for scene in scenes]
            states = [
                [[np.frombuffer(one[key][0], "<f4") for key in (2, 3, 4, 5)] for one in scene]
                for scene in objects
            ]
            yield reactsim.WosacRollouts(
                message[1][0].decode(),
                [one[6][0] for one in objects[0]],
                np.array(states).swapaxes(2, 3),
            )


def fields(message: bytes) -> dict[int, list[Any]]:
    """Returns the values of a message of protocol buffers by the number of the field."""
    found: dict[int, list[Any]] = {}
    at = 0

    def number() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = message[at]
            value, shift, at = value | (byte & 0x7F) << shift, shift + 7, at + 1
            if byte < 0x80:
                return value

    while at < len(message):
        key = number()
        value: Any = number()
        if key & 7 == 2:
            value, at = message[at : at + value], at + value
        found.setdefault(key >> 3, []).append(value)
    return found


def check_shares(scenario: Path, rollouts: reactsim.WosacRollouts) -> None:
    """Compares shares with scores of the other rollouts."""
    configs = ["2025", "2023"]
    sideways = np.zeros_like(rollouts.states)
    sideways[..., 1] = 0.1 * np.arange(len(sideways))[:, None, None]
    states = rollouts.states + sideways

    def scored(states: Any) -> reactsim.WosacScores:
        given = dataclasses.replace(rollouts, states=states)
        return reactsim.wosac(scenario, given, configs=configs, shares=True)

    scores = scored(states)
    assert [share.config for share in scores.shares] == configs
    for left_out in (0, 17, 31):
        others = scored(np.delete(states, left_out, axis=0))
        for share, row, other in zip(scores.shares, scores.rows, others.rows, strict=True):
            assert (share.scenario_id, share.config) == (row["scenario_id"], row["config"])
            assert {len(values) for values in share.likelihoods.values()} == {len(states)}
            assert share.metametric[left_out] == row["metametric"] - other["metametric"]
            for name, values in share.likelihoods.items():
                assert values[left_out] == row[name] - other[name]
    assert np.isnan(scored(states[:1]).shares[0].metametric).tolist() == [True]


@pytest.mark.program
@pytest.mark.usefixtures("with_program")
def test_runs_have_shares_of_their_rollouts() -> None:
    run = reactsim.run(
        baselines=["mix:idm=0.5+stop=0.5"],
        protocol="realism",
        rollouts=3,
        limit=2,
        progress=False,
    )
    assert run.wosac().shares == []
    scores = run.wosac(shares=True)
    assert [share.scenario_id for share in scores.shares] == [
        row["scenario_id"] for row in scores.rows
    ]
    for share in scores.shares:
        assert share.metametric.shape == (3,)
        assert len(share.likelihoods) == 10
        assert np.isfinite([share.metametric, *share.likelihoods.values()]).all()


@pytest.mark.program
@pytest.mark.usefixtures("with_program")
def test_runs_arrays_and_submissions_have_the_same_scores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
    archive = tmp_path / "a.tar.gz"
    reactsim.command(
        "export", "wosac", run, scenarios=scenario, metadata=metadata, out=archive, progress=False
    )
    submission = score_run(archive, scenario)
    assert submission.means["2025"]["metametric"] == pytest.approx(metrics["metametric"], abs=1e-3)

    arrays = next(rollouts_of(archive))
    in_memory = reactsim.wosac(scenario, arrays)
    assert (in_memory.means, in_memory.rows[0]["rollouts"]) == (submission.means, 32)
    check_shares(scenario, arrays)
    with pytest.raises(reactsim.ReactsimError, match="unknown configuration `2020`"):
        reactsim.wosac(scenario, arrays, configs=["2020"])
    monkeypatch.setattr(sys.modules["reactsim.wosac"], "CHUNK_BYTES", 1)
    unknown = dataclasses.replace(arrays, scenario_id="other")
    several = reactsim.wosac(scenario, iter([arrays, unknown, arrays]))
    assert several.means == in_memory.means
    assert "no scenario file has the scenario `other`" in several.failures[0]
    assert "is given twice" in several.failures[1]

    with pytest.raises(reactsim.ReactsimError, match="realism"):
        reactsim.command(
            *("export", "wosac"),
            reactsim.run(baselines=["stop"], scenarios=scenario, av="log", progress=False),
            scenarios=scenario,
            metadata=metadata,
            out=tmp_path / "b.tar.gz",
            progress=False,
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
