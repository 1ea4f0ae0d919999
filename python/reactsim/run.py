"""Runs simulators and a planner of this process on the benchmark."""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
import tempfile
import time
import warnings
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .client import Session, is_served, serve
from .metric import Metric, checked
from .options import PathLike, joined, paths, reading, selection
from .process import attend, first_errors, own_session
from .program import CHECK, ReactsimError, arguments, find_program, local_folder
from .results import Results

__all__ = ["run"]


def run(
    simulators: Any = None,
    scenarios: PathLike | Sequence[PathLike] | None = None,
    *,
    planner: Any = None,
    tracker: str = "lqr",
    plan_every: int = 1,
    name: str | None = None,
    av: str | None = None,
    deviations: PathLike | None = None,
    protocol: str | None = None,
    replan: str | None = None,
    baselines: Sequence[str] = (),
    metrics: Sequence[Metric] = (),
    rollouts: int | None = None,
    seed: int | None = None,
    limit: int | None = None,
    ids: Sequence[str] = (),
    categories: Sequence[str] = (),
    current_frame: int | None = None,
    window_step: int | None = None,
    history: int | None = None,
    future: int | str | None = None,
    all_agents: bool = False,
    batch: int | None = None,
    out: PathLike | None = None,
    resume: bool = False,
    options: Sequence[str] = (),
    reveal_ids: bool = False,
    jobs: int | None = None,
    progress: bool = True,
) -> Results:
    """Runs simulators, a planner, and baselines next to them, and returns the results.

    The program `reactsim` is started as a child process; it asks the simulators and the planner,
    which stay in this process, so breakpoints, prints and notebooks work.

    If the program has started this process (`--external NAME='python mine.py'`), `run` serves the
    simulators and the planner as `serve` does, and ends the process: one script is for both.

    Args:
        simulators: A `Simulator`, a class without arguments to make one, any object with the same
            methods, or a list of these. Without simulators and `baselines`, those that run by
            default move the agents around the planner. A path is that of a specification, as
            `scenarios` has it.
        planner: A `Planner` that drives the AV, or a class without arguments to make one.
        tracker: Controller that follows the plans of the planner: "lqr" or "perfect".
        plan_every: Number of steps between two plans of the planner.
        scenarios: Files, folders or URLs of scenarios; the shipped benchmark by default. Or a
            specification (`.toml`), such as that of a run folder: arguments that are given take
            precedence over it.
        name: Name in tables of the only simulator or planner; its own name by default.
        av: Driver of the AV: "deviated", "log", "deviated-or-log", "constant-velocity", "brake:4",
            "retime:0.8", "shift:2", "file:PATH", or a planner that ships, such as
            "planner:pdm-closed".
        deviations: File of deviated AVs.
        protocol: "reactive", the default, or "realism", in which the simulator also moves the AV.
        replan: Replan rate or interval, such as "5steps"; "2hz" by default.
        baselines: Ids of baselines to run next to the simulators, or alone, such as "idm";
            "default" for those that run by default; "mix:idm=1+stop=1" for mixed traffic.
        metrics: Metrics of your own, which are computed for every rollout after the run and added
            to the results; see `Metric`. They need pyarrow.
        rollouts: Rollouts per scenario and simulator; 1 by default.
        seed: Seed of all random choices; 0 by default.
        limit: Only the first `limit` of the selected scenarios, over all files.
        ids: Only scenarios with one of these ids; all by default.
        categories: Only scenarios whose deviated AV has one of these categories, such as "lateral".
        current_frame: Index of the current frame, from 0, for formats that leave it open.
        window_step: Frames between scenarios of one recording of 20 s.
        history: Number of frames up to and including the current one.
        future: Number of frames after the current one, or a time such as "15s", or "log".
        all_agents: Simulate all agents that are present at the current frame, of all kinds and any
            number, as the Sim Agents challenge requires.
        batch: Number of episodes per batch; the simulator's `batch` by default.
        out: Run folder to write; a temporary folder by default, which lives as long as the results.
        resume: Continue the interrupted run in `out`, to which no metrics were added yet.
        options: Further options of `reactsim run`, such as "--av-lookahead=0".
        reveal_ids: Give the simulator the ids of scenarios and agents; tables mark it.
        jobs: Number of threads of the program.
        progress: Show the number of finished episodes, and the messages of the program.

    Raises:
        ReactsimError: The program could not be started or failed; the message has its last lines.
            Failed scenarios only cause a warning; `Results.failures` lists them. Or a metric
            failed: the attribute `results` of the error is then the finished run, and
            `add_metrics` of it can follow.

    """
    if isinstance(simulators, (str, os.PathLike)):
        if scenarios is not None or not _is_spec(simulators):
            raise ValueError(
                f"{os.fspath(simulators)!r} is no specification (`.toml`) in place of scenarios:"
                " give ids in `baselines`, and files in `scenarios`"
            )
        simulators, scenarios = None, simulators
    has_spec = any(_is_spec(path) for path in paths(scenarios))
    if resume and out is None:
        raise ValueError("`resume` needs the folder `out` of the interrupted run")
    several = simulators if isinstance(simulators, (list, tuple)) else [simulators]
    given = [("simulator", own) for own in several if own is not None]
    given += [("planner", planner)] if planner is not None else []
    if not given and not baselines and not has_spec:
        raise ValueError("give simulators, a planner, only `baselines`, or a specification")
    if given and is_served():
        # A script that runs its simulator is also one that `--external` can start.
        serve(*(own for _, own in given))
        raise SystemExit
    if metrics:
        metrics = checked(metrics)
    if planner is not None and av is not None:
        raise ValueError("`planner` drives the AV: leave `av` out")
    if name is not None and len(given) != 1:
        raise ValueError("`name` is for one simulator or planner: set the attribute `name` of each")
    counter = _Counter() if progress else None
    sessions: dict[str, Session] = {}
    programs: list[tuple[str, Any]] = []
    for role, own in given:
        # An episode of both is counted once.
        counts = counter if role == given[0][0] else None
        session = own_session(own, role, batch=batch, on_end=counts)
        title = name or session.name
        if title in sessions:
            raise ValueError(f"`{title}` is the name of two simulators or planners; change one")
        sessions[title] = session
        programs.append(("--external" if role == "simulator" else "--planner", f"{title}=@stdio"))
        if role == "planner":
            av = f"planner:external:{title},tracker={tracker},every={plan_every}"
    program = find_program()
    cleanup = contextlib.ExitStack()
    if out is None:
        temporary = tempfile.mkdtemp(prefix="reactsim-")
        cleanup.callback(shutil.rmtree, temporary, ignore_errors=True)
        folder = Path(temporary, "run")
    else:
        folder = local_folder(out)
    options_given = [
        ("--models", joined(baselines)),
        *programs,
        ("--out", folder),
        ("--keep-rollouts", True),
        ("--protocol", protocol),
        ("--replan", replan),
        ("--rollouts", rollouts),
        ("--seed", seed),
        ("--av", av),
        ("--deviations", deviations),
        ("--limit", limit),
        ("--jobs", jobs),
        *selection(ids, categories),
        *reading(current_frame, window_step, history, future, all_agents),
        ("--resume", resume),
        ("--reveal-ids", reveal_ids),
    ]
    command = ["run", *arguments(options_given, paths(scenarios), options)]
    with cleanup:
        output = attend(command, sessions, codes=range(-256, 256), show=progress)
        error = first_errors(sessions.values())
        if output.code not in (0, 1):
            text = "\n".join(output.messages)
            raise ReactsimError(f"`reactsim run` ended with code {output.code}:\n{text}{error}")
        if not (folder / "provenance.json").is_file():
            raise ReactsimError(f"`{program}` ended without any result; {CHECK}")
        results = Results(folder)
        # A temporary folder lives as long as the results.
        weakref.finalize(results, cleanup.pop_all().close)
    if output.code == 1:
        warnings.warn(
            f"{len(results.failures)} scenarios failed, see `failures`{error}", stacklevel=2
        )
    if metrics:
        as_read: dict[str, Any] = {
            "scenarios": scenarios,
            "deviations": deviations,
            "current_frame": current_frame,
            "window_step": window_step,
            "history": history,
            "future": future,
            "all_agents": all_agents,
        }
        try:
            results.add_metrics(metrics, **(_scenarios_of(results) if has_spec else as_read))
        except BaseException as error:
            # A temporary folder lives as long as the results.
            error.results = results  # type: ignore[attr-defined]
            raise
    return results


def _is_spec(path: PathLike) -> bool:
    return os.fspath(path).endswith(".toml")


def _scenarios_of(results: Results) -> dict[str, Any]:
    """Returns the scenarios of a run and how they are read, as `Results.add_metrics` takes them."""
    spec = results.spec or {}

    def found(path: str) -> str:
        return path if "://" in path else str(results.folder / path)

    deviations = spec.get("deviations")
    return {
        "scenarios": [found(path) for path in spec.get("scenarios", [])],
        "deviations": None if deviations is None else found(deviations),
        "current_frame": spec.get("current-frame"),
        "window_step": spec.get("window-step"),
        "history": spec.get("history"),
        "future": spec.get("future"),
        "all_agents": spec.get("all-agents", False),
    }


class _Counter:
    """Shows the number of finished episodes where somebody watches."""

    INTERVAL = 0.5  # seconds between two outputs

    def __init__(self) -> None:
        self.done = 0
        self.shown = 0.0
        self.watched = "ipykernel" in sys.modules or (
            sys.stderr is not None and sys.stderr.isatty()
        )

    def __call__(self, episodes: int) -> None:
        self.done += episodes
        if self.watched and time.monotonic() - self.shown > self.INTERVAL:
            self.shown = time.monotonic()
            print(f"\r{self.done} episodes\r", end="", file=sys.stderr, flush=True)
