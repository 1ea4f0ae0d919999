"""Evaluate traffic simulators with `reactsim`, a benchmark for simulated road users.

    import reactsim

    class Mine(reactsim.Simulator):
        def plan(self, seen):  # numpy in, numpy out
            ...

    results = reactsim.run(Mine(), baselines=["idm"], limit=20)
    results.table()

`import reactsim` needs only numpy. pandas, pyarrow and matplotlib are used where they are
installed. The environments for reinforcement learning need gymnasium (`Env` and `VectorEnv`, which
`gymnasium.make` and `make_vec` make of the id "reactsim/Drive-v0"), pettingzoo (`ParallelEnv`) and
Stable-Baselines3 (`reactsim.sb3.VecEnv`).
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from . import nuplan as nuplan
from .adaptation import Adaptation, train_adapt
from .client import (
    DT,
    Kind,
    Lane,
    Light,
    Lights,
    Line,
    Lines,
    LineType,
    Neighbor,
    Observation,
    Plan,
    Planner,
    PlannerObservation,
    ProtocolError,
    Relation,
    Scene,
    Scenes,
    Simulator,
    Trajectory,
    serve,
)
from .command import command
from .comparison import Comparison, Comparisons, MetricDifference, compare
from .curation import Candidates, curate
from .display import Gif, Markdown, Svg
from .metric import Case, Metric
from .plot import plot_rollout, plot_scene
from .program import Output, ReactsimError, find_program
from .registration import register as _register
from .results import Results
from .rows import Event, Rollout
from .run import run
from .scenarios import Scenario, scenarios
from .scoring import RolloutScores, StatesScores, score, score_states
from .training import train
from .wosac import WosacRollouts, WosacScores, WosacShares, wosac

__all__ = [
    "DT",
    "Adaptation",
    "Candidates",
    "Case",
    "Comparison",
    "Comparisons",
    "Event",
    "Gif",
    "Kind",
    "Lane",
    "Light",
    "Lights",
    "Line",
    "LineType",
    "Lines",
    "Markdown",
    "Metric",
    "MetricDifference",
    "Neighbor",
    "Observation",
    "Output",
    "Plan",
    "Planner",
    "PlannerObservation",
    "ProtocolError",
    "ReactsimError",
    "Relation",
    "Results",
    "Rollout",
    "RolloutScores",
    "Scenario",
    "Scene",
    "Scenes",
    "Simulator",
    "StatesScores",
    "Svg",
    "Trajectory",
    "WosacRollouts",
    "WosacScores",
    "WosacShares",
    "command",
    "compare",
    "curate",
    "find_program",
    "plot_rollout",
    "plot_scene",
    "run",
    "scenarios",
    "score",
    "score_states",
    "serve",
    "train",
    "train_adapt",
    "wosac",
]

__version__ = "0.1.0"

# They need packages that may be missing, so that they are imported when they are first used.
if TYPE_CHECKING:
    from .environment import Env as Env
    from .environment import VectorEnv as VectorEnv
    from .parallel import ParallelEnv as ParallelEnv

_LAZY = {"Env": ".environment", "ParallelEnv": ".parallel", "VectorEnv": ".environment"}


_register()


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(importlib.import_module(_LAZY[name], __name__), name)
    raise AttributeError(f"module `reactsim` has no attribute `{name}`")


def __dir__() -> list[str]:
    return sorted([*globals(), *_LAZY])
