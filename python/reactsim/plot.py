"""Pictures with matplotlib, which is needed only here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .client import Array, Kind, Scene
from .rows import Rollout

__all__ = ["plot_rollout", "plot_scene"]

AV_COLOR = "#e8710a"
AGENT_COLORS: dict[int, str] = {
    Kind.VEHICLE: "#4a7ab5",
    Kind.PEDESTRIAN: "#8e44ad",
    Kind.CYCLIST: "#2e8b57",
}
LINE_COLORS = {"centre": "#dddddd", "edge": "#555555", "paint": "#c9c9c9", "stop": "#c0392b"}


def plot_scene(scene: Scene, ax: Any = None, frame: int | None = None, radius: float = 60.0) -> Any:
    """Draws the map and the agents of a scene or scenario at a frame; returns the axes.

    The frame is the current one by default; later ones need a scenario that was read with its
    future. `radius` is half of the side of the picture, metres; the AV at the current frame is in
    the middle.
    """
    now, last = scene.n_history - 1, scene.n_history + scene.n_steps - 1
    frame = now if frame is None else frame
    states = scene.history if frame <= now else getattr(scene, "states", None)
    valid = scene.valid if frame <= now else getattr(scene, "present", None)
    if states is None or valid is None or not 0 <= frame < states.shape[1]:
        raise ValueError(
            f"frame {frame} is not known: it must be 0 to {now}, or 0 to {last} with the logged"
            " future"
        )
    ax = _prepare(scene, ax, radius)
    _boxes(ax, scene, states[:, frame], valid[:, frame])
    return ax


def plot_rollout(
    scene: Scene,
    rollout: Rollout | Array,
    ax: Any = None,
    step: int = 40,
    radius: float = 60.0,
) -> Any:
    """Draws a rollout on its scenario and returns the axes.

    The picture has the paths of all agents, and their boxes at a step, from 1. `rollout` is one of
    `Results.rollouts`, or states [n, steps, 3 or more] of the agents of the scene.
    """
    if isinstance(rollout, Rollout):
        order: Sequence[str] = getattr(scene, "agents", ())
        if not order:
            raise ValueError("a `Rollout` needs a scenario with ids, from `reactsim.scenarios`")
        index = {agent: k for k, agent in enumerate(rollout.agents)}
        absent = np.full(rollout.states.shape[1:], np.nan)
        states = np.stack([rollout.states[index[a]] if a in index else absent for a in order])
    else:
        states = np.asarray(rollout)
    if states.shape[0] != scene.n_agents or not 1 <= step <= states.shape[1]:
        raise ValueError(
            f"states of shape {states.shape} do not fit {scene.n_agents} agents and step {step}"
        )
    ax = _prepare(scene, ax, radius)
    for agent, (x, y) in enumerate(np.moveaxis(states[..., :2], -1, 1)):
        ax.plot(x, y, color=_color(scene, agent), lw=1, alpha=0.6, zorder=3)
    now = states[:, step - 1]
    _boxes(ax, scene, now, np.isfinite(now[:, :3]).all(axis=1))
    return ax


def _prepare(scene: Scene, ax: Any, radius: float) -> Any:
    try:
        from matplotlib import pyplot
        from matplotlib.collections import LineCollection
    except ImportError:
        text = "pictures need matplotlib: pip install 'reactsim[plot]'; Scenario.svg() does not"
        raise ImportError(text) from None
    if ax is None:
        _, ax = pyplot.subplots(figsize=(6, 6))
    groups = [
        ([lane.points for lane in scene.lanes], LINE_COLORS["centre"], 0.8),
        ([line.points for line in scene.painted_lines], LINE_COLORS["paint"], 0.8),
        ([line.points for line in scene.road_edges], LINE_COLORS["edge"], 1.2),
        ([line.points for line in scene.crosswalks], LINE_COLORS["paint"], 1.0),
        ([line.points for line in scene.stop_lines], LINE_COLORS["stop"], 1.5),
    ]
    for lines, color, width in groups:
        ax.add_collection(LineCollection(lines, colors=color, linewidths=width, zorder=1))
    ax.set_aspect("equal")
    ax.set_xlim(-radius, radius)
    ax.set_ylim(-radius, radius)
    ax.set_xlabel("x (m)")
    ax.set_ylabel("y (m)")
    return ax


def _boxes(ax: Any, scene: Scene, states: Array, valid: Array) -> None:
    from matplotlib.patches import Polygon

    for agent in np.flatnonzero(valid).tolist():
        x, y, heading = states[agent, :3]
        length, width = scene.sizes[agent]
        corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [length / 2, width / 2]
        cos, sin = np.cos(heading), np.sin(heading)
        corners = corners @ np.array([[cos, sin], [-sin, cos]]) + [x, y]
        ax.add_patch(Polygon(corners, closed=True, color=_color(scene, agent), lw=0, zorder=4))


def _color(scene: Scene, agent: int) -> str:
    return AV_COLOR if agent == 0 else AGENT_COLORS.get(int(scene.kinds[agent]), "#777777")
