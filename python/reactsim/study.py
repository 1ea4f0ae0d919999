"""Studies: several runs and a table of what they have in common."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from .display import Markdown
from .options import PathLike, Sources, joined, paths, reading, selection, settings
from .program import arguments, local_folder, produce
from .results import Results

__all__ = ["Study", "study"]


class Study:
    """A study in a folder, written by `reactsim.study` or by `reactsim study`.

    Notebooks show its tables.
    """

    def __init__(self, folder: PathLike) -> None:
        self.folder = local_folder(folder)
        """The folder of the study."""
        if not (self.folder / "study.json").is_file():
            raise FileNotFoundError(f"`{self.folder}` is no study: it has no study.json")

    def __repr__(self) -> str:
        return f"Study({str(self.folder)!r})"

    def _repr_markdown_(self) -> str:
        return str(self.table())

    def table(self) -> Markdown:
        """Returns the tables of the study, as in study.md."""
        return Markdown((self.folder / "study.md").read_text("utf-8"))

    @cached_property
    def description(self) -> dict[str, Any]:
        """Kind and members of the study, as in study.json."""
        result: dict[str, Any] = json.loads((self.folder / "study.json").read_text("utf-8"))
        return result

    @property
    def members(self) -> dict[str, Results]:
        """The runs of the study, by label."""
        members = self.description["members"]
        return {member["label"]: Results(self.folder / member["folder"]) for member in members}


def study(
    kind: str,
    scenarios: Sources = None,
    *,
    out: PathLike,
    intervals: str | Sequence[int | str] = (),
    protocol: str | None = None,
    replan: str | None = None,
    rollouts: int | None = None,
    reactive_rollouts: int | None = None,
    vocabularies: Mapping[str, PathLike] | None = None,
    planners: str | Sequence[str] = (),
    tracker: str | None = None,
    plan_every: str | None = None,
    models: str | Sequence[str] = (),
    weights: Mapping[str, PathLike] | None = None,
    parameters: Mapping[str, Any] | None = None,
    av: str | None = None,
    deviations: PathLike | None = None,
    limit: int | None = None,
    ids: Sequence[str] = (),
    categories: Sequence[str] = (),
    current_frame: int | None = None,
    window_step: int | None = None,
    all_agents: bool = False,
    seed: int = 0,
    keep_rollouts: bool = False,
    jobs: int | None = None,
    resume: bool = False,
    options: Sequence[str] = (),
    progress: bool = True,
) -> Study:
    """Runs a study and returns its results.

    Args:
        kind: "replan", "realism", "guards", "vocabulary", "planners" or "errors".
        scenarios: Files, folders or URLs of scenarios; the shipped benchmark by default.
        out: Folder to write: the table, and a run folder per member.
        intervals: "replan": steps of 0.1 s between two plans, such as `[1, 5, 10]`.
        protocol: "replan": "reactive", or "realism".
        replan: Other studies: replan rate or interval, such as "2hz" or "5steps".
        rollouts: Rollouts per scenario and simulator; the default depends on the study.
        reactive_rollouts: "realism": rollouts of the reactive protocol.
        vocabularies: "vocabulary": files of vocabularies, by their names in the table.
        planners: "planners": planners, such as "pdm-closed".
        tracker: "planners": controller that follows the plans, "lqr" or "perfect".
        plan_every: "planners": steps between two plans of a planner, such as "5steps".
        models: Simulators; the default ones of the study by default.
        weights: Files of weights, by simulator.
        parameters: Parameters of simulators, such as `{"idm.vehicle.headway": 1.5}`.
        av: Driver of the AV, as for `run`.
        deviations: File of deviated AVs.
        limit: Only the first `limit` scenarios of every file.
        ids: Only scenarios with one of these ids; all by default.
        categories: Only scenarios whose deviated AV has one of these categories, such as "lateral".
        current_frame: Index of the current frame, from 0, for formats that leave it open.
        window_step: Frames between scenarios of one recording of 20 s.
        all_agents: Simulate all agents that are present at the current frame, of all kinds.
        seed: Seed of all random choices.
        keep_rollouts: Keep the rollouts, for pages and pictures; "realism" then also computes the
            realism metrics of the Sim Agents challenge.
        jobs: Number of threads; one per core by default.
        resume: Continue the interrupted study in `out`.
        options: Further options of `reactsim study`, such as "--external=mine=python mine.py".
        progress: Show the messages of the program.

    Raises:
        ReactsimError: The study could not be run. Scenarios that failed only cause a warning.

    """
    given = [
        ("--out", out),
        ("--intervals", joined(intervals)),
        ("--protocol", protocol),
        ("--replan", replan),
        ("--rollouts", rollouts),
        ("--reactive-rollouts", reactive_rollouts),
        *settings("--vocabulary", vocabularies or {}),
        ("--planners", joined(planners)),
        ("--tracker", tracker),
        ("--plan-every", plan_every),
        ("--models", joined(models)),
        *settings("--model-weights", weights or {}),
        *settings("--set", parameters or {}),
        ("--av", av),
        ("--deviations", deviations),
        ("--limit", limit),
        *selection(ids, categories),
        *reading(current_frame, window_step, all_agents),
        ("--seed", seed),
        ("--keep-rollouts", keep_rollouts),
        ("--jobs", jobs),
        ("--resume", resume),
    ]
    # Not an option: no study begins with `-`.
    if kind.startswith("-"):
        raise ValueError(f"there is no study `{kind}`")
    command = ["study", kind, *arguments(given, paths(scenarios), options)]
    produce(command, Path(out, "study.json"), show=progress)
    return Study(out)
