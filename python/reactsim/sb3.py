"""Environments for Stable-Baselines3: `pip install 'reactsim[sb3]'`.

from reactsim.sb3 import VecEnv
from stable_baselines3 import PPO

envs = VecEnv(simulator="idm", num_envs=16, end_at="at-fault-contact", scores=False)
PPO("MlpPolicy", envs).learn(100_000)
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Union

import numpy as np

from .client import Array
from .display import Gif
from .environment import VectorEnv
from .options import PathLike, Sources
from .pictures import SavesMp4
from .scenarios import Scenario

try:
    from stable_baselines3.common.vec_env import VecEnv as BaseVecEnv
except ImportError as error:
    raise ImportError(
        f"`reactsim.sb3` needs Stable-Baselines3 ({error}): pip install 'reactsim[sb3]'"
    ) from None

__all__ = ["VecEnv"]

Indices = Union[None, int, Iterable[int]]


class VecEnv(SavesMp4, BaseVecEnv):
    """A `VectorEnv` with the interface of Stable-Baselines3.

    An episode that is over begins again within the same step; `infos` then has its last observation
    as `terminal_observation`. Observations are vectors and actions are from -1 to 1, unless `flat`
    or `normalized` is False.

    Args:
        scenarios: As for `reactsim.Env`.
        simulator: As for `reactsim.Env`.
        num_envs: Number of episodes.
        settings: The other arguments of `reactsim.VectorEnv`.

    Attributes:
        envs: The environment.

    """

    def __init__(
        self,
        scenarios: Sources | Scenario = None,
        simulator: Any = "idm",
        *,
        num_envs: int = 16,
        **settings: Any,
    ) -> None:
        given = {"flat": True, "normalized": True, **settings}
        self.envs = VectorEnv(scenarios, simulator, num_envs=num_envs, **given)
        self._actions: Any = None
        spaces = self.envs.single_observation_space, self.envs.single_action_space
        super().__init__(num_envs, *spaces)

    def reset(self) -> Any:
        """Begins all episodes, with the seed and the options that were set."""
        options = [dict(own or {}) for own in self._options]
        chosen = {
            f"{name}s": [own.get(name) for own in options]
            for name in ("scenario", "rollout")
            if any(name in own for own in options)
        }
        observation, infos = self.envs.reset(seed=self._seeds[0], options=chosen)
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = self._separate(infos)
        return observation

    def step_async(self, actions: Array) -> None:
        """Takes the actions of the next `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, Array, Array, list[dict[str, Any]]]:
        """Executes the actions; returns observations, rewards, ends and infos."""
        observation, rewards, terminated, truncated, vector = self.envs.step(self._actions)
        infos, over = self._separate(vector), terminated | truncated
        if over.any():
            slots = np.flatnonzero(over)
            first = self.envs.restart()
            for slot in slots.tolist():
                infos[slot]["TimeLimit.truncated"] = bool(truncated[slot])
                infos[slot]["terminal_observation"] = _row(observation, slot)
            if isinstance(observation, dict):
                for name, array in observation.items():
                    array[slots] = first[name]
            else:
                observation[slots] = first
        return observation, rewards.astype(np.float32), over, infos

    def _separate(self, infos: dict[str, Any]) -> list[dict[str, Any]]:
        """Returns the entries of each episode."""
        separate: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for name, values in infos.items():
            if name.startswith("_"):
                continue
            present = infos.get(f"_{name}")
            for slot, value in enumerate(values.tolist()):
                if present is None or present[slot]:
                    separate[slot][name] = value
        return separate

    def save_gif(self, path: PathLike | None, index: int = 0, **options: Any) -> Gif:
        """Writes an animation of an episode so far, as `reactsim.VectorEnv.save_gif`."""
        return self.envs.save_gif(path, index, **options)

    def get_images(self) -> list[Any]:
        """Returns a picture of each episode."""
        return list(self.envs.render() or [None] * self.num_envs)

    def close(self) -> None:
        """Ends the processes of the program."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """Returns an attribute of the environment, for each index."""
        return [getattr(self.envs, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Sets an attribute of the environment, which all episodes share."""
        setattr(self.envs, attr_name, value)

    def env_method(
        self, method_name: str, *method_args: Any, indices: Indices = None, **method_kwargs: Any
    ) -> list[Any]:
        """Raises AttributeError: the episodes are no objects of their own."""
        raise AttributeError(f"episodes have no method `{method_name}`: use `envs`")

    def env_is_wrapped(self, wrapper_class: Any, indices: Indices = None) -> list[bool]:
        """Returns False for each index."""
        return [False] * len(list(self._get_indices(indices)))


def _row(observation: Any, slot: int) -> Any:
    if isinstance(observation, dict):
        return {name: array[slot].copy() for name, array in observation.items()}
    return observation[slot].copy()
