"""Measure how time and memory grow with agents, lanes, steps, scenarios and threads.

Scenarios are the roads of `road.py`; one size varies at a time. Seconds are processor time of a
whole process (wall time for threads), with reading, all metrics and the table; those of SUMO and of
the environment of Waymax are of steps of the same cars alone. The best of three runs counts; of
Waymax, steps of one scenario are measured and multiplied. The last plot is that of
`scoring.py`. Writes a table to stdout and a picture.

    PYTHONPATH=python REACTSIM_BINARY=target/release/reactsim python benches/scaling.py \
        target/release/reactsim docs/scaling.svg --waymax CHECKOUT --scorer PYTHON
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


def point(program, home, sizes, waymax):
    """Return what `measure` returns, and the processor seconds of SUMO and Waymax or None."""
    road.LANES, road.CARS_PER_LANE, road.STEPS = sizes["lanes"], sizes["cars"], sizes["steps"]
    road.LENGTH = road.length(sizes["cars"], sizes["steps"])
    road.write(home / "json", sizes["scenarios"])
    native = home / "road.parquet"
    subprocess.run([program, "convert", "-q", home / "json", "--out", native], check=True)
    options = "--models idm --av brake:4 --all-agents --quiet".split()
    found = measure([program, "run", native, *options, "--jobs", sizes.get("threads", 1)])
    if "threads" in sizes or sizes["scenarios"] > 1000:
        return *found, None, None
    other = None
    if waymax:
        script = Path(__file__).with_name("environment.py")
        command = [sys.executable, script, "--waymax", waymax, "--steps-of", native]
        other = float(subprocess.check_output(command)) * sizes["steps"] * sizes["scenarios"]
    net = road.write_sumo_network(home)
    if not net:
        return *found, None, other
    sumo = [sys.executable, road.__file__, "--count", sizes["scenarios"]]
    sumo += ["--size", road.LANES, road.CARS_PER_LANE, road.STEPS, round(road.LENGTH)]
    command = list(map(str, [*sumo, "--sumo-process", net, "move"]))
    printed = [subprocess.check_output(command, text=True) for _ in range(ROUNDS)]
    return *found, min(float(text.split()[-1]) for text in printed), other


def draw(measured, scored, picture):
    """Draw the points of every axis, and cars and processor seconds of both scorers."""
    columns = len(AXES) + bool(scored)
    figure, plots = pyplot.subplots(1, columns, figsize=(3 * columns, 3.4), layout="constrained")
    for (axis, points), plot in zip(measured.items(), plots, strict=False):
        sizes = [point[0] for point in points]
        seconds = [point[2 if axis == "threads" else 1] for point in points]
        plot.loglog(sizes, seconds, "o-", color="C0", label="reactsim, s")
        for column, name, style in ((4, "SUMO", "C1s--"), (5, "Waymax", "C3D--")):
            others = [(point[0], point[column]) for point in points if point[column] is not None]
            if others:
                plot.loglog(*zip(*others, strict=True), style, label=f"{name}'s steps, s")
        memory = [point[3] / 100 for point in points]
        plot.loglog(sizes, memory, "^:", color="C2", label="memory, 100 MB")
        plot.set(xlabel=axis, xticks=sizes, xticklabels=sizes)
    if scored:
        cars, own, official = zip(*scored, strict=True)
        plots[-1].loglog(cars, own, "o-", color="C0", label="reactsim score, s")
        plots[-1].loglog(cars, official, "v--", color="C4", label="official scorer, s")
        plots[-1].set(xlabel="objects, 32 rollouts", xticks=cars, xticklabels=map(int, cars))
        plots[-1].legend(fontsize=8)
    for plot in plots:
        plot.xaxis.minorticks_off()
        plot.grid(alpha=0.3)
    plots[0].legend(fontsize=8)
    figure.savefig(picture, metadata={"Date": None})


def main():
    """Measure all axes, print the table and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("reactsim")
    parser.add_argument("picture", type=Path)
    parser.add_argument("--waymax", type=Path, help="folder of github.com/waymo-research/waymax")
    parser.add_argument("--scorer", help="a Python that has the official scorer")
    arguments = parser.parse_args()
    print("| axis | size | processor s | wall s | MB | SUMO, s | Waymax, s |\n|---|" + "--:|" * 6)
    measured = {axis: [] for axis in AXES}
    for axis, variants in AXES.items():
        for variant in variants:
            sizes = USUAL | variant
            size = sizes["lanes"] * sizes["cars"] if axis == "agents" else sizes[axis]
            with tempfile.TemporaryDirectory() as folder:
                found = point(arguments.reactsim, Path(folder), sizes, arguments.waymax)
            measured[axis].append((size, *found))
            cells = " | ".join("-" if value is None else f"{value:.2f}" for value in found)
            print(f"| {axis} | {size} | {cells} |", flush=True)
    scored = []
    if arguments.scorer:
        command = [arguments.scorer, Path(__file__).with_name("scoring.py"), arguments.reactsim]
        printed = subprocess.check_output(command, text=True)
        scored = [list(map(float, line.split())) for line in printed.splitlines()]
        print(printed)
    draw(measured, scored, arguments.picture)


if __name__ == "__main__":
    main()
