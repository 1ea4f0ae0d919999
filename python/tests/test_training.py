"""Trainings, whose log is passed on while it is written."""

from __future__ import annotations

import json
import os
import sys
import threading
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, Dict, List

import pytest
import reactsim
from reactsim.training import _followed, _logger, _numbers

ROW: Dict[str, Any] = {
    "row": "step",
    "step": 3,
    "epoch": 0.5,
    "loss": None,
    "metrics": {"accuracy": 0.25, "surprise": float("nan")},
    "wall": {"seconds": 2.0},
}


def wandb(monkeypatch: pytest.MonkeyPatch, logged: List[Any]) -> None:
    """A stand-in for the package, which has one active run."""
    module: Any = ModuleType("wandb")
    module.run = None

    def init(project: str) -> None:
        logged.append(project)

    def log(numbers: Dict[str, float], step: int) -> None:
        logged.append((step, numbers))

    module.init, module.log = init, log
    monkeypatch.setitem(sys.modules, "wandb", module)


def mlflow(monkeypatch: pytest.MonkeyPatch, logged: List[Any]) -> Any:
    """A stand-in for the package, which has an active run per thread."""
    module: Any = ModuleType("mlflow")
    local = threading.local()
    begun: List[str] = []

    def active_run() -> Any:
        return getattr(local, "run", None)

    def start_run() -> Any:
        begun.append(f"run {len(begun)}")
        local.run = SimpleNamespace(info=SimpleNamespace(run_id=begun[-1]))
        return local.run

    class MlflowClient:
        def log_metric(self, run_id: str, key: str, value: float, *, step: int) -> None:
            logged.append((run_id, step, key, value))

    module.active_run, module.start_run, module.MlflowClient = active_run, start_run, MlflowClient
    module.begun = begun
    monkeypatch.setitem(sys.modules, "mlflow", module)
    return module


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


def test_a_file_that_is_replaced_by_a_shorter_one_is_followed(tmp_path: Path) -> None:
    file, anew = tmp_path / "log.jsonl", tmp_path / "anew.jsonl"
    old = [f'{{"step": {step}, "run": 0}}\n' for step in range(10)]
    new = [f'{{"step": {step}, "run": 1}}\n' for step in range(7, 14)]
    # An interrupted training can leave the beginning of a row.
    file.write_text("".join(old) + '{"step": ')
    rows: List[Any] = []
    came = threading.Event()

    def logger(row: Any) -> None:
        rows.append((row["step"], row["run"]))
        came.set()

    with _followed(file, [logger]):
        anew.write_text("".join(old[:7] + new[:2]))
        os.replace(anew, file)
        assert came.wait(30.0)
        with file.open("a") as stream:
            stream.writelines(new[2:])
    assert rows == [(step, 1) for step in range(7, 14)]


def test_a_row_whose_beginning_was_left_is_passed_on_whole(tmp_path: Path) -> None:
    file = tmp_path / "log.jsonl"
    file.write_text('{"step": 1}\n{"st')
    rows: List[Any] = []
    with _followed(file, [rows.append]):
        file.write_text('{"step": 1}\n{"step": 2}\n')
    assert rows == [{"step": 2}]


def test_rows_go_to_the_run_of_mlflow_that_is_active(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    logged: List[Any] = []
    module = mlflow(monkeypatch, logged)
    file = tmp_path / "log.jsonl"
    module.start_run()
    mine = module.start_run().info.run_id
    with _followed(file, [_logger("mlflow")]):
        file.write_text((json.dumps(ROW) + "\n") * 2)
    assert logged == [(mine, 3, name, value) for name, value in _numbers(ROW).items()] * 2
    assert module.begun == ["run 0", mine]


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
    values: List[Any] = []
    rows: List[Any] = []
    wandb(monkeypatch, logged)
    module = mlflow(monkeypatch, values)
    given: Dict[str, Any] = {"recipe": "quick", "set": {"learning.epochs": 1}, "progress": False}
    log: List[Any] = ["wandb", "mlflow", rows.append]
    output = reactsim.train("ntp-reactive", logs, out=out, log=log, **given)
    assert output.path == out
    written = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    assert rows == written and {row["row"] for row in rows} == {"step", "validation"}
    assert logged[0] == "reactsim"
    assert logged[1:] == [(row["step"], _numbers(row)) for row in rows]
    assert "step/loss" in logged[1][1]
    # One run is begun, by the thread that called.
    run = module.active_run().info.run_id
    assert module.begun == [run]
    assert values == [
        (run, row["step"], name, value) for row in rows for name, value in _numbers(row).items()
    ]
