"""Planners of nuPlan's devkit, with a stand-in for the devkit."""

from __future__ import annotations

import json
import math
import sys
from typing import Any, Dict, List, Optional, Sequence, Tuple

import fake_devkit as devkit
import numpy as np
import pytest
import reactsim
from fakes import MINI, Loopback, Message
from reactsim import nuplan
from reactsim.client import Array
from reactsim.roadblocks import parts_of

SPEED = 8.0  # m/s
ORIGIN = (587_796.5, 4_474_298.25)  # coordinates of the origin of the scene, metres
FIRST_LANE = 100_000
LANE, CONNECTOR, OUTLINE, STOP, CROSSWALK, JUNCTION, AREA = 0, 1, 2, 5, 6, 9, 10


@pytest.fixture(autouse=True)
def with_devkit(monkeypatch: pytest.MonkeyPatch) -> None:
    devkit.install(monkeypatch)


class Road:
    """A map: lanes by name, with their links, and other lines."""

    def __init__(self) -> None:
        self.names: List[str] = []
        self.lines: List[Tuple[int, int, int, float, Array]] = []
        self.others: List[Tuple[int, int, int, float, Array]] = []
        self.links: List[List[int]] = []

    def lane(
        self,
        name: str,
        points: Sequence[Tuple[float, float]],
        *,
        kind: int = LANE,
        limit: float = 13.0,
        category: int = 2,
        outline: Optional[Sequence[Tuple[float, float]]] = None,
    ) -> None:
        index = len(self.names)
        self.names.append(name)
        self.lines.append((kind, category, -1, limit, np.array(points, float)))
        ring = np.array(outline if outline is not None else np.empty((0, 2)), float)
        self.others.append((OUTLINE, 0, index, math.nan if outline is not None else 1.75, ring))

    def other(self, kind: int, points: Any, category: int = 0, lane: str = "") -> None:
        index = self.names.index(lane) if lane else -1
        self.others.append((kind, category, index, math.nan, np.array(points, float)))

    def link(self, name: str, following: str) -> None:
        a, b = self.names.index(name), self.names.index(following)
        self.links += [[a, b, 0, 0, 0, 0, 0], [b, a, 1, 0, 0, 0, 0]]

    def beside(self, right: str, left: str) -> None:
        a, b = self.names.index(right), self.names.index(left)
        self.links += [[a, b, 2, 0, 1, 0, 1], [b, a, 3, 0, 1, 0, 1]]

    def tensors(self) -> Dict[str, Array]:
        lines = self.lines + self.others
        counts = [len(line[4]) for line in lines]
        return {
            "points": np.concatenate([line[4].reshape(-1, 2) for line in lines]),
            "line_start": np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
            "line_episode": np.zeros(len(lines), np.int32),
            "line_type": np.array([line[0] for line in lines], np.uint8),
            "line_class": np.array([line[1] for line in lines], np.uint8),
            "line_lane": np.array([line[2] for line in lines], np.int32),
            "line_value": np.array([line[3] for line in lines]),
            "link": np.array(self.links, np.int32).reshape(-1, 7),
        }


def two_lane_road() -> Road:
    """Two lanes along the x axis, a junction of two connectors, and one lane after it."""
    road = Road()
    right = [(-100.0, -1.75), (40.0, -1.75), (40.0, 1.75), (-100.0, 1.75)]
    road.lane("right", [(-100.0, 0.0), (40.0, 0.0)], outline=right)
    road.lane("left", [(-100.0, 3.5), (40.0, 3.5)], limit=math.nan)
    road.beside("right", "left")
    road.lane("ahead", [(40.0, 0.0), (60.0, 0.0)], kind=CONNECTOR)
    road.lane("turn", [(40.0, 0.0), (50.0, -2.0), (55.0, -15.0)], kind=CONNECTOR)
    road.lane("out", [(60.0, 0.0), (200.0, 0.0)])
    road.lane("bikes", [(-100.0, -4.0), (200.0, -4.0)], category=3)
    for before, after in (("right", "ahead"), ("right", "turn"), ("ahead", "out")):
        road.link(before, after)
    road.other(STOP, [(39.0, -1.75), (39.0, 1.75)], 0, "right")
    road.other(CROSSWALK, [(36.0, -4.0), (38.0, -4.0), (38.0, 5.0), (36.0, 5.0)])
    road.other(JUNCTION, [(40.0, -20.0), (60.0, -20.0), (60.0, 6.0), (40.0, 6.0)])
    road.other(AREA, [(-100.0, -2.0), (200.0, -2.0), (200.0, 6.0), (-100.0, 6.0)])
    return road


# Kinds, sizes and first states of the agents: the AV, a car, a pedestrian, a cyclist, another one,
# and one without extent.
KINDS = [0, 0, 1, 2, 3, 0]
SIZES = [[5.176, 2.297], [4.5, 2.0], [0.6, 0.6], [1.8, 0.7], [1.0, 1.0], [0.0, 0.0]]
STARTS = [
    [0.0, 0.0, 0.0, SPEED, 0.0],
    [20.0, 0.5, 0.1, 3.0, 0.3],
    [10.0, -5.0, 1.5, math.nan, math.nan],
    [-15.0, 3.0, 0.0, 4.0, 0.0],
    [30.0, -3.0, 0.0, 1.0, 0.0],
    [5.0, 9.0, 0.0, 0.0, 0.0],
]


def history(frames: int = 11) -> Tuple[Array, Array]:
    """Returns states up to the current frame, which keep their velocities.

    The pedestrian walks along y. The cyclist is absent until frame 5.
    """
    states = np.repeat(np.array(STARTS)[:, None], frames, axis=1)
    velocity = np.nan_to_num(states[:, :, 3:])
    velocity[2] = [0.0, 1.2]
    states[:, :, :2] += velocity * 0.1 * (np.arange(frames) + 1 - frames)[:, None]
    valid = np.ones((len(STARTS), frames), bool)
    valid[3, : min(5, frames - 1)] = False
    states[~valid] = 0.0
    return states, valid


class Program(Loopback):
    """Plays the program for a planner in one episode."""

    def __init__(self, planner: Any, **arguments: Any) -> None:
        super().__init__(nuplan.wrap(planner, **arguments))
        self.welcome = self.hello()

    def start(
        self,
        road: Optional[Road] = None,
        route: Sequence[str] = ("right", "ahead", "out"),
        length: float = 5.176,
        *,
        metadata: Optional[Dict[str, str]] = None,
        frames: int = 11,
        future: int = 80,
    ) -> Message:
        road = road or two_lane_road()
        states, valid = history(frames)
        sizes = np.array(SIZES)
        sizes[0, 0] = length
        self.agents, self.handle, self.frames = len(KINDS), 1, frames
        self.states = states
        self.tensors = tensors = {
            **road.tensors(),
            "episode": np.ones(1, np.uint64),
            "seed": np.ones(1, np.uint64),
            "n_agents": np.array([self.agents], np.int32),
            "kind": np.array([KINDS], np.uint8),
            "size": sizes[None],
            "history": states[None],
            "valid": valid[None].astype(np.uint8),
            "light_episode": np.zeros(3, np.int32),
            "light_lane": np.array([2, 3, 5], np.int32),
            "light_stop": np.zeros((3, 2)),
            "light_state": np.repeat(np.array([[4], [6], [4]], np.uint8), frames, axis=1),
            "obstacle_episode": np.zeros(1, np.int32),
            "obstacle": np.array([[12.0, 3.0, 0.5, 3.0, 1.0]]),
            "route": np.array([road.names.index(name) for name in route], np.int32),
        }
        self.frame = frames - 1
        self.metadata = {"moves_av": "1", "steps": "80", "length": f"[{frames}, {future}]"}
        self.metadata.update(metadata or {})
        return self.ask("begin", self.metadata, tensors)

    def change(
        self, slots: Sequence[int], new: int = 0, obstacles: Optional[Array] = None
    ) -> Message:
        """Continues with the agents in these slots after `new` steps; -1: one enters."""
        self.advance(new)
        frame, recent = self.frame, self.states[:, -self.frames :]
        entering = np.zeros((1, self.frames, 5))
        entering[:, -1] = [50.0, 3.5, 0.0, 6.0, 0.0]
        valid = np.ones((len(slots), self.frames), np.uint8)
        valid[[slot < 0 for slot in slots], :-1] = 0
        self.states = np.concatenate([recent, entering])[list(slots)]
        kinds, sizes = (self.tensors[name][0] for name in ("kind", "size"))
        self.handle, self.frame, self.agents = self.handle + 1, self.frames - 1, len(slots)
        self.tensors.update(
            {
                "episode": np.full(1, self.handle, np.uint64),
                "n_agents": np.array([self.agents], np.int32),
                "kind": np.append(kinds, np.uint8(0))[None, list(slots)],
                "size": np.concatenate([sizes, [[4.0, 2.0]]])[None, list(slots)],
                "history": self.states[None],
                "valid": valid[None],
                "continued_slot": np.array([slots], np.int32),
            }
        )
        if obstacles is not None:
            self.tensors["obstacle"] = obstacles
            self.tensors["obstacle_episode"] = np.zeros(len(obstacles), np.int32)
        before = {"continues": str(self.handle - 1), "continued_frame": str(frame)}
        answer = self.ask("begin", {**self.metadata, **before}, self.tensors)
        self.ask("end", {}, {"episode": np.full(1, self.handle - 1, np.uint64)})
        return answer

    def advance(self, new: int) -> None:
        """Moves all agents by `new` steps, in which they keep their velocities."""
        ahead = 0.1 * np.arange(1, new + 1)[:, None]
        last = self.states[:, -1]
        states = np.repeat(last[:, None], new, axis=1)
        states[:, :, :2] += np.nan_to_num(last[:, None, 3:]) * ahead
        self.states = np.concatenate([self.states, states], axis=1)
        self.frame += new

    def drive(
        self,
        new: int = 0,
        steps: int = 1,
        ego: Optional[Array] = None,
        lights: Sequence[int] = (4, 6, 4),
    ) -> Message:
        """Asks for a plan after `new` steps, in which all agents keep their velocities."""
        self.advance(new)
        tensors: Dict[str, Array] = {
            "episode": np.full(1, self.handle, np.uint64),
            "active": np.ones(1, np.uint8),
            "states": self.states[None, :, self.states.shape[1] - new :],
            "valid": np.ones((1, self.agents, new), np.uint8),
            "light_state": np.repeat(np.array(lights, np.uint8)[:, None], new, axis=1),
            "av_next": np.full((1, 5), np.nan),
        }
        if ego is not None:
            tensors["ego"] = ego[None]
        return self.ask("plan", {"frame": str(self.frame), "steps": str(steps)}, tensors)


class Bare(devkit.AbstractMap):
    """A map without lanes."""

    map_name = "bare"

    def get_proximal_map_objects(self, point: Any, radius: float, layers: Any) -> Any:
        return {layer: [] for layer in layers}


def started(**arguments: Any) -> Tuple[Program, devkit.Planner]:
    """Returns an episode of a planner, and the planner."""
    pytest.importorskip("shapely")
    program = Program(devkit.Planner, **arguments)
    assert program.welcome["name"] == "Straight-on"
    answer = program.start()
    assert answer[0]["type"] == "begun", answer
    return program, devkit.Planner.latest


def planned(message: Message) -> Dict[str, Array]:
    assert message[0]["type"] == "planned", message[0]
    return message[1]


def failed(message: Message) -> str:
    assert message[0]["type"] == "failed", message
    return message[0]["error"]


def test_states_are_those_of_the_rear_axle() -> None:
    program, planner = started()
    planned(program.drive())
    ego, _ = planner.inputs[0].history.current_state
    assert ego.rear_axle.x == pytest.approx(-1.461) and ego.rear_axle.y == pytest.approx(0.0)
    assert (ego.rear_axle_velocity_2d.x, ego.tire_steering_angle) == (SPEED, 0.0)
    assert ego.vehicle_parameters.vehicle_name == "pacifica"
    # The motion that the program sends is that of the tracker.
    motion = np.array([7.5, 0.1, -1.0, 0.2, 0.05, 0.12, 0.3])
    planned(program.drive(1, ego=motion))
    ego, _ = planner.inputs[1].history.current_state
    assert ego.rear_axle.x == pytest.approx(0.8 - 1.461)
    found = [
        *(ego.rear_axle_velocity_2d.x, ego.rear_axle_velocity_2d.y),
        *(ego.rear_axle_acceleration_2d.x, ego.rear_axle_acceleration_2d.y),
        *(ego.tire_steering_angle, ego.angular_vel, ego.angular_accel),
    ]
    assert found == motion.tolist()


def test_other_boxes_have_the_axles_of_the_pacifica_in_scale() -> None:
    vehicle = nuplan._vehicle(nuplan._devkit(), 10.352, 2.5)
    assert vehicle.rear_axle_to_center == pytest.approx(2.922)
    assert (vehicle.wheel_base, vehicle.width) == (pytest.approx(6.178), 2.5)


def test_motions_of_a_steady_turn_are_those_of_its_rear_axle() -> None:
    radius, rate = 20.0, 0.5
    angle = rate * 0.1 * np.arange(11) + 2.9  # headings pass pi
    xy = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    velocity = radius * rate * np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    wrapped = np.mod(angle + math.pi / 2 + math.pi, math.tau) - math.pi
    states = np.column_stack([xy, wrapped, velocity])
    vehicle = devkit.get_pacifica_parameters()
    expected = [10.0, -0.5 * 1.461, 0.25 * 1.461, 5.0, math.atan(0.05 * 3.089), 0.5, 0.0]
    np.testing.assert_allclose(nuplan.ego_motions(states, vehicle), [expected] * 11, atol=1e-9)
    states[:, 3:] = np.nan
    found = nuplan.ego_motions(states, vehicle)
    assert found[5, 0] == pytest.approx(10.0, abs=0.01)
    standing = np.zeros((1, 5))
    assert nuplan.ego_motions(standing, vehicle).tolist() == [[0.0] * 7]


def test_the_history_has_two_seconds_at_most() -> None:
    program, planner = started()
    for new in (0, 5, 5, 5):
        planned(program.drive(new, steps=5))
    lengths = [len(seen.history.ego_states) for seen in planner.inputs]
    assert lengths == [11, 16, 21, 22]
    for seen, now in zip(planner.inputs, (1_000_000, 1_500_000, 2_000_000, 2_500_000)):
        times = [state.time_us for state in seen.history.ego_states]
        assert times[-1] == now == seen.iteration.time_point.time_us
        assert set(np.diff(times)) == {100_000}
        assert len(seen.history.observations) == len(times)
    assert [seen.iteration.index for seen in planner.inputs] == [0, 5, 10, 15]
    assert planner.inputs[0].history.sample_interval == 0.1


def tokens(history: Any, sample: int = -1) -> Dict[int, float]:
    """Returns the number and the position along x of each object at a sample."""
    tracked = history.observations[sample].tracked_objects
    return {o.metadata.track_id: o.box.center.x for o in tracked}


def test_a_planner_goes_on_when_agents_enter_or_leave() -> None:
    program, planner = started()
    planned(program.drive(steps=5))
    # The car (1) and the agent of another kind (4) have left 3 steps later, and a car has entered.
    moved = np.array([[12.0, 3.0, 0.5, 3.0, 1.0], [60.0, 3.0, 0.0, 2.0, 2.0]])
    assert program.change([0, 2, 3, 5, -1], new=3, obstacles=moved)[0]["type"] == "begun"
    planned(program.drive(2, steps=5))
    planned(program.drive(5, steps=5))
    assert len(planner.inputs) == 3, "one planner drives in the whole rollout"
    assert [seen.iteration.index for seen in planner.inputs] == [0, 5, 10]
    for seen, now in zip(planner.inputs, (1_000_000, 1_500_000, 2_000_000)):
        times = [state.time_us for state in seen.history.ego_states]
        assert times == list(range(0, now + 1, 100_000))
        x = [state.rear_axle.x for state in seen.history.ego_states]
        np.testing.assert_allclose(np.diff(x), 0.1 * SPEED, atol=1e-9)
    first, second = planner.inputs[0].history, planner.inputs[1].history
    # Agents 0 to 5 are the first ones, 6 is the obstacle.
    assert sorted(tokens(first)) == [1, 2, 3, 4, 6]
    assert tokens(second, 10) == tokens(first)
    assert sorted(tokens(second)) == [2, 3, 6, 7, 8]
    assert tokens(second)[3] == pytest.approx(-15.0 + 0.5 * 4.0)
    assert tokens(second)[7] == pytest.approx(51.2)
    assert tokens(second)[8] == 60.0
    # The car enters at frame 13; nobody appears before it was seen.
    assert 7 not in tokens(second, 12) and 7 in tokens(second, 13)
    # Only the cyclist and the car that entered stay.
    program.change([0, 2, 4], new=5)
    planned(program.drive())
    third = planner.inputs[3]
    assert (third.iteration.index, sorted(tokens(third.history))) == (15, [3, 6, 7, 8])
    assert tokens(third.history)[3] == pytest.approx(-15.0 + 1.5 * 4.0)


@pytest.mark.parametrize(("extend_history", "samples"), [(False, 13), (True, 22)])
def test_a_history_begins_anew_after_a_gap(extend_history: bool, samples: int) -> None:
    program, planner = started(extend_history=extend_history)
    planned(program.drive(steps=30))
    program.change([0, 1, 2, 3, 4, 5], new=28)
    planned(program.drive(2, steps=30))
    states = planner.inputs[1].history.ego_states
    assert len(states) == samples
    times = [state.time_us for state in states]
    assert set(np.diff(times)) == {100_000}
    assert times[-1] == planner.inputs[0].history.ego_states[-1].time_us + 3_000_000
    assert planner.inputs[1].iteration.index == 30
    assert states[-1].rear_axle.x == pytest.approx(3.0 * SPEED - 1.461)


@pytest.mark.parametrize(
    ("frames", "extend_history", "samples"),
    [(2, False, 2), (2, True, 22), (21, False, 21), (100, False, 22), (100, True, 22)],
)
def test_scenarios_of_other_lengths_are_driven(
    frames: int, extend_history: bool, samples: int
) -> None:
    pytest.importorskip("shapely")
    program = Program(devkit.Planner, extend_history=extend_history)
    assert program.start(frames=frames, future=150)[0]["type"] == "begun"
    planner = devkit.Planner.latest
    planner.answer = lambda ego: devkit.Trajectory(
        [ego.time_us, ego.time_us + 60_000_000], [[0.0, 0.0, 0.0], [60.0 * SPEED, 0.0, 0.0]]
    )
    assert planned(program.drive(steps=10))["trajectory"].shape == (1, 150, 3)
    assert planned(program.drive(10, steps=10))["trajectory"].shape == (1, 140, 3)
    history = planner.inputs[0].history
    times = [state.time_us for state in history.ego_states]
    assert len(times) == samples and times[0] >= 0
    assert set(np.diff(times)) == {100_000}
    assert history.ego_states[-1].rear_axle.x == pytest.approx(-1.461)
    assert history.ego_states[-1].tire_steering_angle == 0.0
    assert [seen.iteration.index for seen in planner.inputs] == [0, 10]


def test_a_history_can_be_extended() -> None:
    program, planner = started(extend_history=True)
    planned(program.drive())
    history = planner.inputs[0].history
    times = [state.time_us for state in history.ego_states]
    assert times == list(range(0, 2_200_000, 100_000))
    first = history.ego_states[0]
    assert first.rear_axle.x == pytest.approx(-2.1 * SPEED - 1.461)
    assert first.rear_axle_velocity_2d.x == SPEED
    cars = [o for o in history.observations[0].tracked_objects if o.metadata.track_id == 1]
    assert cars[0].box.center.x == pytest.approx(20.0 - 2.1 * 3.0)
    # Nobody appears before it was seen.
    assert all(o.metadata.track_id != 3 for o in history.observations[0].tracked_objects)


def test_objects_are_tracked() -> None:
    program, planner = started()
    planned(program.drive())
    _, seen = planner.inputs[0].history.current_state
    types = devkit.TrackedObjectType
    found = {tracked.metadata.track_id: tracked for tracked in seen.tracked_objects}
    assert {number: tracked.tracked_object_type for number, tracked in found.items()} == {
        1: types.VEHICLE,
        2: types.PEDESTRIAN,
        3: types.BICYCLE,
        4: types.GENERIC_OBJECT,
        6: types.GENERIC_OBJECT,
    }
    car, walker, obstacle = found[1], found[2], found[6]
    assert (car.box.length, car.box.width, car.box.center.heading) == (4.5, 2.0, 0.1)
    assert (car.velocity.x, car.velocity.y) == (3.0, 0.3) and math.isnan(car.box.height)
    assert walker.velocity.y == pytest.approx(1.2), "an unknown velocity is the displacement"
    assert type(found[4]) is type(obstacle) is devkit.StaticObject
    assert (obstacle.box.center.x, obstacle.box.length) == (12.0, 3.0)
    tokens = {tracked.metadata.track_token for tracked in found.values()}
    assert len(tokens) == 5 and {len(token) for token in tokens} == {6}
    before = planner.inputs[0].history.observations[4].tracked_objects
    assert [tracked.metadata.track_id for tracked in before] == [1, 2, 4, 6]


def test_lights_of_connectors_are_given() -> None:
    program, planner = started()
    planned(program.drive())
    for state, expected in [(255, None), (8, 1), (7, 3), (0, 3), (5, 1), (1, 2), (3, 0)]:
        planned(program.drive(1, lights=(4, state, 4)))
        lights = planner.inputs[-1].traffic_light_data or []
        found = {light.lane_connector_id: int(light.status) for light in lights}
        # Lanes for bicycles are left out.
        other = {} if expected is None else {FIRST_LANE + 3: expected}
        assert found == {FIRST_LANE + 2: 2, **other}
        assert all(
            light.timestamp == planner.inputs[-1].iteration.time_point.time_us for light in lights
        )


def test_trajectories_become_poses_of_the_centre() -> None:
    program, planner = started()
    answer = planned(program.drive(steps=5))
    poses = answer["trajectory"][0]
    assert poses.shape == (80, 3)
    np.testing.assert_allclose(poses[:, 0], 0.1 * SPEED * np.arange(1, 81), atol=1e-9)
    np.testing.assert_allclose(answer["present"], [[0.0, 0.0, 0.0]], atol=1e-12)
    # A plan on a path beside the AV, that turns.
    planner.answer = lambda ego: devkit.Trajectory(
        [ego.time_us - 50_000, ego.time_us + 1_050_000], [[0.0, 1.0, 0.0], [11.0, 1.0, 1.1]]
    )
    answer = planned(program.drive(1, steps=5))
    assert answer["trajectory"].shape == (1, 10, 3)
    at = [0.5 + 1.461 * math.cos(0.05), 1.0 + 1.461 * math.sin(0.05), 0.05]
    np.testing.assert_allclose(answer["present"][0], at, atol=1e-9)
    at = [10.5 + 1.461 * math.cos(1.05), 1.0 + 1.461 * math.sin(1.05), 1.05]
    np.testing.assert_allclose(answer["trajectory"][0, -1], at, atol=1e-9)


@pytest.mark.parametrize(
    ("answer", "part"),
    [
        (lambda ego: "no", "returned str, expected an AbstractTrajectory"),
        (
            lambda ego: devkit.Trajectory([ego.time_us, ego.time_us + 400_000], np.zeros((2, 3))),
            "from 0 s to 0.4 s after the present, expected one from 0 s to at least 0.5 s",
        ),
        (
            lambda ego: devkit.Trajectory(
                [ego.time_us + 100_000, ego.time_us + 900_000], np.zeros((2, 3))
            ),
            "from 0.1 s to 0.9 s after the present",
        ),
        (
            lambda ego: devkit.Trajectory(
                [ego.time_us, ego.time_us + 200_000, ego.time_us + 800_000],
                [[0, 0, 0], [0, 0, 0], [math.nan, 0, 0]],
            ),
            "the state after 0.3 s has x nan",
        ),
        (lambda ego: 1 / 0, "division by zero"),
    ],
)
def test_wrong_trajectories_are_refused(answer: Any, part: str) -> None:
    program, planner = started()
    planner.answer = answer
    text = failed(program.drive(steps=5))
    assert part in text, text


def test_wrong_planners_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    class Oracle(devkit.Planner):
        requires_scenario = True

    class Camera(devkit.Planner):
        def observation_type(self) -> Any:
            return devkit.Sensors

    class Locked(devkit.Planner):
        def __deepcopy__(self, memo: Any) -> Any:
            raise ValueError("locked")

    for planner, error, text in [
        (Oracle, ValueError, "Oracle needs the recorded scenario"),
        (Camera(), ValueError, "Camera observes Sensors"),
        (Locked(), TypeError, r"Locked cannot be copied .*ValueError: locked.*give a function"),
        ("plan", TypeError, "'plan' is no planner"),
        (lambda: 3, TypeError, "int is no planner of nuPlan's devkit: it has no method `name`"),
    ]:
        with pytest.raises(error, match=text):
            nuplan.wrap(planner)
    with pytest.raises(TypeError, match=r"`maps` is 'maps/', expected an AbstractMap"):
        nuplan.wrap(devkit.Planner, maps="maps/")
    monkeypatch.setitem(sys.modules, "nuplan.common.actor_state.agent", None)
    with pytest.raises(ImportError, match=r"needs nuPlan's devkit.*github.com/motional"):
        nuplan.wrap(devkit.Planner)


def test_every_rollout_has_a_planner_of_its_own() -> None:
    pytest.importorskip("shapely")
    planner = devkit.Planner()
    program = Program(planner, name="mine")
    assert program.welcome["name"] == "mine"
    program.start()
    planned(program.drive())
    assert planner.initialized == [] and planner.inputs == []


def test_the_route_is_a_list_of_roadblocks() -> None:
    program, planner = started()
    planned(program.drive())
    (given,) = planner.initialized
    layers = devkit.SemanticMapLayer
    blocks = [
        given.map_api.get_map_object(id_, layers.ROADBLOCK)
        or given.map_api.get_map_object(id_, layers.ROADBLOCK_CONNECTOR)
        for id_ in given.route_roadblock_ids
    ]
    lanes = [[edge.id for edge in block.interior_edges] for block in blocks]
    ids = [str(FIRST_LANE + k) for k in range(5)]
    assert lanes == [ids[:2], [ids[2]], [ids[4]]]
    assert [type(block).__name__ == "NuPlanRoadBlockConnector" for block in blocks] == [0, 1, 0]
    goal = given.mission_goal
    assert (goal.x, goal.y, goal.heading) == (200.0, 0.0, 0.0)


def scene_of(road: Road) -> reactsim.Scene:
    program = Program(devkit.Planner)
    program.start(road, route=road.names[:1])
    return program.session.drives[1].scene


def scene_map(road: Optional[Road] = None) -> Any:
    pytest.importorskip("shapely")
    from reactsim.nuplan_map import SceneMap

    return SceneMap(scene_of(road or two_lane_road()))


def test_lanes_have_the_geometry_of_the_scene() -> None:
    found = scene_map()
    layers, point = devkit.SemanticMapLayer, devkit.Point2D
    right, left, ahead, turn, _ = found.edges
    path = right.baseline_path
    assert (path.length, len(path.discrete_path)) == (140.0, 141)
    assert path.discrete_path[1] == devkit.StateSE2(-99.0, 0.0, 0.0)
    assert path.get_nearest_arc_length_from_position(point(3.0, 1.0)) == pytest.approx(103.0)
    pose = turn.baseline_path.get_nearest_pose_from_position(point(60.0, -20.0))
    assert (pose.x, pose.y) == (55.0, -15.0)
    assert pose.heading == pytest.approx(math.atan2(-13.0, 5.0))
    assert path.get_curvature_at_arc_length(70.0) == 0.0
    assert turn.baseline_path.get_curvature_at_arc_length(10.2) < -0.05
    with pytest.raises(ValueError, match=r"arc length 141\.0 m is not on line"):
        path.get_curvature_at_arc_length(141.0)
    assert right.polygon.area == pytest.approx(140.0 * 3.5) == left.polygon.area
    assert (right.speed_limit_mps, left.speed_limit_mps) == (13.0, None)
    for edge, y in ((right, 0.0), (left, 3.5)):
        sides = [
            [pose.y for pose in side.discrete_path]
            for side in (edge.left_boundary, edge.right_boundary)
        ]
        np.testing.assert_allclose(sides[0], y + 1.75)
        np.testing.assert_allclose(sides[1], y - 1.75)
        assert edge.left_boundary.discrete_path[0].x == -100.0
    assert right.outgoing_edges == [ahead, turn] and ahead.incoming_edges == [right]
    assert (left.adjacent_edges, right.adjacent_edges) == ((None, right), (left, None))
    assert left.is_left_of(right) and (left.index, right.index) == (0, 1)
    assert [edge.has_traffic_lights() for edge in found.edges] == [0, 0, 1, 1, 0]
    assert turn.turn_type == devkit.LaneConnectorType.RIGHT
    (line,) = right.stop_lines
    assert line.stop_line_type == devkit.StopLineType.TRAFFIC_LIGHT and line.parent is right.parent
    assert line.polygon.area == pytest.approx(0.7)
    with pytest.raises(NotImplementedError, match="the oriented distance of lane 100000"):
        right.oriented_distance(point(0.0, 0.0))
    assert found.get_all_map_objects(point(45.0, -0.5), layers.LANE_CONNECTOR) == [ahead, turn]


def test_the_map_is_queried_like_that_of_the_devkit() -> None:
    found = scene_map()
    layers, point = devkit.SemanticMapLayer, devkit.Point2D
    right, left = found.edges[:2]
    assert found.get_one_map_object(point(0.0, 0.5), layers.LANE) is right
    assert found.get_one_map_object(point(0.0, 9.0), layers.LANE) is None
    assert found.get_one_map_object(point(0.0, 1.75), layers.LANE) is None, "borders are outside"
    with pytest.raises(AssertionError, match="2 objects of LANE_CONNECTOR"):
        found.get_one_map_object(point(45.0, -0.5), layers.LANE_CONNECTOR)
    near = found.get_proximal_map_objects(
        point(20.0, 8.0), 3.0, [layers.LANE, layers.ROADBLOCK, layers.CARPARK_AREA]
    )
    assert near == {
        layers.LANE: [left],
        layers.ROADBLOCK: [right.parent],
        layers.CARPARK_AREA: [],
    }
    inside = {
        layer: found.is_in_layer(point(50.0, 5.0), layer)
        for layer in (layers.LANE, layers.INTERSECTION, layers.DRIVABLE_AREA)
    }
    assert inside == {layers.LANE: False, layers.INTERSECTION: True, layers.DRIVABLE_AREA: True}
    assert found.is_in_layer(point(37.0, 0.0), layers.CROSSWALK)
    nearest = found.get_distance_to_nearest_map_object(point(0.0, 8.25), layers.ROADBLOCK)
    assert nearest == (right.get_roadblock_id(), pytest.approx(3.0))
    assert found.get_distance_to_nearest_map_object(point(0.0, 0.0), layers.WALKWAYS) == (
        None,
        None,
    )
    distances = found.get_distances_matrix_to_nearest_map_object(
        [point(0.0, 7.0), point(0.0, 0.0)], layers.DRIVABLE_AREA
    )
    np.testing.assert_allclose(distances, [1.0, 0.0])
    assert found._get_roadblock("5") is None
    assert found.get_available_raster_layers() == []
    missing = layers.BASELINE_PATHS
    with pytest.raises(ValueError, match="raster layer DRIVABLE_AREA: scenes have no raster"):
        found.get_raster_map([layers.DRIVABLE_AREA])
    with pytest.raises(ValueError, match="layer: BASELINE_PATHS is unavailable"):
        found.get_all_map_objects(point(0.0, 0.0), missing)
    with pytest.raises(ValueError, match="layer: BASELINE_PATHS is unavailable"):
        found.get_map_object("1", missing)
    with pytest.raises(AssertionError, match="is unavailable"):
        found.get_proximal_map_objects(point(0.0, 0.0), 5.0, [layers.BASELINE_PATHS])


def test_maps_without_outlines_of_junctions_have_connectors() -> None:
    road = two_lane_road()
    road.others = [line for line in road.others if line[0] not in (JUNCTION, AREA)]
    found = scene_map(road)
    layers, point = devkit.SemanticMapLayer, devkit.Point2D
    assert found.is_in_layer(point(50.0, 0.0), layers.INTERSECTION)
    assert not found.is_in_layer(point(0.0, 0.0), layers.INTERSECTION)
    with pytest.raises(ValueError, match="the scene has no drivable polygons"):
        found.is_in_layer(point(0.0, 0.0), layers.DRIVABLE_AREA)
    # In maps of connectors only, no place is a junction, and no route is cut where lanes overlap.
    road.lines = [(CONNECTOR, *line[1:]) for line in road.lines]
    found = scene_map(road)
    assert not found.is_in_layer(point(50.0, 0.0), layers.INTERSECTION)
    names = {type(block).__name__ for block in found.layers[layers.ROADBLOCK_CONNECTOR]}
    assert names == {"_RoadBlockConnector"} and found.layers[layers.ROADBLOCK] == []


def blocks_of(road: Road) -> List[List[str]]:
    """Returns the lanes of each roadblock, with numbers of their parts."""
    parts = parts_of(scene_of(road).lanes)
    blocks: Dict[int, List[str]] = {}
    counts: Dict[int, int] = {}
    for part in parts:
        counts[part.lane] = counts.get(part.lane, 0) + 1
        is_cut = sum(other.lane == part.lane for other in parts) > 1
        name = road.names[part.lane] + (f"#{counts[part.lane]}" if is_cut else "")
        blocks.setdefault(part.block, []).append(name)
    return [blocks[k] for k in sorted(blocks)]


def rows(*cuts: Sequence[float]) -> Road:
    """Returns a road along the x axis of rows of lanes, cut at these places, from right to left."""
    road = Road()
    for row, places in enumerate(cuts):
        for k, (start, end) in enumerate(zip(places, places[1:])):
            x = np.linspace(start, end, 11)
            road.lane(f"{row}-{k}", [(float(at), 3.5 * row) for at in x])
            if k:
                road.link(f"{row}-{k - 1}", f"{row}-{k}")
    for row in range(len(cuts) - 1):
        for k, (start, end) in enumerate(zip(cuts[row], cuts[row][1:])):
            for j, (other, last) in enumerate(zip(cuts[row + 1], cuts[row + 1][1:])):
                if other < end and start < last:
                    road.beside(f"{row}-{k}", f"{row + 1}-{j}")
    return road


def test_lanes_are_cut_beside_the_cuts_of_others() -> None:
    found = blocks_of(rows([-100, 30, 400], [-100, 400]))
    assert found == [["0-0", "1-0#1"], ["0-1", "1-0#2"]]
    found = blocks_of(rows([-100, 30, 400], [-100, 400], [100, 400]))
    assert found == [["0-0", "1-0#1"], ["0-1#1", "1-0#2"], ["0-1#2", "1-0#3", "2-0"]]
    # Ends that differ by some metres are one place.
    assert blocks_of(rows([-100, 30, 400], [-100, 33, 400])) == [["0-0", "1-0"], ["0-1", "1-1"]]


def test_routes_of_cut_lanes_begin_at_the_av() -> None:
    pytest.importorskip("shapely")
    road = rows([-100, -30, 400], [-100, 400])
    program = Program(devkit.Planner)
    # The AV is in the second part of the road; the route names lane 1-0 as a whole.
    program.start(road, route=["0-1", "1-0"])
    planned(program.drive())
    (given,) = devkit.Planner.latest.initialized
    block, again = given.route_roadblock_ids
    assert again == block, "the devkit expects two roadblocks"
    found = given.map_api.get_map_object(block, devkit.SemanticMapLayer.ROADBLOCK)
    assert [edge.incoming_edges[0].id for edge in found.interior_edges] == ["100000", "100002"]


class WorldLane:
    """A lane of a map of the devkit."""

    def __init__(self, id_: int, points: Sequence[Tuple[float, float]], block: str) -> None:
        self.id, self.block = str(id_), block
        xy = np.array(points) + ORIGIN
        self.line = xy
        self.discrete_path = [devkit.StateSE2(x, y, 0.0) for x, y in xy.tolist()]
        self.baseline_path = self

    def get_roadblock_id(self) -> str:
        return self.block

    def get_nearest_pose_from_position(self, point: Any) -> Any:
        x, y = np.clip([point.x, point.y], self.line.min(axis=0), self.line.max(axis=0))
        return devkit.StateSE2(x, y, 0.0)


class World(devkit.AbstractMap):
    """A map of the devkit that has the lanes of the route."""

    map_name = "us-ma-boston"

    def __init__(self, shift: float = 0.0) -> None:
        layers = devkit.SemanticMapLayer
        self.layers = {
            layers.LANE: [
                WorldLane(41, [(-100.0, 3.5 + shift), (40.0, 3.5 + shift)], "7"),
                WorldLane(42, [(-100.0, shift), (40.0, shift)], "7"),
                WorldLane(43, [(60.0, shift), (200.0, shift)], "9"),
                WorldLane(45, [(-100.0, -4.0), (200.0, -4.0)], "10"),
            ],
            layers.LANE_CONNECTOR: [
                WorldLane(44, [(40.0, shift), (60.0, shift)], "8"),
                WorldLane(46, [(40.0, 0.0), (50.0, -2.0), (55.0, -15.0)], "11"),
            ],
        }

    def get_proximal_map_objects(self, point: Any, radius: float, layers: Any) -> Any:
        return {layer: self.layers[layer] for layer in layers}


REVEALED = {
    "scenario_ids": '["s1"]',
    "agent_ids": json.dumps([[str(k) for k in range(len(KINDS))]]),
    "origins": json.dumps([ORIGIN]),
    "rollouts": "[0]",
}


class Factory:
    """Builds maps by name."""

    def __init__(self) -> None:
        self.asked: List[str] = []

    def build_map_from_name(self, map_name: str) -> Any:
        self.asked.append(map_name)
        return World() if map_name == World.map_name else Bare()


def test_maps_of_the_devkit_are_found_by_position() -> None:
    factory, asked = Factory(), []

    def of_scenario(scenario: str) -> Any:
        asked.append(scenario)
        return World()

    for maps in (World(), factory, of_scenario):
        program = Program(devkit.Planner, maps=maps)
        program.start(metadata=REVEALED)
        poses = planned(program.drive())["trajectory"][0]
        np.testing.assert_allclose(poses[0], [0.8, 0.0, 0.0], atol=1e-6)
        planner = devkit.Planner.latest
        (given,), (seen,) = planner.initialized, planner.inputs
        assert given.route_roadblock_ids == ["7", "8", "9"]
        assert isinstance(given.map_api, World)
        assert given.mission_goal.x == 200.0 + ORIGIN[0]
        ego, observed = seen.history.current_state
        assert (ego.rear_axle.x, ego.rear_axle.y) == pytest.approx(
            (ORIGIN[0] - 1.461, ORIGIN[1]), abs=1e-6
        )
        car = next(o for o in observed.tracked_objects if o.metadata.track_id == 1)
        assert (car.box.center.x, car.box.center.y) == (ORIGIN[0] + 20.0, ORIGIN[1] + 0.5)
        lights = {light.lane_connector_id for light in seen.traffic_light_data or []}
        assert lights == {44, 46, 45}
    assert factory.asked == ["sg-one-north", "us-ma-boston"] and asked == ["s1"]


@pytest.mark.parametrize(
    ("maps", "metadata", "part"),
    [
        (World(), {}, "give `reveal_ids=True` to `reactsim.run`, or `--reveal-ids`"),
        (World(1.5), REVEALED, "lane 0 of the scene, at (587836.5, 4474298.2), is not in map"),
        (Bare(), REVEALED, "is not in map `bare`; give the map of the location"),
        (lambda scenario: 3, REVEALED, "`maps` gave 3, expected an AbstractMap"),
    ],
)
def test_wrong_maps_are_refused(maps: Any, metadata: Dict[str, str], part: str) -> None:
    program = Program(devkit.Planner, maps=maps)
    program.start(metadata=metadata)
    text = failed(program.drive())
    assert part in text, text


def test_scenes_without_lanes_or_a_box_are_refused() -> None:
    program = Program(devkit.Planner)
    assert "box of 0.0 m x 2.297 m" in failed(program.start(length=0.0))
    pytest.importorskip("shapely")
    road = Road()
    for k in range(6):
        road.lane(str(k), [(0.0, 0.0), (9.0, 0.0)], category=3)
    program.start(road, route=["0"])
    assert "the route has no lanes for motor vehicles" in failed(program.drive())


@pytest.mark.program
@pytest.mark.usefixtures("with_program")
def test_a_planner_of_the_devkit_drives_in_the_program() -> None:
    pytest.importorskip("shapely")
    scenario = MINI / "platoon.json"
    results = reactsim.run(
        planner=nuplan.wrap(devkit.Planner), baselines=["idm"], scenarios=[scenario], progress=False
    )
    assert len(results.failures) == 0
    assert results.provenance["settings"]["av"].startswith("planner:external:Straight-on")
    inputs = devkit.Planner.latest.inputs
    assert [seen.iteration.index for seen in inputs] == list(range(80))
    speeds = [seen.history.current_state[0].rear_axle_velocity_2d.x for seen in inputs]
    np.testing.assert_allclose(speeds, speeds[0], atol=0.5)
