#!/usr/bin/env python3
"""Throughput of environments: `reactsim.VectorEnv` and the environment of Waymax, in one run.

    PYTHONPATH=python REACTSIM_BINARY=PROGRAM python3 benches/environment.py --waymax CHECKOUT

Both step the same scenarios of the shipped benchmark with constant actions (acceleration and
curvature of a bicycle) of the AV, an intelligent driver model as traffic, the observation of the AV
and a reward from contacts and the road. Waymax runs its `PlanningAgentEnvironment` with
`IDMRoutePolicy` and `sdc_observation_from_state`, compiled for the batch; compilation is not timed.
A decision is one step of one AV, and a state step one step of one present agent; Waymax pads every
scenario to 128 objects and 20,000 points of the map, as for its datasets. Without `--waymax`, only
this program is measured.

Needs gymnasium; for Waymax a checkout of github.com/waymo-research/waymax, jax, chex, dm_env, flax.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import time
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import reactsim

OBJECTS = 128  # Waymax's default
MAP_POINTS = 20_000  # of the dataset configurations of Waymax
OBSERVED_POINTS = 1000  # default of `sdc_observation_from_state`
STEPS = 80
SEED = 1


def median_rate(step: Any, per_step: int, steps: int) -> float:
    """Returns `per_step` per second: the median over 5 rounds of so many steps."""
    rates = []
    for _ in range(5):
        start = time.perf_counter()
        for _ in range(steps):
            step()
        rates.append(steps * per_step / (time.perf_counter() - start))
    return float(np.median(rates))


def ours(count: int, ids: list[str], agents: int, steps: int) -> float:
    """Returns state steps per second of `VectorEnv`."""
    envs = reactsim.VectorEnv(simulator="idm", ids=ids, num_envs=count, scores=False)
    envs.reset(seed=SEED, options={"scenarios": ids, "rollouts": [0] * count})
    actions = np.zeros((count, 2), np.float32)
    rate = median_rate(lambda: envs.step(actions), agents, steps)
    envs.close()
    return rate


# --------------------------------------------------------------------------------------------------
# Waymax.


def load_waymax(folder: Path) -> None:
    """Makes a checkout importable. It reads datasets with TensorFlow, which is not needed here."""
    sys.path.insert(0, str(folder))
    if importlib.util.find_spec("tensorflow") is None:
        sys.modules["tensorflow"] = MagicMock()


def padded(values: np.ndarray, count: int) -> np.ndarray:
    """Returns the first `count` rows, with zeros after the last one."""
    rest = [(0, max(0, count - len(values)))] + [(0, 0)] * (values.ndim - 1)
    return np.pad(values[:count], rest)


def map_points(scene: reactsim.Scene) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Returns position, direction, type and id of points of lanes and road edges."""
    lines = [(lane.points, 2) for lane in scene.lanes]
    lines += [(edge.points, 15) for edge in scene.road_edges]
    lines += [(ring, 15) for area in scene.drivable_areas for ring in area]
    points, directions, kinds, ids = [], [], [], []
    for index, (line, kind) in enumerate(lines):
        ahead = np.diff(line, axis=0, append=2 * line[-1:] - line[-2:-1])
        points.append(line)
        directions.append(ahead / np.maximum(np.hypot(*ahead.T), 1e-9)[:, None])
        kinds.append(np.full(len(line), kind))
        ids.append(np.full(len(line), index))
    return tuple(np.concatenate(part) for part in (points, directions, kinds, ids))


def waymax_state(scenes: list[reactsim.Scenario], n_objects: int, n_points: int) -> Any:
    """Returns the state of Waymax with the logs of scenarios, with a batch dimension."""
    import jax.numpy as jnp
    from waymax import datatypes

    columns: dict[str, list[np.ndarray]] = {}

    def add(**values: np.ndarray) -> None:
        for name, value in values.items():
            columns.setdefault(name, []).append(value)

    for scene in scenes:
        states = padded(np.nan_to_num(scene.states), n_objects)
        valid = padded(scene.present, n_objects)
        sizes = np.repeat(padded(scene.sizes, n_objects)[:, None], states.shape[1], axis=1)
        of_map = map_points(scene)
        points, directions, kinds, ids = (padded(part, n_points) for part in of_map)
        add(states=states, valid=valid, sizes=sizes, kinds=padded(scene.kinds, n_objects))
        add(points=points, directions=directions, types=kinds, ids=ids)
        add(known=np.arange(n_points) < len(of_map[0]))
    batch = {name: jnp.asarray(np.stack(values)) for name, values in columns.items()}
    states, valid, sizes = batch["states"].astype(jnp.float32), batch["valid"], batch["sizes"]
    zeros = jnp.zeros(valid.shape, jnp.float32)
    lights = (len(scenes), 16, valid.shape[-1])
    times = jnp.arange(valid.shape[-1], dtype=jnp.int32) * 100_000
    log = datatypes.Trajectory(
        **dict(zip(("x", "y", "yaw", "vel_x", "vel_y"), jnp.moveaxis(states, -1, 0))),
        z=zeros,
        length=sizes[..., 0].astype(jnp.float32),
        width=sizes[..., 1].astype(jnp.float32),
        height=zeros + 1.5,
        valid=valid,
        timestamp_micros=jnp.broadcast_to(times, valid.shape),
    )
    objects = valid.shape[:2]
    is_av = jnp.broadcast_to(jnp.arange(n_objects) == 0, objects)
    none = jnp.zeros(objects, bool)
    points, directions = batch["points"], batch["directions"]
    return datatypes.SimulatorState(
        sim_trajectory=log,
        log_trajectory=log,
        log_traffic_light=datatypes.TrafficLights(
            **{name: jnp.zeros(lights) for name in ("x", "y", "z")},
            **{name: jnp.zeros(lights, jnp.int32) for name in ("state", "lane_ids")},
            valid=jnp.zeros(lights, bool),
        ),
        object_metadata=datatypes.ObjectMetadata(
            ids=jnp.broadcast_to(jnp.arange(n_objects, dtype=jnp.int32), objects),
            # Vehicle 1, pedestrian 2, cyclist 3, other 4.
            object_types=batch["kinds"].astype(jnp.int32) + 1,
            is_sdc=is_av,
            is_modeled=none,
            is_valid=valid.any(-1),
            objects_of_interest=none,
            is_controlled=valid.any(-1),
        ),
        roadgraph_points=datatypes.RoadgraphPoints(
            x=points[..., 0].astype(jnp.float32),
            y=points[..., 1].astype(jnp.float32),
            z=jnp.zeros(points.shape[:2], jnp.float32),
            dir_x=directions[..., 0].astype(jnp.float32),
            dir_y=directions[..., 1].astype(jnp.float32),
            dir_z=jnp.zeros(points.shape[:2], jnp.float32),
            types=batch["types"].astype(jnp.int32),
            ids=batch["ids"].astype(jnp.int32),
            valid=batch["known"],
        ),
        timestep=jnp.array(0),
    )


def waymax_step(
    scenes: list[reactsim.Scenario],
    n_objects: int = OBJECTS,
    n_points: int = MAP_POINTS,
    decides: bool = True,
) -> Any:
    """Returns a function that steps Waymax; to decide, with observation and reward."""
    import jax
    import jax.numpy as jnp
    from waymax import agents as drivers
    from waymax import config, datatypes, dynamics, env

    idm = drivers.IDMRoutePolicy(is_controlled_func=lambda state: ~state.object_metadata.is_sdc)
    environment = env.PlanningAgentEnvironment(
        dynamics.InvertibleBicycleModel(),
        config.EnvironmentConfig(max_num_objects=n_objects),
        sim_agent_actors=(idm,),
        sim_agent_params=({},),
    )
    count = len(scenes)
    action = datatypes.Action(data=jnp.zeros((count, 2)), valid=jnp.ones((count, 1), bool))

    @jax.jit
    def advance(state: Any) -> tuple[Any, Any, Any]:
        state = environment.step(state, action)
        if not decides:
            return state, None, None
        seen = datatypes.sdc_observation_from_state(state, roadgraph_top_k=OBSERVED_POINTS)
        return state, environment.reward(state, action), seen

    start = environment.reset(waymax_state(scenes, n_objects, n_points))
    now = {"state": start}

    def step() -> None:
        if int(now["state"].timestep) >= 10 + STEPS:
            now["state"] = start
        now["state"], reward, seen = advance(now["state"])
        jax.block_until_ready((now["state"], reward, seen))

    step()
    return step


def seconds_per_step(file: Path) -> float:
    """Returns processor seconds of a step of the first scenario of a file, without padding."""
    (scene,) = reactsim.scenarios(file, limit=1, future=True)
    step = waymax_step([scene], scene.n_agents, len(map_points(scene)[0]), decides=False)
    times = []
    for _ in range(10):
        start = time.process_time()
        step()
        times.append(time.process_time() - start)
    return min(times)


def main() -> None:
    """Measures both and prints a table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--waymax", type=Path, help="folder of github.com/waymo-research/waymax")
    parser.add_argument("--envs", type=int, nargs="+", default=[1, 16, 64], help="scenarios")
    parser.add_argument("--steps", type=int, default=100, help="steps of each of 5 rounds")
    parser.add_argument("--waymax-steps", type=int, default=2, help="the same for Waymax")
    parser.add_argument(
        "--steps-of", type=Path, metavar="FILE", help="print only `seconds_per_step` of a file"
    )
    options = parser.parse_args()
    if options.waymax is not None:
        load_waymax(options.waymax)
    if options.steps_of is not None:
        print(seconds_per_step(options.steps_of))
        return
    scenes = list(reactsim.scenarios(limit=max(options.envs), future=True))
    names = ["scenarios", "agents", "decisions per second", "state steps per second"]
    print(f"| {' | '.join([*names, 'Waymax', 'ratio'])} |\n|{'--:|' * 6}")
    for count in options.envs:
        some = scenes[:count]
        agents = sum(scene.n_agents for scene in some)
        own = ours(count, [scene.id for scene in some], agents, options.steps)
        other = None
        if options.waymax is not None:
            other = median_rate(waymax_step(some), agents, options.waymax_steps)
        compared = f"{other:,.0f} | {own / other:.1f}" if other is not None else "- | -"
        decisions = own * count / agents
        print(f"| {count} | {agents} | {decisions:,.0f} | {own:,.0f} | {compared} |", flush=True)


if __name__ == "__main__":
    main()
