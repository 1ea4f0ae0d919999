"""A stand-in for the program: makes scenes, and plays its side of the protocol."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple

import numpy as np
import reactsim
from reactsim.client import Array, Session, read_frame, write_frame

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "python"
EXAMPLES = PACKAGE / "examples"
IMPORTED = Path(reactsim.__file__).resolve().parents[1]
"""Folder from which the tests import the package: the checkout's, or that of an installed wheel."""

MINI = ROOT / "scenarios" / "mini"
"""Twelve hand-written scenarios."""

SMALL: Dict[str, Any] = {"agents": 4, "lanes": 6, "points": 5, "lights": 2, "route": 4}
"""Sizes of small observations of environments."""

Message = Tuple[Dict[str, str], Dict[str, Array]]


def executable(path: Path, script: str, interpreter: str = "/bin/sh") -> Path:
    """Writes a script that can be started, and returns its path."""
    path.write_text(f"#!{interpreter}\n{script}\n")
    path.chmod(0o755)
    return path


def is_running(process: int) -> bool:
    """Returns whether a process exists and is no zombie."""
    try:
        os.kill(process, 0)
        stat = Path(f"/proc/{process}/stat")
        return not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


def other_lengths(folder: Path) -> Dict[str, Tuple[int, int]]:
    """Writes scenarios of other lengths than the benchmark's; returns history and steps by id."""
    lengths = {"short": (5, 60), "long": (21, 150)}
    for source, (name, (history, steps)) in zip(("cut-in", "platoon"), lengths.items()):
        document = json.loads((MINI / f"{source}.json").read_text("utf-8"))
        document.update(id=name, history=history, future=steps)
        (folder / f"{name}.json").write_text(json.dumps(document), "utf-8")
    return lengths


def make_scenes(
    episodes: int = 3, agents: int = 5, seed: int = 0, points: int = 20, frames: int = 11
) -> Dict[str, Array]:
    """Returns the tensors of `begin`: episodes with fewer and fewer agents and two linked lanes
    each. `frames`: number of frames of the history."""
    rng = np.random.Generator(np.random.PCG64(seed))
    n_agents = np.maximum(agents - np.arange(episodes), 1).astype(np.int32)
    used = np.arange(agents) < n_agents[:, None]
    history = rng.normal(0.0, 20.0, (episodes, agents, frames, 5))
    valid = used[:, :, None] & (rng.random((episodes, agents, frames)) < 0.9)
    valid[:, :, -1] = used
    history[~valid] = 0.0
    if agents > 1:
        history[:, 1, :, 3:] = np.nan
    # Lines of an episode: two lanes, the outline of one, a half-width, an edge, a stop line, two
    # rings.
    types = np.array([0, 1, 2, 2, 3, 5, 10, 11], np.uint8)
    lanes = np.array([-1, -1, 0, 1, -1, 0, -1, -1], np.int32)
    values = np.array([13.9, np.nan, np.nan, 1.75, np.nan, 7.5, np.nan, np.nan])
    counts = np.array([points, points, 4, 0, points, 2, 4, 3])
    lines = len(types)
    base = lines * np.arange(episodes, dtype=np.int32)
    links = np.array(
        [[0, 1, 0, 0, 0, 0, 0], [1, 0, 1, 0, 0, 0, 0], [0, 1, 2, 1, 2, 3, 4]], np.int32
    )
    link = np.concatenate([links + np.array([b, b, 0, 0, 0, 0, 0], np.int32) for b in base])
    start = np.concatenate([[0], np.cumsum(np.tile(counts, episodes))]).astype(np.int64)
    return {
        "episode": np.arange(100, 100 + episodes, dtype=np.uint64),
        "seed": np.arange(episodes, dtype=np.uint64) + np.uint64(2**63),
        "n_agents": n_agents,
        "kind": np.where(used, 0, 255).astype(np.uint8),
        "size": np.where(used[..., None], [4.5, 2.0], 0.0),
        "history": history,
        "valid": valid.astype(np.uint8),
        "points": rng.normal(0.0, 50.0, (int(start[-1]), 2)),
        "line_start": start,
        "line_episode": np.repeat(np.arange(episodes, dtype=np.int32), lines),
        "line_type": np.tile(types, episodes),
        "line_class": np.tile(np.array([2, 2, 0, 0, 1, 1, 0, 0], np.uint8), episodes),
        "line_lane": (
            np.tile(lanes, episodes) + np.repeat(base, lines) * (np.tile(lanes, episodes) >= 0)
        ).astype(np.int32),
        "line_value": np.tile(values, episodes),
        "link": link,
        "light_episode": np.arange(episodes, dtype=np.int32),
        "light_lane": base + np.int32(1),
        "light_stop": rng.normal(0.0, 50.0, (episodes, 2)),
        "light_state": np.full((episodes, frames), 4, np.uint8),
        "obstacle_episode": np.zeros(1, np.int32),
        "obstacle": np.array([[1.0, 2.0, 0.5, 3.0, 1.0]]),
    }


class Parent:
    """Plays the program for one simulator over two streams."""

    def __init__(self, reader: Any, writer: Any) -> None:
        self.reader, self.writer = reader, writer
        self.seq = 0
        self.to = {"to": "mine", "worker": "0"}

    def ask(
        self,
        kind: str,
        metadata: Optional[Dict[str, str]] = None,
        tensors: Optional[Dict[str, Array]] = None,
    ) -> Message:
        """Sends a request and returns the answer."""
        write_frame(self.writer, kind, str(self.seq), {**self.to, **(metadata or {})}, tensors)
        return self.answer()

    def answer(self) -> Message:
        """Reads the answer to the last request."""
        answer = read_frame(self.reader)
        assert answer is not None, "the simulator ended"
        assert answer[0]["seq"] == str(self.seq)
        self.seq += 1
        return answer

    def hello(self) -> Dict[str, str]:
        """Sends `hello` and returns the metadata of the answer."""
        metadata = {
            "program": "reactsim 0.0.0",
            "protocols": "[1]",
            "name": "mine",
            "replan_steps": "[5]",
            "protocol_name": '["reactive"]',
            "reveals_ids": "0",
        }
        return self.ask("hello", metadata)[0]

    def begin(self, tensors: Dict[str, Array], steps: int = 5, **metadata: str) -> Message:
        """Opens a batch."""
        self.scenes = tensors
        shape = tensors["kind"].shape
        history, future = json.loads(metadata.get("length", "[11, 80]"))
        self.last = history + future - 1
        self.states = np.zeros((*shape, self.last + 1, 5))
        self.states[:, :, :history] = tensors["history"]
        self.frame = history - 1
        self.new = 0
        return self.ask("begin", {"moves_av": "0", "steps": str(steps), **metadata}, tensors)

    def plan(self, steps: int, active: Optional[Array] = None) -> Message:
        """Asks for a plan and executes it."""
        batch, agents = self.scenes["kind"].shape
        used = np.arange(agents) < self.scenes["n_agents"][:, None]
        new = slice(self.frame + 1 - self.new, self.frame + 1)
        tensors = {
            "episode": self.scenes["episode"],
            "active": np.ones(batch, np.uint8) if active is None else active,
            "states": self.states[:, :, new],
            "valid": np.repeat(used[:, :, None], self.new, axis=2).astype(np.uint8),
            "light_state": np.full((len(self.scenes["light_lane"]), self.new), 6, np.uint8),
            "av_next": np.full((batch, 5), np.nan),
        }
        answer = self.ask("plan", {"frame": str(self.frame), "steps": str(steps)}, tensors)
        if answer[0]["type"] == "planned":
            plan = answer[1]["states"].astype(float)
            first = self.frame + 1
            self.states[:, :, first : first + steps, :3] = plan
            moved = np.diff(self.states[:, :, self.frame : first + steps, :2], axis=2)
            self.states[:, :, first : first + steps, 3:] = moved / 0.1
            self.frame += steps
            self.new = steps
        return answer

    def end(self) -> Message:
        """Closes the batch."""
        return self.ask("end", {}, {"episode": self.scenes["episode"]})

    def bye(self) -> None:
        """Sends `bye`."""
        write_frame(self.writer, "bye", str(self.seq), self.to)


class Loopback(Parent):
    """Plays the program for a simulator in this process."""

    def __init__(self, simulator: Any) -> None:
        super().__init__(None, None)
        self.session = Session(simulator)

    def ask(
        self,
        kind: str,
        metadata: Optional[Dict[str, str]] = None,
        tensors: Optional[Dict[str, Array]] = None,
    ) -> Message:
        request, self.reader = io.BytesIO(), io.BytesIO()
        write_frame(request, kind, str(self.seq), metadata, tensors)
        request.seek(0)
        self.session.run(request, self.reader)
        self.reader.seek(0)
        return self.answer()


class Child(Parent):
    """Plays the program for a simulator in a child process."""

    def __init__(self, *command: str, env: Optional[Dict[str, str]] = None) -> None:
        environment = {**os.environ, "PYTHONPATH": str(IMPORTED), **(env or {})}
        self.process = subprocess.Popen(
            [sys.executable, *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=environment,
        )
        super().__init__(self.process.stdout, self.process.stdin)

    def wait(self) -> Tuple[int, str]:
        """Closes standard input; returns the exit code and standard error."""
        out, errors = self.process.communicate(timeout=30)
        assert out == b""
        return self.process.returncode, errors.decode()

    def __enter__(self) -> Child:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()


def roll_out(
    parent: Parent, tensors: Dict[str, Array], steps: int = 5, **metadata: str
) -> List[Array]:
    """Plays a whole batch; returns all plans."""
    assert parent.begin(tensors, steps, **metadata)[0]["type"] == "begun"
    plans = []
    while parent.frame < parent.last:
        metadata, answer = parent.plan(min(steps, parent.last - parent.frame))
        assert metadata["type"] == "planned", metadata
        plans.append(answer["states"])
    assert parent.end()[0]["type"] == "ended"
    return plans
