"""Descriptions, pictures and animations of scenarios and rollouts, which the program makes."""

from __future__ import annotations

import shlex
import tempfile
from collections.abc import Sequence
from pathlib import Path

from .display import Gif, Svg, Text
from .options import Options, PathLike, Run, folders, joined, paths, reading
from .program import ReactsimError, arguments, call, invoke

__all__ = ["animate", "draw", "inspect"]


def inspect(
    source: PathLike | None = None,
    *,
    id: str | None = None,
    category: str | None = None,
    case: str | None = None,
    current_frame: int | None = None,
    window_step: int | None = None,
    all_agents: bool = False,
) -> Text:
    """Describes a scenario: agents, map, lights, the deviated AV and how it can be avoided.

    Args:
        source: File, folder or URL of scenarios; the shipped benchmark by default.
        id: Id of the scenario; the first one by default.
        category: Category of the deviated AV of the scenario, such as "lateral".
        case: A case study of the shipped benchmark, such as "cut-in"; `catalog("cases")` lists
            them.
        current_frame: Index of the current frame, from 0, for formats that leave it open.
        window_step: Frames between scenarios of one recording of 20 s.
        all_agents: Take all agents that are present at the current frame, of all kinds.

    Raises:
        ReactsimError: There is no such scenario, or it cannot be read.

    """
    given = [("--id", id), ("--category", category), ("--case", case)]
    given += reading(current_frame, window_step, all_agents)
    return Text(invoke(["inspect", *arguments(given, paths(source))]).text)


def draw(
    source: PathLike | None = None,
    *,
    id: str | None = None,
    category: str | None = None,
    case: str | None = None,
    rollout: Run | None = None,
    simulator: str | None = None,
    index: int | None = None,
    steps: int | Sequence[int] = (),
    radius: float | None = None,
    current_frame: int | None = None,
    window_step: int | None = None,
    all_agents: bool = False,
) -> Svg:
    """Draws a scenario, or a rollout of it, as a still.

    Args:
        source: File, folder or URL of scenarios; the shipped benchmark by default.
        id: Id of the scenario; the first one by default.
        category: Category of the deviated AV of the scenario, such as "lateral".
        case: A case study of the shipped benchmark, such as "cut-in".
        rollout: Run with kept rollouts, of which one is drawn.
        simulator: Simulator to draw. Without `rollout` the program runs it first, against the
            deviated AV of the scenario.
        index: Index of the rollout, from 0.
        steps: Steps of the stills, 0 (current frame) to 80, of 0.1 s each; 0 by default.
        radius: Half of the side of a picture, metres; 60 by default.
        current_frame: Index of the current frame, from 0, for formats that leave it open.
        window_step: Frames between scenarios of one recording of 20 s.
        all_agents: Draw all agents that are present at the current frame, of all kinds.

    Raises:
        ReactsimError: There is no such scenario or rollout.

    """
    given = [
        *_subject(id, category, case, rollout, index),
        ("--simulator", simulator),
        ("--steps", steps if isinstance(steps, int) else joined(steps)),
        ("--radius", radius),
        *reading(current_frame, window_step, all_agents),
    ]
    return Svg(_picture("--svg", given, source).decode("utf-8"))


def animate(
    source: PathLike | None = None,
    *,
    id: str | None = None,
    category: str | None = None,
    case: str | None = None,
    rollout: Run | None = None,
    simulators: str | Sequence[str] = (),
    index: int | None = None,
    radius: float | None = None,
    size: int | None = None,
    every: int | None = None,
    follow: bool = False,
    current_frame: int | None = None,
    window_step: int | None = None,
    all_agents: bool = False,
) -> Gif:
    """Draws a scenario, or rollouts of it, as an animation of 8 s.

    Without simulators it shows what happens if nobody reacts: the AV follows its deviated
    trajectory, and all other agents follow the log.

    Args:
        source: File, folder or URL of scenarios; the shipped benchmark by default.
        id: Id of the scenario; the first one by default.
        category: Category of the deviated AV of the scenario, such as "lateral".
        case: A case study of the shipped benchmark, such as "cut-in".
        rollout: Run with kept rollouts, which are drawn.
        simulators: Simulators to draw side by side. Without `rollout` the program runs them first,
            against the deviated AV of the scenario.
        index: Index of the rollout, from 0.
        radius: Half of the side of a picture, metres; by default large enough for the path of the
            AV, or 40 with `follow`.
        size: Side of a panel, pixels, 100 to 1200; 480 by default.
        every: Show only every Nth step; 1, the default, is 10 frames per second.
        follow: Keep the AV in the middle, which makes larger files.
        current_frame: Index of the current frame, from 0, for formats that leave it open.
        window_step: Frames between scenarios of one recording of 20 s.
        all_agents: Draw all agents that are present at the current frame, of all kinds.

    Raises:
        ReactsimError: There is no such scenario or rollout.

    """
    given = [
        *_subject(id, category, case, rollout, index),
        ("--simulator", joined(simulators)),
        ("--radius", radius),
        ("--size", size),
        ("--every", every),
        ("--follow", follow),
        *reading(current_frame, window_step, all_agents),
    ]
    return Gif(_picture("--gif", given, source))


def _subject(
    id: str | None,
    category: str | None,
    case: str | None,
    rollout: Run | None,
    index: int | None,
) -> Options:
    folder = None if rollout is None else folders(rollout)[0]
    return [
        ("--id", id),
        ("--rollout", folder),
        ("--category", category),
        ("--case", case),
        ("--index", index),
    ]


def _picture(kind: str, given: Options, source: PathLike | None) -> bytes:
    """Lets the program draw to a file, and returns its content."""
    with tempfile.TemporaryDirectory(prefix="reactsim-") as folder:
        path = Path(folder, "picture")
        command = ["inspect", *arguments([*given, (kind, path)], paths(source))]
        call(command)
        if not path.is_file():
            raise ReactsimError(f"`reactsim {shlex.join(command)}` wrote no picture")
        return path.read_bytes()
