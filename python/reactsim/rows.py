"""What is recorded of rollouts: tracks, events, and the numbers of metrics."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from .client import HISTORY, Array

__all__ = [
    "Event",
    "Rollout",
    "flat",
    "flat_row",
    "frame_of",
    "read_event",
    "read_rollout",
    "value_of",
]


class Rollout(NamedTuple):
    """Realised tracks of one scenario: all its steps, 80 in the benchmark, and n agents.

    Attributes:
        scenario: Id of the scenario.
        simulator: Id of the simulator.
        rollout: Index of the rollout.
        agents: Ids of the agents.
        states: States, f64 [n, steps, 5]: x, y, heading, vx, vy in the local frame, in metres,
            radians and m/s; NaN where absent or unknown.
        origin: World coordinates of the local origin, metres; NaN if unknown.
        n_history: Number of frames before the first step, 11 in the benchmark.

    """

    scenario: str
    simulator: str
    rollout: int
    agents: list[str]
    states: Array
    origin: tuple[float, float]
    n_history: int = HISTORY

    @property
    def frames(self) -> range:
        """Frames of the states: 11 to 90 in the benchmark."""
        return range(self.n_history, self.n_history + self.states.shape[1])


class Event(NamedTuple):
    """An occurrence that a metric counted.

    Attributes:
        metric: Id of the metric.
        step: First step, from 1.
        last_step: Last step.
        agent: Id of the agent.
        partner: Id of the other agent, if there is one.
        reason: Reason why the event counts or not.
        counted: Whether the event counts in the value of the metric.
        values: Named values at the event.

    """

    metric: str
    step: int
    last_step: int
    agent: str
    partner: str | None
    reason: str | None
    counted: bool
    values: dict[str, float]


def read_rollout(row: Mapping[str, Any], n_history: int) -> Rollout:
    """Returns a rollout from its row of `rollouts.parquet`."""
    columns: list[Array] = []
    for name in ("x", "y", "heading", "vx", "vy"):
        values = row.get(name)
        if values is None:
            columns.append(np.full_like(columns[0], np.nan))
        else:
            columns.append(np.array(values, dtype=float).reshape(len(values), -1))
    origin = (row.get("origin_x"), row.get("origin_y"))
    x, y = (float("nan") if value is None else float(value) for value in origin)
    states = np.stack(columns, axis=-1)
    return Rollout(
        row["scenario_id"],
        row["simulator"],
        row.get("rollout") or 0,
        row["agent_id"],
        states,
        (x, y),
        n_history,
    )


def read_event(line: Mapping[str, Any]) -> Event:
    """Returns an event from its fields, as in a line of `events.jsonl`."""
    return Event(**{name: line[name] for name in Event._fields})


def value_of(metric: dict[str, Any] | None) -> float | None:
    """Returns the number of a metric, which is stored with its components."""
    if metric is None:
        return None
    ((kind, value),) = metric.items()
    if kind in ("rate", "mean"):
        return value[0] / value[1] if value[1] else None
    return float(value)


def flat(line: dict[str, Any], prefixes: dict[str, str]) -> dict[str, Any]:
    """Moves the entries of nested objects to the line."""
    result = {key: value for key, value in line.items() if key not in prefixes}
    for key, prefix in prefixes.items():
        result.update({prefix + name: value for name, value in (line.get(key) or {}).items()})
    return result


def flat_row(row: dict[str, Any]) -> dict[str, Any]:
    """Returns a line of `rows.jsonl` with an entry per metric."""
    metrics = {name: value_of(value) for name, value in row["metrics"].items()}
    notes = {name: note["count"] for name, note in row.get("notes", {}).items()}
    prefixes = {"metrics": "", "deviation": "deviation_", "outcomes": "outcome_", "notes": "note_"}
    prefixes["length"] = "length_"
    return flat({**row, "metrics": metrics, "notes": notes}, prefixes)


def frame_of(lines: list[dict[str, Any]], columns: list[str] | None = None) -> Any:
    """Returns a pandas data frame if pandas is installed, else the lines."""
    if importlib.util.find_spec("pandas") is None:
        return lines
    import pandas

    if columns is None:
        columns = list(dict.fromkeys(key for line in lines for key in line))
    frame = pandas.DataFrame(lines, columns=columns)
    if "rollout" in frame:
        frame["rollout"] = frame["rollout"].astype("Int64")
    return frame
