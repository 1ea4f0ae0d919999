"""Functions for the commands of the program, with the program; skipped if it cannot be found."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import reactsim
from fakes import ROOT
from reactsim import training
from reactsim.program import invoke
from stop import Stop

pytestmark = [pytest.mark.program, pytest.mark.usefixtures("with_program")]

MINI = ROOT / "scenarios" / "mini"
REFERENCE = ROOT / "references" / "reactsim-bench-v2"


@pytest.fixture(scope="module")
def runs(program: str, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Two runs of two simulators, with other settings of `idm`."""
    folder = tmp_path_factory.mktemp("runs")
    previous = os.environ.get("REACTSIM_BINARY")
    os.environ["REACTSIM_BINARY"] = program
    try:
        changes = {"before": [], "after": ["--set=idm.vehicle.headway=3"]}
        return [
            reactsim.run(
                Stop(),
                MINI,
                baselines=["idm"],
                out=folder / name,
                options=options,
                progress=False,
            )
            for name, options in changes.items()
        ]
    finally:
        os.environ.pop("REACTSIM_BINARY")
        if previous is not None:
            os.environ["REACTSIM_BINARY"] = previous


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
        assert {"first_simulator", "metric", "difference", "low", "high", "p"} <= set(rows.columns)

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


class TestReport:
    def test_formats(self, runs: Any, tmp_path: Path) -> None:
        table = reactsim.report(runs, columns=["ade"], also=["log-clinging"], bold=True)
        assert isinstance(table, reactsim.Markdown)
        assert table.count("| before |") >= 2
        assert runs[0].report(columns="ade").startswith("| Method")
        assert set(json.loads(reactsim.report(runs[0], format="json"))["simulators"]) == {
            "idm",
            "stop-py",
        }
        latex = reactsim.report(runs[0], format="latex", caption="A & B", label="tab:a")
        assert "\\label{tab:a}" in latex
        out = tmp_path / "table.csv"
        assert reactsim.report(runs[0], format="csv", out=out) == out.read_text("utf-8")
        with pytest.raises(ValueError, match="give the file"):
            reactsim.report(runs[0], format="parquet")
        assert reactsim.report(runs[0], format="parquet", out=tmp_path / "t.parquet") == ""
        with pytest.raises(reactsim.ReactsimError, match="for the page"):
            reactsim.report(runs[0], case="cut-in")

    def test_page(self, runs: Any) -> None:
        page = reactsim.report(runs[0], format="html", scenarios=MINI, cases=1, case="cut-in")
        assert isinstance(page, reactsim.Html)
        assert page.startswith("<!doctype html>")
        assert "cut-in" in page
        shown = page._repr_html_()
        assert shown.startswith('<iframe srcdoc="&lt;!doctype html&gt;')
        # The page is one attribute: nothing in it ends the attribute.
        assert shown.count('"') == 8

    def test_view(self, runs: Any) -> None:
        with reactsim.view(runs[0], scenarios=MINI) as page:
            assert page.is_open
            assert page.url in page._repr_html_()
            text = urllib.request.urlopen(page.url, timeout=30).read()
            assert b"<!doctype html>" in text
        assert not page.is_open
        with pytest.raises((urllib.error.URLError, ConnectionError)):
            urllib.request.urlopen(page.url, timeout=5)
        with pytest.raises(reactsim.ReactsimError, match="is not a run folder"):
            reactsim.view("none")


class TestPictures:
    def test_scenarios(self) -> None:
        assert "deviation      lateral" in reactsim.inspect(MINI, id="cut-in")
        assert "&amp;" in reactsim.Text("a&b")._repr_html_()
        scenario = next(iter(reactsim.scenarios(MINI, ids="cut-in")))
        assert scenario._repr_svg_() == reactsim.draw(MINI, id="cut-in")
        assert scenario.svg(simulator="idm", steps=40) != scenario.svg(steps=40)
        gif = scenario.gif(every=20)
        assert gif.startswith(b"GIF89a")
        assert gif == reactsim.animate(MINI, id="cut-in", every=20)
        assert len(scenario.gif(every=20, simulators=["stop", "idm"])) > len(gif)
        assert gif._repr_mimebundle_()["image/gif"].startswith("R0lGODlh")
        assert repr(gif) == str(gif) == f"Gif({len(gif)} bytes)"
        with pytest.raises(reactsim.ReactsimError, match="no-such-case"):
            reactsim.draw(case="no-such-case")

    def test_rollouts(self, runs: Any) -> None:
        before = runs[0]
        pictures = [results.svg("cut-in", "idm", source=MINI) for results in runs]
        assert pictures[0] != pictures[1]
        both = before.gif("cut-in", source=MINI, every=20)
        assert both == before.gif("cut-in", ["idm", "stop-py"], source=MINI, every=20)
        assert both != before.gif("cut-in", "idm", source=MINI, every=20)

    def test_notebooks_show_them(self, runs: Any, program: str) -> None:
        nbformat = pytest.importorskip("nbformat")
        nbclient = pytest.importorskip("nbclient")
        pytest.importorskip("ipykernel")
        setup = f"import sys; sys.path.insert(0, {str(ROOT / 'python')!r}); import reactsim"
        shown = {
            f"next(reactsim.scenarios({str(MINI)!r}))": "image/svg+xml",
            f"reactsim.animate({str(MINI)!r}, id='cut-in', every=20)": "image/gif",
            f"reactsim.report({str(runs[0].folder)!r}, format='html')": "text/html",
            f"reactsim.compare({str(runs[0].folder)!r}, {str(runs[1].folder)!r})": "text/markdown",
            "reactsim.catalog('cases')": "text/html",
        }
        cells = [nbformat.v4.new_code_cell(source) for source in [setup, *shown]]
        notebook = nbformat.v4.new_notebook(cells=cells)
        nbclient.NotebookClient(notebook, timeout=120).execute()
        for cell, kind in zip(notebook.cells[1:], shown.values()):
            (output,) = cell.outputs
            assert kind in output["data"], cell.source
        assert notebook.cells[2].outputs[0]["data"]["image/gif"].startswith("R0lGODlh")

    def test_reading(self, tmp_path: Path) -> None:
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
        avs = reactsim.export_av(MINI, tmp_path / "avs.json", deviations=found)
        assert len(json.loads(avs.read_text())["deviations"]) == stats["chosen"]
        found.review(tmp_path / "review.html", limit=1)
        assert (tmp_path / "review.html").read_text().startswith("<!doctype html>")
        decisions = tmp_path / "none.jsonl"
        decisions.write_text("")
        applied = found.apply(decisions, tmp_path / "applied.parquet")
        assert applied.stats()["chosen"] == stats["chosen"]
        with pytest.raises(FileNotFoundError):
            reactsim.curation.Candidates(tmp_path / "none")
        with pytest.raises(reactsim.ReactsimError, match="code 2"):
            reactsim.curate(tmp_path / "none", tmp_path / "c.parquet", progress=False)

    def test_generate(self, tmp_path: Path) -> None:
        logs = reactsim.generate(
            tmp_path / "logs.parquet", preset="train", count=3, seed=4, progress=False
        )
        assert logs.candidates is None
        assert f'name = "{logs.path.name}"' in logs.manifest
        ids = [s.id for s in reactsim.scenarios(logs.path)]
        assert len(ids) == 3
        assert reactsim.list_scenarios(logs.path, ids=ids[0]).count("generated/") == 1
        parts = training.split(logs.path, tmp_path / "parts", parts={"a": 0.5, "b": 0.5})
        found = [
            s.id for path in parts.values() if path.is_file() for s in reactsim.scenarios(path)
        ]
        assert sorted(found) == sorted(ids)
        points = training.intentions(
            logs.path, tmp_path / "i.safetensors", points=2, progress=False
        )
        assert points.stat().st_size > 0

    def test_heights(self, tmp_path: Path) -> None:
        logs = reactsim.generate(
            tmp_path / "logs.parquet", preset="train", count=1, maps="overpass", progress=False
        )
        for scenario in reactsim.scenarios(logs.path):
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

    def test_generate_a_benchmark(self, tmp_path: Path) -> None:
        bench = reactsim.generate(
            tmp_path / "bench.parquet",
            count=2,
            maps=["straight-road", "curved-road"],
            progress=False,
        )
        assert bench.candidates is not None
        assert bench.candidates.path == tmp_path / "bench.deviations.parquet"
        assert all(s.av is not None for s in reactsim.scenarios(bench.path))


def test_convert(tmp_path: Path) -> None:
    source = tmp_path / "logs"
    shutil.copytree(MINI, source)
    out = reactsim.convert(source, tmp_path / "a.parquet", categories="lateral", progress=False)
    assert [s.id for s in reactsim.scenarios(out)] == [
        s.id for s in reactsim.scenarios(MINI, categories="lateral")
    ]
    (source / "cut-in.json").write_text('{"format": "reactsim-scenario-v1"}')
    with pytest.warns(UserWarning, match=r"some scenarios failed:\n(.|\n)*cut-in.json"):
        reactsim.convert(source, tmp_path / "b.parquet", progress=False)
    with pytest.raises(reactsim.ReactsimError, match="no-such-id"):
        reactsim.convert(MINI, tmp_path / "c.parquet", ids=["no-such-id"], progress=False)


def test_verify(tmp_path: Path) -> None:
    run = reactsim.run(baselines=["stop"], scenarios=MINI, progress=False)
    reference = reactsim.make_reference(
        run, tmp_path / "reference", name="mini", aggregates_only=True
    )
    result = reactsim.verify(reference, scenarios=MINI, progress=False)
    assert result.is_equal and bool(result)
    assert "|   equal |" in result.table
    summary = json.loads((reference / "summary.json").read_text())
    summary["simulators"]["stop"]["metrics"]["ade"]["mean"] += 0.5
    (reference / "summary.json").write_text(json.dumps(summary))
    with pytest.raises(reactsim.ReactsimError, match="summary"):
        reactsim.verify(reference, scenarios=MINI, progress=False)
    with pytest.raises(reactsim.ReactsimError, match="code 2"):
        reactsim.verify(tmp_path / "none")


def test_study(tmp_path: Path) -> None:
    study = reactsim.study(
        "replan",
        MINI,
        out=tmp_path / "study",
        intervals=[5, 10],
        models="idm",
        limit=1,
        progress=False,
    )
    assert list(study.members) == ["every 5 steps (2 Hz)", "every 10 steps (1 Hz)"]
    assert "| IDM " in study.table()
    assert all(len(run.rows) > 0 for run in study.members.values())
    assert "| IDM " in reactsim.report(study)
    with pytest.raises(FileNotFoundError, match="is no study"):
        reactsim.Study(tmp_path)
    with pytest.raises(ValueError, match="no study `--help`"):
        reactsim.study("--help", out=tmp_path / "x")


def test_score(runs: Any, tmp_path: Path) -> None:
    before, _ = runs
    scored = reactsim.score(
        before.folder / "rollouts.parquet", MINI, out=tmp_path / "scored", progress=False
    )
    assert ades(scored) == pytest.approx(ades(before))
    with pytest.raises(reactsim.ReactsimError, match="code 2"):
        reactsim.score_document({"format": "none"})


def test_lists() -> None:
    assert "idm " in reactsim.catalog()
    assert "vehicle.headway" in reactsim.catalog("parameters", "idm")
    assert "epochs" in training.recipe("ntp-reactive", parameters={"learning.epochs": 2})
    assert "reactsim" in reactsim.command("list", "--help")
    with pytest.raises(ValueError, match="no list `--help`"):
        reactsim.catalog("--help")
    with pytest.raises(reactsim.ReactsimError, match="no-such-model"):
        reactsim.catalog("parameters", "no-such-model")


def test_leaderboard(tmp_path: Path) -> None:
    html = tmp_path / "board.html"
    board = reactsim.leaderboard(REFERENCE, html=html)
    assert board.benchmark["name"] == "reactsim-bench"
    assert {line["simulator"] for line in board.lines} >= {"idm", "stop"}
    assert "| IDM " in board.table
    assert "<html" in html.read_text("utf-8")


def test_runs_of_baselines() -> None:
    results = reactsim.run(baselines="stop,idm", scenarios=MINI, limit=1, progress=False)
    assert results.simulators == ["stop", "idm"]
    folder = results.folder
    assert folder.is_dir()
    del results
    assert not folder.exists()
    with pytest.raises(reactsim.ReactsimError, match=r"code 2:(.|\n)*no-such-model"):
        reactsim.run(baselines=["no-such-model"], progress=False)


@pytest.mark.parametrize("name", ["-q", "--help", "=x", "a b", 'it\'s "so"'])
def test_names_are_no_options(
    name: str, runs: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(runs[0].folder, name)
    assert len(reactsim.compare(name, name)) == 2
    assert reactsim.report(name).startswith("| Method")
    out = f"{name}.parquet"
    assert reactsim.convert(MINI, out, progress=False) == Path(out)
    assert len(list(reactsim.scenarios(out))) == 12
    assert "</svg>" in reactsim.draw(out, id="cut-in", rollout=name, simulator="idm")
    for call in (
        lambda: reactsim.compare(name, "none"),
        lambda: reactsim.compare(name, name, models=[name, name]),
        lambda: reactsim.report(name, format=name),
        lambda: reactsim.inspect(MINI, id=name),
        lambda: reactsim.verify(name, progress=False),
    ):
        with pytest.raises(reactsim.ReactsimError, match="code 2"):
            call()


def test_interrupts(tmp_path: Path) -> None:
    out = tmp_path / "logs.parquet"
    threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT)).start()
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        reactsim.generate(out, preset="train", count=1_000_000, progress=False)
    assert time.monotonic() - start < 20


def test_differences_are_no_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "program"
    program.write_text("#!/bin/sh\necho '| idm | differs |'\nexit 1\n")
    program.chmod(0o755)
    monkeypatch.setenv("REACTSIM_BINARY", str(program))
    result = reactsim.verify(progress=False)
    assert not result.is_equal and not bool(result)
    assert result._repr_markdown_() == "| idm | differs |\n"


def test_messages_have_the_last_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "program"
    program.write_text("#!/bin/sh\nseq 100 >&2\nexit 7\n")
    program.chmod(0o755)
    monkeypatch.setenv("REACTSIM_BINARY", str(program))
    with pytest.raises(reactsim.ReactsimError, match=r"code 7:\n71\n(.|\n)*\n100$"):
        invoke(["compare"])
    program.write_text("#!/bin/sh\n")
    for call in (
        lambda: reactsim.compare("a", "b"),
        lambda: reactsim.report("a"),
        lambda: reactsim.verify(),
        lambda: reactsim.view("a"),
        lambda: reactsim.convert("a", tmp_path / "none"),
    ):
        with pytest.raises(reactsim.ReactsimError, match="check that REACTSIM_BINARY"):
            call()
