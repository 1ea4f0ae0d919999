"""Trains networks of the program, and passes the log of the training on while it is written."""

from __future__ import annotations

import importlib
import json
import math
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import takewhile
from pathlib import Path
from typing import Any, Callable, Union

from .command import command
from .options import PathLike, Sources, paths
from .program import Output, ReactsimError, local_folder

__all__ = ["Log", "train"]

Log = Union[str, Callable[[Mapping[str, Any]], Any]]
"""Where the rows of a log go: "wandb", "mlflow", or a function of one row."""

LOG = "log.jsonl"
INTERVAL = 1.0  # seconds between two looks for new rows


def train(
    task: str,
    scenarios: Sources = None,
    *,
    out: PathLike,
    log: Log | Sequence[Log] = (),
    progress: bool = True,
    **options: Any,
) -> Output:
    """Trains a network, as `reactsim train TASK SCENARIOS --out OUT` does.

    Args:
        task: Training task, such as "ntp-reactive", or "quick".
        scenarios: Files or folders of scenarios, such as "logs.parquet" or "logs.parquet=3", which
            counts them three times per epoch.
        out: Folder to write: weights, checkpoints, curves and the log.
        log: Trackers and functions that receive the rows of the log while they are written, or one
            of them. "wandb" and "mlflow" log the numbers to the active run of these packages, which
            must be installed; a run is begun if none is active. wandb drops rows whose step is
            lower than one already in the active run. A function is called with each row, a
            dictionary that has "row" ("step" or "validation"), "step", "epoch", "loss", "metrics",
            "closed_loop" and "wall" (seconds, steps per second, bytes of memory). It is called in
            another thread, one row at a time. A continued training (`resume=True`) passes on new
            rows only. Of `adapt`, the log of the first training only.
        progress: Show the messages of the program.
        options: Other options of `reactsim train`, as `reactsim.command` takes them:
            `set={"learning.epochs": 2}`, `recipe="quick"`.

    Raises:
        ReactsimError: The training failed; or a function of `log` did, which the attribute
            `__cause__` has, and the training was finished all the same.

    """
    several = [log] if isinstance(log, str) or callable(log) else list(log)
    loggers = [_logger(one) for one in several]
    folder = local_folder(out)
    file = folder / "training" / LOG if task in ("quick", "adapt") else folder / LOG
    with _followed(file, loggers):
        words = ["train", task, *paths(scenarios)]
        return command(*words, out=folder, progress=progress, **options)


def _logger(log: Log) -> Callable[[Mapping[str, Any]], Any]:
    """Returns a function of one row."""
    if not isinstance(log, str):
        return log
    if log not in ("wandb", "mlflow"):
        raise ValueError(f"`log` is {log!r}, expected 'wandb', 'mlflow' or a function")
    try:
        tracker: Any = importlib.import_module(log)
    except ImportError as error:
        raise ImportError(f"`log={log!r}` needs the package ({error}): pip install {log}") from None
    if log == "wandb":
        if tracker.run is None:
            tracker.init(project="reactsim")
        return lambda row: tracker.log(_numbers(row), step=row["step"])
    # The active run of mlflow is that of a thread, and rows come from another one.
    run = tracker.active_run() or tracker.start_run()
    client, run_id = tracker.MlflowClient(), run.info.run_id

    def log_row(row: Mapping[str, Any]) -> None:
        for name, value in _numbers(row).items():
            client.log_metric(run_id, name, value, step=row["step"])

    return log_row


def _numbers(row: Mapping[str, Any]) -> dict[str, float]:
    """Returns the finite numbers of a row, named such as "step/loss" or "step/wall/seconds"."""
    found: dict[str, float] = {}

    def add(prefix: str, values: Mapping[str, Any]) -> None:
        for name, value in values.items():
            if isinstance(value, Mapping):
                add(f"{prefix}/{name}", value)
            elif isinstance(value, (int, float)) and name != "step" and math.isfinite(value):
                found[f"{prefix}/{name}"] = float(value)

    add(row["row"], row)
    return found


@contextmanager
def _followed(file: Path, loggers: Sequence[Callable[[Mapping[str, Any]], Any]]) -> Iterator[None]:
    """Passes on the rows that are added to a file while the context is open."""
    if not loggers:
        yield
        return
    done = threading.Event()
    errors: list[BaseException] = []
    before = _complete(file.read_bytes()) if file.is_file() else b""

    def follow() -> None:
        known = before
        try:
            while True:
                is_last = done.wait(INTERVAL)
                known = _pass_on(file, known, loggers)
                if is_last:
                    return
        except Exception as error:
            errors.append(error)

    thread = threading.Thread(target=follow, daemon=True, name="reactsim log")
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()
    if errors:
        raise ReactsimError(f"`log` failed: {errors[0]!r}") from errors[0]


def _pass_on(
    file: Path, known: bytes, loggers: Sequence[Callable[[Mapping[str, Any]], Any]]
) -> bytes:
    """Passes on the complete lines that follow the known ones. Returns all that are known then."""
    if not file.is_file():
        return known
    content = file.read_bytes()
    if not content.startswith(known):
        # A continued training writes what followed its last checkpoint anew.
        pairs = zip(content.splitlines(keepends=True), known.splitlines(keepends=True))
        known = b"".join(line for line, other in takewhile(lambda pair: pair[0] == pair[1], pairs))
    new = _complete(content[len(known) :])
    for line in new.splitlines():
        row = json.loads(line)
        for logger in loggers:
            logger(row)
    return known + new


def _complete(text: bytes) -> bytes:
    """Returns the complete lines."""
    return text[: text.rfind(b"\n") + 1]
