"""An environment whose actions move agents, among which the AV follows a trajectory.

`ParallelEnv` has the interface of parallel environments of pettingzoo: `pip install
'reactsim[env]'`. Actions move every agent but the AV, and the AV follows its deviated trajectory,
its log or a script. Observations are described in `reactsim.environment`, in the frame of each
agent, without a route: `av` and `av_size` are then the observing agent, and the AV is one of
`agents`.

Measures of each step are in the `info` of each agent: `contact_av` and `contact_agents` (1 while
the box of the agent overlaps the box of the AV, or of another agent), `off_road` (1 while the
centre of a vehicle is off the road; NaN for other agents, and if it is unknown) and `speed` (m/s).
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .client import Array
from .display import Gif
from .environment import (
    RENDER_FPS,
    Reward,
    action_space,
    check_names,
    check_render_mode,
    checked,
    common_of,
    end_info,
    episode_of,
    known_reward,
    observation_space,
    traffic_of,
    warn_skipped,
    weighted,
)
from .options import PathLike, Sources, whole
from .pictures import SavesMp4, drawing, save_drawing
from .process import ProgramProcess
from .program import ReactsimError, text_of
from .scenarios import Scenario

try:
    import pettingzoo
    from gymnasium import spaces
except ImportError as error:
    raise ImportError(
        f"environments of many agents need gymnasium and pettingzoo ({error}): pip install"
        " 'reactsim[env]'"
    ) from None

__all__ = ["AGENT_REWARD", "ParallelEnv"]

AGENT_REWARD: Mapping[str, float] = {"contact_av": -10.0, "contact_agents": -10.0, "off_road": -1.0}
"""Default weights of the reward of an agent."""


class ParallelEnv(SavesMp4, pettingzoo.ParallelEnv[str, dict[str, Array], Array]):
    """An environment in which actions move agents, and the AV follows a trajectory.

    Agents are `agent_1`, `agent_2`, ...: those that are present at the current frame, by their
    distance to the AV. Actions move all of them, or the nearest ones (`controlled`) among others
    that `simulator` moves. `infos` has the id of each agent in its recording. An episode is
    truncated after the steps of its scenario, 80 of 0.1 s in the benchmark; `scores` of every
    `info` then has the metrics of the benchmark.

    Args:
        scenarios: Files, folders or URLs of scenarios, or one `Scenario`; the shipped benchmark by
            default. All selected scenarios are kept in memory; those that cannot be read are left
            out with a warning, unless `ids` has them.
        av: Driver of the AV: "deviated", "log", "deviated-or-log", "constant-velocity", "brake:4",
            "retime:0.8" or "shift:2".
        deviations: File of deviated AVs; for a `Scenario` the one with which it was read.
        simulator: Simulator of the agents that actions do not move, as for `Env`.
        controlled: Number of the nearest agents that actions move; all without a simulator.
        ids: Only scenarios with one of these ids; all by default.
        limit: Only the first `limit` of the selected scenarios, over all files.
        action: "bicycle" or "state", as for `Env`.
        agents: Number of the nearest agents, the AV included, that each agent observes.
        frames: Number of frames that are observed, 1 to 100, as for `Env`.
        lanes: Number of the nearest pieces of lanes that are observed.
        points: Number of points of a piece of a lane.
        lights: Number of the nearest traffic lights that are observed.
        render_mode: "rgb_array" for pictures by `render`.
        reward: Weights of measures, or a function of the measures; `AGENT_REWARD` by default.
        scores: Score episodes after their last step.
        metric_options: Variants of the metrics.
        current_frame: Index of the current frame, from 0, for formats that leave it open.
        window_step: Frames between scenarios of one recording of 20 s.
        history: Number of frames of a scenario up to and including the current one, as for `Env`.
        future: Number of steps of an episode, or a time, or "log", as for `Env`.
        all_agents: Simulate all agents that are present at the current frame.
        rolled_out: `replan`, `av_lookahead`, `seed`, `weights`, `parameters` and `external_limit`
            of the simulator, as for `Env`.

    Raises:
        ReactsimError: The program refuses a setting, an action or a scenario, or has ended, or the
            simulator has failed.

    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "render_modes": ["rgb_array"],
        "render_fps": RENDER_FPS,
        "name": "reactsim",
    }

    def __init__(
        self,
        scenarios: Sources | Scenario = None,
        *,
        av: str = "deviated",
        deviations: PathLike | None = None,
        simulator: Any = None,
        controlled: int | None = None,
        ids: Sequence[str] = (),
        limit: int | None = None,
        action: str = "bicycle",
        agents: int = 32,
        frames: int = 11,
        lanes: int = 64,
        points: int = 10,
        lights: int = 8,
        render_mode: str | None = None,
        reward: Reward | None = None,
        scores: bool = True,
        metric_options: Mapping[str, Any] | None = None,
        current_frame: int | None = None,
        window_step: int | None = None,
        history: int | None = None,
        future: int | str | None = None,
        all_agents: bool = False,
        **rolled_out: Any,
    ) -> None:
        check_render_mode(render_mode)
        self.render_mode = render_mode
        if action not in ("bicycle", "state"):
            raise ValueError(f"`action` is {action!r}, expected bicycle or state")
        if isinstance(scenarios, Scenario) and deviations is None:
            deviations = scenarios.deviations
        check_names("ParallelEnv", rolled_out)
        if simulator is None and rolled_out:
            raise ValueError(f"`{next(iter(rolled_out))}` is given without a simulator")
        if (simulator is None) != (controlled is None):
            raise ValueError("`simulator` and `controlled` are needed together")
        traffic, sessions = None, None
        if simulator is not None:
            traffic, sessions = traffic_of(simulator, 1, **rolled_out)
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
        sizes = {"agents": agents, "frames": frames, "lanes": lanes, "points": points}
        sizes |= {"lights": lights, "route": 0}
        common |= {"traffic": traffic, "action": action, "sizes": sizes}
        arguments = {
            "common": common,
            "av": av,
            "deviations": None if deviations is None else text_of(deviations),
            "controlled": None if controlled is None else whole("controlled", controlled, least=1),
        }
        self._process = ProgramProcess(sessions)
        try:
            description, _ = self._process.request("world", arguments)
            self._measures: list[str] = description["measures"]
            self._reward = known_reward(AGENT_REWARD if reward is None else reward, self._measures)
        except BaseException:
            self._process.close()
            raise
        self._scenarios: list[str] = description["scenarios"]
        warn_skipped(description, 3)
        shapes = [(name, shape) for name, shape in description["arrays"] if name != "route"]
        self._arrays: list[str] = [name for name, _ in shapes]
        self._observation_space = observation_space(shapes)
        self._action_space = action_space(action, 0)
        self.possible_agents = [f"agent_{k + 1}" for k in range(description["agents"])]
        self.agents: list[str] = []
        self._ids: list[str] = []
        self._generator = np.random.default_rng()

    @property
    def scenarios(self) -> list[str]:
        """Ids of the scenarios."""
        return list(self._scenarios)

    @property
    def states(self) -> Array:
        """Realised states so far, f64 [1 + agents, frames, 5]: the AV, then the agents.

        x, y, heading, vx, vy in the frame of the scenario, in metres, radians and m/s; NaN where
        absent or unknown.
        """
        _, arrays = self._process.request("world-tracks", {})
        return arrays["states"]

    @functools.cached_property
    def observation_spaces(self) -> dict[str, spaces.Space[Any]]:
        """Space of the observations of each agent."""
        return dict.fromkeys(self.possible_agents, self._observation_space)

    @functools.cached_property
    def action_spaces(self) -> dict[str, spaces.Space[Any]]:
        """Space of the actions of each agent."""
        return dict.fromkeys(self.possible_agents, self._action_space)

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Returns the space of the observations of an agent."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Returns the space of the actions of an agent."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, dict[str, Array]], dict[str, dict[str, Any]]]:
        """Begins an episode; `options={"scenario": id or index, "rollout": 0}` names it."""
        if seed is not None:
            self._generator = np.random.default_rng(seed)
        # Other options are ignored: the tests of pettingzoo give some.
        chosen = {k: v for k, v in (options or {}).items() if k in ("scenario", "rollout")}
        given = episode_of(self._scenarios, self._generator, **chosen)
        self.agents = []
        self._ids, arrays = self._process.request("world-reset", given)
        self.agents = self.possible_agents[: len(self._ids)]
        infos = {
            agent: {"id": id, "scenario": self._scenarios[given["scenario"]]}
            for agent, id in zip(self.agents, self._ids)
        }
        return self._observations(arrays), infos

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[
        dict[str, dict[str, Array]],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Executes an action per agent."""
        if not self.agents:
            raise ReactsimError("no episode has begun, or it is over: call `reset` first")
        if set(actions) != set(self.agents):
            missing, other = set(self.agents) - set(actions), set(actions) - set(self.agents)
            raise ValueError(
                f"`actions` lacks {sorted(missing)} and has {sorted(other)} of no agent, expected"
                " one action per agent"
            )
        shape = self._action_space.shape
        values = np.concatenate([checked(actions[agent], shape, shape) for agent in self.agents])
        end, arrays = self._process.request("world-step", {}, {"actions": values})
        measures = arrays["measures"]
        rewards = weighted(self._reward, self._measures, measures).tolist()
        infos: dict[str, dict[str, Any]] = {
            agent: {"id": id, **dict(zip(self._measures, row))}
            for agent, id, row in zip(self.agents, self._ids, measures.tolist())
        }
        observations = self._observations(arrays)
        agents = self.agents
        if end is not None:
            entries = end_info(end)
            for info in infos.values():
                info.update(entries)
            self.agents = []
        return (
            observations,
            dict(zip(agents, rewards)),
            dict.fromkeys(agents, False),
            dict.fromkeys(agents, end is not None),
            infos,
        )

    def _observations(self, arrays: Mapping[str, Array]) -> dict[str, dict[str, Array]]:
        return {
            agent: {name: arrays[name][k] for name in self._arrays}
            for k, agent in enumerate(self.agents)
        }

    def render(self) -> Array | None:
        """Returns a picture of the present step, as `Env.render`."""
        if self.render_mode is None:
            return None
        return self._process.request("world-draw", drawing(follow=True))[1]["rgb"]

    def save_gif(self, path: PathLike | None, **options: Any) -> Gif:
        """Writes an animation of the episode so far; `options` are those of `Env.save_gif`."""
        given = drawing(**{"every": 1, **options})
        return save_drawing(path, self._process.request("world-draw", given)[1])

    def close(self) -> None:
        """Ends the process of the program."""
        self._process.close()
