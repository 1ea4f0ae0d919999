"""Evaluate traffic simulators with `reactsim`, a benchmark for simulated road users.

    import reactsim

    class Mine(reactsim.Simulator):
        def plan(self, seen):  # numpy in, numpy out
            ...

    results = reactsim.run(Mine(), baselines=["idm"], limit=20)
    results.table()

`import reactsim` needs only numpy. pandas, pyarrow and matplotlib are used where they are
installed. The environments for reinforcement learning, `Env`, `VectorEnv` and `ParallelEnv`, need
gymnasium and pettingzoo.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from .catalog import catalog, list_scenarios
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
    serve,
)
from .command import command
from .comparison import Comparison, Comparisons, MetricDifference, compare
from .conversion import convert, export_av, export_wosac
from .curation import Candidates, curate
from .display import Gif, Html, Markdown, Svg, Text
from .generation import Generated, generate
from .pages import Page, view
from .pictures import animate, draw, inspect
from .plot import plot_rollout, plot_scene
from .program import ReactsimError, find_program
from .publishing import Leaderboard, leaderboard, make_reference
from .report import report
from .results import Results, Rollout
from .run import run
from .scenarios import Scenario, scenarios
from .scoring import (
    Event,
    RolloutScores,
    StatesScores,
    score,
    score_document,
    score_states,
)
from .study import Study, study
from .training import train, train_adapt, train_quick
from .verification import Verification, verify
from .wosac import WosacRollouts, WosacScores, wosac

__all__ = [
    "DT",
    "Candidates",
    "Comparison",
    "Comparisons",
    "Event",
    "Generated",
    "Gif",
    "Html",
    "Kind",
    "Lane",
    "Leaderboard",
    "Light",
    "Lights",
    "Line",
    "LineType",
    "Lines",
    "Markdown",
    "MetricDifference",
    "Neighbor",
    "Observation",
    "Page",
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
    "Study",
    "Svg",
    "Text",
    "Verification",
    "WosacRollouts",
    "WosacScores",
    "animate",
    "catalog",
    "command",
    "compare",
    "convert",
    "curate",
    "draw",
    "export_av",
    "export_wosac",
    "find_program",
    "generate",
    "inspect",
    "leaderboard",
    "list_scenarios",
    "make_reference",
    "plot_rollout",
    "plot_scene",
    "report",
    "run",
    "scenarios",
    "score",
    "score_document",
    "score_states",
    "serve",
    "study",
    "train",
    "train_adapt",
    "train_quick",
    "verify",
    "view",
    "wosac",
]

# They need packages that may be missing, so that they are imported when they are first used.
if TYPE_CHECKING:
    from .environment import Env as Env
    from .environment import VectorEnv as VectorEnv
    from .parallel import ParallelEnv as ParallelEnv

_LAZY = {"Env": ".environment", "ParallelEnv": ".parallel", "VectorEnv": ".environment"}


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(importlib.import_module(_LAZY[name], __name__), name)
    raise AttributeError(f"module `reactsim` has no attribute `{name}`")


def __dir__() -> list[str]:
    return sorted([*globals(), *_LAZY])
