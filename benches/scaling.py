"""Measure how time and memory grow with agents, lanes, steps, scenarios and threads.

Scenarios are the roads of `road.py`; one size varies at a time. Seconds are processor time of a
whole process (wall time for threads), with reading, all metrics and the table; SUMO's are those of
its steps of the same cars alone. The best of three runs counts. Writes a table to stdout and a
picture.

    python benches/scaling.py target/release/reactsim docs/scaling.svg
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import matplotlib as mpl
import road
from matplotlib import pyplot

mpl.use("svg")
ROUNDS = 3
# Lanes, cars per lane, steps and scenarios of the usual road.
USUAL = {"lanes": 4, "cars": 16, "steps": 80, "scenarios": 64}
AXES = {
    "agents": [{"cars": cars} for cars in (2, 4, 8, 16, 32, 64, 128)],
    "lanes": [{"lanes": lanes, "cars": 64 // lanes} for lanes in (2, 4, 8, 16, 32)],
    "steps": [{"steps": steps} for steps in (80, 150, 300, 600)],
    "scenarios": [{"scenarios": count} for count in (10, 100, 1000, 10_000)],
    "threads": [{"scenarios": 400, "threads": threads} for threads in (1, 2, 4, 8, 16)],
}


def measure(command):
    """Return processor seconds, wall seconds and megabytes of the best of several runs."""
    results = []
    for _ in range(ROUNDS):
        begin = time.monotonic()
        process = subprocess.Popen(list(map(str, command)), stdout=subprocess.DEVNULL)
        _, status, used = os.wait4(process.pid, 0)
        if status != 0:
            sys.exit(f"{command}: status {status}")
        wall = time.monotonic() - begin
        results.append((used.ru_utime + used.ru_stime, wall, used.ru_maxrss / 1024))
    return [min(column) for column in zip(*results, strict=True)]


def point(program, home, sizes):
    """Return what `measure` returns for reactsim, and the processor seconds of SUMO or None."""
    road.LANES, road.CARS_PER_LANE, road.STEPS = sizes["lanes"], sizes["cars"], sizes["steps"]
    # Room for all cars, at their distances, up to the end of the scenario.
    road.LENGTH = 200.0 + 45.0 * sizes["cars"] + 1.4 * sizes["steps"]
    road.write(home / "json", sizes["scenarios"])
    native = home / "road.parquet"
    subprocess.run([program, "convert", "-q", home / "json", "--out", native], check=True)
    options = "--models idm --av brake:4 --all-agents --quiet".split()
    found = measure([program, "run", native, *options, "--jobs", sizes.get("threads", 1)])
    net = road.write_sumo_network(home)
    if not net or "threads" in sizes or sizes["scenarios"] > 1000:
        return *found, None
    sumo = [sys.executable, road.__file__, "--count", sizes["scenarios"]]
    sumo += ["--size", road.LANES, road.CARS_PER_LANE, road.STEPS, round(road.LENGTH)]
    command = list(map(str, [*sumo, "--sumo-process", net, "move"]))
    printed = [subprocess.check_output(command, text=True) for _ in range(ROUNDS)]
    return *found, min(float(text.split()[-1]) for text in printed)


def draw(measured, picture):
    """Draw size, processor s, wall s, MB and the seconds of SUMO, of the points of every axis."""
    figure, plots = pyplot.subplots(1, len(AXES), figsize=(15, 3.4), layout="constrained")
    for (axis, points), plot in zip(measured.items(), plots, strict=True):
        sizes = [point[0] for point in points]
        seconds = [point[2 if axis == "threads" else 1] for point in points]
        plot.loglog(sizes, seconds, "o-", color="C0", label="reactsim, s")
        sumo = [(point[0], point[4]) for point in points if point[4] is not None]
        if sumo:
            plot.loglog(*zip(*sumo, strict=True), "s--", color="C1", label="SUMO's steps, s")
        memory = [point[3] / 100 for point in points]
        plot.loglog(sizes, memory, "^:", color="C2", label="memory, 100 MB")
        plot.set(xlabel=axis, xticks=sizes, xticklabels=sizes)
        plot.xaxis.minorticks_off()
        plot.grid(alpha=0.3)
    plots[0].legend(fontsize=8)
    figure.savefig(picture, metadata={"Date": None})


def main():
    """Measure all axes, print the table and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("reactsim")
    parser.add_argument("picture", type=Path)
    arguments = parser.parse_args()
    print(
        "| axis | size | processor s | wall s | MB | SUMO, processor s |\n|---|--:|--:|--:|--:|--:|"
    )
    measured = {axis: [] for axis in AXES}
    for axis, variants in AXES.items():
        for variant in variants:
            sizes = USUAL | variant
            size = sizes["lanes"] * sizes["cars"] if axis == "agents" else sizes[axis]
            with tempfile.TemporaryDirectory() as folder:
                found = point(arguments.reactsim, Path(folder), sizes)
            measured[axis].append((size, *found))
            cells = " | ".join("-" if value is None else f"{value:.2f}" for value in found)
            print(f"| {axis} | {size} | {cells} |", flush=True)
    draw(measured, arguments.picture)


if __name__ == "__main__":
    main()
