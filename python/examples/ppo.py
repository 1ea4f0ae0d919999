"""A driving policy by PPO: trained among `idm` agents for four minutes, then compared with braking.

`python ppo.py` generates scenarios to train on; `python ppo.py SCENARIOS` trains on your own. Both
save the policy in the current folder, and drive the scenarios of the benchmark, which it never saw;
`ppo.gif` shows the last one.

The AV follows its route: the action is the acceleration of the next half second, and the tracker
steers. An emergency brake replaces the action, of scripts too, when a collision is near. The
observation is the speed, the time to collision, the bends of the route, and how far the nearest
agents are along and beside the route.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import reactsim

try:
    import gymnasium
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor
except ImportError:
    sys.exit("this example needs gymnasium and Stable-Baselines3: pip install stable-baselines3")

POLICY = Path("ppo.zip")
VIDEO = Path("ppo.gif")
SECONDS = 210.0  # time limit of the training
STEPS = 90_000  # decisions of the training
ENVS = 8
SCENARIOS = 400  # scenarios of the training
GENERATE = {"preset": "train", "count": SCENARIOS, "seed": 9}
TESTED = 150  # scenarios of the comparison
AGENTS = 12
EVERY = 2  # steps of 0.1 s per decision
TIMES = 0.1 * np.arange(1, 11)  # seconds of the planned poses
ACCELERATIONS = [-4.0, -2.0, -1.0, 0.0, 1.0, 2.0]  # m/s², the choices of a decision
REACH = 60.0  # metres of the route that are observed
URGENT = 2.5  # seconds, time to collision below which the emergency brake acts
EMERGENCY = -8.0  # m/s²
LONGEST = 3.0  # seconds, above which times to collision do not matter
MAX_SPEED = 13.0  # m/s, where no limit is known


def reward(measures):
    """Rewards progress; a contact at fault costs as much as 3 km, an imminent one up to 135 m."""
    return (
        0.02 * measures["progress"]
        - 60.0 * measures["at_fault_contact"]
        - 0.3 * max(LONGEST - measures["ttc"], 0.0) ** 2
        - 0.02 * (measures["uncomfortable"] > 0.0)
    )


class AlongRoute(gymnasium.Wrapper):
    """Reduces driving to the choice of an acceleration along the route."""

    def __init__(self, source, **settings):
        sizes = {"agents": AGENTS, "frames": 1, "lanes": 1, "points": 2, "lights": 1}
        super().__init__(
            reactsim.Env(
                source,
                action="plan",
                poses=len(TIMES),
                every=EVERY,
                route=round(REACH / 2),
                reward=reward,
                **sizes,
                **settings,
            )
        )
        self.action_space = gymnasium.spaces.Discrete(len(ACCELERATIONS))
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (10 + 6 * AGENTS,))

    def reset(self, **options):
        observation, info = self.env.reset(**options)
        return self.features(observation, LONGEST), info

    def step(self, action):
        acceleration = EMERGENCY if self.ttc < URGENT else ACCELERATIONS[action]
        observation, *rest, info = self.env.step(self.plan(acceleration))
        return self.features(observation, info["ttc"]), *rest, info

    def plan(self, acceleration):
        """Returns poses [10, 3] along the route at an acceleration."""
        speeds = np.clip(self.speed + acceleration * TIMES, 0.0, max(self.limit, self.speed))
        steps = 0.1 * (speeds + np.concatenate([[self.speed], speeds[:-1]])) / 2
        distances = np.cumsum(steps)
        xy = np.stack([np.interp(distances, self.s, self.line[:, k]) for k in (0, 1)], 1)
        # Straight on where the route ends.
        end = np.array([np.cos(self.headings[-1]), np.sin(self.headings[-1])])
        xy += np.maximum(distances - self.s[-1], 0.0)[:, None] * end
        return np.column_stack([xy, np.interp(distances, self.s, self.headings)])

    def features(self, observation, ttc):
        """Returns the observation [10 + 6 * AGENTS] of the policy, and keeps what `step` needs."""
        self.speed = float(np.hypot(*observation["av"][-1, 4:6]))
        self.limit = float(observation["lane_features"][0, 2]) or MAX_SPEED
        route = observation["route"][observation["route"][:, 4] > 0.0]
        self.line = np.concatenate([[[0.0, 0.0]], route[:, :2]])
        self.headings = np.unwrap(np.concatenate([[0.0], np.arctan2(route[:, 3], route[:, 2])]))
        lengths = np.linalg.norm(np.diff(self.line, axis=0), axis=1)
        self.s = np.concatenate([[0.0], np.cumsum(lengths)])
        self.ttc = min(ttc, LONGEST)
        # Of each agent: distance along and beside the route, speed likewise, half its length.
        agents = observation["agents"][:, -1]
        xy, velocity = agents[:, :2], agents[:, 4:6]
        nearest = np.argmin(np.linalg.norm(xy[:, None] - self.line[None], axis=2), axis=1)
        heading = self.headings[nearest]
        ahead = np.stack([np.cos(heading), np.sin(heading)], 1)
        left = np.stack([-ahead[:, 1], ahead[:, 0]], 1)
        offset = xy - self.line[nearest]
        along = self.s[nearest] + (offset * ahead).sum(1)
        beside = (offset * left).sum(1)
        sizes = observation["agent_features"][:, 0] / 2
        about = np.stack(
            [
                along / 20.0,
                np.clip(beside, -20.0, 20.0) / 5.0,
                (velocity * ahead).sum(1) / 10.0,
                (velocity * left).sum(1) / 5.0,
                sizes / 5.0,
                np.ones(AGENTS),
            ],
            1,
        )
        about[agents[:, 6] == 0.0] = [5.0, 4.0, 0.0, 0.0, 0.0, 0.0]
        bends = np.interp(np.arange(8) * REACH / 8, self.s, self.headings)
        own = [self.speed / 10.0, self.ttc, *np.diff(bends), self.s[-1] / REACH]
        # Agents on the route come first.
        is_on_route = (along > 0.0) & (np.abs(beside) < 2.5) & (agents[:, 6] > 0.0)
        order = np.lexsort((np.linalg.norm(xy, axis=1), ~is_on_route))
        return np.concatenate([own, about[order].ravel()], dtype=np.float32)


class UntilTime(BaseCallback):
    """Stops the training when its time is over."""

    def _on_step(self):
        return time.monotonic() < self.end

    def _on_training_start(self):
        self.end = time.monotonic() + SECONDS


def train(source):
    """Trains a policy and saves it."""

    def make():
        return AlongRoute(source, end_at="at-fault-contact", scores=False)

    envs = VecMonitor(DummyVecEnv([make] * ENVS))
    policy = PPO(
        "MlpPolicy",
        envs,
        n_steps=256,
        batch_size=256,
        gamma=0.96,
        ent_coef=0.003,
        seed=0,
        policy_kwargs={"net_arch": [128, 128]},
        verbose=1,
    )
    policy.learn(STEPS, callback=UntilTime())
    policy.save(POLICY)
    envs.close()
    return policy


def drive(env, choose):
    """Drives all scenarios; returns mean progress (m), contacts at fault in all, mean score."""
    sums = np.zeros(3)
    for scenario in env.unwrapped.scenarios:
        observation, info = env.reset(options={"scenario": scenario, "rollout": 0})
        is_over = False
        while not is_over:
            observation, _, terminated, truncated, info = env.step(choose(observation))
            sums[:2] += info["progress"], info["at_fault_contact"]
            is_over = terminated or truncated
        sums[2] += info["scores"].metrics["av-score"]
    return sums / [TESTED, 1, TESTED]


if __name__ == "__main__":
    torch.set_num_threads(1)  # the network is small
    if len(sys.argv) > 1:
        policy = train(sys.argv[1])
    else:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "train.parquet")
            print(reactsim.command("generate", **GENERATE, out=path), file=sys.stderr)
            policy = train(path)
    env = AlongRoute(None, limit=TESTED)
    print("policy            progress (m)  contacts at fault  score")
    for name, choose in {
        "ppo": lambda seen: policy.predict(seen, deterministic=True)[0],
        "keeps its speed": lambda _: ACCELERATIONS.index(0.0),
        "brakes by 1 m/s²": lambda _: ACCELERATIONS.index(-1.0),
        "brakes by 2 m/s²": lambda _: ACCELERATIONS.index(-2.0),
        "brakes by 4 m/s²": lambda _: ACCELERATIONS.index(-4.0),
    }.items():
        progress, contacts, score = drive(env, choose)
        print(f"{name:16}  {progress:12.1f}  {contacts:17.0f}  {score:5.3f}")
        if name == "ppo":
            env.unwrapped.save_gif(VIDEO)
    env.close()
