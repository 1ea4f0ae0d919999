"""Reads scenarios of all formats of the program as numpy arrays."""

from __future__ import annotations

import os
import shlex
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, cast

import numpy as np

from .client import STEPS, Array, ProtocolError, Scene, Scenes, _Tensors, read_frame
from .display import Gif, Svg
from .options import PathLike, Sources, paths, reading, selection
from .pictures import picture
from .program import CHECK, ReactsimError, arguments, find_program, start

__all__ = ["STEPS", "Scenario", "reading_of", "scenarios"]


class Scenario(Scene):
    """A scenario with its logged future: agents, history, map, lights, and the deviated AV.

    Attributes:
        id: Id of the scenario.
        agents: Ids of the agents; the first one is the AV.
        n_history: Number of frames up to and including the current one, 11 in the benchmark.
        n_steps: Number of steps after the current frame, 80 in the benchmark.
        origin: World coordinates of the local origin, metres.
        source: File or folder that was read; None for the shipped benchmark.
        deviations: File of deviated AVs with which it was read, if there was one.
        obstacle_heights: Height of the bottom of each obstacle, f64 [O], metres, NaN if unknown.
        history_heights: Height of the bottom of each agent up to the current frame, f64 [n,
            n_history], metres, NaN if unknown. Scenarios on one level have no heights.
        future_heights: Heights after the current frame, f64 [n, n_steps].
        future: Logged states after the current frame, f64 [n, n_steps, 5]: x, y, heading, vx, vy in
            metres, radians and m/s; 0 where absent.
        future_valid: Whether each agent is present after the current frame, bool [n, n_steps].
        light_future: States of the traffic lights after the current frame, u8 [K, n_steps].
        av: Deviated AV after the current frame, f64 [n_steps, 5], as `future`; None if the scenario
            has none.

    """

    def __init__(
        self,
        scenes: Scenes,
        tensors: dict[str, Array],
        source: str | None = None,
        reading: Mapping[str, Any] | None = None,
        deviations: str | None = None,
    ) -> None:
        super().__init__(scenes, 0)
        if scenes.scenario_ids is None or scenes.agent_ids is None or scenes.origins is None:
            raise ProtocolError("a scenario without ids")
        if len(scenes) != 1:
            raise ProtocolError(f"{len(scenes)} scenarios in one message, expected 1")
        self.id: str = scenes.scenario_ids[0]
        self.agents: list[str] = scenes.agent_ids[0]
        self.origin: tuple[float, float] = (scenes.origins[0][0], scenes.origins[0][1])
        self.source = source
        self.deviations = deviations
        self._reading = dict(reading or {})
        take = _Tensors(tensors)
        shape = scenes.kinds.shape
        n = self.n_agents
        scenes.lines.heights = take.take("point_heights", "F64", len(scenes.lines.points))
        self.obstacle_heights: Array = take.take("obstacle_heights", "F64", len(self.obstacles))
        self.history_heights: Array = take.take("heights", "F64", *shape, self.n_history)[0, :n]
        self.future_heights: Array | None = None
        self.future: Array | None = None
        self.future_valid: Array | None = None
        self.light_future: Array | None = None
        self.av: Array | None = None
        steps = self.n_steps
        if "future" in tensors:
            self.future = take.take("future", "F64", *shape, steps, 5)[0, :n]
            self.future_valid = take.take("future_valid", "BOOL", *shape, steps)[0, :n]
            self.future_heights = take.take("future_heights", "F64", *shape, steps)[0, :n]
            self.light_future = take.take("light_future", "U8", len(scenes.lights), steps)
        if "av" in tensors:
            self.av = take.take("av", "F64", steps, 5)

    def __repr__(self) -> str:
        return f"Scenario({self.id!r}, {self.n_agents} agents)"

    def reading(self) -> dict[str, Any]:
        """Returns the files of the scenario and how they are read, as the program takes them."""
        return reading_of(self.source, **self._reading)

    @property
    def states(self) -> Array:
        """Logged states at all frames, f64 [n, n_history + n_steps, 5], as `future`."""
        return _whole(self.history, self.future)

    @property
    def present(self) -> Array:
        """Whether each agent is present at each frame, bool [n, n_history + n_steps]."""
        return _whole(self.valid, self.future_valid)

    @property
    def heights(self) -> Array:
        """Heights of the bottoms of agents at all frames, f64 [n, n_history + n_steps], metres."""
        return _whole(self.history_heights, self.future_heights)

    def svg(
        self,
        *,
        radius: float | None = None,
        steps: int | Sequence[int] = (),
        simulator: str | None = None,
    ) -> Svg:
        """Returns a picture, made by the program.

        Args:
            radius: Half of the side of the picture, metres; 60 by default.
            steps: Steps to draw, from 0 (current frame) to `n_steps`; 0 by default.
            simulator: Simulator that moves the agents, such as "idm"; the program runs it against
                the deviated AV in the file of the scenario.

        """
        given = {"radius": radius, "steps": steps, "simulator": simulator, **self._reading}
        return Svg(picture("svg", self.source, id=self.id, **given).decode("utf-8"))

    def gif(
        self,
        *,
        simulators: str | Sequence[str] = (),
        radius: float | None = None,
        size: int | None = None,
        every: int | None = None,
        follow: bool = False,
    ) -> Gif:
        """Returns an animation of 8 s, made by the program.

        Without simulators the AV follows its deviated trajectory, and all other agents follow the
        log. A deviated AV is taken from the file of the scenario, not from a file of `deviations`.

        Args:
            simulators: Simulators to draw side by side; the program runs them first, against the
                deviated AV of the scenario.
            radius: Half of the side of a picture, metres; by default large enough for the path of
                the AV, or 40 with `follow`.
            size: Side of a panel, pixels, 100 to 1200; 480 by default.
            every: Show only every Nth step; 1, the default, is 10 frames per second.
            follow: Keep the AV in the middle, which makes larger files.

        """
        given = {"simulator": simulators, "radius": radius, "size": size, "every": every}
        return Gif(picture("gif", self.source, id=self.id, follow=follow, **given, **self._reading))

    def _repr_svg_(self) -> str:
        return str(self.svg())


def _whole(history: Array, future: Array | None) -> Array:
    if future is None:
        raise ValueError("read the scenario with `future=True`")
    return np.concatenate([history, future], axis=1)


def reading_of(source: Sources, **as_read: Any) -> dict[str, Any]:
    """Returns files of scenarios and how they are read, as arguments of a request."""
    return {"paths": [_absolute(path) for path in paths(source)], **as_read}


def scenarios(
    source: PathLike | None = None,
    *,
    deviations: PathLike | None = None,
    limit: int | None = None,
    ids: Sequence[str] = (),
    categories: Sequence[str] = (),
    future: bool | int | str = True,
    current_frame: int | None = None,
    window_step: int | None = None,
    history: int | None = None,
    all_agents: bool = False,
) -> Iterator[Scenario]:
    """Iterates over scenarios, one in memory at a time.

    Args:
        source: File or folder of scenarios of any format that the program reads; the shipped
            benchmark by default.
        deviations: File of deviated AVs.
        limit: Only the first `limit` of the selected scenarios, over all files.
        ids: Only scenarios with one of these ids; all by default.
        categories: Only scenarios whose deviated AV has one of these categories, such as "lateral".
        future: Read the logged future and the deviated AV too; also the number of frames after the
            current one, a time such as "15s", or "log" for all that are recorded.
        current_frame: Index of the current frame, from 0, for formats that leave it open
            (Argoverse 2, ScenarioNet, Waymo files of more than 91 frames).
        window_step: Read several scenarios of each long recording of Waymo, ScenarioNet and native
            files: frame 10 and every `window_step` frames after it is a current frame.
        history: Number of frames up to and including the current one.
        all_agents: Read all agents that are present at the current frame, of all kinds and any
            number, instead of the AV and the 63 nearest vehicles, pedestrians and cyclists.

    Raises:
        ReactsimError: The program could not be started, or failed; the message is its own.

    """
    as_read: dict[str, Any] = {
        "current_frame": current_frame,
        "window_step": window_step,
        "history": history,
        "future": None if isinstance(future, bool) else future,
        "all_agents": all_agents,
    }
    given = [
        ("--deviations", deviations),
        ("--limit", limit),
        *selection(ids, categories),
        *reading(**as_read),
        ("--with-future", future is not False),
    ]
    command = [find_program(), "export", "scenes", *arguments(given, paths(source))]
    path = None if source is None else os.fspath(source)
    return _read(command, path, as_read, None if deviations is None else _absolute(deviations))


def _absolute(path: PathLike) -> str:
    text = os.fspath(path)
    return text if "://" in text else os.path.abspath(text)


def _read(
    command: list[str], path: str | None, as_read: Mapping[str, Any], deviations: str | None
) -> Iterator[Scenario]:
    with tempfile.TemporaryDirectory(prefix="reactsim-") as folder:
        log = Path(folder, "stderr")
        with log.open("wb") as errors:
            program = start(command, stdout=subprocess.PIPE, stderr=errors)
        stream = cast("IO[bytes]", program.stdout)
        is_complete = False
        problem = "it ended before the message `bye`"
        try:
            while True:
                try:
                    frame = read_frame(stream)
                except ProtocolError as error:
                    problem = str(error)
                    break
                if frame is None or frame[0]["type"] == "bye":
                    is_complete = frame is not None
                    break
                if frame[0]["type"] != "scene":
                    problem = f"unknown message `{frame[0]['type']}`"
                    break
                yield Scenario(Scenes(*frame), frame[1], path, as_read, deviations)
        finally:
            stream.close()
            if not is_complete and program.poll() is None:
                program.terminate()
            code = program.wait()
        # Exit code 1: some records could not be read.
        if not is_complete or code not in (0, 1):
            text = log.read_text("utf-8", "replace").strip() or CHECK
            raise ReactsimError(f"`reactsim {shlex.join(command[1:])}` failed ({problem}):\n{text}")
