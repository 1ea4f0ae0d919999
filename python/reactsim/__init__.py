"""Evaluate traffic simulators with `reactsim`, a benchmark for simulated road users.

    import reactsim

    class Mine(reactsim.Simulator):
        def plan(self, seen):  # numpy in, numpy out
            ...

    results = reactsim.run(Mine(), baselines=["idm"], limit=20)
    results.table()

`import reactsim` needs only numpy. pandas, pyarrow and matplotlib are used where they are
installed.
"""

from __future__ import annotations

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
from .plot import plot_rollout, plot_scene
from .program import ReactsimError, find_program
from .results import Markdown, Results, Rollout
from .run import run
from .scenarios import Scenario, scenarios
from .wosac import WosacRollouts, WosacScores, wosac

__all__ = [
    "DT",
    "Kind",
    "Lane",
    "Light",
    "Lights",
    "Line",
    "LineType",
    "Lines",
    "Markdown",
    "Neighbor",
    "Observation",
    "Plan",
    "Planner",
    "PlannerObservation",
    "ProtocolError",
    "ReactsimError",
    "Relation",
    "Results",
    "Rollout",
    "Scenario",
    "Scene",
    "Scenes",
    "Simulator",
    "WosacRollouts",
    "WosacScores",
    "find_program",
    "plot_rollout",
    "plot_scene",
    "run",
    "scenarios",
    "serve",
    "wosac",
]
