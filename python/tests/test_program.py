"""The package and the program together; skipped if the program cannot be found."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import reactsim
from constant_velocity import ConstantVelocity
from fakes import EXAMPLES, IMPORTED, MINI
from stop import Stop

pytestmark = [pytest.mark.program, pytest.mark.usefixtures("with_program")]


def metrics(results: reactsim.Results, simulator: str) -> list[dict[str, Any]]:
    """Returns the rows of a simulator without its name."""
    lines = results._lines("rows.jsonl")
    return [
        {key: value for key, value in line.items() if key != "simulator"}
        for line in lines
        if line["simulator"] == simulator
    ]


@pytest.mark.parametrize(
    ("simulator", "baseline"), [(ConstantVelocity(), "constant-velocity"), (Stop(), "stop")]
)
@pytest.mark.parametrize("protocol", ["reactive", "realism"])
def test_examples_equal_baselines(simulator: Any, baseline: str, protocol: str) -> None:
    results = reactsim.run(
        simulator, MINI, protocol=protocol, baselines=[baseline], batch=5, progress=False
    )
    assert simulator.name in results.simulators
    rows = metrics(results, simulator.name)
    assert len(rows) >= 12
    assert rows == metrics(results, baseline)
    assert len(results.failures) == 0


def test_child_process(program: str, tmp_path: Path) -> None:
    out = tmp_path / "run"
    command = f"{sys.executable} {EXAMPLES / 'stop.py'}"
    done = subprocess.run(
        [program, "run", str(MINI), "--external", f"mine={command}", "--out", str(out)],
        capture_output=True,
        check=False,
        env={"PYTHONPATH": str(IMPORTED)},
    )
    assert done.returncode == 0, done.stderr.decode()
    assert metrics(reactsim.Results(out), "mine")


class Broken(Stop):  # type: ignore[misc]
    def plan(self, seen: reactsim.Observation) -> Any:
        if seen.frame >= 30:
            raise RuntimeError("broken at frame 30")
        return super().plan(seen)


class PartlyBroken(Stop):  # type: ignore[misc]
    def plan(self, seen: reactsim.Observation) -> Any:
        return reactsim.Plan(super().plan(seen), {0: "the first one is not to my taste"})


def test_failures() -> None:
    with pytest.warns(UserWarning, match="broken at frame 30"):
        # A baseline, because a run without any result is an error.
        results = reactsim.run(Broken(), MINI, limit=2, baselines=["stop"], progress=False)
    assert len(results.failures) > 0
    with pytest.warns(UserWarning, match="not to my taste"):
        results = reactsim.run(PartlyBroken(), MINI, batch=2, baselines=["stop"], progress=False)
    assert 0 < len(results.failures) <= 12


class Curious(Stop):  # type: ignore[misc]
    def begin(self, scenes: reactsim.Scenes) -> None:
        self.ids = scenes.scenario_ids


def test_ids_are_revealed_on_request() -> None:
    curious = Curious()
    reactsim.run(curious, MINI, limit=1, progress=False)
    assert curious.ids is None
    reactsim.run(curious, MINI, limit=1, reveal_ids=True, progress=False)
    assert curious.ids


def test_wrong_settings() -> None:
    with pytest.raises(reactsim.ReactsimError, match="code 2"):
        reactsim.run(Stop(), "not-there", progress=False)
    only_slow = type("OnlySlow", (Stop,), {"intervals": (20,)})
    with pytest.raises(reactsim.ReactsimError):
        reactsim.run(only_slow(), MINI, progress=False)


def test_scenarios() -> None:
    scenarios = list(reactsim.scenarios(MINI))
    assert len(scenarios) == 12
    assert len({s.id for s in scenarios}) == 12
    for scenario in scenarios:
        assert scenario.present[:, 10].all()
        assert np.abs(scenario.history[0, 10, :2]).max() == 0.0
        assert np.isfinite(scenario.states[scenario.present][:, :3]).all()
    assert sum(s.av is not None for s in scenarios) > 0
    assert any(s.lanes for s in scenarios)
    assert len(list(reactsim.scenarios(limit=2, future=False))) == 2
    lateral = [scene.id for scene in reactsim.scenarios(MINI, categories="lateral", future=False)]
    assert lateral == ["cut-in", "oncoming-nudge", "pull-out", "wide-bend"]
    results = reactsim.run(Stop(), MINI, ids=lateral[:2], progress=False)
    assert list(results.provenance["settings"]["selection"]["ids"]) == lateral[:2]
    assert "</svg>" in scenarios[0].svg()
    with pytest.raises(reactsim.ReactsimError):
        list(reactsim.scenarios("not-there"))


def test_notebook() -> None:
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    pytest.importorskip("pandas")
    pytest.importorskip("matplotlib")
    notebook = nbformat.read(EXAMPLES / "quick_start.ipynb", as_version=4)
    path = f"import sys; sys.path.insert(0, {str(IMPORTED)!r})"
    notebook.cells.insert(0, nbformat.v4.new_code_cell(path))
    nbclient.NotebookClient(notebook, timeout=300).execute()
