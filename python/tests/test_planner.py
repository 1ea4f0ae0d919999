"""Planners: sessions with many open episodes, and runs of the program."""

from __future__ import annotations

from typing import Any, Dict, List

import numpy as np
import pytest
import reactsim
from fakes import Loopback, Message, make_scenes
from reactsim.client import Array, Planner, PlannerObservation, Scene


class Straight(Planner):
    """Keeps its velocity; counts the plans of every episode."""

    version = "3"

    def __init__(self) -> None:
        self.answer: Any = None

    def begin(self, scene: Scene) -> Dict[str, Any]:
        return {"plans": 0, "agents": scene.n_agents}

    def plan(self, seen: PlannerObservation) -> Any:
        seen.memory["plans"] += 1
        self.last = seen
        if self.answer is not None:
            return self.answer
        ahead = reactsim.DT * np.arange(1, seen.steps + 3)[:, None]
        x, y, heading, vx, vy = np.nan_to_num(seen.av)
        xy = np.array([x, y]) + np.array([vx, vy]) * ahead
        return np.concatenate([xy, np.full_like(ahead, heading)], axis=1)


class Program(Loopback):
    """Plays the program for a planner: episodes of one scene each."""

    def start(self, handle: int, agents: int, route: List[int]) -> Message:
        tensors = make_scenes(1, agents, seed=handle)
        tensors["episode"] = np.array([handle], np.uint64)
        tensors["route"] = np.array(route, np.int32)
        return self.ask("begin", {"moves_av": "1", "steps": "80"}, tensors)

    def drive(self, handle: int, agents: int, frame: int, new: int, steps: int) -> Message:
        tensors: Dict[str, Array] = {
            "episode": np.array([handle], np.uint64),
            "active": np.ones(1, np.uint8),
            "states": np.full((1, agents, new, 5), float(handle)),
            "valid": np.ones((1, agents, new), np.uint8),
            "light_state": np.full((1, new), 6, np.uint8),
            "av_next": np.full((1, 5), np.nan),
        }
        return self.ask("plan", {"frame": str(frame), "steps": str(steps)}, tensors)


def test_episodes_are_kept_apart() -> None:
    planner = Straight()
    program = Program(planner)
    welcome = program.hello()
    assert (welcome["role"], welcome["name"], welcome["version"]) == ("planner", "Straight", "3")
    assert program.start(7, 4, [1, 0])[0]["type"] == "begun"
    assert program.start(8, 2, [])[0]["type"] == "begun"
    first = program.drive(7, 4, 10, 0, 5)
    assert first[0]["type"] == "planned" and first[1]["trajectory"].shape == (1, 7, 3)
    assert planner.last.route == [1, 0] and planner.last.states.shape == (4, 11, 5)
    program.drive(8, 2, 10, 0, 5)
    assert planner.last.route == [] and planner.last.states.shape == (2, 11, 5)
    program.drive(7, 4, 15, 5, 5)
    assert planner.last.memory == {"plans": 2, "agents": 4}
    np.testing.assert_array_equal(planner.last.av, np.full(5, 7.0))
    assert program.ask("end", {}, {"episode": np.array([7], np.uint64)})[0]["type"] == "ended"
    assert program.drive(7, 4, 20, 5, 5)[0]["error"].startswith("`plan` without `begin`")
    assert program.drive(8, 2, 15, 5, 5)[0]["type"] == "planned"


@pytest.mark.parametrize(
    ("answer", "part"),
    [
        (None, ""),
        (np.zeros((2, 3)), "shape (2, 3), expected an array of shape [5 to 80, 3]"),
        (np.zeros((81, 3)), "shape (81, 3)"),
        (np.zeros((5, 2)), "shape (5, 2)"),
        (np.zeros((1, 5, 3)), "shape (1, 5, 3)"),
        (np.zeros((5, 3), np.int64), "type int64, expected float64 or float32"),
        (np.full((5, 3), np.nan), "x nan, y nan, heading nan for step 1"),
        ([[1.0, 2.0], [3.0]], "that is no array"),
    ],
)
def test_answers_are_checked(answer: Any, part: str) -> None:
    planner = Straight()
    program = Program(planner)
    program.hello()
    program.start(1, 3, [0])
    planner.answer = answer
    text, tensors = program.drive(1, 3, 10, 0, 5)
    if answer is None:
        assert text["type"] == "planned" and tensors["trajectory"].dtype == np.float64
        return
    assert text["type"] == "failed" and part in text["error"], text
    assert program.drive(1, 3, 15, 5, 5)[0]["type"] == "failed"


def test_run_takes_a_simulator_or_a_planner() -> None:
    with pytest.raises(ValueError, match="give a simulator or a planner"):
        reactsim.run()
    with pytest.raises(ValueError, match="give a simulator or a planner"):
        reactsim.run(reactsim.Simulator(), planner=Straight())
    with pytest.raises(ValueError, match="`planner` drives the AV"):
        reactsim.run(planner=Straight(), av="log")
    with pytest.raises(ValueError, match="Straight is a planner; pass it as `planner`"):
        reactsim.run(Straight())
    with pytest.raises(ValueError, match="Simulator is a simulator; pass it as `simulator`"):
        reactsim.run(planner=reactsim.Simulator())


@pytest.mark.usefixtures("with_program")
def test_a_planner_drives_in_the_program() -> None:
    """A planner in this process is judged like any other."""
    results = reactsim.run(planner=Straight(), baselines=["idm"], limit=2, progress=False)
    rows = results.summary["simulators"]["idm"]["metrics"]
    score: Array = np.array(rows["av-score"]["mean"])
    assert 0.0 <= score <= 1.0
    assert results.provenance["settings"]["av"] == "planner:external:Straight"
    assert "| AV score" in results.table(), results.table()
    assert results.provenance["driver"]["external"]["version"] == "3"
