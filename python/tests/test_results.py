"""Results of a run folder."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Any, Dict, List

import numpy as np
import pytest
import reactsim
from fake_program import write_folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_folder(tmp_path / "run", failed=True)
    return tmp_path / "run"


def records(frame: Any) -> List[Dict[str, Any]]:
    result: List[Dict[str, Any]] = frame if isinstance(frame, list) else frame.to_dict("records")
    return result


def check(results: reactsim.Results) -> None:
    first, over_all, empty = records(results.rows)
    assert (first["scenario"], first["simulator"], first["rollout"]) == ("first", "idm", 0)
    assert (first["aa-collision"], first["aav-collision"], first["ade"]) == (0.25, 2.0, 0.5)
    assert first["deviation_ade"] == 1.5
    assert over_all["min-ade"] == 1.5
    assert empty["ade"] is None or np.isnan(empty["ade"])
    assert empty["aa-collision"] is None or np.isnan(empty["aa-collision"])
    (event,) = records(results.events)
    assert (event["metric"], event["step"], event["value_speed"]) == ("aav-collision", 3, 3.5)
    (failure,) = records(results.failures)
    assert failure["error"] == "it is broken"


def test_with_pandas(folder: Path) -> None:
    pandas = pytest.importorskip("pandas")
    results = reactsim.Results(folder)
    assert isinstance(results.rows, pandas.DataFrame)
    assert results.rows["rollout"].isna().tolist() == [False, True, False]
    assert results.rows.groupby("simulator")["aav-collision"].mean()["idm"] == 2.0
    check(results)
    (folder / "failures.jsonl").write_text("")
    assert list(reactsim.Results(folder).failures.columns)[-1] == "error"


def test_without_pandas(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    results = reactsim.Results(folder)
    assert isinstance(results.rows, list)
    check(results)


def test_texts(folder: Path) -> None:
    results = reactsim.Results(str(folder))
    assert results.table() == "| Method |\n|---|\n| IDM |\n"
    assert results.table()._repr_markdown_() == str(results.table()) == results._repr_markdown_()
    assert "Lateral" in results.table(details=True)
    assert results.summary["simulators"]["idm"]["scenarios"] == 1
    assert results.provenance["version"] == "0.0.0"
    assert results.simulators == ["idm", "mine"]
    if sys.version_info >= (3, 11):
        assert results.spec is None
        (folder / "spec.toml").write_text('models = ["idm"]\nseed = 3\n')
        assert reactsim.Results(folder).spec == {"models": ["idm"], "seed": 3}
    assert repr(results) == f"Results({str(folder)!r})"


def test_printed_tables_fit_the_terminal(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    legend = "† is shown the log's future.\nMeans over scenarios ± <half>.\n"
    wide = "| M  | one | two | three |\n|----|----:|----:|------:|\n| a | 1 | 2 | 3 |\n"
    (folder / "summary.md").write_text(f"{wide}\nLateral (1):\n\n{wide}\n{legend}", "utf-8")
    table = reactsim.Results(folder).table()
    assert table == f"{wide}\n{legend}" == str(table)
    html = reactsim.Results(folder)._repr_html_()
    assert html.count("<tr>") == 2 and '<td style="text-align: right">1</td>' in html
    assert "future.<br>Means over scenarios ± &lt;half&gt;." in html
    monkeypatch.setattr("sys.stdout", io.StringIO())
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", "18")
    first, second, end = str(table).split("\n\n")
    assert first == "| M  | one | two |\n|----|----:|----:|\n| a | 1 | 2 |"
    assert second == "| M  | three |\n|----|------:|\n| a | 3 |"
    assert end == legend
    monkeypatch.setenv("COLUMNS", "80")
    assert str(table) == table


def test_missing_files(folder: Path) -> None:
    with pytest.raises(FileNotFoundError, match="is no run folder"):
        reactsim.Results(folder / "none")
    (folder / "summary.json").unlink()
    with pytest.raises(FileNotFoundError, match="the run is not finished"):
        _ = reactsim.Results(folder).summary
    with pytest.raises(FileNotFoundError, match="--keep-rollouts"):
        next(reactsim.Results(folder).rollouts())


def test_rollouts(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    track = [float(k) for k in range(80)]
    absent: List[Any] = [None] * 80
    rows = {
        "scenario_id": ["first", "first", "second"],
        "simulator": ["idm", "mine", "mine"],
        "rollout": [0, 0, 1],
        "origin_x": [1.0, 1.0, None],
        "origin_y": [2.0, 2.0, None],
        "agent_id": [["0", "1"]] * 3,
    }
    for name in ("x", "y", "heading", "vx", "vy"):
        rows[name] = [[track, absent]] * 3
    parquet.write_table(pyarrow.table(rows), folder / "rollouts.parquet")
    results = reactsim.Results(folder)
    first, second, third = results.rollouts()
    assert (first.scenario, first.simulator, first.agents) == ("first", "idm", ["0", "1"])
    assert first.origin == (1.0, 2.0)
    assert np.isnan(third.origin).all()
    assert first.states.shape == (2, 80, 5)
    assert first.states[0, 7].tolist() == [7.0] * 5
    assert np.isnan(first.states[1]).all()
    assert (second.simulator, third.rollout) == ("mine", 1)
    assert len(list(results.rollouts(simulator="mine"))) == 2
    assert len(list(results.rollouts(simulator="mine", scenario="first"))) == 1
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ImportError, match="needs pyarrow"):
        next(results.rollouts())
