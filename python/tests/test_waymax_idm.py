"""The example `waymax_idm.py` with the code of Waymax.

Needs jax, chex and dm_env, and Waymax: installed, or as the folder of a checkout in the environment
variable `WAYMAX_CHECKOUT`.
"""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path
from typing import Any, Dict

import numpy as np
import pytest
from fakes import Loopback, make_scenes
from reactsim.client import Array, Scenes

for package in ("jax", "chex", "dm_env"):
    pytest.importorskip(package)

import waymax_idm


def highway(*agents: Any) -> Dict[str, Array]:
    """Returns a scene with these agents (x, y, speed) along x, and one long lane after another."""
    tensors = make_scenes(episodes=1, agents=len(agents))
    for agent, (x, y, speed) in enumerate(agents):
        history = tensors["history"][0, agent]
        history[:] = 0.0
        history[:, 0] = x + 0.1 * speed * np.arange(-10, 1)
        history[:, 1] = y
        history[:, 3] = speed
    tensors["valid"][:] = 1
    for line, first in ((0, -100.0), (1, 100.0)):
        start = tensors["line_start"][line]
        x = np.linspace(first, first + 200.0, 20)
        tensors["points"][start : start + 20] = np.column_stack([x, np.zeros(20)])
    return tensors


def test_routes() -> None:
    scene = Scenes({}, highway((50.0, 0.0, 10.0), (0.0, 1.0, 10.0)))[0]
    place = waymax_idm.find_place(scene.lanes, np.array([0.0, 1.0, 0.1]))
    assert place is not None
    assert place.lane == 0
    assert place.offset == pytest.approx(1.0)
    assert place.turn == pytest.approx(0.1)
    route = waymax_idm.route_along(scene.lanes, place, speed=10.0)
    assert route.shape == (waymax_idm.WAYPOINTS, 3)
    np.testing.assert_allclose(route[0], [0.0, 1.0, 0.1], atol=0.02)
    np.testing.assert_allclose(route[41:, 1:], 0.0, atol=1e-9)
    np.testing.assert_allclose(route[41:, 0], 0.5 * np.arange(41, waymax_idm.WAYPOINTS))
    assert waymax_idm.find_place(scene.lanes, np.array([0.0, 3.0, 0.0])) is None
    assert waymax_idm.find_place(scene.lanes, np.array([0.0, 0.0, 3.0])) is None


@pytest.fixture(scope="module")
def simulator() -> Any:
    """The simulator; tests are skipped without Waymax."""
    folder = os.environ.get("WAYMAX_CHECKOUT")
    if folder is None and importlib.util.find_spec("waymax") is None:
        pytest.skip("WAYMAX_CHECKOUT is not set: a folder of github.com/waymo-research/waymax")
    return waymax_idm.WaymaxIdm(None if folder is None else Path(folder).resolve())


def roll_out(simulator: Any, tensors: Dict[str, Array], steps: int) -> Array:
    """Returns the states of all agents at all frames, [agents, 91, 5]."""
    parent = Loopback(simulator)
    assert parent.begin(tensors, steps)[0]["type"] == "begun"
    while parent.frame < 90:
        metadata, _ = parent.plan(min(steps, 90 - parent.frame))
        assert metadata["type"] == "planned", metadata
    return np.asarray(parent.states[0])


def test_free_road(simulator: Any) -> None:
    states = roll_out(simulator, highway((-50.0, 50.0, 0.0), (0.0, 0.0, 10.0)), 5)
    # The intelligent driver model with the defaults of Waymax: 2 m/s², 30 m/s, exponent 4.
    x, speed, expected = 0.0, 10.0, []
    for _ in range(80):
        faster = speed + 0.1 * 2.0 * (1.0 - (speed / 30.0) ** 4)
        x += 0.1 * (speed + faster) / 2.0
        speed = faster
        expected.append(x)
    np.testing.assert_allclose(states[1, 11:, 0], expected, atol=1e-3)
    np.testing.assert_allclose(states[1, 11:, 1:3], 0.0, atol=1e-5)
    # Neither the policy nor its velocities depend on the interval of the plans.
    other = roll_out(simulator, highway((-50.0, 50.0, 0.0), (0.0, 0.0, 10.0)), 3)
    np.testing.assert_allclose(other[1, :, :3], states[1, :, :3], atol=1e-3)


def test_leader(simulator: Any) -> None:
    parked, off_lane = (40.0, 0.0, 0.0), (40.0, 5.0, 0.0)
    states = roll_out(simulator, highway(parked, (20.0, 0.0, 5.0), off_lane), 5)
    np.testing.assert_allclose(states[2, :, :2], [[40.0, 5.0]] * 91)  # it is parked
    gap = states[0, -1, 0] - states[1, -1, 0] - 4.5
    assert 0.0 < gap < 5.0  # the follower stands behind the AV
    assert abs(states[1, -1, 0] - states[1, -2, 0]) < 0.05


def test_missing_waymax(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no checkout"):
        waymax_idm.load_waymax(tmp_path)
