"""Compares two runs on the same scenarios, scenario by scenario."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

from .display import Markdown
from .options import Options, PathLike, each, joined, paths
from .program import arguments, invoke
from .rows import frame_of

__all__ = ["Comparison", "Comparisons", "MetricDifference", "compare"]


@dataclasses.dataclass(frozen=True)
class MetricDifference:
    """The difference of one metric between two simulators, in the unit of the metric.

    Rates are shares from 0 to 1, where tables print percent.

    Attributes:
        first: Mean of the first simulator over the scenarios in which both have a value.
        second: Mean of the second simulator over the same scenarios.
        difference: Mean over scenarios of second minus first.
        low: Lower end of the 95 % bootstrap interval of `difference`.
        high: Upper end of it.
        scenarios: Number of scenarios in which both have a value.
        p: p-value of the two-sided permutation test over scenarios.
        verdict: "better", "worse" (p below 0.05) or "no-difference-seen", of the second simulator.
        visible: Smallest difference that these scenarios show in four of five cases; None if they
            cannot tell.
        better: Ids of the scenarios in which the second simulator is better, with second minus
            first; largest change first.
        worse: The same for scenarios in which it is worse.
        groups: Number of groups of dependent scenarios, such as those of one recording; None if
            every scenario counts as independent.

    """

    first: float
    second: float
    difference: float
    low: float
    high: float
    scenarios: int
    p: float
    verdict: str
    visible: float | None
    better: tuple[tuple[str, float], ...]
    worse: tuple[tuple[str, float], ...]
    groups: int | None = None


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Two simulators of two runs, or of one.

    Attributes:
        first: Id of the first simulator.
        second: Id of the second simulator.
        scenarios: Number of scenarios for which both have a result.
        unpaired: Number of scenarios for which only one of them has a result.
        metrics: Differences by id of the metric; metrics without a scenario in which both have a
            value are left out.

    """

    first: str
    second: str
    scenarios: int
    unpaired: int
    metrics: Mapping[str, MetricDifference]


class Comparisons(Sequence[Comparison]):
    """Comparisons of all pairs of simulators of two runs, in the order of the first run.

    Notebooks show the tables.

    Attributes:
        pairs: The comparisons.
        exceeded: A message of the program for each bound of `worse` that a metric exceeded.

    """

    def __init__(
        self,
        pairs: Sequence[Comparison],
        exceeded: Sequence[str],
        options: Options,
        runs: list[str],
    ) -> None:
        self.pairs = tuple(pairs)
        self.exceeded = tuple(exceeded)
        self._options = options
        self._runs = runs

    def __len__(self) -> int:
        return len(self.pairs)

    def __getitem__(self, index: Any) -> Any:
        """Returns the comparison at an index, or of the first simulator with an id."""
        if not isinstance(index, str):
            return self.pairs[index]
        found = [pair for pair in self.pairs if pair.first == index]
        if not found:
            raise KeyError(index)
        return found[0]

    def __repr__(self) -> str:
        return f"Comparisons({', '.join(f'{p.first} / {p.second}' for p in self.pairs)})"

    def _repr_markdown_(self) -> str:
        return str(self.table())

    @cached_property
    def rows(self) -> Any:
        """A row per pair and metric: the fields of `MetricDifference` without scenario lists.

        A pandas data frame where pandas is installed, otherwise a list of dictionaries. Columns
        `first_simulator` and `second_simulator` name the pair.
        """
        rows = []
        for pair in self.pairs:
            for metric, difference in pair.metrics.items():
                fields = dataclasses.asdict(difference)
                del fields["better"], fields["worse"]
                names = {"first_simulator": pair.first, "second_simulator": pair.second}
                rows.append({**names, "metric": metric, **fields})
        return frame_of(rows)

    def table(self, top: int = 3) -> Markdown:
        """Returns the tables of the program, in Markdown, which also name differing settings.

        Args:
            top: Number of scenarios to list per metric: `top` that got worse and `top` that got
                better.

        """
        given = [*self._options, ("--top", top), ("--format", "markdown")]
        return Markdown(invoke(["compare", *arguments(given, self._runs)]).text)


def compare(
    first: PathLike,
    second: PathLike,
    *,
    models: Sequence[str] = (),
    despite: str | Sequence[str] = (),
    worse: Mapping[str, float] | None = None,
    seed: int = 0,
) -> Comparisons:
    """Compares two runs on the same scenarios, scenario by scenario.

    Args:
        first: First run: its folder, or `Results`.
        second: Second run; the same run to compare two of its simulators.
        models: Id of a simulator of the first run, and id of a simulator of the second; by default
            all simulators that both runs have.
        despite: Settings in which the runs may differ, such as "av" or "replan".
        worse: Largest accepted worsening by metric, in the units of the tables (percent for
            rates), such as `{"aav-collision": 0.05}`; `Comparisons.exceeded` has what got worse by
            more.
        seed: Seed of resamplings and permutations.

    Raises:
        ReactsimError: The runs have no scenario in common, or differ in a setting that `despite`
            does not name.

    """
    bounds = [("--worse", f"{metric}={bound}") for metric, bound in (worse or {}).items()]
    common: Options = [
        ("--models", joined(models)),
        *each("--despite", despite),
        ("--seed", seed),
    ]
    runs = [*paths(first), *paths(second)]
    given = [*common, *bounds, ("--format", "json"), ("--quiet", True)]
    output = invoke(["compare", *arguments(given, runs)], codes=(0, 1) if bounds else (0,))
    pairs = [comparison_of(pair) for pair in output.document]
    return Comparisons(pairs, output.messages if output.code == 1 else (), common, runs)


def comparison_of(pair: dict[str, Any]) -> Comparison:
    """Returns a comparison as the program writes it in JSON."""
    metrics = {name: _difference(metric) for name, metric in pair["metrics"].items()}
    return Comparison(pair["first"], pair["second"], pair["scenarios"], pair["unpaired"], metrics)


def _difference(metric: dict[str, Any]) -> MetricDifference:
    estimate = metric["difference"]
    better, worse = (tuple((id, change) for id, change in metric[k]) for k in ("better", "worse"))
    return MetricDifference(
        metric["first"],
        metric["second"],
        estimate["mean"],
        estimate["low"],
        estimate["high"],
        estimate["scenarios"],
        metric["p"],
        metric["verdict"],
        metric["visible"],
        better,
        worse,
        metric.get("groups"),
    )
