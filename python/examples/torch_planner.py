"""A small PyTorch planner: learns from logged AVs for half a minute, then drives among `idm`.

`python torch_planner.py` generates scenarios to learn from; `python torch_planner.py SCENARIOS`
learns from your own. Both save the weights in the current folder. The planner can then be served:

    reactsim study planners --planner mine='python torch_planner.py --serve' --out studies/mine

The input of the network is the route ahead of the AV, its speed, and the nearest agents, in the
frame of the AV. The output is the distance that the AV drives along the route within 1 to 4 s.
"""

import hashlib
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import reactsim

try:
    import torch
except ImportError:
    sys.exit("this example needs PyTorch: pip install torch")

WEIGHTS = Path("torch_planner.pt")
SECONDS = 30.0  # time limit of the training
SCENARIOS = 100  # scenarios of the training
GENERATE = {"preset": "train", "count": SCENARIOS, "seed": 8}
NEIGHBOURS = 8
POINTS = 10  # points of the path, every 5 m
FEATURES = 1 + POINTS * 2 + NEIGHBOURS * 4
HORIZON = 40  # planned steps
KNOTS = np.array([10, 20, 30, 40])  # steps of the outputs


def in_frame_of(pose, points):
    """Returns points [..., 2] in the frame of a pose x, y, heading."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    return (points - pose[:2]) @ np.array([[cos, -sin], [sin, cos]])


def ahead(path, xy):
    """Returns the part of a path [P, 2] after the point nearest to xy, beginning at xy."""
    nearest = int(np.argmin(np.linalg.norm(path - xy, axis=1)))
    return np.concatenate([xy[None], path[nearest + 1 :]])


def along(path, distances):
    """Returns the points of a path [P, 2] at distances [n], continued straight beyond its end."""
    steps = np.diff(path, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    s = np.concatenate([[0.0], np.cumsum(lengths)])
    xy = np.stack([np.interp(distances, s, path[:, k]) for k in (0, 1)], 1)
    end = steps[-1] / max(lengths[-1], 1e-6)
    return xy + np.maximum(distances - s[-1], 0.0)[:, None] * end


def features(pose, speed, path, others):
    """Returns the inputs [FEATURES] from the path [P, 2] and the states of other agents [n, 5]."""
    points = in_frame_of(pose, along(path, 5.0 * np.arange(1, POINTS + 1)))
    xy = in_frame_of(pose, others[:, :2])
    velocity = in_frame_of([0.0, 0.0, pose[2]], np.nan_to_num(others[:, 3:]))
    nearest = np.argsort(np.linalg.norm(xy, axis=1))[:NEIGHBOURS]
    near = np.full((NEIGHBOURS, 4), [100.0, 0.0, 0.0, 0.0])
    near[: len(nearest)] = np.concatenate([xy, velocity], 1)[nearest]
    return np.concatenate([[speed], points.ravel(), near.ravel()]) / 10.0


def network():
    """Returns the untrained network."""
    torch.manual_seed(0)
    return torch.nn.Sequential(
        torch.nn.Linear(FEATURES, 64),
        torch.nn.ReLU(),
        torch.nn.Linear(64, 64),
        torch.nn.ReLU(),
        torch.nn.Linear(64, len(KNOTS)),
    )


def training_set(source):
    """Returns inputs, and the distances that the logged AV drives within 1 to 4 s."""
    inputs, outputs = [], []
    for _, scenario in zip(range(SCENARIOS), reactsim.scenarios(source)):
        track = scenario.states[0]
        for frame in range(10, 50, 2):
            if not scenario.present[0, frame : frame + HORIZON + 1].all():
                continue
            path = track[frame:, :2][scenario.present[0, frame:]]
            path = path[
                np.linalg.norm(np.diff(path, axis=0, prepend=path[:1] - 1.0), axis=1) > 0.01
            ]
            if len(path) < 2:
                continue
            here = scenario.present[:, frame].copy()
            here[0] = False
            speed = np.hypot(*np.nan_to_num(track[frame, 3:]))
            inputs.append(features(track[frame], speed, path, scenario.states[here, frame]))
            driven = np.linalg.norm(np.diff(track[frame : frame + HORIZON + 1, :2], axis=0), axis=1)
            outputs.append(np.cumsum(driven)[KNOTS - 1])
    return np.array(inputs), np.array(outputs)


def train(source):
    """Trains the network and saves its weights."""
    inputs, outputs = training_set(source)
    print(f"{len(inputs)} samples", file=sys.stderr)
    x = torch.tensor(inputs, dtype=torch.float32)
    y = torch.tensor(outputs, dtype=torch.float32)
    model = network()
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-3)
    step, error, start = 0, 0.0, time.monotonic()
    while time.monotonic() - start < SECONDS and step < 5000:
        batch = torch.randint(len(x), (256,))
        loss = torch.nn.functional.smooth_l1_loss(model(x[batch]), y[batch])
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        step, error = step + 1, 0.99 * error + 0.01 * loss.item()
    print(f"{step} steps, loss {error:.3f}", file=sys.stderr)
    torch.save(model.state_dict(), WEIGHTS)


class TorchPlanner(reactsim.Planner):
    """Drives along the route as far as the network predicts."""

    name = "torch-planner"
    version = "1"

    def __init__(self):
        self.model = network()
        self.model.load_state_dict(torch.load(WEIGHTS))
        self.model.eval()
        self.weights_sha256 = hashlib.sha256(WEIGHTS.read_bytes()).hexdigest()

    def begin(self, scene):
        """Nothing is remembered before the first plan."""
        return {}

    def plan(self, seen):
        x, y, heading = seen.av[:3]
        speed = float(np.hypot(*np.nan_to_num(seen.av[3:])))
        if "path" not in seen.memory:
            seen.memory["path"] = self.path(seen)
        path = ahead(seen.memory["path"], np.array([x, y]))
        if len(path) < 2:
            path = np.array([[x, y], [x + np.cos(heading), y + np.sin(heading)]])
        others = seen.states[1:, -1][seen.valid[1:, -1]]
        with torch.no_grad():
            inputs = torch.tensor(features(seen.av, speed, path, others), dtype=torch.float32)
            knots = self.model(inputs).numpy().astype(float)
        knots = np.maximum.accumulate(np.maximum(knots, 0.0))
        steps = np.arange(1, HORIZON + 1)
        distances = np.interp(steps, np.concatenate([[0], KNOTS]), np.concatenate([[0.0], knots]))
        xy = along(path, distances)
        moved = np.diff(xy, axis=0, prepend=[[x, y]])
        headings = np.arctan2(moved[:, 1], moved[:, 0])
        headings[np.linalg.norm(moved, axis=1) < 0.05] = heading
        return np.concatenate([xy, headings[:, None]], 1)

    @staticmethod
    def path(seen):
        """Returns the centre lines of linked lanes of the route, from the one nearest to the AV."""
        path = [seen.scene.lanes[lane].points for lane in seen.route_chain]
        return np.concatenate([path[0], *(points[1:] for points in path[1:])])


if __name__ == "__main__":
    torch.set_num_threads(1)  # the network is small
    if sys.argv[1:] == ["--serve"]:
        reactsim.serve(TorchPlanner())
        sys.exit()
    if len(sys.argv) > 1:
        train(sys.argv[1])
    else:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "train.parquet")
            print(reactsim.command("generate", **GENERATE, out=path), file=sys.stderr)
            train(path)
    print(reactsim.run(planner=TorchPlanner(), baselines=["log-replay", "idm"], limit=20).table())
