"""Scenes, observations and sessions in this process."""

from __future__ import annotations

import io
import json
from typing import Any, Dict, List, Tuple

import numpy as np
import pytest
from fakes import Loopback, make_scenes, roll_out
from reactsim.client import (
    Array,
    Kind,
    Light,
    Observation,
    Plan,
    ProtocolError,
    Scenes,
    Session,
    Simulator,
)


class Mine(Simulator):
    """Stands still; keeps what it saw."""

    version = "2"
    intervals = (5, 10)
    batch = 16

    def __init__(self) -> None:
        self.seen: List[Tuple[int, int, int]] = []
        self.ended: List[int] = []
        self.answer: Any = None

    def begin(self, scenes: Scenes) -> None:
        self.scenes = scenes

    def plan(self, seen: Observation) -> Any:
        self.seen.append((seen.frame, seen.n_new, seen.steps))
        self.last = seen
        if self.answer is not None:
            return self.answer(seen) if callable(self.answer) else self.answer
        return np.repeat(seen.states[:, :, -1:, :3], seen.steps, axis=2)

    def end(self, episodes: Array) -> None:
        self.ended += episodes.tolist()


@pytest.fixture
def mine() -> Mine:
    return Mine()


@pytest.fixture
def parent(mine: Mine) -> Loopback:
    return Loopback(mine)


def tamper(**changes: Any) -> Dict[str, Array]:
    tensors = make_scenes()
    for name, change in changes.items():
        if change is None:
            del tensors[name]
        else:
            tensors[name] = change(tensors[name].copy())
    return tensors


@pytest.mark.parametrize(("history", "future"), [(11, 150), (2, 60), (21, 600), (100, 1)])
def test_batches_of_other_lengths(mine: Mine, parent: Loopback, history: int, future: int) -> None:
    parent.hello()
    tensors = make_scenes(frames=history)
    plans = roll_out(parent, tensors, 30, length=json.dumps([history, future]))
    assert sum(plan.shape[2] for plan in plans) == future
    assert (mine.scenes.n_history, mine.scenes.n_steps) == (history, future)
    assert (mine.scenes[0].n_history, mine.scenes[0].n_steps) == (history, future)
    assert mine.scenes[1].history.shape == (4, history, 5)
    assert mine.seen[0][:2] == (history - 1, history)
    last = history + future - 1 - plans[-1].shape[2]
    assert mine.seen[-1][0] == last and mine.last.light_states.shape == (3, last + 1)
    np.testing.assert_array_equal(mine.last.states, parent.states[:, :, : last + 1])


@pytest.mark.parametrize(
    "length",
    ["[11]", "[1, 80]", "[11, 0]", "[101, 80]", "[11, 6001]", "[11, true]", "[1.5, 8]", "x"],
)
def test_impossible_lengths_are_refused(parent: Loopback, length: str) -> None:
    parent.hello()
    metadata = {"moves_av": "0", "steps": "5", "length": length}
    answer, _ = parent.ask("begin", metadata, make_scenes())
    assert answer["type"] == "failed" and "metadata `length` is" in answer["error"]


def test_simulators_may_support_one_length_only(mine: Mine, parent: Loopback) -> None:
    mine.any_length = False
    assert "lengths" not in parent.hello()


def test_a_batch(mine: Mine, parent: Loopback) -> None:
    assert parent.hello() == {
        "type": "welcome",
        "role": "simulator",
        "protocol": "1",
        "seq": "0",
        "name": "Mine",
        "version": "2",
        "weights_sha256": "",
        "intervals": "[5, 10]",
        "lengths": "any",
        "batch": "16",
    }
    tensors = make_scenes()
    plans = roll_out(parent, tensors, steps=7)
    assert [p.shape[2] for p in plans] == [7] * 11 + [3]
    assert mine.seen[:2] == [(10, 11, 7), (17, 7, 7)]
    assert mine.seen[-1] == (87, 7, 3)
    assert mine.ended == [100, 101, 102]
    seen = mine.last
    np.testing.assert_array_equal(seen.states, parent.states[:, :, :88])
    np.testing.assert_array_equal(seen.valid[:, :, :11], tensors["valid"].astype(bool))
    assert seen.valid[0, :, 11:].all()
    assert not seen.valid[1, 4].any()
    assert (seen.light_states[:, :11] == Light.STOP).all()
    assert (seen.light_states[:, 11:] == Light.GO).all()
    assert seen.light_states.shape == (3, 88)
    assert np.isnan(seen.av_next).all()
    assert not seen.moves_av
    np.testing.assert_array_equal(seen.episodes, [100, 101, 102])
    with pytest.raises(ValueError, match="read-only"):
        seen.states[0, 0, 0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        seen.scenes.history[0, 0, 0, 0] = 1.0
    # A second batch in the same process.
    roll_out(parent, make_scenes(2, 3, seed=1))
    assert parent.session.first_error is None


def test_scene_views(mine: Mine, parent: Loopback) -> None:
    tensors = make_scenes()
    parent.begin(tensors, moves_av="1", scenario_ids='["a", "b", "c"]')
    scenes = mine.scenes
    assert scenes.moves_av
    assert scenes.steps == 5
    assert scenes.scenario_ids == ["a", "b", "c"]
    assert scenes.agent_ids is None
    assert len(scenes) == len(list(scenes)) == 3
    with pytest.raises(IndexError):
        _ = scenes[3]
    scene = scenes[-2]
    assert scene.index == 1
    assert scene.n_agents == 4
    assert scene.history.shape == (4, 11, 5)
    assert scene.valid.dtype == np.bool_
    assert (scene.kinds == Kind.VEHICLE).all()
    assert scene.sizes.tolist() == [[4.5, 2.0]] * 4
    assert [len(a) for a in (scene.obstacles, scenes[0].obstacles)] == [0, 1]
    lane, connector = scene.lanes
    start = tensors["line_start"]
    np.testing.assert_array_equal(lane.points, tensors["points"][start[8] : start[9]])
    assert not lane.is_connector
    assert connector.is_connector
    assert (lane.category, lane.speed_limit) == (2, 13.9)
    assert np.isnan(connector.speed_limit)
    assert lane.outline is not None
    assert lane.outline.shape == (4, 2)
    assert connector.outline is None
    assert connector.half_width == 1.75
    assert (lane.successors, lane.predecessors, lane.right) == ([1], [], [])
    assert connector.predecessors == [0]
    assert [tuple(n) for n in lane.left] == [(1, 1, 2, 3, 4)]
    (edge,) = scene.road_edges
    assert (edge.points.shape, edge.category, edge.lane) == ((20, 2), 1, -1)
    (stop,) = scene.stop_lines
    assert (stop.lane, stop.value, stop.category) == (0, 7.5, 1)
    assert [len(ring) for ring in scene.drivable_areas[0]] == [4, 3]
    assert not scene.crosswalks
    assert not scene.painted_lines
    assert len(scene.lights) == 1
    assert scene.lights.lane.tolist() == [1]
    assert scene.lights.stop.shape == (1, 2)
    parent.end()


def test_lines_in_any_order() -> None:
    tensors = make_scenes()
    metadata = {"moves_av": "0"}
    order = np.arange(24).reshape(3, 8).T.ravel()
    start = tensors["line_start"]
    pieces = [tensors["points"][start[i] : start[i + 1]] for i in order]
    place = np.argsort(order).astype(np.int32)
    shuffled = dict(tensors)
    for name in ("line_episode", "line_type", "line_class", "line_value"):
        shuffled[name] = tensors[name][order]
    lane = tensors["line_lane"][order]
    shuffled["line_lane"] = np.where(lane >= 0, place[lane], -1).astype(np.int32)
    shuffled["points"] = np.concatenate(pieces)
    shuffled["line_start"] = np.concatenate([[0], np.cumsum([len(p) for p in pieces])])
    shuffled["link"] = tensors["link"].copy()
    shuffled["link"][:, :2] = place[tensors["link"][:, :2]]
    shuffled["light_lane"] = place[tensors["light_lane"]]
    scenes = Scenes(metadata, make_scenes()), Scenes(metadata, shuffled)
    for first, second in zip(*scenes):
        for a, b in zip(first.lanes, second.lanes):
            np.testing.assert_array_equal(a.points, b.points)
            assert (a.successors, a.left, a.half_width) == (b.successors, b.left, b.half_width) or (
                np.isnan(a.half_width) and np.isnan(b.half_width)
            )
        assert first.lights.lane.tolist() == second.lights.lane.tolist()


def test_random_streams(mine: Mine, parent: Loopback) -> None:
    draws = []
    for _ in range(2):
        parent.begin(make_scenes())
        rng = mine.scenes.rng(0)
        assert rng is mine.scenes.rng(0) is mine.scenes[0].rng
        draws.append((rng.random(), rng.random(), mine.scenes.rng(1).random()))
        parent.end()
    assert draws[0] == draws[1]
    assert len(set(draws[0])) == 3


def test_wrong_plans(mine: Mine, parent: Loopback) -> None:
    parent.begin(make_scenes())

    def error(answer: Any) -> str:
        mine.answer = answer
        metadata, _ = parent.plan(5)
        # The frames of a failed plan were received; the next request repeats none.
        assert metadata["type"] == "failed"
        return metadata["error"]

    shape = "expected (3, 5, 5, 3)"
    found = error(np.zeros((3, 5, 4, 3)))
    assert "Mine.plan returned an array of shape (3, 5, 4, 3), " + shape in found
    assert "float64 or float32" in error(np.zeros((3, 5, 5, 3), int))
    assert "returned None" in error(lambda _: None)
    assert "shape ()" in error("text")
    assert "episode 9 of 3" in error(Plan(np.zeros((3, 5, 5, 3)), {9: "no"}))

    class Unusable:
        def __array__(self, *_: Any, **__: Any) -> Array:
            raise TypeError("it is on a GPU")

    assert "Unusable that is no array: it is on a GPU" in error(Unusable())

    def fail(_: Observation) -> None:
        raise ValueError("bad weights \udc80")

    text = error(fail)
    assert text.startswith("Traceback")
    assert text.endswith("ValueError: bad weights ?")
    assert "reactsim/client.py" not in text

    def leave(_: Observation) -> None:
        raise SystemExit(3)

    assert "called sys.exit" in error(leave)
    assert parent.session.first_error is not None
    assert parent.end()[0]["type"] == "ended"
    mine.answer = None
    roll_out(parent, make_scenes())


def test_states_that_are_not_finite(mine: Mine, parent: Loopback) -> None:
    parent.begin(make_scenes())

    def states(*changes: Tuple[int, int, int, int, float]) -> Array:
        result = np.zeros((3, 5, 5, 3), np.float32)
        for *place, value in changes:
            result[tuple(place)] = value
        return result

    # Slot 0 and padding are ignored, and so are inactive episodes.
    mine.answer = states((0, 0, 0, 0, np.nan), (2, 4, 0, 0, np.nan))
    metadata, tensors = parent.plan(5)
    assert "errors" not in metadata
    assert tensors["states"].dtype == np.float32
    mine.answer = states((1, 2, 3, 1, np.inf), (2, 1, 0, 0, 1e9), (0, 3, 4, 2, np.nan))
    metadata, tensors = parent.plan(5, np.array([0, 1, 1], np.uint8))
    assert metadata["type"] == "planned"
    expected = ": expected finite numbers within 100 km of the origin"
    first = "Mine.plan returned x 0, y inf, heading 0 for agent 2 at step 4 of 5"
    second = "Mine.plan returned x 1e+09, y 0, heading 0 for agent 1 at step 1 of 5"
    assert json.loads(metadata["errors"]) == {"1": first + expected, "2": second + expected}
    assert np.isfinite(tensors["states"][1:]).all()
    mine.answer = Plan(np.zeros((3, 5, 5, 3)), {2: "too many agents"})
    assert parent.plan(5)[0]["errors"] == '{"2": "too many agents"}'
    # Texts of all episodes together stay below the limit of an answer.
    mine.answer = Plan(np.zeros((3, 5, 5, 3)), dict.fromkeys(range(3), '"\ud800ü' * 100_000))
    texts = json.loads(parent.plan(5)[0]["errors"])
    assert sum(len(json.dumps(json.dumps(text))) for text in texts.values()) < 1 << 20
    parent.end()
    # In the realism protocol slot 0 counts.
    parent.begin(make_scenes(), moves_av="1")
    mine.answer = states((0, 0, 0, 0, np.nan))
    assert "agent 0 at step 1" in parent.plan(5)[0]["errors"]
    parent.end()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seed": None}, "`seed` is missing"),
        ({"seed": lambda a: a.astype(np.int64)}, "type int64, expected uint64"),
        ({"size": lambda a: a[:, :, :1]}, "`size` has shape"),
        ({"valid": lambda a: a[:, :4]}, "`valid` has shape"),
        ({"valid": lambda a: a * 2}, "flags other than 0 and 1"),
        ({"n_agents": lambda a: a + 1}, "outside 1 to 5"),
        ({"line_start": lambda a: a[::-1].copy()}, "does not divide"),
        ({"line_start": lambda a: a + 1}, "does not divide"),
        ({"line_episode": lambda a: a + 1}, "outside 0 to 2"),
        ({"line_lane": lambda a: a - 1}, "outside -1 to 23"),
        ({"link": lambda a: a + 24}, "lane outside"),
        ({"light_lane": lambda a: a + 24}, "outside -1 to 23"),
    ],
)
def test_wrong_scenes(parent: Loopback, changes: Dict[str, Any], message: str) -> None:
    metadata, _ = parent.begin(tamper(**changes))
    assert metadata["type"] == "failed"
    assert message in metadata["error"]
    assert parent.begin(make_scenes())[0]["type"] == "begun"
    parent.end()


def test_wrong_order(mine: Mine, parent: Loopback) -> None:
    tensors = make_scenes()
    parent.begin(tensors)
    assert "while a batch is open" in parent.begin(tensors)[0]["error"]
    parent.new, parent.frame = 5, 20
    assert "does not follow" in parent.plan(5)[0]["error"]
    parent.new, parent.frame = 0, 300
    assert "expected 10 to 89" in parent.plan(5)[0]["error"]
    parent.end()
    parent.frame = 10
    assert "without `begin`" in parent.plan(5)[0]["error"]
    assert parent.end()[0]["type"] == "ended"
    assert mine.ended == [100, 101, 102]
    assert "unknown request" in parent.ask("dance")[0]["error"]
    assert "version 2" in parent.ask("hello", {"protocol": "2"})[0]["error"]
    with pytest.raises(ProtocolError, match="a frame of"):
        parent.session.run(io.BytesIO(b"\xff" * 8), io.BytesIO())


def test_errors_in_begin_and_end(mine: Mine, parent: Loopback) -> None:
    class Bad(Mine):
        def begin(self, scenes: Scenes) -> None:
            raise RuntimeError("no memory")

        def end(self, episodes: Array) -> None:
            raise RuntimeError("no end")

    bad = Loopback(Bad())
    assert "no memory" in bad.begin(make_scenes())[0]["error"]
    assert bad.end()[0]["type"] == "ended"
    mine.end = Bad().end  # type: ignore[method-assign]
    parent.begin(make_scenes())
    assert "no end" in parent.end()[0]["error"]
    assert parent.begin(make_scenes())[0]["type"] == "begun"


def test_any_object_is_a_simulator() -> None:
    class Duck:
        def plan(self, seen: Observation) -> List[Any]:
            return np.zeros((*seen.states.shape[:2], seen.steps, 3)).tolist()  # type: ignore[no-any-return]

    local = Loopback(Duck)
    assert local.hello()["name"] == "Duck"
    roll_out(local, make_scenes())
    with pytest.raises(TypeError, match="no method `plan`"):
        Session(object())


def test_copies_know_nothing_of_earlier_episodes() -> None:
    class Remembering(Mine):
        def __init__(self) -> None:
            super().__init__()
            self.memory: List[int] = []

    for given in (Remembering, Remembering()):
        session = Session(given, copies=True)
        session.simulator.memory.append(1)
        first, second = session.copy(), session.copy()
        first.simulator.memory.append(2)
        assert second.simulator.memory == []
        assert isinstance(second.simulator, Remembering)

    class Single(Mine):
        def __deepcopy__(self, _: Any) -> Any:
            raise RuntimeError("there is one")

    Session(Single(), copies=False)
    Session(Single, copies=True).copy()
    with pytest.raises(
        TypeError, match=r"Single cannot be copied .*there is one\): give its class"
    ):
        Session(Single(), copies=True)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("weights_sha256", "12", "64 hex digits"),
        ("batch", 0, "1 to 1024"),
        ("intervals", (0,), "1 to 80 steps"),
        ("version", 3, "expected text"),
    ],
)
def test_wrong_descriptions(name: str, value: Any, message: str) -> None:
    simulator = Mine()
    setattr(simulator, name, value)
    local = Loopback(simulator)
    assert message in local.hello()["error"]
