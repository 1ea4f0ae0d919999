"""References and the leaderboard."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .display import Markdown
from .options import Options, PathLike, Run, each, folders
from .program import arguments, invoke, local_folder, produce

__all__ = ["Leaderboard", "leaderboard", "make_reference"]


@dataclasses.dataclass(frozen=True)
class Leaderboard:
    """References and submitted runs in one table, which notebooks show.

    Attributes:
        benchmark: Name, version and digest of the benchmark.
        lines: One dictionary per entry and simulator, best first: method, status, metrics.
        table: The table, in Markdown.

    """

    benchmark: dict[str, Any]
    lines: list[dict[str, Any]]
    table: Markdown

    def _repr_markdown_(self) -> str:
        return str(self.table)


def leaderboard(
    entries: Run | Sequence[Run],
    *,
    scenarios: PathLike | None = None,
    html: PathLike | None = None,
) -> Leaderboard:
    """Lists references and submitted runs in one table.

    Args:
        entries: Folders of references and runs, or `Results`; runs on a whole benchmark with the
            settings of the first entry. A run is verified by its rollouts.
        scenarios: Scenarios of the benchmark, unless they ship with the program.
        html: Also write the table to this file, as an HTML page.

    Raises:
        ReactsimError: An entry is for another benchmark, or has other settings.

    """
    given: Options = [("--scenarios", scenarios)]
    names = folders(entries)
    as_json = [*given, ("--html", html), ("--format", "json")]
    document = invoke(["leaderboard", *arguments(as_json, names)]).document
    as_table = [*given, ("--format", "markdown")]
    table = Markdown(invoke(["leaderboard", *arguments(as_table, names)]).text)
    return Leaderboard(document["benchmark"], document["lines"], table)


def make_reference(
    run: Run,
    out: PathLike,
    *,
    name: str,
    title: str | None = None,
    commands: str | Sequence[str] = (),
    aggregates_only: bool = False,
) -> Path:
    """Creates a reference from a finished run or study, for `verify`; returns its folder.

    Args:
        run: Run or study: its folder, `Results` or `Study`.
        out: Folder to write.
        name: Name of the reference.
        title: Title, one line; the name by default.
        commands: Commands that produced the run.
        aggregates_only: Leave rows out, for recordings whose terms allow only aggregates.

    Raises:
        ReactsimError: The run is not finished, or was made by a build with local changes.

    """
    given = [
        ("--name", name),
        ("--title", title),
        *each("--command", commands),
        ("--aggregates-only", aggregates_only),
        ("--out", out),
    ]
    produce(["reference", "make", *arguments(given, folders(run))], out, show=False)
    return local_folder(out)
