"""Measure scoring of 32 rollouts on straight roads, beside the official scorer of Sim Agents.

    python benches/scoring.py target/release/reactsim [--cars 2 4 8 16]

Prints the number of cars and processor seconds: of a whole process of reactsim, which computes all
four configurations, and of one call of `compute_scenario_metrics_for_bundle` alone. Metametrics
that differ are refused.
Needs a Python with waymo-open-dataset-tf-2-12-0 (3.10 or older).
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import road
import tensorflow
from google.protobuf import text_format
from waymo_open_dataset.protos import (
    scenario_pb2,
    sim_agents_metrics_pb2,
    sim_agents_submission_pb2,
)
from waymo_open_dataset.wdl_limited.sim_agents_metrics import metrics

CURRENT, FUTURE, ROLLOUTS, ROUNDS = 10, 80, 32, 3
SPACING = 2.0  # of the points of lines, metres
LARGEST_DIFFERENCE = 1e-6  # of metametrics
SIZE = {"length": 4.5, "width": 1.8, "height": 1.5}


def log():
    """Return the road as a log of cars at constant speed, all of which are evaluated."""
    scenario = scenario_pb2.Scenario(scenario_id="road", current_time_index=CURRENT)
    scenario.timestamps_seconds.extend(0.1 * step for step in range(CURRENT + 1 + FUTURE))
    for number, (lane, position, speed) in enumerate(road.cars(0)):
        track = scenario.tracks.add(id=number + 1, object_type=scenario_pb2.Track.TYPE_VEHICLE)
        for seconds in scenario.timestamps_seconds:
            x = position + speed * (seconds - 0.1 * CURRENT)
            y = lane * road.LANE_WIDTH
            track.states.add(center_x=x, center_y=y, velocity_x=speed, valid=True, **SIZE)
        scenario.tracks_to_predict.add(track_index=number)
    for lane in range(road.LANES):
        feature = scenario.map_features.add(id=1000 + lane).lane
        feature.type = 2
        for x in np.arange(0.0, road.LENGTH, SPACING):
            feature.polyline.add(x=x, y=lane * road.LANE_WIDTH)
    for number, y in enumerate((-0.5, road.LANES - 0.5)):
        feature = scenario.map_features.add(id=2000 + number).road_edge
        feature.type = 1
        for x in np.arange(0.0, road.LENGTH, SPACING)[:: 1 - 2 * number]:
            feature.polyline.add(x=x, y=y * road.LANE_WIDTH)
    return scenario


def rollouts(scenario):
    """Return rollouts that drift off the log at random accelerations."""
    result = sim_agents_submission_pb2.ScenarioRollouts(scenario_id=scenario.scenario_id)
    draw = np.random.default_rng(0)
    seconds = 0.1 * np.arange(1, FUTURE + 1)
    for _ in range(ROLLOUTS):
        scene = result.joint_scenes.add()
        for track in scenario.tracks:
            ahead = 0.5 * draw.normal() * seconds**2
            states = track.states[CURRENT + 1 :]
            scene.simulated_trajectories.add(
                object_id=track.id,
                center_x=[state.center_x + by for state, by in zip(states, ahead)],
                center_y=[state.center_y for state in states],
                center_z=[0.0] * FUTURE,
                heading=[0.0] * FUTURE,
            )
    return result


def official(scenario, simulated):
    """Return processor seconds and metametric of the official scorer."""
    file = Path(metrics.__file__).with_name("challenge_2025_sim_agents_config.textproto")
    config = text_format.Parse(file.read_text(), sim_agents_metrics_pb2.SimAgentMetricsConfig())
    begin = time.process_time()
    scores = metrics.compute_scenario_metrics_for_bundle(config, scenario, simulated)
    return time.process_time() - begin, scores.metametric


def main():
    """Measure all sizes."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("reactsim")
    parser.add_argument("--cars", type=int, nargs="+", default=[2, 4, 8, 16], help="per lane")
    arguments = parser.parse_args()
    for road.CARS_PER_LANE in arguments.cars:
        road.LENGTH = road.length(road.CARS_PER_LANE, FUTURE)
        scenario = log()
        simulated = rollouts(scenario)
        with tempfile.TemporaryDirectory() as folder:
            recorded, scored = Path(folder) / "road.tfrecord", Path(folder) / "road.binproto"
            with tensorflow.io.TFRecordWriter(str(recorded)) as writer:
                writer.write(scenario.SerializeToString())
            scored.write_bytes(simulated.SerializeToString())
            command = [arguments.reactsim, "score", scored, "--wosac", "--scenarios", recorded]
            command += ["--format", "json"]
            runs = [road.cpu_seconds(command) for _ in range(ROUNDS)]
        seconds, printed = min(runs)
        own = json.loads(printed)["configs"]["2025"]["buckets"]["realism_meta_metric"]
        official_seconds, metametric = official(scenario, simulated)
        if abs(own - metametric) > LARGEST_DIFFERENCE:
            sys.exit(f"metametric {own}, {metametric} of the official scorer")
        print(len(scenario.tracks), seconds, official_seconds, flush=True)


if __name__ == "__main__":
    main()
