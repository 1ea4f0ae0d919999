"""A small PyTorch policy: trained on logged futures for less than a minute, then evaluated.

`python torch_policy.py` generates scenarios to train on; `python torch_policy.py SCENARIOS` trains
on your own. Both save the weights in the current folder and run the shipped benchmark.

The input of the network is the motion of one agent and its nearest neighbours, in the frame of the
agent. The output is a correction of the constant-velocity trajectory.
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

WEIGHTS = Path("torch_policy.pt")
SECONDS = 40.0  # time limit of the training
SCENARIOS = 100  # scenarios of the training
GENERATE = {"preset": "train", "count": SCENARIOS, "seed": 7}
HORIZON = 40  # predicted steps; replan intervals up to this are supported
NEIGHBOURS = 8
FRAMES = 11  # observed frames
FEATURES = FRAMES * 3 + NEIGHBOURS * 5


def features(states, valid):
    """Returns network inputs [n, FEATURES] for agents with states [n, FRAMES, 5]."""
    now = states[:, -1]
    cos, sin = np.cos(now[:, 2]), np.sin(now[:, 2])
    turn = np.stack([np.stack([cos, sin], -1), np.stack([-sin, cos], -1)], -2)  # world to agent
    velocity = np.nan_to_num(states[..., 3:])
    past = np.einsum("nij,nkj->nki", turn, states[..., :2] - now[:, None, :2])
    past = np.concatenate([past * valid[..., None], valid[..., None]], -1)
    delta = now[None, :, :2] - now[:, None, :2]
    distance = np.linalg.norm(delta, axis=-1) + 1e6 * ~valid[None, :, -1]
    np.fill_diagonal(distance, 1e9)
    near = np.argsort(distance, axis=1)[:, :NEIGHBOURS]
    rows = np.arange(len(now))[:, None]
    other = np.concatenate([delta[rows, near], velocity[:, -1][near] - velocity[:, None, -1]], -1)
    other = np.einsum("nij,nkcj->nkci", turn, other.reshape(*near.shape, 2, 2)).reshape(
        *near.shape, 4
    )
    is_near = (distance[rows, near] < 50.0)[..., None]
    other = np.concatenate([other * is_near, is_near], -1)
    other = np.pad(other, [(0, 0), (0, NEIGHBOURS - near.shape[1]), (0, 0)])
    return np.concatenate([past.reshape(len(now), -1), other.reshape(len(now), -1)], 1) / 10.0


def constant_velocity(now, steps):
    """Returns positions [n, steps, 2] of agents that keep their velocity."""
    time = reactsim.DT * np.arange(1, steps + 1)
    return now[:, None, :2] + np.nan_to_num(now[:, None, 3:]) * time[:, None]


def targets(now, future):
    """Returns logged minus constant-velocity positions, along and across the heading."""
    delta = future[..., :2] - constant_velocity(now, future.shape[1])
    cos, sin = np.cos(now[:, None, 2]), np.sin(now[:, None, 2])
    return np.stack(
        [delta[..., 0] * cos + delta[..., 1] * sin, delta[..., 1] * cos - delta[..., 0] * sin], -1
    )


def network():
    """Returns the untrained network."""
    torch.manual_seed(0)
    return torch.nn.Sequential(
        torch.nn.Linear(FEATURES, 128),
        torch.nn.ReLU(),
        torch.nn.Linear(128, 128),
        torch.nn.ReLU(),
        torch.nn.Linear(128, HORIZON * 2),
    )


def training_set(source):
    """Returns inputs and targets of all vehicles that are present long enough."""
    inputs, outputs = [], []
    for _, scenario in zip(range(SCENARIOS), reactsim.scenarios(source)):
        for frame in range(10, 50, 5):
            past = slice(frame + 1 - FRAMES, frame + 1)
            ahead = slice(frame + 1, frame + 1 + HORIZON)
            states, present = scenario.states, scenario.present
            used = present[:, frame] & present[:, ahead].all(axis=1) & (scenario.kinds == 0)
            here = np.flatnonzero(present[:, frame])
            chosen = np.isin(here, np.flatnonzero(used))
            inputs.append(features(states[here, past], present[here, past])[chosen])
            outputs.append(targets(states[used, frame], states[used, ahead]))
    return np.concatenate(inputs), np.concatenate(outputs)


def train(source):
    """Trains the network and saves its weights."""
    inputs, outputs = training_set(source)
    print(f"{len(inputs)} samples", file=sys.stderr)
    x = torch.tensor(inputs, dtype=torch.float32)
    y = torch.tensor(outputs.reshape(len(outputs), -1), dtype=torch.float32)
    model = network()
    optimizer = torch.optim.Adam(model.parameters(), lr=1e-3)
    step, error, start = 0, 0.0, time.monotonic()
    while time.monotonic() - start < SECONDS and step < 3000:
        batch = torch.randint(len(x), (256,))
        loss = torch.nn.functional.smooth_l1_loss(model(x[batch]), y[batch])
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        step, error = step + 1, 0.99 * error + 0.01 * loss.item()
    print(f"{step} steps, loss {error:.3f}", file=sys.stderr)
    torch.save(model.state_dict(), WEIGHTS)


class TorchPolicy(reactsim.Simulator):
    """Moves every agent as the network predicts; parked agents stay."""

    name = "torch-policy"
    version = "1"
    intervals = tuple(range(1, HORIZON + 1))
    batch = 16

    def __init__(self):
        self.model = network()
        self.model.load_state_dict(torch.load(WEIGHTS))
        self.model.eval()
        self.weights_sha256 = hashlib.sha256(WEIGHTS.read_bytes()).hexdigest()

    def plan(self, seen):
        plan = np.zeros((*seen.valid.shape[:2], seen.steps, 3))
        for i, n in enumerate(seen.scenes.n_agents):
            states, valid = seen.states[i, :n, -FRAMES:], seen.valid[i, :n, -FRAMES:]
            now = np.nan_to_num(states[:, -1])
            with torch.no_grad():
                x = torch.tensor(features(states, valid), dtype=torch.float32)
                change = self.model(x).numpy().astype(float)
            change = change.reshape(n, HORIZON, 2)[:, : seen.steps]
            change *= (np.hypot(now[:, 3], now[:, 4]) > 0.5)[:, None, None]
            cos, sin = np.cos(now[:, None, 2]), np.sin(now[:, None, 2])
            positions = constant_velocity(now, seen.steps)
            positions[..., 0] += change[..., 0] * cos - change[..., 1] * sin
            positions[..., 1] += change[..., 0] * sin + change[..., 1] * cos
            plan[i, :n, :, :2] = positions
            plan[i, :n, :, 2] = self.headings(now, positions)
        return plan

    @staticmethod
    def headings(now, positions):
        """Returns the direction of motion; slow agents keep their heading."""
        moved = np.diff(positions, axis=1, prepend=now[:, None, :2])
        headings = np.arctan2(moved[..., 1], moved[..., 0])
        slow = np.hypot(moved[..., 0], moved[..., 1]) < 0.05
        return np.where(slow, now[:, None, 2], headings)


if __name__ == "__main__":
    torch.set_num_threads(1)  # the network is small
    if len(sys.argv) > 1:
        train(sys.argv[1])
    else:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "train.parquet")
            print(reactsim.command("generate", **GENERATE, out=path), file=sys.stderr)
            train(path)
    results = reactsim.run(TorchPolicy(), baselines=["constant-velocity", "idm"])
    print(results.table())
