"""Functions for the commands of the program, with the program; skipped if it cannot be found."""

from __future__ import annotations

import os
import re
import shutil
import signal
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import reactsim
from fakes import MINI, ROOT, executable
from reactsim.program import invoke
from stop import Stop

pytestmark = [pytest.mark.program, pytest.mark.usefixtures("with_program")]


@pytest.fixture(scope="module")
def runs(with_program: None, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Two runs of two simulators, with other settings of `idm`."""
    folder = tmp_path_factory.mktemp("runs")
    given: Any = {"baselines": ["idm"], "progress": False}
    changed = ["--set=idm.vehicle.headway=3"]
    return [
        reactsim.run(Stop(), MINI, out=folder / "before", **given),
        reactsim.run(Stop(), MINI, out=folder / "after", options=changed, **given),
    ]


class TestCompare:
    def test_differences_are_those_of_the_rows(self, runs: Any) -> None:
        before, after = runs
        pairs = reactsim.compare(before, after)
        assert [(pair.first, pair.second) for pair in pairs] == [
            ("idm", "idm"),
            ("stop-py", "stop-py"),
        ]
        pair = pairs["idm"]
        assert (pair.scenarios, pair.unpaired) == (12, 0)
        first, second = (ades(results) for results in runs)
        ade = pair.metrics["ade"]
        assert ade.first == pytest.approx(sum(first.values()) / 12)
        assert ade.difference == pytest.approx(sum(second.values()) / 12 - ade.first)
        assert ade.low <= ade.difference <= ade.high
        assert 0 < ade.p <= 1
        direction = "worse" if ade.difference > 0 else "better"
        assert ade.verdict == (direction if ade.p < 0.05 else "no-difference-seen")
        assert ade.visible is not None and ade.visible > 0
        changes = dict(ade.better + ade.worse)
        assert changes == pytest.approx({id: second[id] - first[id] for id in changes})
        assert all(change < 0 for _, change in ade.better)
        assert len(changes) == sum(second[id] != first[id] for id in first) > 0
        assert pairs["stop-py"].metrics["ade"].difference == 0.0
        assert "| ADE (m) ↓" in pairs.table()
        with pytest.raises(KeyError):
            pairs["none"]

    def test_bounds(self, runs: Any) -> None:
        before = runs[0]
        models = ["idm", "stop-py"]
        worsening = reactsim.compare(before, before, models=models)[0].metrics["ade"].difference
        assert worsening > 0
        same = {"models": models, "worse": {"ade": worsening + 0.1}}
        assert before.compare(before, **same).exceeded == ()
        exceeded = before.compare(before, models=models, worse={"ade": worsening - 0.1}).exceeded
        assert len(exceeded) == 1
        assert "`stop-py` got worse by more than ade" in exceeded[0]

    def test_rows(self, runs: Any) -> None:
        pandas = pytest.importorskip("pandas")
        rows = reactsim.compare(*runs).rows
        assert isinstance(rows, pandas.DataFrame)
        assert {"first_simulator", "metric", "difference", "low", "high", "p", "verdict"} <= set(
            rows.columns
        )

    def test_other_runs(self, runs: Any, tmp_path: Path) -> None:
        with pytest.raises(reactsim.ReactsimError, match="is not a run folder"):
            reactsim.compare(runs[0], tmp_path)
        other = reactsim.run(Stop(), MINI, replan="1hz", out=tmp_path / "other", progress=False)
        with pytest.raises(reactsim.ReactsimError, match="--despite replan"):
            reactsim.compare(runs[0], other)
        assert len(reactsim.compare(runs[0], other, despite="replan")) == 1


def ades(results: reactsim.Results) -> "dict[str, float]":
    """Returns the displacement of `idm` by scenario."""
    rows = [row for row in results._lines("rows.jsonl") if row["simulator"] == "idm"]
    rows = [row for row in rows if row["rollout"] is not None]
    return {
        row["scenario"]: row["metrics"]["ade"]["mean"][0] / row["metrics"]["ade"]["mean"][1]
        if "mean" in row["metrics"]["ade"]
        else row["metrics"]["ade"]["value"]
        for row in rows
    }


class TestCommand:
    def test_tables(self, runs: Any) -> None:
        table = reactsim.command("report", *runs, columns=["ade"], also=["log-clinging"], bold=True)
        assert (table.code, table.path) == (0, None)
        assert str(table) == table.text
        assert table.text.count("| before |") >= 2
        assert table._repr_html_().startswith("<pre>")
        summaries = reactsim.command("report", runs[0], format="json").document
        assert set(summaries["simulators"]) == {"idm", "stop-py"}
        latex = reactsim.command("report", runs[0], "--format=latex", caption="A & B", label="a")
        assert "\\label{a}" in latex.text
        with pytest.raises(reactsim.ReactsimError, match="for the page"):
            reactsim.command("report", runs[0], case="cut-in")
        for out in (["--out", "t.csv"], ["--out=t.csv"]):
            assert reactsim.command("report", runs[0], *out, format="csv").path == Path("t.csv")

    @pytest.fixture(autouse=True)
    def folder(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.chdir(tmp_path)

    def test_pages(self, runs: Any) -> None:
        page = reactsim.command("report", runs[0], format="html", scenarios=MINI, cases=1)
        assert page.text.startswith("<!doctype html>")
        shown = page._repr_html_()
        assert shown.startswith('<iframe srcdoc="&lt;!doctype html&gt;')
        # The page is one attribute: nothing in it ends the attribute.
        assert shown.count('"') == 8

    def test_failed_scenarios(self, tmp_path: Path) -> None:
        source = tmp_path / "logs"
        shutil.copytree(MINI, source)
        (source / "cut-in.json").write_text('{"format": "reactsim-scenario-v1"}')
        with pytest.warns(UserWarning, match=r"ended with code 1:\n(.|\n)*cut-in.json"):
            done = reactsim.command("convert", source, out="a.parquet", progress=False)
        assert done.code == 1
        assert done.path is not None
        assert len(list(reactsim.scenarios(done.path))) == 11
        with pytest.raises(reactsim.ReactsimError, match="no-such-id"):
            reactsim.command("convert", MINI, id=["no-such-id"], out="b.parquet", progress=False)

    def test_options(self) -> None:
        recipe = {"learning.epochs": 2, "learning.batch": 8}
        done = reactsim.command("train", "ntp-reactive", print_recipe=True, set=recipe, jobs=None)
        assert "epochs = 2" in done.text
        assert "reactsim" in reactsim.command("list", "--help").text
        with pytest.raises(reactsim.ReactsimError, match="no-such-model"):
            reactsim.command("list", "parameters", "no-such-model")


class TestPictures:
    def test_scenarios(self) -> None:
        scenario = next(iter(reactsim.scenarios(MINI, ids="cut-in")))
        assert scenario._repr_svg_() == scenario.svg()
        assert scenario.svg(simulator="idm", steps=40) != scenario.svg(steps=40)
        gif = scenario.gif(every=20)
        assert gif.startswith(b"GIF89a")
        assert len(scenario.gif(every=20, simulators=["stop", "idm"])) > len(gif)
        assert gif._repr_mimebundle_()["image/gif"].startswith("R0lGODlh")
        assert repr(gif) == str(gif) == f"Gif({len(gif)} bytes)"
        scenario.id = "no-such-id"
        with pytest.raises(reactsim.ReactsimError, match="no-such-id"):
            scenario.svg()

    def test_rollouts(self, runs: Any) -> None:
        before = runs[0]
        pictures = [results.svg("cut-in", "idm", source=MINI) for results in runs]
        assert pictures[0] != pictures[1]
        assert [results.svg("cut-in", "idm") for results in runs] == pictures
        both = before.gif("cut-in", every=20)
        assert both == before.gif("cut-in", ["idm", "stop-py"], source=MINI, every=20)
        assert both != before.gif("cut-in", "idm", source=MINI, every=20)

    def test_notebooks_show_them(self, runs: Any) -> None:
        nbformat = pytest.importorskip("nbformat")
        nbclient = pytest.importorskip("nbclient")
        pytest.importorskip("ipykernel")
        setup = f"import sys; sys.path.insert(0, {str(ROOT / 'python')!r}); import reactsim"
        shown = {
            f"next(reactsim.scenarios({str(MINI)!r}))": "image/svg+xml",
            f"next(reactsim.scenarios({str(MINI)!r})).gif(every=20)": "image/gif",
            f"reactsim.command('report', {str(runs[0].folder)!r}, format='html')": "text/html",
            f"reactsim.compare({str(runs[0].folder)!r}, {str(runs[1].folder)!r})": "text/markdown",
            "reactsim.command('list', 'cases')": "text/html",
        }
        cells = [nbformat.v4.new_code_cell(source) for source in [setup, *shown]]
        notebook = nbformat.v4.new_notebook(cells=cells)
        nbclient.NotebookClient(notebook, timeout=120).execute()
        for cell, kind in zip(notebook.cells[1:], shown.values()):
            (output,) = (one for one in cell.outputs if one["output_type"] == "execute_result")
            assert kind in output["data"], cell.source

    def test_reading(self) -> None:
        more = list(reactsim.scenarios(MINI, ids="crosswalk", all_agents=True))
        assert more[0].svg().startswith("<svg")


class TestDeviations:
    def test_curate(self, tmp_path: Path) -> None:
        found = reactsim.curate(
            MINI, tmp_path / "a.parquet", min_vehicles=1, candidates=4, progress=False
        )
        stats = found.stats()
        assert stats["funnel"]["scenarios"] == 12
        assert 0 < stats["chosen"] <= stats["scenarios"] < 12
        chosen = re.search(r"\| 4 Chosen +\| +(\d+) \|", found.table())
        assert chosen is not None and int(chosen[1]) == stats["chosen"]
        few = reactsim.curate(
            MINI, tmp_path / "b.parquet", min_vehicles=1, candidates=1, limit=1, progress=False
        )
        assert few.stats()["funnel"]["candidates"] < stats["funnel"]["candidates"]
        results = reactsim.run(Stop(), MINI, deviations=found, progress=False)
        assert len(results.rows) > 0
        with pytest.raises(FileNotFoundError):
            reactsim.curation.Candidates(tmp_path / "none")
        with pytest.raises(reactsim.ReactsimError, match="code 2"):
            reactsim.curate(tmp_path / "none", tmp_path / "c.parquet", progress=False)

    def test_heights(self, tmp_path: Path) -> None:
        logs = tmp_path / "logs.parquet"
        reactsim.command(
            "generate", preset="train", count=1, maps="overpass", out=logs, progress=False
        )
        for scenario in reactsim.scenarios(logs):
            assert np.array_equal(np.isfinite(scenario.heights), scenario.present)
            points = np.concatenate([lane.points for lane in scenario.lanes])
            heights = np.concatenate([lane.heights for lane in scenario.lanes])
            assert len(heights) == len(points)
            assert np.ptp(heights) > 4.0
            # The AV is on the ground of some lane.
            near = np.linalg.norm(points - scenario.history[0, -1, :2], axis=1) < 5.0
            assert np.abs(heights[near] - scenario.history_heights[0, -1]).min() < 1.0
        (flat,) = reactsim.scenarios(MINI, ids="cut-in")
        assert np.isnan(flat.heights).all()
        (first, *_) = (lane.heights for lane in flat.lanes)
        assert first is not None
        assert np.isnan(first).all()


def test_score(runs: Any, tmp_path: Path) -> None:
    before, _ = runs
    scored = reactsim.score(
        before.folder / "rollouts.parquet", MINI, out=tmp_path / "scored", progress=False
    )
    assert ades(scored) == pytest.approx(ades(before))


def test_runs_of_baselines() -> None:
    results = reactsim.run(baselines="stop,idm", scenarios=MINI, limit=1, progress=False)
    assert results.simulators == ["stop", "idm"]
    folder = results.folder
    assert folder.is_dir()
    del results
    assert not folder.exists()
    with pytest.raises(reactsim.ReactsimError, match=r"code 2:(.|\n)*no-such-model"):
        reactsim.run(baselines=["no-such-model"], progress=False)


@pytest.mark.parametrize("name", ["-q", "--help", "=x", "a b", 'it\'s "so"', "two\nlines"])
def test_names_are_no_options(
    name: str, runs: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(runs[0].folder, name)
    assert len(reactsim.compare(name, name)) == 2
    assert reactsim.command("report", "--", name, format="csv").text.startswith("run,")
    out = f"{name}.parquet"
    assert reactsim.command("convert", MINI, out=out, progress=False).path == Path(out)
    (scenario, *_) = reactsim.scenarios(out, ids="cut-in")
    results = reactsim.run(Stop(), out, ids=["cut-in"], out=f"-{name}", progress=False)
    assert [rollout.agents for rollout in results.rollouts()] == [scenario.agents]
    assert "</svg>" in reactsim.Results(name).svg("cut-in", "idm", source=out)
    for call in (
        lambda: reactsim.compare(name, "none"),
        lambda: reactsim.compare(name, name, models=[name, name]),
        lambda: reactsim.command("report", "--", name, format=name),
        lambda: reactsim.command("inspect", MINI, id=name),
        lambda: reactsim.run(Stop(), MINI, ids=[name], deviations=name, progress=False),
        lambda: reactsim.command("verify", "--", name, progress=False),
    ):
        with pytest.raises(reactsim.ReactsimError, match="code 2"):
            call()


def test_interrupts(tmp_path: Path) -> None:
    out = tmp_path / "logs.parquet"
    threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT)).start()
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        reactsim.command("generate", preset="train", count=1_000_000, out=out, progress=False)
    assert time.monotonic() - start < 20


def test_messages_have_the_last_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = executable(tmp_path / "program", "seq 100 >&2\nexit 7")
    monkeypatch.setenv("REACTSIM_BINARY", str(program))
    with pytest.raises(reactsim.ReactsimError, match=r"code 7:\n71\n(.|\n)*\n100$"):
        invoke(["compare"])
    executable(program, "")
    for call in (
        lambda: reactsim.compare("a", "b"),
        lambda: reactsim.curate("a", tmp_path / "none"),
    ):
        with pytest.raises(reactsim.ReactsimError, match="check that REACTSIM_BINARY"):
            call()
