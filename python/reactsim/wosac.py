"""The realism metrics of the Waymo Open Sim Agents Challenge, for training loops."""

from __future__ import annotations

import dataclasses
import json
import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .client import Array, as_array
from .options import PathLike, Sources, each, joined, paths
from .process import shared_request
from .program import arguments, invoke
from .scenarios import STEPS, reading_of

__all__ = ["WosacRollouts", "WosacScores", "WosacShares", "score_run", "wosac"]

CHUNK_BYTES = 64 << 20  # of states in a request


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
class WosacShares:
    """Shares of R rollouts in the metrics of their scenario, in one configuration.

    The share of a rollout is the metric of all rollouts minus the metric of the other R - 1. It is
    negative if the rollout lowers the metric, and NaN if R is 1.

    Attributes:
        scenario_id: Id of the scenario.
        config: Configuration of the metrics.
        metametric: Shares in the metametric, float64 [R].
        likelihoods: Shares in the likelihoods of the features, float64 [R], by the field names of
            `SimAgentMetrics`, such as `collision_indication_likelihood`.

    """

    scenario_id: str
    config: str
    metametric: Array
    likelihoods: dict[str, Array]


@dataclasses.dataclass(frozen=True)
class WosacScores:
    """Realism metrics of a set of scenarios.

    Attributes:
        means: By configuration: all metrics with the field names of the official messages
            (`SimAgentMetrics`, `SimAgentsBucketedMetrics`), as means over scenarios.
        rows: One dictionary per scenario and configuration.
        failures: What could not be scored, with the reason.
        shares: Shares of the rollouts in the order of `rows`; empty without `shares=True`.

    """

    means: dict[str, dict[str, float]]
    rows: list[dict[str, Any]]
    failures: list[str]
    shares: list[WosacShares]


def wosac(
    scenarios: PathLike | Sequence[PathLike],
    rollouts: WosacRollouts | Iterable[WosacRollouts],
    *,
    configs: Sequence[str] = ("2025",),
    shares: bool = False,
    jobs: int | None = None,
) -> WosacScores:
    """Computes the realism metrics of rollouts in memory.

    The first call starts a process of the program, which all calls use. It keeps the recordings of
    the scenarios that were scored last, so that many calls for a scenario read it once.

    Args:
        scenarios: Files of the Waymo Open Motion Dataset with the scenarios; others in them do not
            matter.
        rollouts: Rollouts of any number of scenarios, 32 each for the metrics of the challenge.
            They are taken 64 MB at a time from a generator.
        configs: Configurations: "2025", "2024", "2023", "2024_challenge_code".
        shares: Return the shares of every rollout in the metrics of its scenario.
        jobs: Number of threads; one per core by default.

    Raises:
        ReactsimError: No scenario could be scored.
        ValueError: Arrays have other shapes than documented.

    """
    several = [rollouts] if isinstance(rollouts, WosacRollouts) else rollouts
    given = {
        "logs": reading_of(scenarios)["paths"],
        "configs": list(configs),
        "shares": shares,
        "jobs": jobs or os.cpu_count() or 1,
    }
    scores, rows, repeated = "", "", list[str]()
    for chunk in _chunks(several, repeated):
        named = [{"id": scenario, "objects": objects} for scenario, objects, _ in chunk]
        tensors = {f"states-{i}": states for i, (_, _, states) in enumerate(chunk)}
        answer, _ = shared_request("wosac", {**given, "scenarios": named}, tensors)
        scores += answer["scores"] + "\n"
        rows += answer["rows"]
    texts = np.frombuffer((scores + "\n").encode(), np.uint8)
    summary, _ = shared_request("wosac-summary", {"configs": given["configs"]}, {"scores": texts})
    summary["failures"] += [
        f"scenario `{id}` is given twice: the first one counts" for id in repeated
    ]
    return _read(summary, rows)


def score_run(
    run: PathLike,
    scenarios: Sources = None,
    *,
    simulator: str | None = None,
    configs: Sequence[str] = ("2025",),
    shares: bool = False,
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
        shares: Return the shares of every rollout in the metrics of its scenario.
        partial: Accept another number of rollouts than 32, and runs without all scenarios.
        jobs: Number of threads; one per core by default.

    Raises:
        ReactsimError: No scenario could be scored.

    """
    with tempfile.TemporaryDirectory(prefix="reactsim-") as home:
        out = Path(home, "scores")
        given = [
            *(("--wosac", True), ("--quiet", True), ("--partial", partial)),
            *each("--scenarios", paths(scenarios)),
            ("--simulator", simulator),
            ("--wosac-config", joined(configs)),
            ("--out", out),
            ("--format", "json"),
            ("--jobs", jobs),
        ]
        output = invoke(["score", *arguments(given, paths(run))], codes=(0, 1))
        rows = Path(out, "wosac.jsonl").read_text(encoding="utf-8")
        return _read(output.document if shares else {**output.document, "shares": []}, rows)


def _read(scores: Mapping[str, Any], rows: str) -> WosacScores:
    """Returns scores from a document and lines in JSON."""
    means = {
        name: {**config["metrics"], **config["buckets"]}
        for name, config in scores["configs"].items()
    }
    shares = [_shares(**line) for line in scores.get("shares", [])]
    lines = [json.loads(row) for row in rows.splitlines()]
    return WosacScores(means, lines, scores["failures"], shares)


def _shares(scenario_id: str, config: str, **numbers: list[float | None]) -> WosacShares:
    """Returns the shares of a scenario and configuration, where null is an undefined number."""
    arrays = {name: np.array(values, np.float64) for name, values in numbers.items()}
    return WosacShares(scenario_id, config, arrays.pop("metametric"), arrays)


def _chunks(
    rollouts: Iterable[WosacRollouts], repeated: list[str]
) -> Iterator[list[tuple[str, list[int], Array]]]:
    """Returns ids of scenarios, ids of objects and states, as many as one request takes.

    Scenarios that were there before are left out, and their ids are added to `repeated`.
    """
    ids: set[str] = set()
    chunk: list[tuple[str, list[int], Array]] = []
    for one in rollouts:
        if one.scenario_id in ids:
            repeated.append(one.scenario_id)
            continue
        ids.add(one.scenario_id)
        chunk.append((one.scenario_id, *_checked(one)))
        if sum(states.nbytes for _, _, states in chunk) > CHUNK_BYTES:
            yield chunk
            chunk = []
    if chunk:
        yield chunk


def _checked(rollouts: WosacRollouts) -> tuple[list[int], Array]:
    """Returns ids of objects, and states as f32 [R, N, 80, 4]."""
    states = as_array(rollouts.states).astype("<f4", copy=False)
    ids = np.asarray(rollouts.object_id)
    if states.ndim != 4 or states.shape[2:] != (STEPS, 4):
        raise ValueError(f"states have the shape {states.shape}, expected [R, N, {STEPS}, 4]")
    if ids.shape != states.shape[1:2] or not np.issubdtype(ids.dtype, np.integer):
        found = f"the shape {ids.shape} and type {ids.dtype}"
        raise ValueError(f"object_id has {found}, expected {states.shape[1]} integers")
    if ids.size and (ids.min() < 0 or ids.max() >= 1 << 31):
        raise ValueError("object_id must be between 0 and 2^31 - 1")
    return ids.tolist(), states
