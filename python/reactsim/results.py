"""Results of a run: the files of a run folder."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any

from .client import HISTORY
from .comparison import Comparisons, compare
from .display import Gif, Markdown, Svg
from .metric import Metric, add_metrics
from .options import PathLike, Sources
from .pictures import picture
from .program import local_folder
from .rows import Rollout, flat, flat_row, frame_of, read_rollout
from .wosac import WosacScores, score_run

__all__ = ["Results", "Rollout"]


class Results:
    """Results in a run folder, written by `reactsim.run` or by `reactsim run --out FOLDER`.

    `rows`, `events` and `failures` are pandas data frames where pandas is installed, and lists of
    dictionaries otherwise.

    Attributes:
        folder: The run folder.

    """

    def __init__(self, folder: PathLike) -> None:
        self.folder = local_folder(folder)
        if not (self.folder / "provenance.json").is_file():
            raise FileNotFoundError(f"`{self.folder}` is no run folder: it has no provenance.json")

    def __repr__(self) -> str:
        return f"Results({str(self.folder)!r})"

    def __fspath__(self) -> str:
        return str(self.folder)

    def _repr_markdown_(self) -> str:
        return self.table()._repr_markdown_()

    def _repr_html_(self) -> str:
        return self.table()._repr_html_()

    def table(self, details: bool = False) -> Markdown:
        """Returns the results as a Markdown table, and that of the AV if a planner drives it.

        The legend follows, with `details` after the tables per kind of deviation and the notes.
        """
        text = self._text("summary.md")
        if details:
            return Markdown(text)
        blocks = text.split("\n\n")
        has_av = len(blocks) > 2 and blocks[1].startswith("The AV,")
        legend = [block for block in blocks if "\nMeans over scenarios" in f"\n{block}"]
        return Markdown("\n\n".join([*blocks[: 3 if has_av else 1], *legend]).rstrip() + "\n")

    @cached_property
    def summary(self) -> dict[str, Any]:
        """Means and intervals per simulator and metric, as in summary.json."""
        result: dict[str, Any] = json.loads(self._text("summary.json"))
        return result

    @cached_property
    def provenance(self) -> dict[str, Any]:
        """Program, settings, inputs and simulators of the run, as in provenance.json."""
        result: dict[str, Any] = json.loads(self._text("provenance.json"))
        return result

    @cached_property
    def spec(self) -> dict[str, Any] | None:
        """The request of the run, as in spec.toml; None for folders without one.

        Keys are the long names of options of `reactsim run`; paths are relative to the folder.
        Needs Python 3.11.
        """
        import tomllib

        path = self.folder / "spec.toml"
        return tomllib.loads(path.read_text("utf-8")) if path.is_file() else None

    @property
    def simulators(self) -> list[str]:
        """Ids of the simulators, in the order of the run."""
        return [simulator["id"] for simulator in self.provenance["simulators"]]

    @cached_property
    def rows(self) -> Any:
        """Metrics of every scenario, simulator and rollout, with a column per metric.

        Rows without a rollout have the metrics over all rollouts of a scenario. A metric is missing
        where nothing could be judged.
        """
        return frame_of([flat_row(row) for row in self._lines("rows.jsonl")])

    @cached_property
    def events(self) -> Any:
        """Occurrences that metrics counted, with agents and steps.

        Values at the event have the prefix `value_`.
        """
        return frame_of([flat(line, {"values": "value_"}) for line in self._lines("events.jsonl")])

    @cached_property
    def failures(self) -> Any:
        """Scenarios without a result, with the error."""
        columns = ["input", "record", "simulator", "file", "scenario", "error"]
        return frame_of(self._lines("failures.jsonl"), columns)

    def rollouts(
        self, *, simulator: str | None = None, scenario: str | None = None
    ) -> Iterator[Rollout]:
        """Iterates over the kept rollouts, of one simulator or scenario if given. Needs pyarrow."""
        path = self.folder / "rollouts.parquet"
        if not path.is_file():
            raise FileNotFoundError(f"`{self.folder}` has no rollouts: run with --keep-rollouts")
        try:
            from pyarrow import parquet
        except ImportError:
            raise ImportError(
                "reading rollouts needs pyarrow: pip install 'reactsim[pandas]'"
            ) from None
        histories = {
            row["scenario"]: row["length"]["history"]
            for row in self._lines("rows.jsonl")
            if "length" in row
        }
        with parquet.ParquetFile(path) as file:
            for batch in file.iter_batches(batch_size=16):
                for row in batch.to_pylist():
                    if simulator not in (None, row["simulator"]):
                        continue
                    if scenario in (None, row["scenario_id"]):
                        yield read_rollout(row, histories.get(row["scenario_id"], HISTORY))

    def svg(
        self, scenario: str, simulator: str, *, source: PathLike | None = None, step: int = 40
    ) -> Svg:
        """Returns a picture of a kept rollout at a step, made by the program.

        `source`: file or folder of the scenario; where the run read it by default.
        """
        given = {"id": scenario, "rollout": self, "simulator": simulator, "steps": step}
        return Svg(picture("svg", source, **given).decode("utf-8"))

    def gif(
        self,
        scenario: str,
        simulators: str | Sequence[str] = (),
        *,
        source: PathLike | None = None,
        size: int | None = None,
        every: int | None = None,
        follow: bool = False,
    ) -> Gif:
        """Returns an animation of kept rollouts of a scenario, side by side, made by the program.

        Args:
            scenario: Id of the scenario.
            simulators: Ids of the simulators; all of the run by default.
            source: File or folder of the scenario; where the run read it by default.
            size: Side of a panel, pixels; 480 by default.
            every: Show only every Nth step; 1, the default, is 10 frames per second.
            follow: Keep the AV in the middle, which makes larger files.

        """
        given = {"id": scenario, "rollout": self, "simulator": simulators or self.simulators}
        further = {"size": size, "every": every, "follow": follow}
        return Gif(picture("gif", source, **given, **further))

    def add_metrics(
        self,
        metrics: Sequence[Metric],
        scenarios: Sources = None,
        *,
        deviations: PathLike | None = None,
        current_frame: int | None = None,
        window_step: int | None = None,
        history: int | None = None,
        future: int | str | None = None,
        all_agents: bool = False,
    ) -> None:
        """Computes metrics of your own for the kept rollouts and adds them to the run folder.

        Rows, events, summary and tables then have them like those of the program. A metric with the
        id of one that was added earlier replaces it. Needs pyarrow.

        Args:
            metrics: The metrics; see `Metric`.
            scenarios: Files, folders or URLs of the scenarios of the run; the shipped benchmark by
                default.
            deviations: File of deviated AVs of the run.
            current_frame: As in the run, as the four following.
            window_step: Frames between scenarios of one recording of 20 s.
            history: Number of frames up to and including the current one.
            future: Number of frames after the current one, or a time, or "log".
            all_agents: All agents were simulated.

        Raises:
            ReactsimError: A metric fails or returns something else than a finite number or None;
                the message names metric, scenario and simulator. The folder is left unchanged.

        """
        add_metrics(
            self,
            metrics,
            scenarios,
            rollouts=self.rollouts(),
            events=self._lines("events.jsonl"),
            deviations=deviations,
            current_frame=current_frame,
            window_step=window_step,
            history=history,
            future=future,
            all_agents=all_agents,
        )
        for name in ("summary", "provenance", "rows", "events"):
            self.__dict__.pop(name, None)

    def compare(self, other: PathLike, **options: Any) -> Comparisons:
        """Compares the run with a second one; the arguments are those of `compare`."""
        return compare(self, other, **options)

    def wosac(self, scenarios: Sources = None, **options: Any) -> WosacScores:
        """Returns the realism metrics of the Sim Agents challenge for the kept rollouts.

        The arguments are those of `reactsim.wosac.score_run`.
        """
        return score_run(self, scenarios, **options)

    def _text(self, name: str) -> str:
        path = self.folder / name
        if not path.is_file():
            raise FileNotFoundError(f"`{self.folder}` has no {name}: the run is not finished")
        return path.read_text("utf-8")

    def _lines(self, name: str) -> list[dict[str, Any]]:
        lines = self._text(name).split("\n")
        # A last line without a line end was truncated by an interruption.
        return [json.loads(line) for line in lines[:-1] if line]
