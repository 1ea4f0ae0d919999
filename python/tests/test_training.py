"""Trainings, whose log is passed on while it is written."""

from __future__ import annotations

import json
import sys
import threading
from pathlib import Path
from types import ModuleType
from typing import Any, Dict, List

import pytest
import reactsim
from reactsim.training import _followed, _numbers

ROW: Dict[str, Any] = {
    "row": "step",
    "step": 3,
    "epoch": 0.5,
    "loss": None,
    "metrics": {"accuracy": 0.25, "surprise": float("nan")},
    "wall": {"seconds": 2.0},
}


def tracker(monkeypatch: pytest.MonkeyPatch, name: str, logged: List[Any]) -> ModuleType:
    """A stand-in for a package that keeps numbers."""
    module: Any = ModuleType(name)
    module.run = None

    def init(project: str) -> None:
        logged.append(project)

    def log(numbers: Dict[str, float], step: int) -> None:
        logged.append((step, numbers))

    module.init, module.log, module.log_metrics = init, log, log
    monkeypatch.setitem(sys.modules, name, module)
    return module  # type: ignore[no-any-return]


def test_numbers_have_the_names_of_their_places() -> None:
    assert _numbers(ROW) == {
        "step/epoch": 0.5,
        "step/metrics/accuracy": 0.25,
        "step/wall/seconds": 2.0,
    }


def test_rows_that_are_added_are_passed_on_once(tmp_path: Path) -> None:
    file = tmp_path / "log.jsonl"
    file.write_text('{"step": 1}\n')
    rows: List[Any] = []
    came = threading.Event()

    def logger(row: Any) -> None:
        rows.append(row["step"])
        came.set()

    with _followed(file, [logger]):
        with file.open("a") as stream:
            stream.write('{"step": 2}\n{"st')
            stream.flush()
            # While the training goes on, complete lines only.
            assert came.wait(30.0) and rows == [2]
            stream.write('ep": 3}\n')
    assert rows == [2, 3]


def test_a_failing_function_is_an_error_with_its_cause(tmp_path: Path) -> None:
    def logger(row: Any) -> None:
        raise KeyError("mine")

    with pytest.raises(reactsim.ReactsimError, match="`log` failed: KeyError") as caught:
        with _followed(tmp_path / "log.jsonl", [logger]):
            (tmp_path / "log.jsonl").write_text(json.dumps(ROW) + "\n")
    assert isinstance(caught.value.__cause__, KeyError)


def test_unknown_and_missing_trackers_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ValueError, match="expected 'wandb', 'mlflow' or a function"):
        reactsim.train("ntp-reactive", out=tmp_path, log="tensorboard")
    monkeypatch.setitem(sys.modules, "mlflow", None)
    with pytest.raises(ImportError, match="pip install mlflow"):
        reactsim.train("ntp-reactive", out=tmp_path, log="mlflow")


@pytest.mark.program
@pytest.mark.usefixtures("with_program")
def test_a_training_is_logged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    logs, out = tmp_path / "logs.parquet", tmp_path / "out"
    reactsim.command("generate", preset="train", count=4, out=logs, progress=False)
    logged: List[Any] = []
    rows: List[Any] = []
    tracker(monkeypatch, "wandb", logged)
    tracker(monkeypatch, "mlflow", logged)
    given: Dict[str, Any] = {"recipe": "quick", "set": {"learning.epochs": 1}, "progress": False}
    log: List[Any] = ["wandb", "mlflow", rows.append]
    output = reactsim.train("ntp-reactive", logs, out=out, log=log, **given)
    assert output.path == out
    written = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    assert rows == written and {row["row"] for row in rows} == {"step", "validation"}
    assert logged[0] == "reactsim"
    pairs = [(row["step"], _numbers(row)) for row in rows for _ in range(2)]
    assert logged[1:] == pairs and "step/loss" in logged[1][1]
