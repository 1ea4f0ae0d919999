"""The realism metrics of the Waymo Open Sim Agents Challenge, for training loops."""

from __future__ import annotations

import dataclasses
import json
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .options import Options, PathLike, Run, Sources, each, folders, joined, paths
from .program import arguments, invoke

__all__ = ["WosacRollouts", "WosacScores", "score_run", "wosac"]

STEPS = 80
KEYS = (0x12, 0x1A, 0x22, 0x2A)  # fields 2 to 5 of SimulatedTrajectory: x, y, z, heading
ID_KEY = 0x30  # field 6: object_id
ID_BYTES = 5  # every id is written with as many bytes, so that all trajectories are equally long
SCENE_KEY = 0x12  # field 2 of ScenarioRollouts: joint_scenes
FIELD_1 = 0x0A


@dataclasses.dataclass(frozen=True)
class WosacRollouts:
    """Rollouts of one scenario.

    Attributes:
        scenario_id: Id of the scenario.
        object_id: Ids of the simulated objects, integers [N]: the tracks that are valid at frame
            10.
        states: x, y, z (metres, world coordinates) and heading (radians) of the frames 11 to 90,
            float32 [R, N, 80, 4].

    """

    scenario_id: str
    object_id: Any
    states: Any


@dataclasses.dataclass(frozen=True)
class WosacScores:
    """Realism metrics of a set of scenarios.

    Attributes:
        means: By configuration: all metrics with the field names of the official messages
            (`SimAgentMetrics`, `SimAgentsBucketedMetrics`), as means over scenarios.
        rows: One dictionary per scenario and configuration.
        failures: What could not be scored, with the reason.

    """

    means: dict[str, dict[str, float]]
    rows: list[dict[str, Any]]
    failures: list[str]


def wosac(
    scenarios: PathLike | Sequence[PathLike],
    rollouts: WosacRollouts | Iterable[WosacRollouts],
    *,
    configs: Sequence[str] = ("2025",),
    jobs: int | None = None,
) -> WosacScores:
    """Computes the realism metrics of rollouts, in one call of the program.

    Args:
        scenarios: Files of the Waymo Open Motion Dataset with the scenarios; others in them do not
            matter.
        rollouts: Rollouts of any number of scenarios, 32 each for the metrics of the challenge.
            They are taken one after the other, so that a generator needs the memory of one.
        configs: Configurations: "2025", "2024", "2023", "2024_challenge_code".
        jobs: Number of threads; one per core by default.

    Raises:
        ReactsimError: No scenario could be scored.
        ValueError: Arrays have other shapes than documented.

    """
    several = [rollouts] if isinstance(rollouts, WosacRollouts) else rollouts
    with tempfile.TemporaryDirectory(prefix="reactsim-") as home:
        file = Path(home, "rollouts.binproto")
        with file.open("wb") as stream:
            for one in several:
                message = encode(one)
                stream.write(bytes([FIELD_1]) + varint(len(message)))
                stream.write(message)
        given: Options = [("--partial", True), *each("--scenarios", paths(scenarios))]
        return _score(file, given, configs, jobs)


def score_run(
    run: Run,
    scenarios: Sources = None,
    *,
    simulator: str | None = None,
    configs: Sequence[str] = ("2025",),
    partial: bool = False,
    jobs: int | None = None,
) -> WosacScores:
    """Computes the realism metrics of the kept rollouts of a run; `Results.wosac` calls it.

    Args:
        run: Run folder or `Results`, or a submission: an archive (.tar.gz), a folder or a
            .binproto file. The metrics of the challenge are for 32 rollouts in the realism
            protocol, with `all_agents`.
        scenarios: Scenarios of the run; the shipped ones by default.
        simulator: Simulator, if the run has several.
        configs: Configurations: "2025", "2024", "2023", "2024_challenge_code".
        partial: Accept another number of rollouts than 32, and runs without all scenarios.
        jobs: Number of threads; one per core by default.

    Raises:
        ReactsimError: No scenario could be scored.

    """
    given: Options = [
        ("--partial", partial),
        *each("--scenarios", paths(scenarios)),
        ("--simulator", simulator),
    ]
    return _score(folders(run)[0], given, configs, jobs)


def _score(
    rollouts: PathLike, given: Options, configs: Sequence[str], jobs: int | None
) -> WosacScores:
    """Lets the program score rollouts, and reads what it wrote."""
    with tempfile.TemporaryDirectory(prefix="reactsim-") as home:
        out = Path(home, "scores")
        given = [
            *(("--wosac", True), ("--quiet", True)),
            *given,
            ("--wosac-config", joined(configs)),
            ("--out", out),
            ("--format", "json"),
            ("--jobs", jobs),
        ]
        output = invoke(["score", *arguments(given, [rollouts])], codes=(0, 1))
        scores = output.document
        lines = Path(out, "wosac.jsonl").read_text(encoding="utf-8").splitlines()
    means = {
        name: {**config["metrics"], **config["buckets"]}
        for name, config in scores["configs"].items()
    }
    return WosacScores(means, [json.loads(line) for line in lines], scores["failures"])


def encode(rollouts: WosacRollouts) -> bytes:
    """Returns a `ScenarioRollouts` message."""
    states = np.asarray(rollouts.states, dtype="<f4")
    ids = np.asarray(rollouts.object_id)
    if states.ndim != 4 or states.shape[2:] != (STEPS, 4):
        raise ValueError(f"states have the shape {states.shape}, expected [R, N, {STEPS}, 4]")
    if ids.shape != states.shape[1:2] or not np.issubdtype(ids.dtype, np.integer):
        found = f"the shape {ids.shape} and type {ids.dtype}"
        raise ValueError(f"object_id has {found}, expected {states.shape[1]} integers")
    if ids.size and (ids.min() < 0 or ids.max() >= 1 << 31):
        raise ValueError("object_id must be between 0 and 2^31 - 1")
    count, objects = states.shape[:2]
    numbers = varint(4 * STEPS)
    length = len(KEYS) * (1 + len(numbers) + 4 * STEPS) + 1 + ID_BYTES
    head = bytes([FIELD_1]) + varint(length)
    record = np.zeros((count, objects, len(head) + length), np.uint8)
    record[..., : len(head)] = np.frombuffer(head, np.uint8)
    at = len(head)
    for field, key in enumerate(KEYS):
        begin = bytes([key]) + numbers
        record[..., at : at + len(begin)] = np.frombuffer(begin, np.uint8)
        at += len(begin)
        values = np.ascontiguousarray(states[..., field])
        record[..., at : at + 4 * STEPS] = values.view(np.uint8)
        at += 4 * STEPS
    record[..., at] = ID_KEY
    for k in range(ID_BYTES):
        more = 0x80 if k + 1 < ID_BYTES else 0
        record[..., at + 1 + k] = ((ids.astype(np.int64) >> (7 * k)) & 0x7F) | more
    name = rollouts.scenario_id.encode()
    scene = bytes([SCENE_KEY]) + varint(objects * record.shape[2])
    parts = [bytes([FIELD_1]) + varint(len(name)) + name]
    parts += [scene + record[r].tobytes() for r in range(count)]
    return b"".join(parts)


def varint(value: int) -> bytes:
    """Returns a number in the variable length of protocol buffers."""
    digits = []
    while value >= 0x80:
        digits.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*digits, value])
