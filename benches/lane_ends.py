#!/usr/bin/env python3
"""Count the scenarios of a run in which the AV stands at the end of a lane on a free road.

    reactsim run LOGS --av planner:idm --models log-replay --keep-rollouts --out RUN
    python benches/lane_ends.py RUN LOGS

A planner that stops there has lost its route: no light, agent or obstacle is ahead. The run needs
its rollouts. Exit code 1 if there is such a scenario.
"""

from __future__ import annotations

import sys

import numpy as np
import reactsim

STANDING = 0.5
"""Speed up to which the AV stands in the last second, m/s."""
NEAR = 6.0
"""Largest distance along the lane from the front of the AV to its end, metres."""
AHEAD = 20.0
"""Length of the road ahead that is searched for agents, obstacles and lights, metres."""
ASIDE = 3.0
"""Half-width of this road, metres."""
STOPS = [int(light) for light in reactsim.Light if "STOP" in light.name or "CAUTION" in light.name]
"""States of lights that can stop drivers."""


def lane_end(
    scenario: reactsim.Scenario, centre: np.ndarray, heading: float, front: float
) -> str | None:
    """Return the lane whose end is before the AV, if it is along one."""
    along = np.array([np.cos(heading), np.sin(heading)])
    for lane in scenario.lanes:
        last = lane.points[-1]
        direction = (last - lane.points[-2]) / max(np.linalg.norm(last - lane.points[-2]), 1e-9)
        gap = last - centre
        # Planners stop with their centre or their rear axle at the end.
        if direction @ along > 0.7 and -2 * front <= gap @ along - front <= NEAR:
            if abs(gap[0] * along[1] - gap[1] * along[0]) < 1.75:
                return str(lane.index)
    return None


def is_free(
    scenario: reactsim.Scenario, others: np.ndarray, pose: np.ndarray, front: float
) -> bool:
    """Return whether no agent, obstacle or light that can stop drivers is ahead."""
    along = np.array([np.cos(pose[2]), np.sin(pose[2])])
    obstacles = [obstacle[:2] for obstacle in np.asarray(scenario.obstacles).reshape(-1, 5)]
    stops = scenario.lights.stop[np.isin(scenario.light_future[:, -10:], STOPS).any(axis=1)]
    # The front may be beyond the stop line.
    points = [(point, 0.0) for point in [*others, *obstacles]] + [(stop, -front) for stop in stops]
    for point, least in points:
        gap = np.asarray(point)[:2] - pose[:2]
        if least < gap @ along < AHEAD and abs(gap[0] * along[1] - gap[1] * along[0]) < ASIDE:
            return False
    return True


def main() -> int:
    run, source = sys.argv[1:]
    scenarios = {scenario.id: scenario for scenario in reactsim.scenarios(source)}
    found, total = [], 0
    for rollout in reactsim.Results(run).rollouts():
        total += 1
        scenario = scenarios[rollout.scenario]
        av, others = rollout.states[0], rollout.states[1:, -1]
        if np.hypot(av[-10:, 3], av[-10:, 4]).max() > STANDING:
            continue
        front = 0.5 * scenario.sizes[0, 0]
        lane = lane_end(scenario, av[-1, :2], av[-1, 2], front)
        if lane and is_free(scenario, others[~np.isnan(others[:, 0])], av[-1, :3], front):
            found.append(f"{rollout.scenario}: at ({av[-1, 0]:.1f}, {av[-1, 1]:.1f})")
    print(f"{len(found)} of {total} rollouts end with the AV standing at a lane end on a free road")
    print("\n".join(found))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
