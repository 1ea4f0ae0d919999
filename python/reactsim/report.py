"""Tables and pages of finished runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .display import Html, Markdown, Text
from .options import PathLike, Run, Sources, each, folders, joined, paths
from .program import arguments, invoke

__all__ = ["report"]

CLASSES: dict[str, type[str]] = {"markdown": Markdown, "html": Html, "terminal": Text}


def report(
    runs: Run | Sequence[Run],
    *,
    format: str = "markdown",
    by: str | Sequence[str] = (),
    columns: str | Sequence[str] = (),
    also: str | Sequence[str] = (),
    bold: bool = False,
    caption: str | None = None,
    label: str | None = None,
    scenarios: Sources = None,
    cases: int | None = None,
    case: str | Sequence[str] = (),
    all_scenes: bool = False,
    out: PathLike | None = None,
) -> str:
    """Returns the tables of finished runs or studies, or their page.

    Args:
        runs: Runs, in one table: folders, `Results` or `Study`.
        format: "markdown" and "html", which notebooks show, "terminal", "csv", "json" (summaries),
            "latex", or "parquet", which needs `out`.
        by: Terminal format: "category" or "difficulty", for further tables.
        columns: Metrics to use as columns instead of the usual ones.
        also: Metrics to add as columns, such as "log-clinging".
        bold: Print the best numbers among comparable runs in bold (Markdown and LaTeX).
        caption: Caption of a LaTeX table.
        label: Label of a LaTeX table, such as "tab:results".
        scenarios: Page: scenarios of the runs, unless they ship with the program. The page shows
            scenes of runs that kept their rollouts.
        cases: Page: number of scenes, of the scenarios in which simulators differ most; 12 by
            default.
        case: Page: ids of further scenarios to show.
        all_scenes: Page: show the scenes of all scenarios.
        out: Also write to this file.

    Returns:
        The text of the tables or of the page; an empty text for Parquet.

    Raises:
        ReactsimError: A run is not finished, or options do not fit the format.

    """
    if format == "parquet" and out is None:
        raise ValueError("Parquet is not text: give the file to write, `out`")
    given = [
        ("--format", format),
        ("--by", joined(by)),
        ("--columns", joined(columns)),
        ("--also", joined(also)),
        ("--bold", bold),
        ("--caption", caption),
        ("--label", label),
        *each("--scenarios", paths(scenarios)),
        ("--cases", cases),
        *each("--case", case),
        ("--all", all_scenes),
        ("--out", out),
    ]
    output = invoke(["report", *arguments(given, folders(runs))])
    if out is None:
        text = output.text
    else:
        text = "" if format == "parquet" else Path(out).read_text("utf-8")
    return CLASSES.get(format, str)(text)
