"""Measures what the client adds to the time of a simulator.

Run it with `PYTHONPATH=python python python/tests/bench_client.py`.

Client time: a session in this process reads the requests of a batch from memory. Round trip: a
child process serves a simulator whose plan costs nothing; the time includes the side of the parent.
Maps are read by touching the lanes and road edges of every scene.
"""

from __future__ import annotations

import io
import os
import sys
import time
from typing import Callable, Dict

import numpy as np
from fakes import Child, make_scenes
from reactsim.client import Array, Observation, Scenes, Session, read_frame, write_frame

CASES = [(1, 64), (16, 64), (64, 64), (16, 200)]  # episodes, agents
STEPS = 5
REPEATS = 20
BLOCKS = 40  # groups of eight lines in a scene
POINTS = 60  # points of a lane

CHILD = """
import numpy as np
import reactsim

class Nothing(reactsim.Simulator):
    def plan(self, seen):
        return np.zeros(seen.states.shape[:2] + (seen.steps, 3))

reactsim.serve(Nothing())
"""


class Nothing:
    """A simulator whose plan costs nothing."""

    def begin(self, scenes: Scenes) -> None:
        self.plans: Dict[int, Array] = {}

    def plan(self, seen: Observation) -> Array:
        if seen.steps not in self.plans:
            self.plans[seen.steps] = np.zeros((*seen.states.shape[:2], seen.steps, 3))
        return self.plans[seen.steps]


def best(measure: Callable[[], None]) -> float:
    """Returns the least time of a few repetitions, seconds."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        measure()
        times.append(time.perf_counter() - start)
    return min(times)


def frames(tensors: Dict[str, Array], new: int) -> io.BytesIO:
    """Returns the requests of one batch with one plan, as a stream."""
    batch, agents = tensors["kind"].shape
    stream = io.BytesIO()
    write_frame(stream, "begin", "0", {"moves_av": "0", "steps": str(STEPS)}, tensors)
    for k in range(16):
        n = 0 if k == 0 else new
        plan = {
            "episode": tensors["episode"],
            "active": np.ones(batch, np.uint8),
            "states": np.zeros((batch, agents, n, 5)),
            "valid": np.ones((batch, agents, n), np.uint8),
            "light_state": np.zeros((len(tensors["light_lane"]), n), np.uint8),
            "av_next": np.zeros((batch, 5)),
        }
        write_frame(stream, "plan", "0", {"frame": str(10 + k * new), "steps": str(STEPS)}, plan)
    write_frame(stream, "end", "0", {}, {"episode": tensors["episode"]})
    return stream


def make_map(episodes: int) -> Dict[str, Array]:
    """Returns the tensors of `begin` with maps as large as those of recorded scenarios."""
    tensors = make_scenes(episodes * BLOCKS, 1, points=POINTS)
    agents = make_scenes(episodes, 64)
    for name in ("line_episode", "light_episode"):
        tensors[name] = tensors[name] // np.int32(BLOCKS)
    for name in ("episode", "seed", "n_agents", "kind", "size", "history", "valid"):
        tensors[name] = agents[name]
    return tensors


def main() -> None:
    """Prints a table."""
    print("| episodes | agents | client per scenario and plan (ms) | round trip (ms) |")
    print("|---:|---:|---:|---:|")
    for episodes, agents in CASES:
        tensors = make_scenes(episodes, agents)
        tensors["n_agents"][:] = agents
        stream = frames(tensors, STEPS)

        def serve_batch(stream: io.BytesIO = stream) -> None:
            stream.seek(0)
            Session(Nothing()).run(stream, io.BytesIO())

        in_process = best(serve_batch) / 16
        with Child("-c", CHILD) as child:
            child.hello()
            times = []
            for _ in range(3):
                child.begin(tensors)
                for _ in range(16):
                    start = time.perf_counter()
                    child.plan(STEPS)
                    times.append(time.perf_counter() - start)
                child.end()
            round_trip = sorted(times)[len(times) // 2]
            child.bye()
            child.wait()
        per_scenario = in_process / episodes * 1000
        print(f"| {episodes} | {agents} | {per_scenario:.4f} | {round_trip * 1000:.2f} |")

    tensors = make_map(16)
    stream = io.BytesIO()
    write_frame(stream, "begin", "0", {"moves_av": "0", "steps": "5"}, tensors)

    def read_maps() -> None:
        stream.seek(0)
        frame = read_frame(stream)
        assert frame is not None
        for scene in Scenes(*frame):
            sum(lane.points[0, 0] for lane in scene.lanes)
            sum(line.points[0, 0] for line in scene.road_edges)

    points = len(tensors["points"])
    rate = points / best(read_maps) / 1e6
    print(f"\nmap: {rate:.1f} million points per second ", end="")
    print(f"({points // 16} points in {len(tensors['line_type']) // 16} lines per scene); ", end="")
    print(f"{os.cpu_count()} cores, Python {sys.version.split()[0]}, numpy {np.__version__}")


if __name__ == "__main__":
    main()
