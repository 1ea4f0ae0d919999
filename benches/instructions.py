"""Compare the instructions that the program takes with recorded counts.

Unlike times, counts hardly depend on the machine and on what else runs there. Each workload runs on
one thread under valgrind, which presents the same processor everywhere that has AVX2. A workload
that takes over 3 % more instructions than recorded in `instructions.json` is an error; one that
takes fewer asks for new counts.

    python benches/instructions.py target/release/reactsim [--update]

Counts are those of one version of the compiler and of the dependencies: `--update` records them
anew, which belongs into the commit that changes them.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import road

RECORDED = Path(__file__).with_name("instructions.json")
TOLERANCE = 0.03


def workloads(home):
    """Return the arguments of each workload."""
    road.write(home / "json", 4)
    run = ["run", "--jobs", "1", "--models"]

    def shipped(model, count):
        return [*run, model, "--limit", str(count)]

    return {
        "idm, 4 roads with 64 cars": [*run, "idm", home / "json", "--av", "brake:4"],
        "idm, 8 shipped scenarios": shipped("idm", 8),
        "log-replay, 8 shipped scenarios": shipped("log-replay", 8),
        "ntp-reactive, 1 shipped scenario": shipped("ntp-reactive", 1),
        "ntp-guarded, 1 shipped scenario": shipped("ntp-guarded", 1),
        "qp-regression, 1 shipped scenario": shipped("qp-regression", 1),
        "generate, 2 logs": [
            *"generate --preset train --count 2 --out".split(),
            home / "g.parquet",
        ],
        "curate, 4 roads": ["curate", home / "json", "--jobs", "1", "--out", home / "c.parquet"],
    }


def instructions(command):
    """Return the number of instructions of a process."""
    options = "--tool=cachegrind --cache-sim=no --cachegrind-out-file=/dev/null"
    valgrind = ["valgrind", *options.split()]
    done = subprocess.run([*valgrind, *command], capture_output=True, text=True, check=False)
    found = re.search(r"I\s+refs:\s+([\d,]+)", done.stderr)
    if done.returncode != 0 or not found:
        sys.exit(f"{' '.join(map(str, command))} failed under valgrind:\n{done.stderr[-2000:]}")
    return int(found[1].replace(",", ""))


def main():
    """Count, print the table and compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("reactsim", nargs="?", default="target/release/reactsim")
    parser.add_argument("--update", action="store_true", help="record the counts")
    arguments = parser.parse_args()
    if not shutil.which("valgrind"):
        sys.exit("valgrind is not installed (Debian: apt-get install valgrind)")
    with tempfile.TemporaryDirectory() as home:
        works = workloads(Path(home)).items()
        # Counts do not depend on what else runs.
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            commands = [[arguments.reactsim, *work] for _, work in works]
            counts = dict(zip((name for name, _ in works), pool.map(instructions, commands)))
    recorded = {} if arguments.update else json.loads(RECORDED.read_text())
    print("| workload | million instructions | of those recorded |\n|---|--:|--:|")
    slower = []
    for name, count in counts.items():
        ratio = count / recorded.get(name, count)
        print(f"| {name} | {count / 1e6:.0f} | {ratio:.3f} |")
        if ratio > 1 + TOLERANCE:
            slower.append(name)
        elif ratio < 1 - TOLERANCE:
            print(
                f"note: {name} takes fewer instructions: record them with --update", file=sys.stderr
            )
    if arguments.update:
        RECORDED.write_text(json.dumps(counts, indent=2) + "\n")
    if slower:
        sys.exit(f"more instructions than recorded: {'; '.join(slower)}")


if __name__ == "__main__":
    main()
