"""A small PyTorch simulator: cloned from logs, then fine-tuned in closed loop.

`python fine_tune.py` generates scenarios to train on; `python fine_tune.py SCENARIOS` trains on
your own. Both save the weights in the current folder. The scores before and after are for 20
scenarios of the benchmark, whose deviated AVs the network never saw.

All agents share one network. First it learns the actions of the logs. Its own errors then lead it
to states that no log contains. So it continues in closed loop: the AV brakes for no reason, and in
the states that they reach themselves the agents learn to return to their logs, and by PPO to avoid
contacts and to stay on the road, as the program measures them at every step.
"""

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

WEIGHTS = Path("fine_tune.pt")
CLONING, FINE_TUNING = 20.0, 180.0  # time limits of the stages, seconds
GENERATE = {"preset": "train", "count": 60, "seed": 12}
SIZES = {"agents": 8, "frames": 2, "lanes": 8, "points": 5, "lights": 1}
LIMITS = np.array([6.0, 0.3])  # acceleration (m/s²) and curvature (1/m) of an action of 1
SCALE = {"av": 10.0, "agents": 10.0, "lanes": 10.0, "lights": 20.0}
NAMES = ["av", "av_size", "agents", "agent_features", "lanes", "lane_features", "lights"]
AHEAD = 10  # steps until an agent is to be back on its log
REWARD = {"contact_av": -1.0, "contact_agents": -0.5, "off_road": -0.2}
DISCOUNT = 0.95  # per step
IMITATION = 10.0  # weight of the labels next to the rewards
TESTED = 20  # scenarios of the comparison
METRICS = ["aav-collision", "aa-collision", "offroad", "ade", "progress"]


def features(observations):
    """Returns the inputs [agents, features] of the network."""
    columns = [
        np.stack([seen[name].ravel() / SCALE.get(name, 5.0) for seen in observations.values()])
        for name in NAMES
    ]
    return torch.from_numpy(np.concatenate(columns, 1, dtype=np.float32)).clip(-10.0, 10.0)


class Network(torch.nn.Module):
    """Mean of the action, in units of `LIMITS`, and expected return of each agent."""

    def __init__(self, inputs):
        super().__init__()
        torch.manual_seed(0)
        self.body = torch.nn.Sequential(
            torch.nn.Linear(inputs, 128),
            torch.nn.ReLU(),
            torch.nn.Linear(128, 128),
            torch.nn.ReLU(),
        )
        self.mean, self.value = torch.nn.Linear(128, 2), torch.nn.Linear(128, 1)
        self.log_std = torch.nn.Parameter(torch.tensor([-2.0, -3.0]))

    def forward(self, x):
        hidden = self.body(x)
        actions = torch.distributions.Normal(self.mean(hidden), self.log_std.exp())
        return actions, self.value(hidden).squeeze(1)


def logs_of(source, limit=None):
    """Returns states [agents, 91, 5] and presence [agents, 91] of the agents by scenario."""
    scenarios = reactsim.scenarios(source, limit=limit)
    return {s.id: (s.states[1:], s.present[1:]) for s in scenarios if s.n_agents > 1}


def random_of(logs):
    """Returns the id of a random scenario."""
    return list(logs)[torch.randint(len(logs), ()).item()]


def back_to_log(states, goal):
    """Returns the actions [agents, 2] that lead to the logged states [agents, 5] within 1 s."""
    x, y, heading = states[:, :3].T
    speed = np.hypot(states[:, 3], states[:, 4])
    dx, dy = goal[:, 0] - x, goal[:, 1] - y
    along = dx * np.cos(heading) + dy * np.sin(heading)
    beside = dy * np.cos(heading) - dx * np.sin(heading)
    within = AHEAD * reactsim.DT
    acceleration = 2.0 * (along - speed * within) / within**2
    curvature = np.where(along > 1.0, 2.0 * beside / np.maximum(along**2 + beside**2, 1.0), 0.0)
    return np.clip(np.stack([acceleration, curvature], 1) / LIMITS, -1.0, 1.0)


def roll_out(env, network, logs, scenario, noise=1.0):
    """Runs an episode of a scenario.

    Returns inputs, drawn actions, labels and rewards by step, and the scores. Labels are actions
    that lead back to the log, NaN where it has ended.
    """
    observations, _ = env.reset(options={"scenario": scenario})
    states, present = logs[scenario]
    now = states[:, 10]
    steps = []
    for frame in range(11, 91):
        x = features(observations)
        with torch.no_grad():
            actions, _ = network(x)
        drawn = actions.mean + noise * actions.stddev * torch.randn_like(actions.mean)
        goal = min(frame + AHEAD - 1, 90)
        label = np.where(present[:, goal, None], back_to_log(now, states[:, goal]), np.nan)
        executed = np.clip(drawn.numpy(), -1.0, 1.0) * LIMITS
        observations, rewards, _, _, infos = env.step(dict(zip(env.agents, executed)))
        now = env.states[1:, -1]
        distance = np.linalg.norm(now[:, :2] - states[:, frame, :2], axis=1)
        lost = np.where(present[:, frame], np.minimum(distance, 10.0), 0.0)
        reward = np.array(list(rewards.values())) - 0.02 * lost
        steps.append((x, drawn, torch.from_numpy(label), torch.from_numpy(reward)))
    scores = infos["agent_1"].get("scores")
    return [torch.stack(column).float() for column in zip(*steps)], scores


def distance_to(labels, actions):
    """Returns the mean distance between actions and labels, where there are labels."""
    known = ~labels.isnan().any(1)
    return torch.nn.functional.smooth_l1_loss(actions.mean[known], labels[known], beta=0.1)


def replayed(env, logs):
    """Returns inputs and labels at every second step of the logs, as the environment shows them."""
    inputs, labels = [], []
    for scenario, (states, present) in logs.items():
        observations, _ = env.reset(options={"scenario": scenario})
        now = states[:, 10]
        for frame in range(11, 91):
            if frame % 2:
                goal = min(frame + AHEAD - 1, 90)
                is_known = present[:, frame - 1] & present[:, goal]
                inputs.append(features(observations)[is_known])
                labels.append(torch.from_numpy(back_to_log(now, states[:, goal])[is_known]))
            # Agents stay where their log ends.
            now = np.where(present[:, frame, None], states[:, frame], now * [1, 1, 1, 0, 0])
            observations, *_ = env.step(dict(zip(env.agents, now)))
    return torch.cat(inputs), torch.cat(labels).float()


def clone(network, inputs, labels):
    """Trains the network to act as logged."""
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-3)
    end = time.monotonic() + CLONING
    while time.monotonic() < end:
        some = torch.randint(len(inputs), (1024,))
        actions, _ = network(inputs[some])
        loss = distance_to(labels[some], actions)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    print(f"cloning: {len(inputs)} samples, loss {loss.item():.4f}", file=sys.stderr)


def fine_tune(env, network, logs):
    """Trains the network on labels and rewards in the states that it reaches."""
    optimizer = torch.optim.Adam(network.parameters(), lr=3e-4)
    episodes, end = 0, time.monotonic() + FINE_TUNING
    while time.monotonic() < end:
        parts = [roll_out(env, network, logs, random_of(logs))[0] for _ in range(4)]
        episodes += len(parts)
        rows = []
        for x, drawn, label, reward in parts:
            with torch.no_grad():
                actions, value = network(x.flatten(0, 1))
                old = actions.log_prob(drawn.flatten(0, 1)).sum(1)
                value = value.view(reward.shape)
            # Returns over about 2 s, continued by the expected value where the episode ends.
            returns, after = torch.empty_like(reward), value[-1]
            for k in reversed(range(len(reward))):
                after = reward[k] + DISCOUNT * after
                returns[k] = after
            rows.append(
                (x.flatten(0, 1), drawn.flatten(0, 1), old, returns.flatten(), label.flatten(0, 1))
            )
        x, drawn, old, returns, labels = (torch.cat(column) for column in zip(*rows))
        for _ in range(3):
            for some in torch.randperm(len(x)).split(2048):
                actions, value = network(x[some])
                gain = returns[some] - value.detach()
                gain = (gain - gain.mean()) / (gain.std() + 1e-6)
                ratio = (actions.log_prob(drawn[some]).sum(1) - old[some]).exp()
                surrogate = torch.min(ratio * gain, ratio.clip(0.8, 1.2) * gain).mean()
                error = torch.nn.functional.mse_loss(value, returns[some])
                optimizer.zero_grad()
                (error - surrogate + IMITATION * distance_to(labels[some], actions)).backward()
                torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
                optimizer.step()
    print(f"closed loop: {episodes} episodes, last return {returns.mean():.3f}", file=sys.stderr)


def test(network):
    """Returns the means of metrics of the benchmark over scenarios with deviated AVs."""
    env = reactsim.ParallelEnv(av="deviated", limit=TESTED, **SIZES)
    logs = logs_of(None, limit=TESTED)
    found = [roll_out(env, network, logs, scenario, noise=0.0)[1] for scenario in logs]
    env.close()
    return {
        metric: np.nanmean(
            [np.nan if s.metrics[metric] is None else s.metrics[metric] for s in found]
        )
        for metric in METRICS
    }


def train(source):
    """Trains a network and saves its weights; prints scores before and after the rewards."""
    logs = logs_of(source)
    env = reactsim.ParallelEnv(source, av="log", action="state", scores=False, **SIZES)
    inputs, labels = replayed(env, logs)
    env.close()
    network = Network(inputs.shape[1])
    clone(network, inputs, labels)
    rows = {"cloned": test(network)}
    env = reactsim.ParallelEnv(source, av="brake:4", reward=REWARD, scores=False, **SIZES)
    fine_tune(env, network, logs)
    env.close()
    rows["fine-tuned"] = test(network)
    torch.save(network.state_dict(), WEIGHTS)
    print("network     " + "".join(f"{metric:>20}" for metric in METRICS))
    for name, row in rows.items():
        print(f"{name:12}" + "".join(f"{row[metric]:20.3f}" for metric in METRICS))


if __name__ == "__main__":
    torch.set_num_threads(1)  # the network is small
    if len(sys.argv) > 1:
        train(sys.argv[1])
    else:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "train.parquet")
            print(reactsim.command("generate", **GENERATE, out=path), file=sys.stderr)
            train(path)
