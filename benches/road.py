"""Measure `idm` on a straight road, beside another release and beside SUMO.

The road is 2 km long and has four lanes with 16 cars each; a scenario lasts 80 steps of 0.1 s.
Every figure is agent-steps of agents that are present per CPU second of a whole process: for
reactsim with reading, all metrics and the table, for SUMO (pip install eclipse-sumo libsumo) with
loading, with and without reading out positions and speeds, and for its steps alone. SUMO runs its
IDM with its own lane changes. All programs run in turn, several times, and the best run of each
counts.

    python benches/road.py target/release/reactsim [--against OLDER] [--logs FILE]

`--write FOLDER` only writes the scenarios.
"""

import argparse
import json
import math
import random
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

LANES = 4
CARS_PER_LANE = 16
LANE_WIDTH = 3.5
LENGTH = 2000.0
STEPS = 80
ROUNDS = 5
SUMO = "SUMO"
STEPS_ALONE = "SUMO, steps alone"


def length(cars_per_lane, steps):
    """Return a length, in metres, with room for all cars up to the end of the scenario."""
    return 200.0 + 45.0 * cars_per_lane + 1.4 * steps


def cars(seed):
    """Return lane, position (metres) and speed (m/s) of every car."""
    draw = random.Random(seed)
    for lane in range(LANES):
        position = 50.0
        for _ in range(CARS_PER_LANE):
            yield lane, position, draw.uniform(9.0, 14.0)
            position += draw.uniform(20.0, 45.0)


def scenario(seed):
    """Return a scenario as a hand-written one; the AV is a car in the middle."""
    agents = [
        {
            "id": f"car-{number}",
            "length": 4.5,
            "width": 1.8,
            "motion": {"at": [position, lane * LANE_WIDTH], "speed": speed},
        }
        for number, (lane, position, speed) in enumerate(cars(seed))
    ]
    lanes = []
    for lane in range(LANES):
        y = lane * LANE_WIDTH
        lane_of = {"id": f"lane-{lane}", "speed_limit": 13.9, "points": [[0, y], [LENGTH, y]]}
        if lane > 0:
            lane_of["right"] = [{"lane": f"lane-{lane - 1}"}]
        if lane + 1 < LANES:
            lane_of["left"] = [{"lane": f"lane-{lane + 1}"}]
        lanes.append(lane_of)
    right, left = -0.5 * LANE_WIDTH, (LANES - 0.5) * LANE_WIDTH
    edges = [{"points": [[0, right], [LENGTH, right]]}, {"points": [[LENGTH, left], [0, left]]}]
    return {
        "format": "reactsim-scenario-v1",
        "id": f"road-{seed:03}",
        "intent": f"A straight road with {LANES} lanes and {LANES * CARS_PER_LANE} cars.",
        "future": STEPS,
        "av": f"car-{CARS_PER_LANE + CARS_PER_LANE // 2}",
        "agents": agents,
        "map": {"lanes": lanes, "road_edges": edges},
    }


def write(folder, count):
    """Write scenarios to a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for seed in range(count):
        (folder / f"road-{seed:03}.json").write_text(json.dumps(scenario(seed)))


def cpu_seconds(command):
    """Return the CPU seconds of a process, and what it printed."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return used, done.stdout


def write_sumo_network(folder):
    """Write the road and its cars for SUMO; return the configuration, or None without SUMO."""
    try:
        import sumo
    except ImportError:
        return None
    nodes, edges, net = folder / "nodes.xml", folder / "edges.xml", folder / "net.xml"
    nodes.write_text(f'<nodes><node id="a" x="0" y="0"/><node id="b" x="{LENGTH}" y="0"/></nodes>')
    edges.write_text(
        f'<edges><edge id="road" from="a" to="b" numLanes="{LANES}" speed="13.9" '
        f'width="{LANE_WIDTH}"/></edges>'
    )
    netconvert = Path(sumo.SUMO_HOME) / "bin" / "netconvert"
    subprocess.run(
        [netconvert, "-n", nodes, "-e", edges, "-o", net], check=True, stdout=subprocess.DEVNULL
    )
    return net


def sumo_process(net, count, reads):
    """Run the copies in SUMO, in this process; print the CPU seconds of the steps alone."""
    import libsumo

    folder, stepping = Path(net).parent, 0.0
    for seed in range(count):
        routes = folder / f"routes-{seed}.xml"
        vehicles = "".join(
            f'<vehicle id="car-{number}" type="car" route="along" depart="0" departLane="{lane}" '
            f'departPos="{position:.2f}" departSpeed="{speed:.2f}" insertionChecks="none"/>'
            for number, (lane, position, speed) in enumerate(cars(seed))
        )
        kind = '<vType id="car" carFollowModel="IDM" length="4.5" width="1.8"/>'
        routes.write_text(f'<routes>{kind}<route id="along" edges="road"/>{vehicles}</routes>')
        options = "--step-length 0.1 --no-step-log --no-warnings".split()
        arguments = ["sumo", "-n", net, "-r", str(routes), *options]
        (libsumo.start if seed == 0 else lambda a: libsumo.load(a[1:]))(arguments)
        present = 0
        begin = time.process_time()
        for _ in range(STEPS):
            libsumo.simulationStep()
            for car in libsumo.vehicle.getIDList():
                present += 1
                if reads:
                    libsumo.vehicle.getPosition(car)
                    libsumo.vehicle.getSpeed(car)
                    libsumo.vehicle.getAngle(car)
        stepping += time.process_time() - begin
        if present < 0.95 * STEPS * LANES * CARS_PER_LANE:
            sys.exit(f"SUMO moved {present} agent-steps only")
    libsumo.close()
    print(stepping)


def present_steps(program, file):
    """Return the number of agents of all scenarios of a file, times the steps."""
    listed = subprocess.run(
        [program, "list", "scenarios", file], check=True, capture_output=True, text=True
    )
    rows = [line.split() for line in listed.stdout.splitlines()]
    column = rows[0].index("agents")
    return STEPS * sum(int(row[column]) for row in rows[1:])


def main():
    """Parse the arguments and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("reactsim", nargs="?", default="target/release/reactsim")
    parser.add_argument("--against", help="another release of reactsim")
    parser.add_argument("--logs", help="a file of logs to measure as well, with an AV that brakes")
    parser.add_argument("--count", type=int, default=100, help="number of scenarios [default: 100]")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write the scenarios and stop")
    parser.add_argument("--sumo-process", nargs=2, help=argparse.SUPPRESS)
    parser.add_argument("--size", type=int, nargs=4, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.size:
        globals().update(
            zip(("LANES", "CARS_PER_LANE", "STEPS", "LENGTH"), arguments.size, strict=True)
        )
    if arguments.write:
        return write(arguments.write, arguments.count)
    if arguments.sumo_process:
        return sumo_process(
            arguments.sumo_process[0], arguments.count, arguments.sumo_process[1] == "read"
        )

    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        write(home / "json", arguments.count)
        road = home / "road.parquet"
        subprocess.run(
            [arguments.reactsim, "convert", "--quiet", home / "json", "--out", road],
            check=True,
            stdout=subprocess.DEVNULL,
        )

        options = "--models idm --av brake:4 --jobs 1 --quiet".split()
        programs = {"reactsim": arguments.reactsim, "other release": arguments.against}
        measured = {}
        for what, file in {"the road": road, "logs": arguments.logs}.items():
            steps = present_steps(arguments.reactsim, file) if file else 0
            for name, program in programs.items():
                if file and program:
                    measured[f"{name}, {what}"] = ([program, "run", file, *options], steps)
        net = write_sumo_network(home)
        if net:
            for name, reads in [(SUMO, "move"), (f"{SUMO}, positions and speeds read", "read")]:
                command = [sys.executable, __file__, "--count", str(arguments.count)]
                command += ["--sumo-process", net, reads]
                measured[name] = (command, LANES * CARS_PER_LANE * STEPS * arguments.count)
        else:
            print("SUMO is not installed: pip install eclipse-sumo libsumo", file=sys.stderr)
        best = {}
        for _ in range(ROUNDS):
            for name, (command, _) in measured.items():
                used, printed = cpu_seconds(command)
                best[name] = min(best.get(name, math.inf), used)
                if name == SUMO:
                    best[STEPS_ALONE] = min(
                        best.get(STEPS_ALONE, math.inf), float(printed.split()[-1])
                    )
        if SUMO in measured:
            measured[STEPS_ALONE] = measured[SUMO]
        print("| what | million agent-steps per CPU second | of the first |\n|---|--:|--:|")
        rates = {name: steps / best[name] / 1e6 for name, (_, steps) in measured.items()}
        first = rates["reactsim, the road"]
        for name, rate in rates.items():
            print(f"| {name} | {rate:.2f} | {rate / first:.2f} |")
    return None


if __name__ == "__main__":
    sys.exit(main())
