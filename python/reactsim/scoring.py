"""Scores rollouts that other programs produced."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .client import Array, as_array
from .options import PathLike, each, paths, reading, settings, several, texts
from .process import shared_request
from .program import arguments, produce
from .results import Results
from .rows import Event, read_event, value_of
from .scenarios import Scenario

__all__ = ["Event", "RolloutScores", "StatesScores", "score", "score_states"]


def score(
    rollouts: PathLike | Sequence[PathLike],
    scenarios: PathLike | Sequence[PathLike],
    *,
    out: PathLike,
    deviations: PathLike | None = None,
    allow: str | Sequence[str] = (),
    pose: str | None = None,
    metric_options: Mapping[str, Any] | None = None,
    current_frame: int | None = None,
    window_step: int | None = None,
    history: int | None = None,
    future: int | str | None = None,
    all_agents: bool = False,
    jobs: int | None = None,
    progress: bool = True,
) -> Results:
    """Scores rollouts in Parquet and returns the results of a run.

    Args:
        rollouts: Files of rollouts, in the format of `rollouts.parquet` in a run folder.
        scenarios: Files, folders or URLs of their scenarios.
        out: Run folder to write.
        deviations: File of deviated AVs with which the rollouts were made, if they are not those in
            the files of the scenarios.
        allow: Checks that the motion may fail, such as "teleports"; the results are marked.
        pose: Point of vehicles whose poses the rollouts have: "centre", "rear-axle",
            "rear-axle=1.2" (metres) or "rear-axle=25%" (of the length).
        metric_options: Variants of the metrics, such as `{"fault_order": "nuplan"}`.
        current_frame: Index of the current frame, as in the run that made the rollouts; so are the
            four following.
        window_step: Frames between scenarios of one recording.
        history: Number of frames up to and including the current one.
        future: Number of frames after the current one, or a time such as "15s", or "log".
        all_agents: All agents were simulated.
        jobs: Number of threads; one per core by default.
        progress: Show the messages of the program.

    Raises:
        ReactsimError: No rollout could be scored, or a check failed. Scenarios that failed only
            cause a warning.

    """
    given = [
        *each("--scenarios", paths(scenarios)),
        ("--deviations", deviations),
        *each("--allow", allow),
        ("--pose", pose),
        *settings("--metric-option", metric_options),
        *reading(current_frame, window_step, history, future, all_agents),
        ("--out", out),
        ("--jobs", jobs),
    ]
    command = ["score", *arguments(given, paths(rollouts))]
    produce(command, Path(out, "provenance.json"), show=progress)
    return Results(out)


@dataclasses.dataclass(frozen=True)
class RolloutScores:
    """Scores of one rollout.

    Attributes:
        metrics: Value by id of the metric, such as "aav-collision"; None where nothing could be
            judged.
        deviation: Deviation of the AV from the log, by name.
        outcomes: Checks of the motion that the rollout failed and that were allowed, such as
            "allowed-teleports".
        events: Occurrences that the metrics counted.

    """

    metrics: dict[str, float | None]
    deviation: dict[str, float]
    outcomes: dict[str, int]
    events: list[Event]


@dataclasses.dataclass(frozen=True)
class StatesScores:
    """Scores of the rollouts of a scenario.

    Attributes:
        scenario: Id of the scenario.
        rollouts: Scores of each rollout.
        metrics: Value by id of the metric: the mean over the rollouts where it is defined, and the
            value over all rollouts for the metrics that compare them with the log, such as
            "min-ade".

    """

    scenario: str
    rollouts: list[RolloutScores]
    metrics: dict[str, float | None]


def score_states(
    scenario: Scenario,
    states: Any,
    *,
    agents: Sequence[str] | None = None,
    simulator: str = "states",
    allow: str | Sequence[str] = (),
    pose: str | None = None,
    metric_options: Mapping[str, Any] | None = None,
) -> StatesScores:
    """Scores rollouts in memory. The numbers are equal to `score` for the same rollouts in a file.

    The first call starts a process of the program, which all calls use. It keeps the scenarios that
    were scored last, so that many calls for a scenario read it once.

    Args:
        scenario: The scenario, from `reactsim.scenarios`. Its AV is the deviated one of the file of
            `deviations` with which it was read, or else of its own file: states of another AV are
            refused, or with `allow="other-av"` scored without the metrics of reactions to it.
        states: States at all steps, [rollouts, agents, `scenario.n_steps`, 3 or 5]: x, y, heading,
            and vx and vy, which may be left out; NaN or masked where an agent is absent. Metres,
            radians and m/s; box centres in the local frame of the scenario. Without the first
            dimension it is one rollout. Or a mapping from ids of agents to arrays without the
            dimension of agents. Agents of the scenario that are left out of the mapping are absent.
        agents: Ids of the agents of an array; `scenario.agents` by default.
        simulator: Name of the simulator in messages.
        allow: Checks that the motion may fail, such as "teleports".
        pose: Point of vehicles whose poses the states have: "centre", "rear-axle",
            "rear-axle=1.2" (metres) or "rear-axle=25%" (of the length).
        metric_options: Variants of the metrics, such as `{"fault_order": "nuplan"}`.

    Raises:
        ValueError: The array has another shape or type, or infinite numbers.
        ReactsimError: The program refuses the rollouts, or a check failed.

    """
    if isinstance(states, Mapping):
        if agents is not None:
            raise ValueError(
                "`agents` is given next to a mapping, whose keys are the ids: leave it out"
            )
        agents = list(states)
        states = _stacked(states, scenario.n_steps)
    count = len(scenario.agents) if agents is None else len(agents)
    array = _checked(states, count, scenario.n_steps)
    given = {
        "reading": {**scenario.reading(), "deviations": scenario.deviations},
        "scenario": scenario.id,
        "simulator": simulator,
        "agents": None if agents is None else list(agents),
        "allow": several(allow),
        "pose": pose,
        "metric_options": texts(metric_options),
    }
    answer, _ = shared_request("score", given, {"states": array})
    return read_scores(answer["rows"], answer["events"])


def read_scores(lines: Sequence[Mapping[str, Any]], events: Sequence[Any]) -> StatesScores:
    """Returns scores from the rows of rollouts, of which the last one is over all, and events."""
    *rows, last = lines
    results = [
        RolloutScores(
            _values(row),
            row.get("deviation", {}),
            row.get("outcomes", {}),
            [read_event(event) for event in found],
        )
        for row, found in zip(rows, events)
    ]
    return StatesScores(last["scenario"], results, {**_means(results), **_values(last)})


def _stacked(states: Mapping[str, Any], steps: int) -> Array:
    """Returns the arrays of agents as one array."""
    arrays = [as_array(array) for array in states.values()]
    if not arrays:
        raise ValueError("`states` is an empty mapping, expected an array per agent")
    shapes = {array.shape for array in arrays}
    if len(shapes) > 1:
        raise ValueError(f"`states` has arrays of the shapes {sorted(shapes)}, expected one shape")
    if arrays[0].ndim not in (2, 3):
        raise ValueError(
            f"`states` has arrays of the shape {arrays[0].shape}, expected [rollouts, {steps}, 3 or"
            f" 5] or [{steps}, 3 or 5]"
        )
    return np.stack(arrays, axis=-3)


def _checked(states: Any, agents: int, steps: int) -> Array:
    """Returns states as f64 [rollouts, agents, steps, 3 or 5]."""
    array = as_array(states)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"`states` has the type {array.dtype}, expected numbers")
    if array.ndim == 3:
        array = array[None]
    is_fit = array.ndim == 4 and array.shape[1:3] == (agents, steps) and array.shape[3] in (3, 5)
    if not is_fit or len(array) == 0:
        raise ValueError(
            f"`states` has the shape {np.shape(states)}, expected [rollouts, {agents}, {steps}, 3"
            f" or 5] for {agents} agents"
        )
    array = np.ascontiguousarray(array, np.float64)
    x, y, heading = np.moveaxis(np.isnan(array[..., :3]), -1, 0)
    is_partial, is_infinite = (x != y) | (x != heading), np.isinf(array)
    if is_partial.any() or is_infinite.any():
        rollout, agent, step = np.argwhere(is_partial | is_infinite.any(-1))[0]
        found = array[rollout, agent, step].tolist()
        raise ValueError(
            f"`states[{rollout}, {agent}, {step}]` is {found}, expected finite x, y and heading, or"
            " NaN in all three for an absent agent"
        )
    return array


def _values(row: Mapping[str, Any]) -> dict[str, float | None]:
    return {metric: value_of(value) for metric, value in row["metrics"].items()}


def _means(rollouts: Sequence[RolloutScores]) -> dict[str, float | None]:
    means: dict[str, float | None] = {}
    for metric in rollouts[0].metrics:
        values = [rollout.metrics[metric] for rollout in rollouts]
        defined = [value for value in values if value is not None]
        means[metric] = sum(defined) / len(defined) if defined else None
    return means
