"""Measure and draw what runs cost: time and memory against size.

Runs `idm` with all metrics on the road of `road.py` (and SUMO's IDM beside it), with one quantity
at a time taken from small to large: agents of a scenario, lanes, scenarios, steps, threads. Writes
`docs/scaling.svg` and prints the numbers. Needs reactsim[plot]; SUMO is
`pip install eclipse-sumo libsumo`.

    python benches/scaling.py target/release/reactsim
"""

import argparse
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import road

PAGE = Path(__file__).resolve().parent.parent / "docs" / "scaling.svg"
ROUNDS = 3
# The quantities: values, and the scenarios of each: lanes, cars per lane, steps, scenarios, threads.
AXES = {
    "Agents": ([8, 16, 32, 64], lambda n: (4, n // 4, 80, 100, 1)),
    "Lanes": ([1, 2, 4, 8, 16, 32], lambda n: (n, max(1, 32 // n), 80, 100, 1)),
    "Steps": ([80, 150, 300, 600], lambda n: (4, 8, n, 40, 1)),
    "Scenarios": ([10, 100, 1000, 10_000], lambda n: (4, 4, 80, n, 1)),
    "Threads": ([1, 2, 4, 8], lambda n: (4, 16, 80, 400, n)),
}


def measure(command, jobs):
    """Return seconds (of the processor; of the clock for several threads) and peak memory (MB)."""
    best, memory = math.inf, 0.0
    for _ in range(ROUNDS):
        began = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _, status, usage = os.wait4(process.pid, 0)
        if os.waitstatus_to_exitcode(status) != 0:
            sys.exit(f"failed: {' '.join(map(str, command))}")
        clock = time.perf_counter() - began
        used = usage.ru_utime + usage.ru_stime if jobs is None else clock
        best, memory = min(best, used), max(memory, usage.ru_maxrss / 1024)
    return best, memory


def measure_axis(program, axis, home):
    """Return value, seconds, memory and seconds of SUMO's process for each value of an axis."""
    values, of = AXES[axis]
    for value in values:
        road.LANES, road.CARS_PER_LANE, road.STEPS, count, threads = of(value)
        if axis == "Threads" and value > os.cpu_count():
            break
        folder = home / f"{axis}-{value}"
        road.write(folder / "json", count)
        file = folder / "road.parquet"
        future = ["--future", str(road.STEPS)]
        convert = [program, "convert", "--quiet", folder / "json", *future, "--out", file]
        subprocess.run(convert, check=True, stdout=subprocess.DEVNULL)
        command = [program, "run", file, *future, "--models", "idm", "--av", "brake:4", "--quiet"]
        command += ["--jobs", str(threads)]
        seconds, memory = measure(command, threads if axis == "Threads" else None)
        sumo = None
        net = road.write_sumo_network(folder) if axis in ("Agents", "Lanes", "Steps") else None
        if net:
            shape = [str(n) for n in (road.LANES, road.CARS_PER_LANE, road.STEPS, count)]
            sumo, _ = measure([sys.executable, __file__, "--sumo-process", net, *shape], None)
        yield value, seconds, memory, sumo


def draw(measured):
    """Draw the lines into the document."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams.update({"svg.hashsalt": "scaling", "font.size": 8})
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, len(measured), figsize=(2.2 * len(measured), 4.4))
    for (name, rows), (above, below) in zip(measured.items(), axes.T):
        values, seconds, memory, sumo = zip(*rows)
        above.plot(values, seconds, "o-", label="reactsim, all metrics", linewidth=1.2, markersize=3)
        if None not in sumo:
            above.plot(values, sumo, "s-", label="SUMO", linewidth=1.2, markersize=3)
        slope = -1 if name == "Threads" else 1
        line = [seconds[0] * (value / values[0]) ** slope for value in values]
        above.plot(values, line, ":", color="gray", label="straight line", linewidth=1)
        below.plot(values, memory, "o-", linewidth=1.2, markersize=3)
        above.set_title(name, loc="left", fontsize=8)
        below.set_ylim(0, 2 * max(max(row[2] for row in rows) for rows in measured.values()))
        for axis in (above, below):
            axis.set_xscale("log", base=10 if name == "Scenarios" else 2)
            axis.grid(alpha=0.3)
        above.set_yscale("log")
    axes[0][0].set_ylabel("Time (s)")
    axes[1][0].set_ylabel("Peak memory (MB)")
    axes[0][0].legend(frameon=False, fontsize=6)
    figure.tight_layout()
    figure.savefig(PAGE, metadata={"Date": None})


def main():
    """Measure all axes, draw and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("reactsim", nargs="?", default="target/release/reactsim")
    parser.add_argument("--sumo-process", nargs=5, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.sumo_process:
        net, *shape = arguments.sumo_process
        road.LANES, road.CARS_PER_LANE, road.STEPS, count = map(int, shape)
        road.sumo_process(net, count, reads=True)
        return
    measured = {}
    for name in AXES:
        with tempfile.TemporaryDirectory() as folder:
            measured[name] = list(measure_axis(arguments.reactsim, name, Path(folder)))
        print(f"\n{name}: value, seconds, MB, seconds of SUMO")
        for row in measured[name]:
            print(*(number if number is None else f"{number:.6g}" for number in row))
    draw(measured)


if __name__ == "__main__":
    main()
