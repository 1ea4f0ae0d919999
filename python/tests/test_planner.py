"""Planners: sessions with many open episodes, and runs of the program."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np
import pytest
import reactsim
from fakes import MINI, Child, Loopback, Message, make_scenes
from reactsim.client import Array, Lane, Neighbor, Planner, PlannerObservation, Scene
from stop import Stop


class Straight(Planner):
    """Keeps its velocity; counts the plans of every episode."""

    version = "3"

    def __init__(self) -> None:
        self.answer: Any = None
        self.ego: List[Any] = []

    def begin(self, scene: Scene) -> Dict[str, Any]:
        self.continues = scene.scenes.continues
        return {"plans": 0, "agents": scene.n_agents}

    def plan(self, seen: PlannerObservation) -> Any:
        seen.memory["plans"] += 1
        self.last = seen
        self.ego.append(seen.ego)
        if self.answer is not None:
            return self.answer
        ahead = reactsim.DT * np.arange(1, seen.steps + 3)[:, None]
        x, y, heading, vx, vy = np.nan_to_num(seen.av)
        xy = np.array([x, y]) + np.array([vx, vy]) * ahead
        return np.concatenate([xy, np.full_like(ahead, heading)], axis=1)


class Program(Loopback):
    """Plays the program for a planner: episodes of one scene each."""

    def start(
        self,
        handle: int,
        agents: int,
        route: List[int],
        continues: Optional[Dict[str, str]] = None,
        slots: Sequence[int] = (),
    ) -> Message:
        tensors = make_scenes(1, agents, seed=handle)
        tensors["episode"] = np.array([handle], np.uint64)
        tensors["route"] = np.array(route, np.int32)
        if continues:
            tensors["continued_slot"] = np.array([slots], np.int32)
        return self.ask("begin", {"moves_av": "1", "steps": "80", **(continues or {})}, tensors)

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


def begun() -> Tuple[Straight, Program]:
    """Returns a planner with an episode of 3 agents, whose handle is 1."""
    planner = Straight()
    program = Program(planner)
    program.hello()
    program.start(1, 3, [0])
    return planner, program


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
    planner, program = begun()
    planner.answer = answer
    text, tensors = program.drive(1, 3, 10, 0, 5)
    if answer is None:
        assert text["type"] == "planned" and tensors["trajectory"].dtype == np.float64
        return
    assert text["type"] == "failed" and part in text["error"], text
    assert program.drive(1, 3, 15, 5, 5)[0]["type"] == "failed"


@pytest.mark.parametrize(
    ("present", "part"),
    [
        (None, ""),
        ([1.0, 2.0, 0.5], ""),
        ([1.0, 2.0], "returned a present pose of shape (2,), expected (3,): x, y, heading"),
        ([1.0, np.nan, 0.5], "(present pose) returned x 1, y nan"),
    ],
)
def test_plans_may_begin_beside_the_av(present: Any, part: str) -> None:
    planner, program = begun()
    planner.answer = reactsim.Trajectory(np.zeros((5, 3)), present)
    text, tensors = program.drive(1, 3, 10, 0, 5)
    if part:
        assert text["type"] == "failed" and part in text["error"], text
        return
    assert tensors["trajectory"].shape == (1, 5, 3)
    assert planner.last.ego is None
    if present is None:
        assert "present" not in tensors
    else:
        np.testing.assert_array_equal(tensors["present"], [present])


def test_episodes_continue_others_when_agents_enter_or_leave() -> None:
    planner, program = begun()
    ended: List[int] = []
    program.session.on_end = ended.append
    assert planner.continues is None
    program.drive(1, 3, 10, 0, 5)
    memory = planner.last.memory
    continues = {"continues": "1", "continued_frame": "14"}
    assert program.start(2, 3, [0], continues, [0, 2, -1])[0]["type"] == "begun"
    before = planner.continues
    assert before is not None and before.memory is memory
    assert (before.frame, before.slots.tolist()) == (14, [0, 2, -1])
    # Both are one rollout.
    assert program.ask("end", {}, {"episode": np.array([1], np.uint64)})[0]["type"] == "ended"
    assert ended == []
    assert program.drive(2, 3, 11, 1, 5)[0]["type"] == "planned"
    assert planner.last.scene.scenes.continues is None
    program.ask("end", {}, {"episode": np.array([2], np.uint64)})
    assert ended == [1]


@pytest.mark.parametrize(
    ("changed", "slots", "part"),
    [
        ({"continues": "7"}, [0, 1, 2], "metadata `continues` is '7', which is no open episode"),
        ({"continues": "-1"}, [0, 1, 2], "metadata `continues` is '-1', which is no open episode"),
        ({"continued_frame": "9"}, [0, 1, 2], "metadata `continued_frame` is '9', expected 10 to"),
        ({}, [0, 1, 3], "tensor `continued_slot` has an index outside -1 to 2"),
        ({}, [0, 1], "tensor `continued_slot` has shape (1, 2), expected (1, 3)"),
    ],
)
def test_wrong_continuations_are_refused(
    changed: Dict[str, str], slots: List[int], part: str
) -> None:
    _, program = begun()
    continues = {"continues": "1", "continued_frame": "14", **changed}
    text, _ = program.start(2, 3, [0], continues, slots)
    assert text["type"] == "failed" and part in text["error"], text


def test_long_scenarios_may_be_planned_to_their_end() -> None:
    planner = Straight()
    program = Program(planner)
    assert program.hello()["lengths"] == "any"
    tensors = {**make_scenes(1, 2), "route": np.array([0], np.int32)}
    metadata = {"moves_av": "1", "steps": "150", "length": "[11, 150]"}
    assert program.ask("begin", metadata, tensors)[0]["type"] == "begun"
    handle = int(tensors["episode"][0])
    planner.answer = np.zeros((150, 3))
    assert program.drive(handle, 2, 10, 0, 5)[1]["trajectory"].shape == (1, 150, 3)
    assert planner.last.scene.n_steps == 150
    # As many poses as in the benchmark are possible up to the last step.
    planner.answer = np.zeros((80, 3))
    assert program.drive(handle, 2, 155, 145, 5)[1]["trajectory"].shape == (1, 80, 3)
    planner.answer = np.zeros((81, 3))
    text, _ = program.drive(handle, 2, 155, 0, 5)
    assert "shape (81, 3), expected an array of shape [5 to 80, 3]" in text["error"]


def test_wrong_programs_are_refused() -> None:
    with pytest.raises(
        ValueError, match="give simulators, a planner, only `baselines`, or a specification"
    ):
        reactsim.run()
    with pytest.raises(ValueError, match="`stop-py` is the name of two"):
        reactsim.run([Stop(), Stop()])
    with pytest.raises(ValueError, match="`name` is for one simulator or planner"):
        reactsim.run(Stop(), planner=Straight(), name="mine")
    with pytest.raises(ValueError, match="`planner` drives the AV"):
        reactsim.run(planner=Straight(), av="log")
    with pytest.raises(ValueError, match="Straight is a planner, expected a simulator"):
        reactsim.run(Straight())
    with pytest.raises(ValueError, match="Simulator is a simulator, expected a planner"):
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


class Beside(Straight):
    """Drives 1 m to the left of the line on which the AV begins, along the x axis of the AV."""

    version = ""

    def begin(self, scene: Scene) -> Dict[str, Any]:
        self.scenes = scene.scenes
        return {"plans": 0, "agents": 0, "start": scene.history[0, -1].copy()}

    def plan(self, seen: PlannerObservation) -> Any:
        super().plan(seen)
        x, y, heading, vx, vy = seen.memory["start"]
        ahead = np.array([np.cos(heading), np.sin(heading)])
        left = np.array([-ahead[1], ahead[0]])
        time = reactsim.DT * np.arange(seen.frame - 10, seen.frame - 10 + 41)[:, None]
        xy = np.array([x, y]) + left + np.hypot(vx, vy) * time * ahead
        poses = np.concatenate([xy, np.full_like(time, heading)], axis=1)
        return reactsim.Trajectory(poses[1:], present=poses[0])


@pytest.mark.usefixtures("with_program")
def test_the_tracker_reaches_a_plan_beside_the_av() -> None:
    planner = Beside()
    scenario = MINI / "platoon.json"
    results = reactsim.run(
        planner=planner,
        baselines=["log-replay"],
        scenarios=[scenario],
        progress=False,
        reveal_ids=True,
    )
    x, y, heading, vx, vy = planner.last.states[0, 10]
    offset = planner.last.av[:2] - [x, y]
    aside = float(offset[1] * np.cos(heading) - offset[0] * np.sin(heading))
    assert aside == pytest.approx(1.0, abs=0.1)
    # The motion of the rear axle at the present frame: begins straight on, then turns to the left.
    ego = np.array(planner.ego)
    assert ego.shape == (80, 7) and np.isfinite(ego).all()
    assert ego[0, 0] == pytest.approx(np.hypot(vx, vy)) and not ego[0, 4:].any()
    assert (ego[1:6, 4] > 0.0).all() and (ego[1:, 1] == 0.0).all()
    assert planner.scenes.scenario_ids == ["platoon"]
    assert planner.scenes.origins is not None and planner.scenes.rollouts == [0]
    assert results.provenance["driver"]["external"]["reveals_ids"] is True


class Failing(Stop):  # type: ignore[misc]
    """Fails at its second plan."""

    name = "failing"

    def plan(self, seen: reactsim.Observation) -> Any:
        if seen.frame > 10:
            raise ZeroDivisionError("nothing to divide")
        return super().plan(seen)


class Unnamed(Stop):  # type: ignore[misc]
    name = ""


@pytest.mark.usefixtures("with_program")
def test_simulators_and_a_planner_live_in_one_process() -> None:
    settings: Dict[str, Any] = {"planner": Straight(), "limit": 3, "jobs": 2, "progress": False}
    both = reactsim.run([Stop(), Unnamed], **settings)
    assert both.simulators == ["stop-py", "Unnamed"]
    alone = reactsim.run(baselines=["stop"], **settings)
    expected = {rollout.scenario: rollout.states for rollout in alone.rollouts()}
    assert len(expected) == 3
    for name in both.simulators:
        found = {r.scenario: r.states for r in both.rollouts(simulator=name)}
        assert set(found) == set(expected)
        for scenario, states in found.items():
            assert np.array_equal(states, expected[scenario], equal_nan=True), (name, scenario)
    with pytest.warns(UserWarning, match=r"first error of the simulator:(.|\n)*nothing to divide"):
        results = reactsim.run(Failing(), baselines=["stop"], **settings)
    assert len(results.failures) == 3


class Late(Stop):  # type: ignore[misc]
    """Answers after the limit of time."""

    name = "late"

    def plan(self, seen: reactsim.Observation) -> Any:
        time.sleep(3.0)
        return super().plan(seen)


class Endless(Stop):  # type: ignore[misc]
    """Fails at the end of every batch, whose plans are complete."""

    name = "endless"
    batch = 1

    def end(self, episodes: Any) -> None:
        raise ValueError("it does not end")


@pytest.mark.usefixtures("with_program")
def test_a_late_answer_is_nobodys() -> None:
    settings: Dict[str, Any] = {"jobs": 1, "limit": 2, "progress": False}
    for simulators in (Late(), [Late(), Stop()]):
        with pytest.raises(
            reactsim.ReactsimError, match=r"code 2:(.|\n)*late: .* within 1 s"
        ) as caught:
            reactsim.run(simulators, options=["--external-limit=1s"], **settings)
        assert "instead of request" not in str(caught.value)
        assert "frame" not in str(caught.value)


@pytest.mark.usefixtures("with_program")
def test_a_simulator_that_fails_at_the_end_of_a_batch_goes_on() -> None:
    settings: Dict[str, Any] = {"limit": 2, "progress": False}
    both = reactsim.run([Endless(), Stop()], **settings)
    assert len(both.failures) == 0
    by = both.summary["simulators"]
    ade = [by[name]["metrics"]["ade"]["mean"] for name in ("endless", "stop-py")]
    assert ade[0] == ade[1]


@pytest.mark.usefixtures("with_program")
def test_studies_take_simulators_and_planners_of_this_process(tmp_path: Any) -> None:
    study = reactsim.command(
        "study",
        "planners",
        limit=2,
        planners="idm",
        external={"mine": Stop()},
        planner={"straight": Straight},
        out=tmp_path / "study",
        progress=False,
    )
    assert "mine" in study.text and "straight" in study.text, study.text
    assert study.text == (tmp_path / "study" / "study.md").read_text()
    with pytest.raises(ValueError, match="Straight is a planner, expected a simulator"):
        reactsim.command("run", external={"mine": Straight()})


BOTH = """
import reactsim

class Mine(reactsim.Simulator):
    def plan(self, seen):
        return seen.states[:, :, -1:, :3].repeat(seen.steps, axis=2)

class Other(Mine):
    name = "other"

class Driver(reactsim.Planner):
    def plan(self, seen):
        return seen.av[None, :3].repeat(seen.steps, axis=0)

reactsim.serve(Mine, Other, Driver)
"""


@pytest.mark.parametrize(
    ("role", "name", "answer"),
    [("simulator", "Mine", "Mine"), ("simulator", "other", "other"), ("planner", "any", "Driver")],
)
def test_a_script_serves_simulators_and_planners(role: str, name: str, answer: str) -> None:
    with Child("-c", BOTH) as child:
        welcome, _ = child.ask("hello", {"role": role, "name": name})
        assert (welcome["name"], welcome["role"]) == (answer, role)
        assert child.wait() == (0, "")


def test_a_script_without_the_program_that_is_asked_says_so() -> None:
    with Child("-c", BOTH) as child:
        with pytest.raises(AssertionError, match="the simulator ended"):
            child.ask("hello", {"role": "simulator", "name": "third"})
        code, errors = child.wait()
        assert code == 1 and "none or several of them are a simulator with the name third" in errors


def lane(index: int, y: float, start: float, after: List[int], beside: Sequence[int] = ()) -> Any:
    """A lane of 10 m along x from `start`."""
    points = np.array([[start, y], [start + 5.0, y], [start + 10.0, y]])
    neighbors = [Neighbor(other, 0, 2, 0, 2) for other in beside]
    return Lane(index, points, False, 2, np.nan, None, 1.75, after, [], neighbors, [])


def test_the_route_is_a_chain_and_the_lanes_beside_it() -> None:
    # Two lanes side by side; only the left one goes on. Lane 5 is not on the route.
    lanes = [
        lane(0, 0.0, 0.0, [2], [1]),
        lane(1, -3.5, 0.0, [3], [0]),
        lane(2, 0.0, 10.0, [4], [3]),
        lane(3, -3.5, 10.0, [5], [2]),
        lane(4, 0.0, 20.0, []),
        lane(5, -3.5, 20.0, []),
    ]
    scene: Any = SimpleNamespace(lanes=lanes)

    def observed(x: float, y: float, heading: float, route: List[int]) -> PlannerObservation:
        states = np.array([[[[x, y, heading, 1.0, 0.0]]]])
        seen: Any = SimpleNamespace(
            frame=10, steps=5, states=states, valid=np.ones((1, 1, 1), bool), light_states=None
        )
        return PlannerObservation(scene, route, None, seen)

    route = [0, 1, 2, 3, 4]
    assert observed(3.0, 0.2, 0.0, route).route_chain == [0, 2, 4]
    # A change of lanes, as late as it is needed.
    assert observed(3.0, -3.4, 0.0, route).route_chain == [1, 3, 2, 4]
    assert observed(12.0, -3.4, 0.0, route).route_chain == [3, 2, 4]
    # A lane that leads elsewhere is no nearer.
    lanes.append(lane(6, -3.4, 3.0, []))
    lanes[6].points = lanes[6].points[:, ::-1].copy()
    assert observed(-3.4, 3.0, 0.0, [6, 0, 2]).route_chain == [0, 2]
    assert observed(3.0, 0.0, 0.0, []).route_chain == []
    assert [observed(3.0, 0.0, 0.0, route).route_beside(k) for k in (0, 3, 4)] == [[1], [2], []]
