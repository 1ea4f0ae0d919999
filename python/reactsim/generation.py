"""Generated scenarios."""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from .curation import Candidates
from .display import Svg
from .options import PathLike, joined
from .program import arguments, invoke, local_folder, produce

__all__ = ["Generated", "GeneratedComparison", "compare_generated", "generate"]


class Generated(NamedTuple):
    """Generated scenarios."""

    path: Path
    """File of the scenarios, Parquet."""
    candidates: Candidates | None
    """Candidates for deviated AVs, of the preset "bench"; the scenarios contain the chosen ones."""
    manifest: str
    """Manifest entry (TOML): command, settings and digests."""


def generate(
    out: PathLike,
    *,
    count: int,
    preset: str = "bench",
    seed: int = 0,
    maps: str | Sequence[str] = (),
    density: float | None = None,
    jobs: int | None = None,
    progress: bool = True,
) -> Generated:
    """Generates scenarios: maps, traffic and, for benchmarks, deviated AVs.

    Args:
        out: File to write (Parquet). The preset "bench" writes candidates to a second file next to
            it.
        count: Number of scenarios.
        preset: "bench", a benchmark with deviated AVs; "train", logs to train on; or "sensed",
            logs to train on as sensors record them.
        seed: Seed of all random choices.
        maps: Map types; all but a few by default. `catalog("maps")` names them.
        density: Traffic volume as a multiple of the usual one; drawn for each scenario by default.
        jobs: Number of threads; one per core by default.
        progress: Show the messages of the program.

    Raises:
        ReactsimError: The scenarios could not be generated.

    """
    given = [
        ("--preset", preset),
        ("--count", count),
        ("--seed", seed),
        ("--out", out),
        ("--maps", joined(maps)),
        ("--density", density),
        ("--jobs", jobs),
    ]
    manifest = produce(["generate", *arguments(given)], out, show=progress).text
    path = local_folder(out)
    names = [json.loads(name) for name in re.findall(r'^name = (".*")$', manifest, re.MULTILINE)]
    further = [path.with_name(name) for name in names if name != path.name]
    return Generated(path, Candidates(further[0]) if further else None, manifest)


class GeneratedComparison(NamedTuple):
    """Statistics of generated and recorded scenarios."""

    statistics: Any
    """All values, including histograms, as the program prints them in JSON."""
    charts: Svg
    """The histograms."""


def compare_generated(
    generated: PathLike,
    reference: PathLike,
    *,
    limit: int | None = None,
    jobs: int | None = None,
) -> GeneratedComparison:
    """Compares generated logs with recorded ones.

    Args:
        generated: File or folder of the generated scenarios.
        reference: File or folder of the scenarios to compare them with.
        limit: Only the first `limit` scenarios of every file.
        jobs: Number of threads; one per core by default.

    Raises:
        ReactsimError: Scenarios cannot be read.

    """
    with tempfile.TemporaryDirectory(prefix="reactsim-") as folder:
        charts = Path(folder, "charts.svg")
        given = [("--format", "json"), ("--svg", charts), ("--limit", limit), ("--jobs", jobs)]
        output = invoke(["generate", "compare", *arguments(given, [generated, reference])])
        return GeneratedComparison(output.document, Svg(charts.read_text("utf-8")))
