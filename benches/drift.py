"""Measure and draw what drifts when traffic is simulated for a long time.

Generates scenarios, runs simulators on them with the AV on its log and agents that enter as in the
log, and draws per second: the density around the AV, the mean speed, the share of agents that are
off the road (next to it, and past the end of the last lane of a road), and the share that touch
another agent. Writes
`docs/drift.svg` and prints a table of every tenth second. Needs reactsim[plot].

    REACTSIM_BINARY=target/release/reactsim PYTHONPATH=python python benches/drift.py
"""

import argparse
import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np
import reactsim

PAGE = Path(__file__).resolve().parent.parent / "docs" / "drift.svg"
STEPS_PER_SECOND = 10
# Radius around the AV in which density and speed are measured, metres.
NEAR = 50.0
# Agents that move less than this in the log are parked or stand, metres.
MOVED = 2.0
# Agents that leave the road this close to the end of a lane without successor pass its end, metres.
LANE_END = 12.0
# The panels: title, numerator and denominator of each second.
PANELS = {
    "Agents within 50 m of the AV": ("near", "scenarios"),
    "Speed of moving agents within 50 m (m/s)": ("speed", "moving"),
    "Next to the road (% of agents)": ("next_to", "agents"),
    "Past the end of a road of the map (% of agents)": ("past_end", "agents"),
    "In a collision between agents (% of agents)": ("collision", "agents"),
}


def measure(results, scenarios, seconds):
    """Return sums per simulator and quantity, f64 [seconds], at the end of each second."""
    sums = defaultdict(lambda: defaultdict(lambda: np.zeros(seconds)))
    at = np.arange(1, seconds + 1) * STEPS_PER_SECOND - 1
    moved, ends = {}, {}
    for scenario in scenarios:
        last = [lane.points[-1] for lane in scenario.lanes if not lane.successors]
        ends[scenario.id] = np.array(last).reshape(-1, 2)
    for rollout in results.rollouts(simulator="log-replay"):
        position = rollout.states[..., :2]
        extent = np.nanmax(position, axis=1) - np.nanmin(position, axis=1)
        moved[rollout.scenario] = dict(zip(rollout.agents, np.hypot(*extent.T) > MOVED))
    for rollout in results.rollouts():
        of = sums[rollout.simulator]
        states = rollout.states[:, at]
        present = np.isfinite(states[1:, :, 0])
        away = states[1:, :, :2] - states[0, :, :2]
        near = present & (np.hypot(away[..., 0], away[..., 1]) <= NEAR)
        moves = np.array([moved[rollout.scenario].get(a, True) for a in rollout.agents[1:]])
        moving = near & moves[:, None]
        speed = np.hypot(states[1:, :, 3], states[1:, :, 4])
        of["scenarios"] += 1
        of["agents"] += present.sum(axis=0)
        of["near"] += near.sum(axis=0)
        of["moving"] += moving.sum(axis=0)
        of["speed"] += np.where(moving, speed, 0.0).sum(axis=0)
    touching = defaultdict(set)
    for event in results.events.to_dict("records"):
        seconds_in = np.flatnonzero((event["step"] <= at + 1) & (at + 1 <= event["last_step"]))
        if event["metric"] == "offroad":
            away = ends[event["scenario"]] - [event["value_x"], event["value_y"]]
            is_end = (np.hypot(away[:, 0], away[:, 1]) <= LANE_END).any()
            sums[event["simulator"]]["past_end" if is_end else "next_to"][seconds_in] += 1
        elif event["metric"] == "aa-collision":
            for second in seconds_in:
                place = event["simulator"], second, event["scenario"]
                touching[place] |= {event["agent"], event["partner"]}
    for (simulator, second, _), agents in touching.items():
        sums[simulator]["collision"][second] += len(agents)
    return sums


def series(of, panel):
    """Return the values of a panel per second, f64 [seconds]."""
    above, below = PANELS[panel]
    factor = 100.0 if "%" in panel else 1.0
    return factor * of[above] / np.maximum(of[below], 1)


def draw(sums, seconds):
    """Draw the panels into the document."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams.update({"svg.hashsalt": "drift", "font.size": 8})
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(len(PANELS), 1, figsize=(5.6, 8.0), sharex=True)
    for panel, axis in zip(PANELS, axes):
        for simulator, of in sums.items():
            axis.plot(range(1, seconds + 1), series(of, panel), label=simulator, linewidth=1.2)
        axis.set_title(panel, loc="left", fontsize=8)
        axis.set_ylim(bottom=0)
        axis.grid(alpha=0.3)
    axes[0].legend(ncols=len(sums), frameon=False)
    axes[-1].set_xlabel("Time (s)")
    figure.tight_layout()
    figure.savefig(PAGE, metadata={"Date": None})


def main():
    """Generate, run, measure and draw."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=100, help="scenarios (default: 100)")
    parser.add_argument("--seconds", type=int, default=30, help="length (default: 30)")
    parser.add_argument("--models", default="log-replay,idm,ntp-guarded", help="with log-replay")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        logs, future = Path(folder) / "logs.parquet", f"{arguments.seconds}s"
        options = {"count": arguments.count, "seed": 7, "future": future, "out": logs}
        reactsim.command("generate", preset="train", **options)
        results = reactsim.run(
            scenarios=logs,
            baselines=arguments.models.split(","),
            av="log",
            future="log",
            out=Path(folder) / "run",
            options=["--entering", "log"],
        )
        scenarios = list(reactsim.scenarios(logs, future="log"))
        sums = measure(results, scenarios, arguments.seconds)
    draw(sums, arguments.seconds)
    shown = [1, *range(10, arguments.seconds + 1, 10)]
    for panel in PANELS:
        print(f"\n{panel}, after {', '.join(map(str, shown))} s")
        for simulator, of in sums.items():
            print(f"{simulator:14}", *(f"{series(of, panel)[s - 1]:7.2f}" for s in shown))


if __name__ == "__main__":
    main()
