"""Adapts shipped networks to logs."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from .comparison import Comparison, comparison_of
from .options import PathLike, each, paths, reading
from .program import arguments, local_folder, produce
from .results import Results

__all__ = ["Adaptation", "train_adapt"]


@dataclasses.dataclass(frozen=True)
class Adaptation:
    """A simulator that was trained on logs, and whether that made it better.

    Attributes:
        baseline: Name of the simulator for `run(baselines=[...])`, such as "ntp-guarded@mine".
        options: Options of `run` with its weights and parameters.
        weights: File of the weights.
        realism: Results before and after on the scenarios to judge by, in the realism protocol.
        reactive: The same in the reactive protocol, with AVs that deviate; None if none could.
        verdict: "worse" if a column of the table got worse with p below 0.05, in which case `text`
            names a setting that works against it; "not-judged" if there are too few AVs to see a
            doubling of a metric of safety, or one has no value; else "better" or
            "no-difference-seen".
        text: The verdict in words, with what led to it.
        differences: Before (first) and after (second) by group of scenarios: "reactive",
            "generated" (metrics of safety) and "realism". Scenarios of one recording count as one
            observation.
        power: By group and metric of safety, how large a rise the scenarios would show, in words.

    """

    baseline: str
    options: list[str]
    weights: Path
    realism: Results
    reactive: Results | None
    verdict: str
    text: str
    differences: Mapping[str, Comparison]
    power: Mapping[str, Mapping[str, str]]


def train_adapt(
    logs: PathLike | Sequence[PathLike],
    out: PathLike,
    *,
    model: str = "ntp-guarded",
    minutes: float = 10.0,
    reward: str | None = None,
    seed: int = 0,
    exclude: PathLike | Sequence[PathLike] = (),
    resume: bool = False,
    jobs: int | None = None,
    current_frame: int | None = None,
    window_step: int | None = None,
    history: int | None = None,
    future: int | str | None = None,
    all_agents: bool = False,
    progress: bool = True,
) -> Adaptation:
    """Adapts a shipped network to logs and runs it next to what it was before.

    Args:
        logs: Files or folders of logs.
        out: Folder to write: scenarios, training, runs.
        model: Simulator to adapt.
        minutes: Time for everything.
        reward: Reward by which the network is fine-tuned after the training: "realism".
        seed: Seed of all random choices.
        exclude: Files or folders of scenarios that are left out, even if they are among the logs.
        resume: Continue in `out` where it was interrupted.
        jobs: Number of threads; one per core by default.
        current_frame: Index of the current frame, for formats that leave it open.
        window_step: Frames between the scenarios of one recording of 20 s.
        history: Number of frames up to and including the current one.
        future: Number of frames after the current one, or a time such as "15s", or "log".
        all_agents: Simulate all agents that are present at the current frame.
        progress: Show the messages of the program.

    Raises:
        ReactsimError: A step failed.

    """
    given = [
        ("--model", model),
        ("--minutes", minutes),
        ("--reward", reward),
        ("--out", out),
        ("--seed", seed),
        *each("--exclude", exclude),
        ("--resume", resume),
        ("--jobs", jobs),
        *reading(current_frame, window_step, history, future, all_agents),
    ]
    folder = Path(local_folder(out))
    produce(["train", "adapt", *arguments(given, paths(logs))], folder / "realism", show=progress)
    training = "training" if reward is None else "rewarded"
    baseline, weights = f"{model}@mine", folder / training / "weights.safetensors"
    options = [f"--model-weights={baseline}={weights}"]
    haste = folder / "haste.txt"
    if haste.exists():
        options.append(f"--set={baseline}.haste.weight={haste.read_text('utf-8').strip()}")
    reactive = folder / "reactive"
    verdict = json.loads((folder / "verdict.json").read_text("utf-8"))
    groups = [name for name in ("reactive", "generated", "realism") if name in verdict]
    return Adaptation(
        baseline,
        options,
        weights,
        Results(folder / "realism"),
        Results(reactive) if reactive.is_dir() else None,
        verdict["verdict"],
        verdict["text"],
        {name: comparison_of(verdict[name]) for name in groups},
        verdict["power"],
    )
