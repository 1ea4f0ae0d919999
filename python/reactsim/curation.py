"""Deviated AVs: trajectories of the AV that leave the log."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .display import Markdown
from .options import PathLike, paths, reading
from .program import arguments, invoke, local_folder, produce

__all__ = ["Candidates", "curate"]


class Candidates:
    """A file of candidates for deviated AVs, which `curate` writes.

    `reactsim.run(..., deviations=candidates.path)` runs simulators against the chosen ones.
    Notebooks show the statistics.

    Attributes:
        path: The file, Parquet.

    """

    def __init__(self, path: PathLike) -> None:
        self.path = local_folder(path)
        if not self.path.is_file():
            raise FileNotFoundError(f"there is no file `{self.path}`")

    def __repr__(self) -> str:
        return f"Candidates({str(self.path)!r})"

    def __fspath__(self) -> str:
        return str(self.path)

    def _repr_markdown_(self) -> str:
        return str(self.table())

    def stats(self) -> dict[str, Any]:
        """Returns the statistics: steps of the selection, categories, distances to the log."""
        given = arguments([("--format", "json")], [self.path])
        result: dict[str, Any] = invoke(["curate", "stats", *given]).document
        return result

    def table(self) -> Markdown:
        """Returns the statistics as Markdown tables."""
        return Markdown(invoke(["curate", "stats", *arguments([], [self.path])]).text)


def curate(
    scenarios: PathLike | Sequence[PathLike],
    out: PathLike,
    *,
    source: str = "rules",
    temperature: float | None = None,
    candidates: int | None = None,
    seed: int = 0,
    limit: int | None = None,
    jobs: int | None = None,
    scenes: bool = True,
    min_vehicles: int | None = None,
    radius: float | None = None,
    max_ttc: float | None = None,
    min_ade: float | None = None,
    drivable_tolerance: float | None = None,
    comfort: bool = False,
    current_frame: int | None = None,
    window_step: int | None = None,
    history: int | None = None,
    future: int | str | None = None,
    all_agents: bool = False,
    progress: bool = True,
) -> Candidates:
    """Creates trajectories of the AV that leave the log, and chooses at most one per scenario.

    Candidates that are infeasible, do not pressure any agent or cannot be avoided are rejected.

    Args:
        scenarios: Files, folders or URLs of scenarios.
        out: File to write (Parquet), with all candidates.
        source: "rules"; "diffusion", samples of a network, or "diffusion:FILE" with other weights;
            or "file:PATH" with trajectories of any planner (Parquet or JSON).
        temperature: Standard deviation of the noise from which a network samples; 1.5 by default.
        candidates: Largest number per scenario; 16 by default, or all of a file.
        seed: Seed of all random choices.
        limit: Only the first `limit` scenarios, over all files.
        jobs: Number of threads; one per core by default.
        scenes: Store the scenes that the review page draws.
        min_vehicles: Only scenarios with this many vehicles near the logged AV; 3 by default.
        radius: Largest distance of a vehicle near the AV, metres; 40 by default.
        max_ttc: Only scenarios in which one of these vehicles has a time to collision below this,
            seconds; 5 by default.
        min_ade: Smallest mean displacement from the log, metres; 2 by default.
        drivable_tolerance: Largest distance of a corner outside the drivable area, metres; 0.3 by
            default.
        comfort: Also reject candidates that exceed nuPlan's comfort bounds.
        current_frame: Index of the current frame, from 0, for formats that leave it open.
        window_step: Frames between scenarios of one recording of 20 s.
        history: Number of frames up to and including the current one.
        future: Number of frames after the current one, or a time such as "15s", or "log".
        all_agents: Simulate all agents that are present at the current frame, of all kinds.
        progress: Show the messages of the program.

    Raises:
        ReactsimError: The scenarios cannot be read, or none could be curated. Scenarios that failed
            only cause a warning.

    """
    given = [
        ("--out", out),
        ("--source", source),
        ("--temperature", temperature),
        ("--candidates", candidates),
        ("--seed", seed),
        ("--limit", limit),
        ("--jobs", jobs),
        ("--without-scenes", not scenes),
        ("--min-vehicles", min_vehicles),
        ("--radius", radius),
        ("--max-ttc", max_ttc),
        ("--min-ade", min_ade),
        ("--drivable-tolerance", drivable_tolerance),
        ("--comfort", comfort),
        *reading(current_frame, window_step, history, future, all_agents),
    ]
    produce(["curate", *arguments(given, paths(scenarios))], out, show=progress)
    return Candidates(out)
