"""Generated scenarios."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from .curation import Candidates
from .options import PathLike, joined
from .program import arguments, local_folder, produce

__all__ = ["Generated", "generate"]


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
