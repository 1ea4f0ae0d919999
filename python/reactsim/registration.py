"""Ids of environments for `gymnasium.make` and `gymnasium.make_vec`."""

from __future__ import annotations

__all__ = ["ID", "register"]

ID = "reactsim/Drive-v0"
"""Id of `Env`, and of `VectorEnv` for `make_vec`."""


def register() -> None:
    """Registers the environments if gymnasium is installed. Further calls do nothing."""
    try:
        from gymnasium import envs
    except ImportError:
        return
    if ID not in envs.registry:
        place = "reactsim.environment"
        try:
            envs.register(
                id=ID, entry_point=f"{place}:Env", vector_entry_point=f"{place}:VectorEnv"
            )
        except TypeError:
            # A gymnasium too old for environments has no vectors; simulators do not need it.
            return
