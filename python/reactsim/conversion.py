"""Writes scenarios, deviated AVs and runs for other programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .options import PathLike, Run, Sources, each, folders, paths, reading, selection
from .program import arguments, local_folder, produce

__all__ = ["convert", "export_av", "export_wosac"]


def convert(
    scenarios: PathLike | Sequence[PathLike],
    out: PathLike,
    *,
    ids: Sequence[str] = (),
    categories: Sequence[str] = (),
    futures: PathLike | None = None,
    certificates: PathLike | None = None,
    history_only: bool = False,
    model: str | None = None,
    current_frame: int | None = None,
    window_step: int | None = None,
    all_agents: bool = False,
    progress: bool = True,
) -> Path:
    """Converts scenarios of any format to native Parquet; returns the file.

    Args:
        scenarios: Files, folders or URLs of scenarios.
        out: The native Parquet file to write.
        ids: Only scenarios with one of these ids; all by default.
        categories: Only scenarios whose deviated AV has one of these categories, such as "lateral".
        futures: File of rollouts (`rollouts.parquet` of a run) that replace the logged future;
            scenarios without a rollout are left out.
        certificates: File of deviated AVs that replace the logged future of the AV, and whose
            certificates replace the future of the agents that respond to it.
        history_only: Leave out everything after the current frame.
        model: Simulator whose rollouts are taken.
        current_frame: Index of the current frame, from 0, for formats that leave it open.
        window_step: Frames between scenarios of one recording of 20 s.
        all_agents: Keep all agents that are present at the current frame, of all kinds.
        progress: Show the messages of the program.

    Raises:
        ReactsimError: No scenario could be converted. Scenarios that failed only cause a warning.

    """
    given = [
        ("--out", out),
        *selection(ids, categories),
        ("--futures", futures),
        ("--certificates", certificates),
        ("--history-only", history_only),
        ("--model", model),
        *reading(current_frame, window_step, all_agents),
    ]
    produce(["convert", *arguments(given, paths(scenarios))], out, show=progress)
    return local_folder(out)


def export_av(
    scenarios: Sources,
    out: PathLike,
    *,
    deviations: PathLike | None = None,
    limit: int | None = None,
    ids: Sequence[str] = (),
    categories: Sequence[str] = (),
    current_frame: int | None = None,
    window_step: int | None = None,
    all_agents: bool = False,
) -> Path:
    """Writes the trajectories of deviated AVs, without anything of the recorded future.

    Args:
        scenarios: Files, folders or URLs of scenarios; None for the shipped benchmark.
        out: The JSON file to write, in the coordinates of the scenarios.
        deviations: File of deviated AVs.
        limit: Only the first `limit` scenarios of every file.
        ids: Only scenarios with one of these ids; all by default.
        categories: Only scenarios whose deviated AV has one of these categories, such as "lateral".
        current_frame: Index of the current frame, from 0, for formats that leave it open.
        window_step: Frames between scenarios of one recording of 20 s.
        all_agents: Read all agents that are present at the current frame, of all kinds.

    Raises:
        ReactsimError: The scenarios cannot be read, or have no deviated AV.

    """
    given = [
        ("--deviations", deviations),
        ("--limit", limit),
        *selection(ids, categories),
        *reading(current_frame, window_step, all_agents),
        ("--out", out),
    ]
    produce(["export", "av", *arguments(given, paths(scenarios))], out, show=False)
    return local_folder(out)


def export_wosac(
    run: Run,
    out: PathLike,
    *,
    scenarios: PathLike | Sequence[PathLike],
    metadata: PathLike,
    simulator: str | None = None,
    shards: int | None = None,
) -> Path:
    """Writes a run as a submission to the Waymo Open Sim Agents Challenge; returns the archive.

    Args:
        run: Run with kept rollouts: realism protocol, 32 rollouts, `all_agents`.
        out: Archive to write (.tar.gz).
        scenarios: Recordings: files or folders of the Waymo Open Motion Dataset.
        metadata: Description of the method (TOML): account_name, unique_method_name, and others.
        simulator: Simulator, if the run has several.
        shards: Number of files in the archive; 1 by default, customarily 150.

    Raises:
        ReactsimError: The run does not fulfil the rules of the challenge.

    """
    given = [
        ("--simulator", simulator),
        *each("--scenarios", paths(scenarios)),
        ("--metadata", metadata),
        ("--out", out),
        ("--shards", shards),
    ]
    produce(["export", "wosac", *arguments(given, folders(run))], out, show=False)
    return local_folder(out)
