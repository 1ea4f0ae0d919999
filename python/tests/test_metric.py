"""Metrics of the user."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import reactsim
from fakes import MINI
from own_metric import Closest

pytestmark = [pytest.mark.program, pytest.mark.usefixtures("with_program")]

MINE = "mean-closest-distance"


@pytest.fixture(autouse=True)
def _with_rollouts() -> None:
    pytest.importorskip("pyarrow")


class Fixed(reactsim.Metric):
    """A metric with a given score."""

    id = "fixed"
    title = "Fixed"
    unit = "s"

    def __init__(self, score: Any) -> None:
        self.given = score

    def score(self, case: reactsim.Case) -> Any:
        return self.given(self, case) if callable(self.given) else self.given


def run(out: Path, **options: Any) -> reactsim.Results:
    return reactsim.run(
        baselines=["idm", "stop"], limit=5, rollouts=2, out=out, progress=False, **options
    )


def lines(results: reactsim.Results, name: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (results.folder / name).read_text("utf-8").splitlines()]


def test_a_metric_is_in_every_result(tmp_path: Path) -> None:
    results = run(tmp_path / "run", metrics=[Closest()])
    record = results.provenance["own_metrics"]
    assert [(own["id"], own["unit"], own["lower_is_better"]) for own in record] == [
        (MINE, "m", False)
    ]
    rows = [row for row in lines(results, "rows.jsonl") if row["rollout"] is not None]
    assert len(rows) == 5 * 2 * 2
    assert all(row["metrics"][MINE]["value"] > 0 for row in rows)
    estimate = results.summary["simulators"]["idm"]["metrics"][MINE]
    assert estimate["low"] <= estimate["mean"] <= estimate["high"]
    assert estimate["scenarios"] == 5
    means = [row["metrics"][MINE]["value"] for row in rows if row["simulator"] == "idm"]
    assert estimate["mean"] == pytest.approx(np.mean(means))
    assert "Closest (m) ↑" in results.table()
    own = [event for event in lines(results, "events.jsonl") if event["metric"] == MINE]
    for row in rows:
        found = [
            event["values"]["distance"]
            for event in own
            if all(event[key] == row[key] for key in ("scenario", "simulator", "rollout"))
        ]
        assert np.mean(found) == pytest.approx(row["metrics"][MINE]["value"])
    (pair,) = reactsim.compare(results, results, models=["idm", "stop"])
    assert pair.metrics[MINE].first == pytest.approx(estimate["mean"])
    page = reactsim.command("report", results, format="html", progress=False).text
    assert f'"id":"{MINE}","title":"Closest"' in page


def test_metrics_are_added_and_replaced(tmp_path: Path) -> None:
    results = run(tmp_path / "run")
    before = results.rows
    assert "fixed" not in before
    results.add_metrics([Fixed(1.5), Closest()])
    assert results.summary["simulators"]["stop"]["metrics"]["fixed"]["mean"] == 1.5
    of_run = lines(run(tmp_path / "other", metrics=[Fixed(1.5), Closest()]), "rows.jsonl")
    assert lines(results, "rows.jsonl") == of_run
    results.add_metrics([Fixed(lambda _, case: None if case.simulator == "idm" else 2)])
    simulators = results.summary["simulators"]
    assert simulators["stop"]["metrics"]["fixed"]["mean"] == 2.0
    assert simulators["idm"]["metrics"]["fixed"]["mean"] is None
    assert [own["id"] for own in results.provenance["own_metrics"]] == [MINE, "fixed"]


def test_a_metric_is_in_the_table_of_a_study(tmp_path: Path) -> None:
    options: dict[str, Any] = {"axis": "replan=5,10", "models": "stop", "limit": 1}
    out = tmp_path / "study"
    reactsim.command("study", out=out, keep_rollouts=True, progress=False, **options)
    for name in ("replan-5", "replan-10"):
        reactsim.Results(out / name).add_metrics([Fixed(1.5)])
    table = reactsim.command("report", out, progress=False).text
    assert "Fixed (s) ↓" in table
    assert table.count(" 1.500 |") == 2


def test_a_case_has_the_rollout(tmp_path: Path) -> None:
    results = run(tmp_path / "run")
    rollouts = {(r.scenario, r.simulator, r.rollout): r for r in results.rollouts()}
    events = lines(results, "events.jsonl")
    seen = []

    def check(_: Fixed, case: reactsim.Case) -> float:
        key = (case.scenario.id, case.simulator, case.rollout)
        seen.append(key)
        n = case.scenario.n_agents
        assert case.states.shape == (n, 91, 5)
        np.testing.assert_array_equal(case.states[:, 11:], rollouts[key].states)
        np.testing.assert_array_equal(case.present[:, :11], case.scenario.valid)
        own = [event for event in events if (event["scenario"], *key[1:]) == key]
        own = [e for e in own if (e["simulator"], e["rollout"]) == key[1:]]
        assert [event.metric for event in case.events] == [event["metric"] for event in own]
        return 0.0

    results.add_metrics([Fixed(check)])
    assert sorted(seen) == sorted(rollouts)


def test_faults_name_metric_scenario_and_simulator(tmp_path: Path) -> None:
    results = run(tmp_path / "run")
    before = (results.folder / "rows.jsonl").read_bytes()
    first = next(reactsim.scenarios(limit=1)).id
    where = f"metric `fixed` in scenario `{first}`, `idm`, rollout 0: "

    def fails(_: Fixed, case: reactsim.Case) -> float:
        raise KeyError(case.simulator)

    def stranger(metric: Fixed, case: reactsim.Case) -> Any:
        return 1.0, [metric.event("nobody", 1)]

    def late(metric: Fixed, case: reactsim.Case) -> Any:
        return 1.0, [metric.event(case.scenario.agents[0], 81)]

    for score, text in [
        (math.nan, where + "`score` returned nan"),
        (math.inf, where + "`score` returned inf"),
        ("much", where + "ValueError"),
        (fails, where + "KeyError: 'idm'"),
        (stranger, where + "an event has the agent `nobody`"),
        (late, "steps from 1 to 80"),
    ]:
        with pytest.raises(reactsim.ReactsimError) as error:
            results.add_metrics([Fixed(score)])
        assert text in str(error.value)
    assert (results.folder / "rows.jsonl").read_bytes() == before


@pytest.mark.parametrize(
    ("attribute", "value", "text"),
    [
        ("id", "Fixed", "lower-case letters"),
        ("id", "ade", "the id is taken"),
        ("id", "scenario", "the id is taken"),
        ("id", "av-pdms", "the id is taken"),
        ("title", " ", "`title` is empty"),
        ("title", "a|b", "expected letters, digits, spaces"),
        ("title", "a" * 61, "at most 60 characters"),
        ("unit", "s\n", "expected letters, digits, spaces"),
        ("unit", "m" * 13, "at most 12 characters"),
        ("direction", "up", "expected one of"),
    ],
)
def test_unfit_metrics_are_refused_before_the_run(attribute: str, value: str, text: str) -> None:
    metric = Fixed(1.0)
    setattr(metric, attribute, value)
    with pytest.raises(ValueError, match=text):
        reactsim.run(baselines=["idm"], metrics=[metric])
    with pytest.raises(ValueError, match="the id is taken"):
        reactsim.run(baselines=["idm"], metrics=[Fixed(1.0), Fixed(2.0)])


def test_other_scenarios_are_refused(tmp_path: Path) -> None:
    results = run(tmp_path / "run")
    with pytest.raises(reactsim.ReactsimError, match="is not among the scenarios"):
        results.add_metrics([Fixed(1.0)], MINI)


def test_a_run_outlives_the_failure_of_a_metric() -> None:
    def fails(*_: Any) -> float:
        raise KeyError("nothing")

    with pytest.raises(reactsim.ReactsimError, match="KeyError") as caught:
        reactsim.run(baselines=["stop"], limit=1, metrics=[Fixed(fails)], progress=False)
    results = caught.value.results
    del caught
    results.add_metrics([Fixed(2.0)])
    assert results.summary["simulators"]["stop"]["metrics"]["fixed"]["mean"] == 2.0


def test_a_specification_is_run_with_its_scenarios(tmp_path: Path) -> None:
    pytest.importorskip("tomllib")
    spec = tmp_path / "spec.toml"
    text = 'models = ["stop"]\nreplan = "1hz"\nseed = 3\nlimit = 1\nrollouts = 2\n'
    spec.write_text(f'scenarios = ["{MINI.as_posix()}"]\n{text}')
    results = reactsim.run(spec, metrics=[Fixed(2.0)], seed=4, progress=False)
    assert results.spec is not None
    keys = ("models", "replan", "seed", "rollouts", "limit")
    assert [results.spec[key] for key in keys] == [["stop"], "10steps", 4, 2, 1]
    assert results.summary["simulators"]["stop"]["metrics"]["fixed"]["mean"] == 2.0
    again = reactsim.run(results.folder / "spec.toml", progress=False)
    assert again.spec is not None
    assert again.spec["seed"] == 4
    assert (
        lines(again, "rows.jsonl")[0]["metrics"]["ade"]
        == (lines(results, "rows.jsonl")[0]["metrics"]["ade"])
    )
