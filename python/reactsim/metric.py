"""Metrics of your own, computed next to those of the program."""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import math
import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Union

import numpy as np

from .client import Array
from .options import PathLike, Sources, paths
from .program import ReactsimError, arguments, invoke
from .rows import Event, Rollout, read_event
from .scenarios import Scenario, scenarios

__all__ = ["Case", "Metric", "add_metrics", "checked"]

DIRECTIONS = ("lower", "higher")

# Rules of the program: ids of columns and of removed metrics, and texts that tables can print.
RESERVED = {
    *("input", "record", "scenario", "digest", "simulator", "rollout", "category", "difficulty"),
    *("av-pdms", "av-epdms"),
}
MARKS = " -.,:()/+²³°·"  # characters of titles and units that are no letters or digits
LONGEST = {"title": 60, "unit": 12}  # characters


@dataclasses.dataclass(frozen=True)
class Case:
    """One rollout of a scenario, which a metric judges.

    Positions are metres in the local frame of the scenario, headings radians counter-clockwise,
    velocities m/s. Frames are 0.1 s apart; step k is frame `scenario.n_history - 1 + k`, that is
    10 + k in the benchmark. Poses are those of box centres.

    Attributes:
        scenario: The scenario: ids (`agents`), `kinds` and `sizes` [n, 2] of the n agents, of which
            the first is the AV, `lanes` and other lines of the map, `lights`, and the log
            (`states`, `present`).
        simulator: Id of the simulator.
        rollout: Index of the rollout.
        states: Realised states at all frames (91 in the benchmark), f64 [n, frames, 5]: x, y,
            heading, vx, vy in metres, radians and m/s; NaN where absent or unknown.
        events: Occurrences that the metrics of the program counted in this rollout.

    """

    scenario: Scenario
    simulator: str
    rollout: int
    states: Array
    events: list[Event]

    @property
    def present(self) -> Array:
        """Whether each agent is present at each frame, bool [n, frames]."""
        present: Array = ~np.isnan(self.states[..., 0])
        return present


Score = Union[float, None, "tuple[float | None, Sequence[Event]]"]


class Metric:
    """A metric of your own: a subclass defines the attributes and `score`.

    `reactsim.run(..., metrics=[Mine()])` and `Results.add_metrics` compute it for every rollout.
    Several rollouts of a scenario are averaged.

    Attributes:
        id: Id in rows and files: lower-case letters, digits and hyphens, such as "mean-headway".
        title: Title of the column in tables.
        unit: Unit: "count", "rate" (a share, printed in percent), "m", "s" or any other; may be
            empty.
        direction: Better values: "lower" or "higher".

    """

    id: str = ""
    title: str = ""
    unit: str = ""
    direction: str = "lower"

    def score(self, case: Case) -> Score:
        """Returns the value of a rollout, or None where nothing can be judged.

        A pair of the value and a list of events, made by `event`, also lists occurrences, which
        `Results.events` and the page show.
        """
        raise NotImplementedError

    def event(
        self,
        agent: str,
        step: int,
        last_step: int | None = None,
        *,
        partner: str | None = None,
        reason: str | None = None,
        counted: bool = True,
        **values: float,
    ) -> Event:
        """Returns an occurrence of an agent, by id, from `step` (at least 1) to `last_step`.

        Args:
            agent: Id of the agent.
            step: First step.
            last_step: Last step; the same by default.
            partner: Id of another agent that is involved.
            reason: Reason why the event counts or not.
            counted: Whether the event counts in the value of the metric.
            values: Named values at the event.

        """
        last = step if last_step is None else last_step
        return Event(self.id, step, last, agent, partner, reason, counted, dict(values))


def checked(metrics: Sequence[Metric]) -> list[Metric]:
    """Returns metrics whose ids, titles, units and directions are valid.

    The program checks them again when they are added; this check is before a long run.
    """
    if metrics and importlib.util.find_spec("pyarrow") is None:
        raise ImportError("metrics of your own need pyarrow: pip install 'reactsim[pandas]'")
    taken = {line.split()[0] for line in invoke(["list", "metrics"]).text.splitlines() if line}
    for metric in metrics:
        name = f"metric `{metric.id or type(metric).__name__}`"
        if not re.fullmatch(r"[a-z][a-z0-9-]{0,59}", metric.id):
            raise ValueError(
                f"{name}: `id` is {metric.id!r}, expected lower-case letters, digits and hyphens,"
                " such as 'mean-headway'"
            )
        if metric.id in taken or metric.id in RESERVED:
            raise ValueError(f"{name}: the id is taken; choose another one")
        if not metric.title.strip():
            raise ValueError(f"{name}: `title` is empty, expected the title of its column")
        for part, text in (("title", metric.title), ("unit", metric.unit)):
            is_plain = all(c.isalnum() or c in MARKS for c in text)
            if not is_plain or len(text) > LONGEST[part]:
                raise ValueError(
                    f"{name}: `{part}` is {text!r}, expected letters, digits, spaces and `-.,:()/+`"
                    f" in one line of at most {LONGEST[part]} characters"
                )
        if metric.direction not in DIRECTIONS:
            raise ValueError(
                f"{name}: `direction` is {metric.direction!r}, expected one of {DIRECTIONS}"
            )
        taken.add(metric.id)
    return list(metrics)


def add_metrics(
    run: PathLike,
    metrics: Sequence[Metric],
    source: Sources = None,
    *,
    rollouts: Iterator[Rollout],
    events: Iterable[Mapping[str, Any]],
    **as_read: Any,
) -> None:
    """Computes metrics for the kept rollouts of a run and adds them to its folder.

    `events` are those of the program; `as_read` is how the scenarios were read.
    """
    metrics = checked(metrics)
    counted: dict[tuple[str, str, int], list[Event]] = {}
    for line in events:
        key = (line["scenario"], line["simulator"], line["rollout"])
        counted.setdefault(key, []).append(read_event(line))
    scored = []
    for scenario, rollout in _pairs(rollouts, source, **as_read):
        key = (scenario.id, rollout.simulator, rollout.rollout)
        states, events_of = _states(scenario, rollout), counted.get(key, [])
        case = Case(scenario, rollout.simulator, rollout.rollout, states, events_of)
        values, found = {}, []
        for metric in metrics:
            values[metric.id], own = _score(metric, case)
            found += own
        scored.append(
            {
                "scenario": scenario.id,
                "simulator": rollout.simulator,
                "rollout": rollout.rollout,
                "values": values,
                "events": [{**event._asdict(), "rollout": rollout.rollout} for event in found],
            }
        )
    add_document(run, {"metrics": [_record(metric) for metric in metrics], "rollouts": scored})


def add_document(run: PathLike, document: dict[str, Any]) -> None:
    """Adds metrics to a run folder: their descriptions, and the values and events of rollouts."""
    with tempfile.TemporaryDirectory(prefix="reactsim-") as folder:
        file = Path(folder, "metrics.json")
        file.write_text(json.dumps(document, allow_nan=False), "utf-8")
        given = [("--add-metrics", file), ("--quiet", True)]
        invoke(["score", *arguments(given, paths(run))])


def _record(metric: Metric) -> dict[str, Any]:
    kind = type(metric)
    return {
        "id": metric.id,
        "title": metric.title,
        "unit": metric.unit,
        "scope": "rollout",
        "lower_is_better": metric.direction == "lower",
        "source": f"{kind.__module__}.{kind.__qualname__}",
    }


def _pairs(
    rollouts: Iterator[Rollout], source: Sources, **as_read: Any
) -> Iterator[tuple[Scenario, Rollout]]:
    """Iterates over the kept rollouts with their scenarios, which are in the same order."""
    rollout = next(rollouts, None)
    sources: list[str | None] = [*paths(source)]
    for path in sources or [None]:
        for scenario in scenarios(path, **as_read):
            while rollout is not None and rollout.scenario == scenario.id:
                yield scenario, rollout
                rollout = next(rollouts, None)
            if rollout is None:
                return
    if rollout is not None:
        raise ReactsimError(
            f"scenario `{rollout.scenario}` of the kept rollouts is not among the scenarios, or in"
            " another order: give the scenarios of the run, and read them as it did"
        )


def _states(scenario: Scenario, rollout: Rollout) -> Array:
    """Returns history and realised states of a rollout, f64 [n, frames, 5]; NaN where absent."""
    if rollout.agents != scenario.agents:
        raise ReactsimError(
            f"scenario `{scenario.id}` has other agents than its kept rollouts: give the scenarios"
            " of the run, and read them as it did"
        )
    shift = np.subtract(rollout.origin, scenario.origin)
    states = np.concatenate([scenario.history, rollout.states], axis=1)
    states[:, : scenario.history.shape[1]][~scenario.valid] = np.nan
    if np.isfinite(shift).all():
        states[:, scenario.history.shape[1] :, :2] += shift
    return states


def _score(metric: Metric, case: Case) -> tuple[float | None, list[Event]]:
    """Returns the value and the events of a metric, which have to be finite numbers."""
    place = f"scenario `{case.scenario.id}`, `{case.simulator}`, rollout {case.rollout}"
    where = f"metric `{metric.id}` in {place}"
    try:
        score = metric.score(case)
        value, events = score if isinstance(score, tuple) else (score, [])
        value = None if value is None else float(value)
        plain = [_plain(event) for event in events]
    except Exception as error:
        raise ReactsimError(f"{where}: {type(error).__name__}: {error}") from error
    if value is not None and not math.isfinite(value):
        raise ReactsimError(f"{where}: `score` returned {value}, expected a finite value or None")
    for event in plain:
        strangers = {event.agent, event.partner or event.agent} - set(case.scenario.agents)
        if strangers:
            raise ReactsimError(
                f"{where}: an event has the agent `{min(strangers)}`, which the"
                " scenario does not have"
            )
        for name, number in event.values.items():
            if not math.isfinite(number):
                raise ReactsimError(
                    f"{where}: `{name}` of an event is {number}, expected a finite value"
                )
    return value, plain


def _plain(event: Event) -> Event:
    """Returns an event without numpy types, which JSON does not have."""
    values = {name: float(number) for name, number in event.values.items()}
    step, last_step = int(event.step), int(event.last_step)
    return event._replace(
        step=step, last_step=last_step, counted=bool(event.counted), values=values
    )
