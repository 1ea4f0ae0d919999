"""Trains networks, and prepares what trainings need."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Union

from .display import Text
from .options import Options, PathLike, Sources, each, paths, settings
from .program import arguments, invoke, local_folder, produce
from .results import Results

__all__ = [
    "Adaptation",
    "intentions",
    "open_loop",
    "recipe",
    "split",
    "train",
    "train_adapt",
    "train_quick",
    "vocabulary",
]

Weighted = Union[Mapping[str, float], Sources]
"""Scenarios, or scenarios with the number of times that they are seen per epoch."""


def train(
    task: str,
    scenarios: Weighted,
    *,
    out: PathLike,
    recipe: PathLike | None = None,
    parameters: Mapping[str, Any] | None = None,
    inputs: Mapping[str, PathLike] | None = None,
    start: PathLike | None = None,
    resume: bool = False,
    cache: PathLike | None = None,
    exclude: PathLike | Sequence[PathLike] = (),
    seed: int = 0,
    backend: str | None = None,
    jobs: int | None = None,
    checkpoint_every: str | None = None,
    closed_loop: Sources = None,
    most_closed_loop: int | None = None,
    closed_loop_rollouts: int | None = None,
    progress: bool = True,
) -> Path:
    """Trains a network and returns the file of its weights.

    `reactsim.run(..., options=["--model-weights=ID=FILE"])` uses them.

    Args:
        task: Training task; `catalog("tasks")` names the tasks.
        scenarios: Files or folders of scenarios, or a dictionary of them with the number of times
            that their scenarios are seen per epoch, such as `{"logs": 4, "g.parquet": 0.5}`.
        out: Folder of the training to write: log, curves, checkpoints, weights.
        recipe: Name of a shipped recipe, or a file (TOML); the default values by default.
        parameters: Values of the recipe to change, such as `{"learning.epochs": 2}`.
        inputs: Files that the task is given, by name, such as "vocabulary".
        start: Weights of an earlier training to start from, instead of new ones.
        resume: Continue the training in `out` from its last checkpoint.
        cache: Folder for scenarios converted from other formats; in `out` by default.
        exclude: Files or folders of scenarios that are not learned from.
        seed: Seed of all random choices.
        backend: Tensor backend; `catalog("backends")` shows which the program has.
        jobs: Number of threads; one per core by default.
        checkpoint_every: Time between checkpoints, such as "90s" or "1h"; "3m" by default.
        closed_loop: Scenarios for closed-loop evaluation at every validation.
        most_closed_loop: Largest number of them; 32 by default.
        closed_loop_rollouts: Rollouts of each of them; 2 by default.
        progress: Show the messages of the program.

    Raises:
        ReactsimError: The training could not be run. Scenarios of known benchmarks are refused.

    """
    given: Options = [
        ("--out", out),
        ("--recipe", recipe),
        *settings("--set", parameters or {}),
        *settings("--input", inputs or {}),
        ("--from", start),
        ("--resume", resume),
        ("--cache", cache),
        *each("--exclude", exclude),
        ("--seed", seed),
        ("--backend", backend),
        ("--jobs", jobs),
        ("--checkpoint-every", checkpoint_every),
        *each("--closed-loop", paths(closed_loop)),
        ("--most-closed-loop", most_closed_loop),
        ("--closed-loop-rollouts", closed_loop_rollouts),
    ]
    if isinstance(scenarios, Mapping):
        several = [f"{path}={times}" for path, times in scenarios.items()]
    else:
        several = paths(scenarios)
    weights = Path(local_folder(out), "weights.safetensors")
    produce(["train", *arguments(given, [task, *several])], weights, show=progress)
    return weights


def recipe(
    task: str,
    recipe: PathLike | None = None,
    *,
    parameters: Mapping[str, Any] | None = None,
) -> Text:
    """Returns a recipe with all values, units and ranges, as TOML.

    The arguments are those of `train`.

    Raises ReactsimError for an unknown task, recipe or value.
    """
    given = [("--print-recipe", True), ("--recipe", recipe)]
    given += settings("--set", parameters or {})
    return Text(invoke(["train", *arguments(given, [task])]).text)


def train_quick(
    out: PathLike,
    *,
    seed: int = 0,
    resume: bool = False,
    jobs: int | None = None,
    progress: bool = True,
) -> Results:
    """Generates data, trains a small network and runs it next to the baselines, in some minutes.

    Args:
        out: Folder to write: scenarios, training, run.
        seed: Seed of all random choices.
        resume: Continue in `out` where it was interrupted.
        jobs: Number of threads; one per core by default.
        progress: Show the messages of the program.

    Raises:
        ReactsimError: A step failed.

    """
    given = [("--out", out), ("--seed", seed), ("--resume", resume), ("--jobs", jobs)]
    run = Path(local_folder(out), "run")
    produce(["train", "quick", *arguments(given)], run, show=progress)
    return Results(run)


@dataclasses.dataclass(frozen=True)
class Adaptation:
    """A simulator that was adapted to logs.

    Attributes:
        baseline: Name of the simulator for `run(baselines=[...])`, such as "ntp-guarded@mine".
        options: Options of `run` with its weights and parameters.
        weights: File of the weights.
        realism: Results before and after on the scenarios to judge by, in the realism protocol.
        reactive: The same in the reactive protocol, with AVs that deviate; None if none could.

    """

    baseline: str
    options: list[str]
    weights: Path
    realism: Results
    reactive: Results | None


def train_adapt(
    logs: PathLike | Sequence[PathLike],
    out: PathLike,
    *,
    model: str = "ntp-guarded",
    minutes: float = 10.0,
    seed: int = 0,
    exclude: PathLike | Sequence[PathLike] = (),
    resume: bool = False,
    jobs: int | None = None,
    current_frame: int | None = None,
    window_step: int | None = None,
    all_agents: bool = False,
    progress: bool = True,
) -> Adaptation:
    """Adapts a shipped network to logs and runs it next to what it was before.

    Args:
        logs: Files or folders of logs.
        out: Folder to write: scenarios, training, runs.
        model: Simulator to adapt.
        minutes: Time for everything.
        seed: Seed of all random choices.
        exclude: Files or folders of scenarios that are left out, even if they are among the logs.
        resume: Continue in `out` where it was interrupted.
        jobs: Number of threads; one per core by default.
        current_frame: Index of the current frame, for formats that leave it open.
        window_step: Frames between the scenarios of one recording of 20 s.
        all_agents: Simulate all agents that are present at the current frame.
        progress: Show the messages of the program.

    Raises:
        ReactsimError: A step failed.

    """
    given = [
        ("--model", model),
        ("--minutes", minutes),
        ("--out", out),
        ("--seed", seed),
        *each("--exclude", exclude),
        ("--resume", resume),
        ("--jobs", jobs),
        ("--current-frame", current_frame),
        ("--window-step", window_step),
        ("--all-agents", all_agents),
    ]
    folder = Path(local_folder(out))
    produce(["train", "adapt", *arguments(given, paths(logs))], folder / "realism", show=progress)
    baseline, weights = f"{model}@mine", folder / "training" / "weights.safetensors"
    options = [f"--model-weights={baseline}={weights}"]
    haste = folder / "haste.txt"
    if haste.exists():
        options.append(f"--set={baseline}.haste.weight={haste.read_text('utf-8').strip()}")
    reactive = folder / "reactive"
    return Adaptation(
        baseline,
        options,
        weights,
        Results(folder / "realism"),
        Results(reactive) if reactive.is_dir() else None,
    )


def split(
    scenarios: Sources, out: PathLike, *, parts: Mapping[str, float], seed: int = 0
) -> dict[str, Path]:
    """Divides scenarios into parts, such as training and validation; returns their files.

    The part of a scenario depends only on its content and the seed.

    Args:
        scenarios: Files or folders of scenarios.
        out: Folder to write: a file NAME.parquet for every part.
        parts: Shares by name, which add up to 1, such as `{"train": 0.9, "val": 0.1}`.
        seed: Seed of all random choices.

    Raises:
        ReactsimError: The scenarios cannot be read.

    """
    given = [*settings("--part", parts), ("--out", out), ("--seed", seed)]
    produce(["train", "split", *arguments(given, paths(scenarios))], out, show=False)
    return {name: Path(local_folder(out), f"{name}.parquet") for name in parts}


def open_loop(
    scenarios: Sources,
    *,
    weights: PathLike | None = None,
    with_parked: bool = False,
    limit: int | None = None,
    backend: str | None = None,
) -> Text:
    """Measures the prediction errors of a network of the task "qp-regression".

    Args:
        scenarios: Files or folders of scenarios.
        weights: Weights of the network; the shipped ones by default.
        with_parked: Also predict parked agents.
        limit: Only the first `limit` scenarios of every file.
        backend: Tensor backend.

    Returns:
        Minimum displacements of six modes over 8 s, metres, and miss rates, as a table.

    Raises:
        ReactsimError: The scenarios or weights cannot be read.

    """
    given = [
        ("--weights", weights),
        ("--with-parked", with_parked),
        ("--limit", limit),
        ("--backend", backend),
    ]
    return Text(invoke(["train", "open-loop", *arguments(given, paths(scenarios))]).text)


def intentions(
    scenarios: Sources,
    out: PathLike,
    *,
    points: int | None = None,
    places: int | None = None,
    seed: int = 0,
    limit: int | None = None,
    progress: bool = True,
) -> Path:
    """Computes intention points for the task "qp-regression"; returns their file.

    Args:
        scenarios: Files or folders of scenarios.
        out: File to write (safetensors).
        points: Points per class; 16 by default.
        places: Positions per class to keep in memory; 50,000 by default.
        seed: Seed of all random choices.
        limit: Only the first `limit` scenarios of every file.
        progress: Show the messages of the program.

    Raises:
        ReactsimError: The scenarios cannot be read, or have too few positions.

    """
    given = [
        ("--out", out),
        ("--points", points),
        ("--places", places),
        ("--seed", seed),
        ("--limit", limit),
    ]
    produce(["train", "intentions", *arguments(given, paths(scenarios))], out, show=progress)
    return local_folder(out)


def vocabulary(
    scenarios: Sources,
    out: PathLike,
    *,
    method: str = "k-disks",
    map_out: PathLike | None = None,
    tokens: int | None = None,
    tolerance: float | None = None,
    symmetric: bool = False,
    segments: int | None = None,
    fill: bool = False,
    seed: int = 0,
    limit: int | None = None,
    progress: bool = True,
) -> Path:
    """Builds a vocabulary of motion tokens; returns its file.

    Args:
        scenarios: Files or folders of scenarios.
        out: File to write (safetensors).
        method: "k-disks", "trajtok" or "kinematic".
        map_out: Also write a vocabulary of map segments of 5 m to this file.
        tokens: Tokens per class (k-disks); 2048 by default.
        tolerance: Distance below which motions share a token, metres (k-disks).
        symmetric: Add the mirror image of every token (k-disks).
        segments: Motions per class to keep in memory; 204,800 by default.
        fill: Add kinematic tokens far from all others.
        seed: Seed of all random choices.
        limit: Only the first `limit` scenarios of every file.
        progress: Show the messages of the program.

    Raises:
        ReactsimError: The scenarios cannot be read, or have too few motions.

    """
    given = [
        ("--method", method),
        ("--out", out),
        ("--map-out", map_out),
        ("--tokens", tokens),
        ("--tolerance", tolerance),
        ("--symmetric", symmetric),
        ("--segments", segments),
        ("--fill", fill),
        ("--seed", seed),
        ("--limit", limit),
    ]
    produce(["train", "vocabulary", *arguments(given, paths(scenarios))], out, show=progress)
    return local_folder(out)
