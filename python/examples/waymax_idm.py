"""The IDM agent of Waymax in closed loop, run by Waymax's own code.

    python waymax_idm.py [--waymax FOLDER] [options]
    reactsim run --external waymax-idm='python waymax_idm.py --waymax FOLDER'

The script needs Waymax (github.com/waymo-research/waymax), which is not on PyPI: install it with
pip from its repository, or pass a checkout with `--waymax` in an environment with jax, chex and
dm_env. Its licence allows only non-commercial use. The package `waymax` on PyPI is not Waymax.

Waymax provides `IDMRoutePolicy` with its defaults, which chooses speeds and moves agents along a
route every 0.1 s. This file fills its `SimulatorState`. Differences from Waymax:

- In Waymax, the route of an agent is its logged future, which no simulator of this benchmark may
  observe. Here, `log_trajectory` contains the centre line of the agent's lane and of the
  straightest lanes after it, joined smoothly to the pose of the agent.
- Vehicles off the lanes drive straight ahead. Vehicles that also did not move in the history are
  parked and stay. Pedestrians, cyclists and others keep their velocity, because the policy has one
  desired speed for all agents.
- Only the next state of the AV is known. In later steps of a plan it keeps its velocity.

The policy brakes for boxes in a straight strip of 10 m ahead. It ignores lights, stop signs, curves
and speed limits.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import sys
import types
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import reactsim

try:
    import jax
    import jax.numpy as jnp
except ImportError as error:
    sys.exit(f"this example needs jax, chex and dm_env: {error}")

SPACING = 0.5  # metres between the waypoints of a route
WAYPOINTS = 600  # per route: 8 s at more than the desired speed of 30 m/s
MAX_OFFSET = 2.5  # metres; vehicles farther from a centre line are not on the lane
MAX_TURN = np.pi / 3  # radians; nor are vehicles with another heading
PARKED_OFFSET = 1.1  # metres; standing vehicles farther from a centre line are parked
PARKED_TRAVEL = 0.5  # metres; vehicles that moved less in the history are standing
JOIN_TIME, JOIN_LENGTH = 2.0, 10.0  # seconds and least metres until a route is on the centre line
BUCKET = 16  # scenes are padded to multiples of so many agents: each size is compiled once


def load_waymax(folder: Path | None) -> None:
    """Makes Waymax importable.

    Its utilities import TensorFlow only for a type annotation. If TensorFlow is not installed,
    a module with the name of that type replaces it.
    """
    if folder is not None:
        if not (folder / "waymax" / "agents").is_dir():
            raise FileNotFoundError(f"{folder} is no checkout of github.com/waymo-research/waymax")
        sys.path.insert(0, str(folder))
    if importlib.util.find_spec("waymax.agents") is None:
        raise ImportError("Waymax is not installed; give a checkout with --waymax")
    if importlib.util.find_spec("tensorflow") is None:
        stand_in = types.ModuleType("tensorflow")
        stand_in.__spec__ = importlib.util.spec_from_loader("tensorflow", None)
        vars(stand_in)["Tensor"] = object
        sys.modules["tensorflow"] = stand_in


# --------------------------------------------------------------------------------------------------
# Routes.


def wrap(angle: np.ndarray) -> np.ndarray:
    """Returns angles from -pi to pi."""
    wrapped: np.ndarray = (angle + np.pi) % (2.0 * np.pi) - np.pi
    return wrapped


def headings_of(points: np.ndarray) -> np.ndarray:
    """Returns the heading of the chord after each point; the last one repeats."""
    chords = np.diff(points, axis=0)
    headings = np.arctan2(chords[:, 1], chords[:, 0])
    return np.append(headings, headings[-1:])


def straightest(lanes: list[reactsim.Lane], lane: int) -> int | None:
    """Returns the successor of a lane that turns least until its end."""
    end = headings_of(lanes[lane].points)[-1]
    turns = {k: abs(wrap(headings_of(lanes[k].points)[-1] - end)) for k in lanes[lane].successors}
    return min(turns, key=lambda k: (turns[k], k), default=None)


@dataclass
class Place:
    """The position of a vehicle on a lane."""

    lane: int
    segment: int
    along: float
    """Metres from the start of the segment."""
    offset: float
    """Metres to the left of the centre line."""
    turn: float
    """Heading relative to the lane, radians."""


def find_place(lanes: list[reactsim.Lane], pose: np.ndarray) -> Place | None:
    """Returns the lane that fits a pose best, if any does."""
    best, best_misfit = None, np.inf
    for lane in lanes:
        chords = np.diff(lane.points, axis=0)
        lengths = np.maximum(np.hypot(chords[:, 0], chords[:, 1]), 1e-9)
        ahead = chords / lengths[:, None]
        from_start = pose[:2] - lane.points[:-1]
        along = np.clip((from_start * ahead).sum(axis=1), 0.0, lengths)
        gaps = np.hypot(*(from_start - along[:, None] * ahead).T)
        k = int(gaps.argmin())
        turn = float(wrap(pose[2] - np.arctan2(ahead[k, 1], ahead[k, 0])))
        if gaps[k] > MAX_OFFSET or abs(turn) > MAX_TURN:
            continue
        misfit = gaps[k] + 2.0 * abs(turn)
        if misfit < best_misfit:
            offset = float(ahead[k, 0] * from_start[k, 1] - ahead[k, 1] * from_start[k, 0])
            best = Place(lane.index, k, float(along[k]), offset, turn)
            best_misfit = misfit
    return best


def route_along(lanes: list[reactsim.Lane], place: Place, speed: float) -> np.ndarray:
    """Returns waypoints [WAYPOINTS, 3] of x, y and heading that begin at a position on a lane."""
    first = lanes[place.lane].points
    chord = first[place.segment + 1] - first[place.segment]
    start = first[place.segment] + chord * (place.along / max(np.hypot(*chord), 1e-9))
    pieces, length = [start[None], first[place.segment + 1 :]], 0.0
    following, visited = straightest(lanes, place.lane), {place.lane}
    while length < SPACING * WAYPOINTS and following is not None and following not in visited:
        visited.add(following)
        pieces.append(lanes[following].points)
        length += np.hypot(*np.diff(lanes[following].points, axis=0).T).sum()
        following = straightest(lanes, following)
    line = np.concatenate(pieces)
    steps = np.hypot(*np.diff(line, axis=0).T)
    line = line[np.append(True, steps > 1e-6)]
    if len(line) < 2:  # the very end of the last lane
        line = np.stack([line[0], line[0] + chord])
    end = line[-1] - line[-2]
    line = np.append(line, line[-1:] + end / np.hypot(*end) * SPACING * WAYPOINTS, axis=0)
    arc = np.append(0.0, np.cumsum(np.hypot(*np.diff(line, axis=0).T)))
    at = SPACING * np.arange(WAYPOINTS + 1)
    points = np.stack([np.interp(at, arc, line[:, k]) for k in range(2)], axis=-1)
    # A cubic leads from the offset and the direction of the vehicle to the centre line.
    join = max(JOIN_LENGTH, JOIN_TIME * speed)
    u = np.minimum(at / join, 1.0)
    offset = place.offset * (2 * u**3 - 3 * u**2 + 1)
    offset += np.tan(place.turn) * join * (u**3 - 2 * u**2 + u)
    heading = headings_of(points)
    points = points + offset[:, None] * np.stack([-np.sin(heading), np.cos(heading)], axis=-1)
    return np.column_stack([points, headings_of(points)])[:WAYPOINTS]


def straight_route(pose: np.ndarray) -> np.ndarray:
    """Returns waypoints [WAYPOINTS, 3] straight ahead."""
    at = SPACING * np.arange(WAYPOINTS)
    x, y = pose[0] + at * np.cos(pose[2]), pose[1] + at * np.sin(pose[2])
    return np.column_stack([x, y, np.full(WAYPOINTS, pose[2])])


# --------------------------------------------------------------------------------------------------
# The simulator.


class Episode:
    """One scene during its rollout: the routes, and which agents follow them."""

    def __init__(self, scene: reactsim.Scene, moves_av: bool) -> None:
        count = scene.n_agents
        self.n_agents = count
        self.padded = -(-count // BUCKET) * BUCKET
        now = scene.history[:, -1]
        self.routes = np.stack([straight_route(pose) for pose in now[:, :3]])
        self.drives = np.zeros(self.padded, bool)
        """Whether the policy of Waymax moves each agent."""
        self.is_parked = np.zeros(count, bool)
        for agent in range(0 if moves_av else 1, count):
            if agent > 0 and scene.kinds[agent] != reactsim.Kind.VEHICLE:
                continue
            place = find_place(scene.lanes, now[agent, :3])
            seen = scene.history[agent, scene.valid[agent], :2]
            is_standing = np.hypot(*(seen[-1] - seen[0])) < PARKED_TRAVEL
            if is_standing and (place is None or abs(place.offset) > PARKED_OFFSET):
                self.is_parked[agent] = True
                continue
            self.drives[agent] = True
            if place is not None:
                speed = float(np.hypot(*np.nan_to_num(now[agent, 3:])))
                self.routes[agent] = route_along(scene.lanes, place, speed)
        self.sizes = scene.sizes
        self.velocity = np.nan_to_num(now[:, 3:])
        """Velocities of the policy, which are exact, instead of differences of positions."""


class WaymaxIdm(reactsim.Simulator):
    """Moves vehicles by `IDMRoutePolicy` along routes of the map."""

    name = "waymax-idm"
    version = "1"

    def __init__(self, waymax: Path | None = None, **settings: float) -> None:
        load_waymax(waymax)
        from waymax import agents, datatypes

        self.datatypes = datatypes
        policy = agents.IDMRoutePolicy(
            is_controlled_func=lambda state: state.object_metadata.is_controlled, **settings
        )

        def act(state: Any) -> Any:
            return policy.select_action({}, state, None, None).action.data

        self.act = jax.jit(act)
        self.episodes: list[Episode] = []

    def begin(self, scenes: reactsim.Scenes) -> None:
        self.episodes = [Episode(scene, scenes.moves_av) for scene in scenes]

    def plan(self, seen: reactsim.Observation) -> np.ndarray:
        plan = np.repeat(seen.states[:, :, -1:, :3], seen.steps, axis=2)
        for i in np.flatnonzero(seen.active).tolist():
            episode = self.episodes[i]
            states = np.array(seen.states[i, : episode.n_agents, -1])
            known = episode.velocity if seen.frame > 10 else np.nan_to_num(states[:, 3:])
            free = ~episode.drives[: episode.n_agents]
            states[:, 3:] = np.where(free[:, None], np.nan_to_num(states[:, 3:]), known)
            states[episode.is_parked, 3:] = 0.0
            for step in range(seen.steps):
                states = self.advance(episode, states)
                if step == 0 and not seen.moves_av and np.isfinite(seen.av_next[i, :3]).all():
                    states[0] = np.nan_to_num(seen.av_next[i])
                plan[i, : episode.n_agents, step] = states[:, :3]
            episode.velocity = states[:, 3:]
        return plan

    def advance(self, episode: Episode, states: np.ndarray) -> np.ndarray:
        """Returns the states of all agents 0.1 s later, [n, 5]."""
        moved = states.copy()
        moved[:, :2] += reactsim.DT * states[:, 3:]
        data = np.asarray(self.act(self.simulator_state(episode, states)), float)
        drives = episode.drives[: episode.n_agents]
        moved[drives] = data[: episode.n_agents][drives]
        return moved

    def simulator_state(self, episode: Episode, states: np.ndarray) -> Any:
        """Returns the Waymax state: the current agents, and routes in place of the log.

        The policy reads neither the map nor the lights; they are omitted.
        """
        n, padded = episode.n_agents, episode.padded
        rest = [(0, padded - n), (0, 0)]
        one = np.zeros((padded, 1), bool)
        one[:n] = True
        now = np.pad(states, rest)[:, None]
        routes = np.pad(episode.routes, [*rest, (0, 0)])
        sizes = np.pad(episode.sizes, rest)[:, None]
        flags = np.zeros(padded, bool)
        is_av = np.arange(padded) == 0
        types = self.datatypes
        return types.SimulatorState(
            sim_trajectory=self.trajectory(now, now[..., 3:], sizes, one),
            log_trajectory=self.trajectory(
                routes, np.zeros_like(routes[..., :2]), sizes, np.repeat(one, WAYPOINTS, axis=1)
            ),
            log_traffic_light=types.TrafficLights(
                **{name: jnp.zeros((0, 1)) for name in ("x", "y", "z")},
                **{name: jnp.zeros((0, 1), jnp.int32) for name in ("state", "lane_ids")},
                valid=jnp.zeros((0, 1), bool),
            ),
            object_metadata=types.ObjectMetadata(
                ids=jnp.arange(padded, dtype=jnp.int32),
                object_types=jnp.full(padded, types.ObjectTypeIds.VEHICLE, jnp.int32),
                is_sdc=jnp.asarray(is_av),
                is_modeled=jnp.asarray(flags),
                is_valid=jnp.asarray(one[:, 0]),
                objects_of_interest=jnp.asarray(flags),
                is_controlled=jnp.asarray(episode.drives),
            ),
            timestep=0,
        )

    def trajectory(
        self, poses: np.ndarray, velocity: np.ndarray, sizes: np.ndarray, valid: np.ndarray
    ) -> Any:
        """Returns a trajectory of Waymax from poses [n, T, 3 or more]."""
        zeros = np.zeros(valid.shape)
        columns = {
            "x": poses[..., 0],
            "y": poses[..., 1],
            "z": zeros,
            "yaw": poses[..., 2],
            "vel_x": velocity[..., 0],
            "vel_y": velocity[..., 1],
            "length": zeros + sizes[..., 0],
            "width": zeros + sizes[..., 1],
            "height": zeros,
        }
        return self.datatypes.Trajectory(
            **{name: jnp.asarray(column, jnp.float32) for name, column in columns.items()},
            valid=jnp.asarray(valid),
            timestamp_micros=jnp.zeros(valid.shape, jnp.int32),
        )

    def end(self, episodes: np.ndarray) -> None:
        self.episodes = []


def main() -> None:
    """Reads the command line and answers the program."""
    parser = argparse.ArgumentParser(description="The IDM agent of Waymax in closed loop.")
    parser.add_argument("--waymax", type=Path, help="folder of github.com/waymo-research/waymax")
    parser.add_argument(
        "--desired-vel",
        type=float,
        default=30.0,
        help="desired speed of all vehicles, m/s [default: 30, that of Waymax]",
    )
    with contextlib.redirect_stdout(sys.stderr):
        options = vars(parser.parse_args())
    reactsim.serve(WaymaxIdm(**options))


if __name__ == "__main__":
    main()
