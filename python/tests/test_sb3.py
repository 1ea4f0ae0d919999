"""Environments for Stable-Baselines3, with the program."""

from __future__ import annotations

from pathlib import Path
from typing import Iterator

import numpy as np
import pytest
from fakes import MINI, SMALL, other_lengths

pytest.importorskip("stable_baselines3")

from reactsim.sb3 import VecEnv

pytestmark = [pytest.mark.program, pytest.mark.usefixtures("with_program")]


@pytest.fixture
def envs() -> Iterator[VecEnv]:
    envs = VecEnv(MINI, num_envs=3, every=40, render_mode="rgb_array", **SMALL)
    yield envs
    envs.close()


def test_episodes_begin_again_within_the_step(envs: VecEnv, tmp_path: Path) -> None:
    envs.seed(1)
    seen = envs.reset()
    assert seen.shape == (3, *envs.observation_space.shape)
    assert all(info["scenario"] in envs.envs.scenarios for info in envs.reset_infos)
    actions = np.zeros((3, 2), np.float32)
    _, rewards, over, infos = envs.step(actions)
    assert rewards.dtype == np.float32 and not over.any() and infos[0]["speed"] > 0.0
    seen, _, over, infos = envs.step(actions)
    assert over.all()
    for own, info in zip(seen, infos):
        assert info["TimeLimit.truncated"] and info["scores"].metrics["av-score"] is not None
        assert not np.array_equal(info["terminal_observation"], own)
    assert [envs.envs.states(index).shape[1] for index in range(3)] == [11, 11, 11]
    assert not envs.step(actions)[2].any()
    assert envs.render().shape[2] == 3
    assert envs.save_gif(tmp_path / "episode.gif", 2, size=100)[:6] == b"GIF89a"


def test_options_name_episodes(envs: VecEnv) -> None:
    envs.set_options({"scenario": 1, "rollout": 0})
    seen = envs.reset()
    assert np.array_equal(seen[0], seen[2])
    assert {info["scenario"] for info in envs.reset_infos} == {envs.get_attr("scenarios")[0][1]}


def test_episodes_may_have_any_length(tmp_path: Path) -> None:
    other_lengths(tmp_path)
    envs = VecEnv(tmp_path, num_envs=2, every=30, **SMALL)
    try:
        envs.set_options([{"scenario": "short"}, {"scenario": "long"}])
        envs.reset()
        over = [envs.step(np.zeros((2, 2), np.float32))[2].tolist() for _ in range(5)]
        assert over[:2] == [[False, False], [True, False]]
        assert [long for _, long in over] == [False] * 4 + [True]
    finally:
        envs.close()


def test_a_policy_learns(envs: VecEnv) -> None:
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecMonitor

    policy = PPO("MlpPolicy", VecMonitor(envs), n_steps=8, batch_size=8, n_epochs=1, seed=0)
    policy.learn(48)
    assert policy.num_timesteps == 48
