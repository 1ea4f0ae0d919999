"""Lists what the program has."""

from __future__ import annotations

from collections.abc import Sequence

from .display import Text
from .options import PathLike, Sources, paths, reading, selection
from .program import arguments, invoke

__all__ = ["catalog", "list_scenarios"]


def catalog(what: str = "models", name: str | None = None) -> Text:
    """Returns one of the lists of the program, as text in columns.

    Args:
        what: "models", "parameters" (of the model `name`), "metrics", "metric-options", "formats",
            "weights", "maps", "cases", "tasks" or "backends".
        name: Model whose parameters are listed.

    Raises:
        ReactsimError: There is no such list or model.

    """
    # Not an option: no list begins with `-`.
    if what.startswith("-"):
        raise ValueError(f"there is no list `{what}`")
    return Text(invoke(["list", what, *arguments([], [] if name is None else [name])]).text)


def list_scenarios(
    source: Sources = None,
    *,
    deviations: PathLike | None = None,
    limit: int | None = None,
    ids: Sequence[str] = (),
    categories: Sequence[str] = (),
    current_frame: int | None = None,
    window_step: int | None = None,
    all_agents: bool = False,
) -> Text:
    """Lists scenarios: id, source, number of agents with the AV, category and difficulty.

    Args:
        source: Files, folders or URLs of scenarios; the shipped benchmark by default.
        deviations: File of deviated AVs.
        limit: Only the first `limit` scenarios of every file.
        ids: Only scenarios with one of these ids; all by default.
        categories: Only scenarios whose deviated AV has one of these categories, such as "lateral".
        current_frame: Index of the current frame, from 0, for formats that leave it open.
        window_step: Frames between scenarios of one recording of 20 s.
        all_agents: Count all agents that are present at the current frame, of all kinds.

    Raises:
        ReactsimError: The scenarios cannot be read.

    """
    given = [
        ("--deviations", deviations),
        ("--limit", limit),
        *selection(ids, categories),
        *reading(current_frame, window_step, all_agents),
    ]
    return Text(invoke(["list", "scenarios", *arguments(given, paths(source))]).text)
