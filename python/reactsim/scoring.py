"""Scores rollouts that other programs produced."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from .options import PathLike, each, paths, settings
from .program import arguments, invoke, produce
from .results import Results

__all__ = ["score", "score_document"]


def score(
    rollouts: PathLike | Sequence[PathLike],
    scenarios: PathLike | Sequence[PathLike],
    *,
    out: PathLike,
    allow: str | Sequence[str] = (),
    pose: str | None = None,
    metric_options: Mapping[str, Any] | None = None,
    jobs: int | None = None,
    progress: bool = True,
) -> Results:
    """Scores rollouts in Parquet and returns the results of a run.

    Args:
        rollouts: Files of rollouts, in the format of `rollouts.parquet` in a run folder.
        scenarios: Files, folders or URLs of their scenarios.
        out: Run folder to write.
        allow: Checks that the motion may fail, such as "teleports"; the results are marked.
        pose: Point of vehicles whose poses the rollouts have: "centre", "rear-axle",
            "rear-axle=1.2" (metres) or "rear-axle=25%" (of the length).
        metric_options: Variants of the metrics, such as `{"fault_order": "nuplan"}`.
        jobs: Number of threads; one per core by default.
        progress: Show the messages of the program.

    Raises:
        ReactsimError: No rollout could be scored, or a check failed. Scenarios that failed only
            cause a warning.

    """
    given = [
        *each("--scenarios", paths(scenarios)),
        *each("--allow", allow),
        ("--pose", pose),
        *settings("--metric-option", metric_options or {}),
        ("--out", out),
        ("--jobs", jobs),
    ]
    command = ["score", *arguments(given, paths(rollouts))]
    produce(command, Path(out, "provenance.json"), show=progress)
    return Results(out)


def score_document(
    document: PathLike | Mapping[str, Any], *, metric_options: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Scores a rollout document: scenarios with one judged rollout each.

    Args:
        document: The document, with the format "reactsim-rollouts-v1", or its JSON file.
        metric_options: Variants of the metrics, such as `{"fault_order": "nuplan"}`.

    Returns:
        `aggregate` (means), `valid_scenarios` (number of scenarios behind each mean), `scenarios`
        with their agents, and `options`.

    Raises:
        ReactsimError: The document is wrong; the message names the place.

    """
    with tempfile.TemporaryDirectory(prefix="reactsim-") as folder:
        if isinstance(document, Mapping):
            path: PathLike = Path(folder, "rollouts.json")
            Path(path).write_text(json.dumps(document, allow_nan=False), "utf-8")
        else:
            path = document
        given = settings("--metric-option", metric_options or {})
        output = invoke(["score", *arguments(given, [path])])
        result: dict[str, Any] = output.document
        return result
