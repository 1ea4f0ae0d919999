"""Environments for reinforcement learning, in which a simulator moves the traffic.

`Env` has the interface of gymnasium, and `VectorEnv` the interface of its vectorised environments.
Both need gymnasium: `pip install 'reactsim[env]'`. Their traffic is the same as in `reactsim.run`,
bit for bit, for the same states of the AV. The log after the current frame is hidden; only the path
of the logged AV, without times, is observed as its route.

Observations are dictionaries of float32 arrays in the frame of the AV: the origin is its box centre
and the x axis points along its heading. Units are metres, m/s and radians. Rows that do not exist
are 0, and so is their flag `valid`. H, A, L, P, K and R are the arguments `frames`, `agents`,
`lanes`, `points`, `lights` and `route`.

- `av` [H, 7]: the AV at the last H frames, oldest first: x, y, cosine and sine of the heading, vx,
  vy, valid
- `av_size` [2]: length and width of the AV
- `agents` [A, H, 7]: the A nearest other agents, nearest first, with the values of `av`
- `agent_features` [A, 6]: length, width, and flags of the kind: vehicle, pedestrian, cyclist, other
- `lanes` [L, P, 4]: the L nearest pieces of lanes, about 2 m between points: x, y, cosine and sine
  of the direction
- `lane_features` [L, 6]: valid, connector, speed limit (0 if unknown), and flags of the light of
  the lane: red, yellow, green
- `lights` [K, 6]: the K nearest traffic lights: x and y of the stop point, red, yellow, green,
  valid
- `route` [R, 5]: points of the route ahead every 2 m: x, y, cosine and sine of the direction, valid

Measures of each step are in `info`. They follow the rules of the metrics of planners, from what is
known at the step: `progress` (metres along the route), `contact` (1 at the first contact with an
object), `at_fault_contact` (the same, if it is the fault of the AV), `ttc` (time to collision in
seconds, infinite if there is none), `off_road`, `uncomfortable` (accelerations, jerks and yaw rates
out of their bounds) and `speed` (m/s). NaN is unknown.
"""

from __future__ import annotations

import dataclasses
import functools
import os
import warnings
from collections.abc import Mapping, Sequence
from typing import Any, Callable, Union

import numpy as np

from .client import STEPS, Array, Session, as_array
from .display import Gif
from .options import PathLike, Sources, several, texts, whole
from .pictures import SavesMp4, drawing, save_drawing
from .process import ProgramProcess, own_session
from .program import ReactsimError
from .scenarios import Scenario, reading_of
from .scoring import read_scores

try:
    import gymnasium
    from gymnasium import spaces
    from gymnasium.vector import AutoresetMode
    from gymnasium.vector.utils import batch_space
except ImportError as error:
    raise ImportError(
        f"environments need gymnasium ({error}): pip install 'reactsim[env]'"
    ) from None

__all__ = ["REWARD", "Env", "Reward", "VectorEnv"]

Reward = Union[Mapping[str, float], Callable[[Mapping[str, float]], float]]
"""Weights of measures, whose weighted sum is the reward, or a function of the measures."""

REWARD: Mapping[str, float] = {
    "progress": 0.1,
    "at_fault_contact": -10.0,
    "off_road": -1.0,
    "uncomfortable": -0.1,
}
"""Default weights of the reward."""

MAX_ACCELERATION = 6.0  # m/s², the limit of the benchmark
MAX_CURVATURE = 0.3  # 1/m, the limit of the benchmark
MAX_PLANNED = 400.0  # metres; no AV drives farther in 8 s
ROLLOUTS = 1 << 31  # number of rollouts of a scenario with random streams of their own
MAX_ROLLOUT = (1 << 32) - 1  # largest index of a rollout that can be given
MIN_SHARE = 4  # episodes of a process, below which a further one is not worth its memory
RENDER_FPS = 10  # steps per second


class _Core:
    """The processes of an environment, which share its episodes, and the meaning of its arrays."""

    def __init__(
        self,
        owner: str,
        batches: int,
        scenarios: Sources | Scenario,
        simulator: Any,
        /,
        *,
        jobs: int | None = 1,
        ids: Sequence[str] = (),
        limit: int | None = None,
        action: str = "bicycle",
        poses: int = 10,
        every: int = 1,
        agents: int = 32,
        frames: int = 11,
        lanes: int = 64,
        points: int = 10,
        lights: int = 8,
        route: int = 20,
        flat: bool = False,
        normalized: bool = False,
        render_mode: str | None = None,
        reward: Reward | None = None,
        end_at: str | Sequence[str] = (),
        scores: bool = True,
        metric_options: Mapping[str, Any] | None = None,
        current_frame: int | None = None,
        window_step: int | None = None,
        history: int | None = None,
        future: int | str | None = None,
        all_agents: bool = False,
        **rolled_out: Any,
    ) -> None:
        check_names(owner, rolled_out)
        check_render_mode(render_mode)
        kinds = ("bicycle", "plan", "state")
        if action not in kinds:
            raise ValueError(f"`action` is {action!r}, expected one of {', '.join(kinds)}")
        common = common_of(
            scenarios,
            ids,
            limit,
            scores,
            metric_options,
            current_frame=current_frame,
            window_step=window_step,
            history=history,
            future=future,
            all_agents=all_agents,
        )
        self.action_space = action_space(action, poses)
        self.scale: Array | None = None
        if normalized:
            if action == "state":
                raise ValueError("`normalized` is for actions with bounds: bicycle or plan")
            self.scale = bounds(action, poses)
            self.action_space = spaces.Box(-1.0, 1.0, self.scale.shape, np.float32)
        jobs = _jobs(jobs, batches, simulator, action)
        self.firsts = [batches * k // jobs for k in range(jobs)]
        """First episode of each process."""
        self.slices = [slice(*ends) for ends in zip(self.firsts, [*self.firsts[1:], batches])]
        """Episodes of each process."""
        traffic, sessions = traffic_of(simulator, batches, **rolled_out)
        common |= {
            "traffic": traffic,
            "action": {"plan": {"poses": poses}} if action == "plan" else action,
            "sizes": {
                "agents": agents,
                "frames": frames,
                "lanes": lanes,
                "points": points,
                "lights": lights,
                "route": route,
            },
        }
        arguments = {"common": common, "every": every, "end_at": several(end_at)}
        self.processes: list[ProgramProcess] = []
        try:
            for _ in self.firsts:
                self.processes.append(ProgramProcess(sessions))
            description = self._all("environment", [arguments] * jobs)[0][0]
            self.measures: list[str] = description["measures"]
            self.reward = known_reward(REWARD if reward is None else reward, self.measures)
        except BaseException:
            self.close()
            raise
        self.scenarios: list[str] = description["scenarios"]
        warn_skipped(description, 4)
        self.flags = [f"_{name}" for name in self.measures]
        """Names of the entries of `infos` that tell whose measures they are."""
        self.arrays: list[str] = [name for name, _ in description["arrays"]]
        self.step_arrays = [*self.arrays, "measures", "terminated", "truncated"]
        self.room = _Room(batches, description["arrays"], len(self.measures))
        self.flat = flat
        self.observation_space = observation_space(description["arrays"], flat)

    def episode(self, slot: int, generator: np.random.Generator, **chosen: Any) -> dict[str, int]:
        """Returns the next episode of a slot; what is not chosen is random."""
        return {"slot": slot, **episode_of(self.scenarios, generator, **chosen)}

    def reset(self, episodes: list[dict[str, int]]) -> Any:
        """Begins episodes in all slots; returns the observations."""
        shares = [{"episodes": own} for own in self._shares(episodes)]
        return self._observed(self._request("reset", shares, {})[1])

    def step(
        self, actions: Any, shape: tuple[int, ...], episodes: list[dict[str, int]]
    ) -> tuple[Any, dict[int, Any], dict[str, Array]]:
        """Executes the actions, an array of this shape, and begins episodes in place of others.

        Returns the observations, the ends by slot, and the arrays of the answer.
        """
        values = checked(actions, shape, self.action_space.shape)
        if self.scale is not None:
            values = values * self.scale.reshape(-1)
        if len(self.processes) > 1:
            self._check_finite(values, episodes)
        shares = [{"episodes": own} for own in self._shares(episodes)]
        documents, arrays = self._request("step", shares, {"actions": values})
        ends = {
            first + int(slot): end
            for first, found in zip(self.firsts, documents)
            for slot, end in found.items()
        }
        return self._observed(arrays), ends, arrays

    def begin(self, episodes: list[dict[str, int]]) -> Any:
        """Begins episodes in place of those in their slots; returns their observations."""
        shares = self._shares(episodes)
        answers = self._all("begin", [{"episodes": own} if own else None for own in shares])
        parts = [arrays for _, arrays in answers if arrays]
        joined = {name: np.concatenate([part[name] for part in parts]) for name in self.arrays}
        return self._observed(joined)

    def states(self, slot: int) -> Array:
        """Returns the realised states of a slot so far."""
        return self._one("tracks", slot, {})["states"]

    def picture(self, slot: int) -> Array:
        """Returns a picture of a slot at present, u8 [height, width, 3]."""
        return self._one("draw", slot, drawing(follow=True))["rgb"]

    def save_gif(self, path: PathLike | None, slot: int, **options: Any) -> Gif:
        """Writes an animation of a slot so far, if there is a path, and returns it."""
        return save_drawing(path, self._one("draw", slot, drawing(**{"every": 1, **options})))

    def close(self) -> None:
        """Ends the processes of the program."""
        for process in self.processes:
            process.close()

    def _one(self, kind: str, slot: int, arguments: Mapping[str, Any]) -> dict[str, Array]:
        """Sends a request about a slot to its process."""
        index, own = self._place(slot)
        return self.processes[index].request(kind, {**arguments, "slot": own})[1]

    def _place(self, slot: int) -> tuple[int, int]:
        """Returns the index of the process of a slot, and the slot there."""
        index = sum(first <= slot for first in self.firsts[1:])
        return index, slot - self.firsts[index]

    def _request(
        self, kind: str, arguments: Sequence[Mapping[str, Any]], tensors: Mapping[str, Array]
    ) -> tuple[list[Any], dict[str, Array]]:
        """Sends a request with the tensors of all episodes to each process.

        Returns the document of each answer, and the arrays of all episodes.
        """
        if len(self.processes) == 1:
            document, arrays = self.processes[0].request(kind, arguments[0], tensors)
            return [document], arrays
        joined = self.room.arrays()
        own = [{name: array[share] for name, array in tensors.items()} for share in self.slices]
        rooms = [{name: array[share] for name, array in joined.items()} for share in self.slices]
        answers = self._all(kind, arguments, own, rooms)
        for (_, arrays), room in zip(answers, rooms):
            for name in self.arrays if kind == "reset" else self.step_arrays:
                if arrays[name] is not room[name]:
                    room[name][...] = arrays[name]
        return [document for document, _ in answers], joined

    def _all(
        self,
        kind: str,
        arguments: Sequence[Mapping[str, Any] | None],
        tensors: Sequence[Mapping[str, Array]] = (),
        rooms: Sequence[Mapping[str, Array] | None] = (),
    ) -> list[tuple[Any, dict[str, Array]]]:
        """Sends a request to each process that has arguments, and then waits for all answers.

        Arrays of the answer of each process are read into those of its `rooms`.
        """
        tensors = tensors or [{}] * len(self.processes)
        rooms = rooms or [None] * len(self.processes)
        if len(self.processes) == 1:
            return [self.processes[0].request(kind, arguments[0] or {}, tensors[0])]
        asked = [k for k, given in enumerate(arguments) if given is not None]
        answers: list[tuple[Any, dict[str, Array]]] = [({}, {}) for _ in arguments]
        errors: list[ReactsimError] = []
        try:
            for k in asked:
                self.processes[k].send(kind, arguments[k] or {}, tensors[k])
            for k in asked:
                try:
                    answers[k] = self.processes[k].receive(rooms[k])
                except ReactsimError as error:
                    errors.append(error)
        except BaseException:
            # The others would take the answers of this request for those of the next one.
            self.close()
            raise
        if errors:
            if kind in ("step", "begin"):
                # Some episodes have moved, and others have not.
                self.close()
            raise errors[0]
        return answers

    def _shares(self, episodes: list[dict[str, int]]) -> list[list[dict[str, int]]]:
        """Returns the episodes of each process, with the slots there."""
        shares: list[list[dict[str, int]]] = [[] for _ in self.firsts]
        for episode in episodes:
            index, slot = self._place(episode["slot"])
            shares[index].append({**episode, "slot": slot})
        return shares

    def _observed(self, arrays: Mapping[str, Array]) -> Any:
        """Returns the observations among the arrays of an answer."""
        if not self.flat:
            return {name: arrays[name] for name in self.arrays}
        flat = [arrays[name].reshape(len(arrays[name]), -1) for name in self.arrays]
        return np.concatenate(flat, axis=1)

    def _check_finite(self, values: Array, episodes: Sequence[Mapping[str, int]]) -> None:
        """Raises ReactsimError for an action that the program would refuse."""
        if np.isfinite(values).all():
            return
        begun = {episode["slot"] for episode in episodes}
        for slot, i in np.argwhere(~np.isfinite(values)).tolist():
            if slot not in begun:
                raise ReactsimError(
                    f"value {i} of the action of slot {slot} is {values[slot, i]}, expected a"
                    " finite number"
                )


class _Room:
    """Room for the arrays of a step of all episodes, into which each process writes its rows.

    They are parts of one block: the allocator gives many large arrays back to the system, and takes
    new pages for them, at every step.
    """

    def __init__(
        self, episodes: int, shapes: Sequence[tuple[str, Sequence[int]]], measures: int
    ) -> None:
        rows: list[tuple[str, tuple[int, ...], Any]] = [("measures", (measures,), np.float64)]
        rows += [(name, tuple(shape), np.float32) for name, shape in shapes]
        rows += [(name, (), np.uint8) for name in ("terminated", "truncated")]
        self._layout: list[tuple[str, tuple[int, ...], Any, int]] = []
        self._size = 0
        for name, shape, dtype in rows:
            self._layout.append((name, (episodes, *shape), dtype, self._size))
            self._size += episodes * int(np.prod(shape)) * np.dtype(dtype).itemsize

    def arrays(self) -> dict[str, Array]:
        """Returns new arrays."""
        block = np.empty(self._size, np.uint8)
        return {
            name: np.ndarray(shape, dtype, block, offset)
            for name, shape, dtype, offset in self._layout
        }


def _jobs(jobs: int | None, episodes: int, simulator: Any, action: str) -> int:
    """Returns the number of processes, by default one per core if each has several episodes."""
    is_baseline = isinstance(simulator, str) and ("=" not in simulator or ":" in simulator)
    single = None
    if not is_baseline:
        single = "of one's own"
    elif action == "state":
        single = "with states as actions"
    if jobs is None:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
        return 1 if single else max(1, min(cores or 1, episodes // MIN_SHARE))
    jobs = whole("jobs", jobs, least=1, most=episodes)
    if single and jobs > 1:
        raise ValueError(f"`jobs` is {jobs}, expected 1 for simulators {single}")
    return jobs


def check_render_mode(render_mode: str | None) -> None:
    """Raises ValueError for another mode than those of `metadata`."""
    if render_mode not in (None, "rgb_array"):
        raise ValueError(f"`render_mode` is {render_mode!r}, expected None or 'rgb_array'")


def check_names(owner: str, rolled_out: Mapping[str, Any]) -> None:
    """Raises TypeError for a keyword argument of `owner` that `traffic_of` does not have."""
    for name in rolled_out:
        if name not in (traffic_of.__kwdefaults__ or {}):
            raise TypeError(f"{owner}() got an unexpected keyword argument {name!r}")


def traffic_of(
    simulator: Any,
    batches: int,
    *,
    replan: str = "2hz",
    av_lookahead: bool = True,
    seed: int = 0,
    weights: Mapping[str, Any] | None = None,
    parameters: Mapping[str, Any] | None = None,
    external_limit: str | None = None,
) -> tuple[dict[str, Any], dict[str, Session]]:
    """Returns the arguments of the traffic, and the simulator of this process, if it is one."""
    sessions = {}
    if not isinstance(simulator, str):
        session = own_session(simulator, "simulator", copies=batches > 1)
        sessions[session.name] = session
        simulator = f"{session.name}=@stdio"
        if external_limit is not None:
            raise ValueError(
                "`external_limit` is for commands: a simulator of this process has none"
            )
    arguments = {
        "simulator": simulator,
        "batches": batches,
        "external_limit": external_limit,
        "weights": texts(weights),
        "parameters": texts(parameters),
        "replan": replan,
        "av_lookahead": av_lookahead,
        "seed": whole("seed", seed),
    }
    return arguments, sessions


def episode_of(
    ids: Sequence[str], generator: np.random.Generator, scenario: Any = None, rollout: Any = None
) -> dict[str, int]:
    """Returns the indices of the scenario, given by its id or index, and of the rollout.

    What is not given is random.
    """
    drawn = int(generator.integers(len(ids))), int(generator.integers(ROLLOUTS))
    if scenario is None:
        index = drawn[0]
    elif not isinstance(scenario, str):
        index = whole("scenario", scenario, most=len(ids) - 1)
    elif scenario in ids:
        index = ids.index(scenario)
    else:
        raise ValueError(f"no scenario `{scenario}` in this environment")
    rollout = drawn[1] if rollout is None else whole("rollout", rollout, most=MAX_ROLLOUT)
    return {"scenario": index, "rollout": rollout}


def common_of(
    scenarios: Sources | Scenario,
    ids: Sequence[str],
    limit: int | None,
    scores: bool,
    metric_options: Mapping[str, Any] | None,
    **as_read: Any,
) -> dict[str, Any]:
    """Returns the arguments that all environments have: scenarios, their selection, and scores."""
    if isinstance(scenarios, Scenario):
        for name, value in {**as_read, "ids": ids}.items():
            # An empty selection is an array or a list.
            if value is not None and value is not False and (name != "ids" or len(value)):
                raise ValueError(
                    f"`{name}` is given with a `Scenario`, which is read already: leave it out"
                )
        reading, ids = scenarios.reading(), [scenarios.id]
    else:
        reading = reading_of(scenarios, **as_read)
    return {
        "reading": reading,
        "ids": list(ids),
        "limit": None if limit is None else whole("limit", limit),
        "scores": scores,
        "metric_options": texts(metric_options),
    }


def known_reward(reward: Reward, measures: Sequence[str]) -> Reward:
    """Returns the reward. Raises ValueError for weights of other measures."""
    unknown = set() if callable(reward) else set(reward) - set(measures)
    if unknown:
        raise ValueError(f"`reward` has weights of {sorted(unknown)}, expected some of {measures}")
    return reward


def warn_skipped(description: Mapping[str, Any], level: int) -> None:
    """Warns of scenarios that cannot be read; `level` is that of the user's code above this."""
    if description["skipped"]:
        warnings.warn(f"scenarios or files: {description['skipped']}", stacklevel=level)


def observation_space(shapes: Sequence[tuple[str, Sequence[int]]], flat: bool = False) -> Any:
    """Returns the space of arrays with these names and shapes, or of all of them as a vector."""
    box = functools.partial(spaces.Box, -np.inf, np.inf, dtype=np.float32)
    if flat:
        return box(shape=(sum(int(np.prod(shape)) for _, shape in shapes),))
    return spaces.Dict({name: box(shape=tuple(shape)) for name, shape in shapes})


def checked(actions: Any, shape: tuple[int, ...], single: tuple[int, ...]) -> Array:
    """Returns actions as f64 [actions, values]; `single` is the shape of one action."""
    array = as_array(actions)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"the action has the type {array.dtype}, expected numbers")
    if array.shape != shape:
        raise ValueError(f"the action has the shape {array.shape}, expected {shape}")
    return array.astype(np.float64).reshape(-1, int(np.prod(single)))


def weighted(reward: Reward, names: Sequence[str], measures: Array) -> Array:
    """Returns the reward of each row of measures, f64."""
    if callable(reward):
        return np.array([float(reward(dict(zip(names, row)))) for row in measures.tolist()])
    # Unknown measures neither reward nor cost anything.
    of_weights = measures[:, [names.index(name) for name in reward]]
    known = np.where(np.isfinite(of_weights), of_weights, 0.0)
    # One sum after the other, so that rewards do not depend on the number of episodes.
    rewards = np.zeros(len(measures))
    for weight, column in zip(reward.values(), known.T):
        rewards += weight * column
    return rewards


def action_space(action: str, poses: int) -> spaces.Box:
    """Returns the space of actions of a kind."""
    if action == "state":
        return spaces.Box(-np.inf, np.inf, (5,), np.float64)
    high = bounds(action, poses).astype(np.float32)
    return spaces.Box(-high, high, dtype=np.float32)


def bounds(action: str, poses: int) -> Array:
    """Returns the largest values of actions other than states, f64 [2] or [poses, 3]."""
    if action == "bicycle":
        return np.array([MAX_ACCELERATION, MAX_CURVATURE])
    metres = MAX_PLANNED * max(1.0, poses / STEPS)
    return np.tile([metres, metres, np.pi], (poses, 1))


def end_info(end: Mapping[str, Any]) -> dict[str, Any]:
    """Returns the entries of `info` at the end of an episode."""
    entries: dict[str, Any] = {}
    if "rows" in end:
        scores = read_scores(end["rows"], end["events"])
        entries["scores"] = dataclasses.replace(scores.rollouts[0], metrics=scores.metrics)
    if "failure" in end:
        entries["failure"] = end["failure"]
    return entries


class Env(SavesMp4, gymnasium.Env[dict[str, Array], Array]):
    """An environment in which actions drive the AV and a simulator moves all other agents.

    An episode has the steps of its scenario, 80 of 0.1 s in the benchmark. It is truncated after
    the last step, or if the simulator finds no plan (`info["failure"]`); it terminates at a
    condition of `end_at`. Without a condition it continues after contacts, as in the benchmark. A
    `Simulator` that raises is an error.
    Observations and measures are described in `reactsim.environment`.

    `reset` chooses a scenario at random; `options={"scenario": id or index, "rollout": 0}` names
    it, and the random streams of its simulator. `info["scores"]` has the scores of an episode after
    its end: all metrics of the benchmark, and the metrics of planners for the AV. If a condition of
    `end_at` ended the episode, they are of the steps until then, and metrics that need all steps
    are None.

    Args:
        scenarios: Files, folders or URLs of scenarios, or one `Scenario`; the shipped benchmark by
            default. All selected scenarios are kept in memory; those that cannot be read are left
            out with a warning, unless `ids` has them.
        simulator: Id of the simulator, such as "idm" or "mix:idm=1+ntp-guarded=1"; or a `Simulator`
            of this process, or its class; or NAME=COMMAND, an external one: "mine=python mine.py".
        ids: Only scenarios with one of these ids; all by default.
        limit: Only the first `limit` of the selected scenarios, over all files.
        action: Kind of the actions. "bicycle": acceleration (m/s², up to 6) and curvature (1/m,
            left positive, up to 0.3) of a kinematic bicycle that does not reverse; values beyond
            are clipped. "plan": poses [poses, 3] after 1, 2, ... steps in the frame of the AV (x,
            y, heading), which the LQR tracker of nuPlan follows; displacements above 50 m/s are
            shortened. "state": the next state in the frame of the scenario (x, y, heading, vx, vy;
            NaN velocities become displacements), at most 8 m away.
        poses: Number of poses of a plan, at least `every`.
        every: Number of steps of 0.1 s per action. Measures are then sums of progress, flags that
            are 1 at any step, the smallest time to collision, and the last speed.
        agents: Number of the nearest agents that are observed.
        frames: Number of frames that are observed, 1 to 100; those before the first one are absent.
        lanes: Number of the nearest pieces of lanes that are observed.
        points: Number of points of a piece of a lane.
        lights: Number of the nearest traffic lights that are observed.
        route: Number of points of the route that are observed.
        flat: Observe one vector, all arrays one after the other, instead of a dictionary.
        normalized: Actions are from -1 to 1, in units of the bounds above (of a plan π and 400 m,
            or 5 m per pose of more than 80).
        render_mode: "rgb_array" for pictures by `render`.
        reward: Weights of measures, or a function of the measures; `REWARD` by default.
        end_at: Conditions that terminate an episode: "contact", "at-fault-contact", "off-road".
        scores: Score episodes after their end.
        replan: Replan rate or interval of the simulator.
        av_lookahead: Agents observe the AV one step ahead, as in the benchmark.
        seed: Seed of the random choices of the simulator.
        weights: Files of weights by id of the simulator.
        parameters: Parameters of the simulator, such as `{"idm.vehicle.headway": 2.5}`.
        metric_options: Variants of the metrics, such as `{"fault_order": "nuplan"}`.
        external_limit: Time for every answer of a command, such as "5s"; by default that of `run`.
        current_frame: Index of the current frame, from 0, for formats that leave it open.
        window_step: Frames between scenarios of one recording of 20 s.
        history: Number of frames of 0.1 s of a scenario up to and including the current one.
        future: Number of steps of 0.1 s of an episode, or a time such as "15s", or "log" for all
            that are recorded. The shipped scenarios have a fixed length.
        all_agents: Simulate all agents that are present at the current frame.

    Raises:
        ReactsimError: The program refuses a setting, an action or a scenario, or has ended, or the
            simulator has failed.

    """

    metadata: dict[str, Any] = {  # noqa: RUF012 # as gymnasium declares it
        "render_modes": ["rgb_array"],
        "render_fps": RENDER_FPS,
    }

    def __init__(
        self,
        scenarios: Sources | Scenario = None,
        simulator: Any = "idm",
        *,
        render_mode: str | None = None,
        **settings: Any,
    ) -> None:
        self.render_mode = render_mode
        if "jobs" in settings:
            raise TypeError("Env() got an unexpected keyword argument 'jobs'")
        self._core = _Core("Env", 1, scenarios, simulator, render_mode=render_mode, **settings)
        self.observation_space = self._core.observation_space
        self.action_space = self._core.action_space
        self._info: dict[str, Any] | None = None

    @property
    def scenarios(self) -> list[str]:
        """Ids of the scenarios."""
        return list(self._core.scenarios)

    @property
    def states(self) -> Array:
        """Realised states of the episode so far, f64 [agents, frames, 5]: x, y, heading, vx, vy.

        Frame of the scenario, metres, radians and m/s; NaN where absent or unknown. Frames begin
        with those of the history.
        """
        return self._core.states(0)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begins an episode; see the class for `options`."""
        super().reset(seed=seed)
        chosen = dict(options or {})
        unknown = set(chosen) - {"scenario", "rollout"}
        if unknown:
            raise ValueError(f"`options` has {sorted(unknown)}, expected `scenario` and `rollout`")
        self._info = None
        episode = self._core.episode(0, self.np_random, **chosen)
        observations = self._core.reset([episode])
        scenario = self._core.scenarios[episode["scenario"]]
        self._info = {"scenario": scenario, "rollout": episode["rollout"]}
        return _first(observations), dict(self._info)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Executes an action; returns observation, reward, terminated, truncated and `info`."""
        core = self._core
        if self._info is None:
            raise ReactsimError("no episode has begun, or it is over: call `reset` first")
        observations, ends, arrays = core.step(action, core.action_space.shape, [])
        measures = arrays["measures"]
        reward = float(weighted(core.reward, core.measures, measures)[0])
        info = {**self._info, **dict(zip(core.measures, measures[0].tolist()))}
        terminated, truncated = bool(arrays["terminated"][0]), bool(arrays["truncated"][0])
        if terminated or truncated:
            info.update(end_info(ends[0]))
            self._info = None
        return _first(observations), reward, terminated, truncated, info

    def render(self) -> Array | None:
        """Returns a picture of the present step, u8 [height, width, 3], as `Scenario.gif` draws it.

        None without `render_mode="rgb_array"`.
        """
        return None if self.render_mode is None else self._core.picture(0)

    def save_gif(
        self,
        path: PathLike | None,
        *,
        size: int = 480,
        radius: float | None = None,
        every: int = 1,
        follow: bool = False,
    ) -> Gif:
        """Writes an animation of the episode so far and returns it; notebooks show it.

        Args:
            path: File to write, such as "episode.gif"; None to return the animation only.
            size: Side of the picture, pixels, 100 to 1200.
            radius: Half of the side of the picture, metres; by default large enough for the path of
                the AV, or 40 with `follow`.
            every: Show only every Nth step of 0.1 s.
            follow: Keep the AV in the middle, which makes larger files.

        """
        options = {"size": size, "radius": radius, "every": every, "follow": follow}
        return self._core.save_gif(path, 0, **options)

    def close(self) -> None:
        """Ends the process of the program."""
        self._core.close()


def _first(observations: Any) -> Any:
    """Returns the first row of observations."""
    if isinstance(observations, dict):
        return {name: array[0] for name, array in observations.items()}
    return observations[0]


class VectorEnv(SavesMp4, gymnasium.vector.VectorEnv[dict[str, Array], Array, Array]):
    """Many episodes in lockstep, shared among processes of the program.

    The interface follows gymnasium's vectorised environments with the mode NEXT_STEP: the first
    step after the end of an episode ignores its action and begins the next episode of its slot. A
    simulator plans once for all episodes whose plans end at the same time. `infos` has an array per
    measure, and `scores` and `failure` as object arrays where an episode ended. Episodes that begin
    at different times are different batches of a simulator that is not of the program. A class of
    this process is then instantiated again, a `Simulator` deep-copied as it was at first, and a
    command started again.

    Args:
        scenarios: As for `Env`.
        simulator: As for `Env`.
        num_envs: Number of episodes.
        jobs: Number of processes, each of which keeps all scenarios in memory. By default one per
            core with at least 4 episodes each, and one for simulators of one's own and for states
            as actions. Results do not depend on it.
        render_mode: As for `Env`.
        settings: The other arguments of `Env`.

    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": RENDER_FPS,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        scenarios: Sources | Scenario = None,
        simulator: Any = "idm",
        *,
        num_envs: int = 16,
        jobs: int | None = None,
        render_mode: str | None = None,
        **settings: Any,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"`num_envs` is {num_envs}, expected at least 1")
        self.render_mode = render_mode
        given = {"jobs": jobs, "render_mode": render_mode, **settings}
        self._core = _Core("VectorEnv", num_envs, scenarios, simulator, **given)
        self.num_envs = num_envs
        self.single_observation_space = self._core.observation_space
        self.single_action_space = self._core.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._episodes: list[dict[str, int]] = []
        self._next: list[dict[str, int]] | None = None
        self._is_over = np.zeros(num_envs, np.bool_)

    @property
    def scenarios(self) -> list[str]:
        """Ids of the scenarios."""
        return list(self._core.scenarios)

    def states(self, index: int) -> Array:
        """Returns the realised states of an episode so far, as `Env.states`."""
        return self._core.states(index)

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begins all episodes.

        `options={"scenarios": [...], "rollouts": [...]}` has ids or indices of scenarios, and
        indices of rollouts, one per episode.
        """
        super().reset(seed=seed)
        chosen = dict(options or {})
        unknown = set(chosen) - {"scenarios", "rollouts"}
        if unknown:
            raise ValueError(f"`options` has {sorted(unknown)}, expected `scenarios`, `rollouts`")
        for name, entries in chosen.items():
            if len(entries) != self.num_envs:
                raise ValueError(f"`{name}` has {len(entries)} entries, expected {self.num_envs}")
        self._episodes = []
        none = [None] * self.num_envs
        episodes = [
            self._core.episode(slot, self.np_random, scenario=scenario, rollout=rollout)
            for slot, (scenario, rollout) in enumerate(
                zip(chosen.get("scenarios", none), chosen.get("rollouts", none))
            )
        ]
        observation = self._core.reset(episodes)
        self._episodes, self._next = episodes, None
        self._is_over[:] = False
        return observation, self._infos()

    def step(self, actions: Any) -> tuple[Any, Array, Array, Array, dict[str, Any]]:
        """Executes an action per episode."""
        core = self._core
        if not self._episodes:
            raise ReactsimError("no episode has begun: call `reset` first")
        # A step that is refused and tried again begins the same episodes.
        if self._next is None:
            over = np.flatnonzero(self._is_over).tolist()
            self._next = [core.episode(slot, self.np_random) for slot in over]
        shape = (self.num_envs, *core.action_space.shape)
        observation, ends, arrays = core.step(actions, shape, self._next)
        for episode in self._next:
            self._episodes[episode["slot"]] = episode
        self._next = None
        measures = arrays["measures"]
        rewards = weighted(core.reward, core.measures, measures)
        rewards[self._is_over] = 0.0
        infos = self._infos()
        infos.update(zip(core.measures, measures.T.copy()))
        running = ~self._is_over
        infos.update({flag: running.copy() for flag in core.flags})
        for slot, end in ends.items():
            for name, value in end_info(end).items():
                if name not in infos:
                    infos[name] = np.full(self.num_envs, None, object)
                    infos[f"_{name}"] = np.zeros(self.num_envs, np.bool_)
                infos[name][slot] = value
                infos[f"_{name}"][slot] = True
        terminated = arrays["terminated"].astype(np.bool_)
        truncated = arrays["truncated"].astype(np.bool_)
        self._is_over = terminated | truncated
        return observation, rewards, terminated, truncated, infos

    def restart(self) -> Any:
        """Begins the next episode in place of each that is over, without a step of the others.

        For libraries whose environments begin the next episode within the last step. Returns the
        first observations of these episodes, in the order of their slots.
        """
        over = np.flatnonzero(self._is_over).tolist()
        if not over:
            raise ReactsimError("no episode is over")
        episodes = [self._core.episode(slot, self.np_random) for slot in over]
        observation = self._core.begin(episodes)
        for episode in episodes:
            self._episodes[episode["slot"]] = episode
        self._is_over[:], self._next = False, None
        return observation

    def render(self) -> tuple[Array, ...] | None:
        """Returns a picture of each episode at present, as `Env.render`."""
        if self.render_mode is None:
            return None
        return tuple(self._core.picture(index) for index in range(self.num_envs))

    def save_gif(self, path: PathLike | None, index: int, **options: Any) -> Gif:
        """Writes an animation of an episode so far; `options` are those of `Env.save_gif`."""
        return self._core.save_gif(path, index, **options)

    def _infos(self) -> dict[str, Any]:
        scenarios = [self._core.scenarios[episode["scenario"]] for episode in self._episodes]
        return {
            "scenario": np.array(scenarios, object),
            "rollout": np.array([episode["rollout"] for episode in self._episodes]),
        }

    def close_extras(self, **_: Any) -> None:
        """Ends the processes of the program."""
        self._core.close()
