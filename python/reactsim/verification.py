"""Checks that the program reproduces published numbers on this machine."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from .display import Markdown
from .options import PathLike, Sources, each, paths, settings
from .program import arguments, invoke

__all__ = ["Verification", "verify"]


@dataclasses.dataclass(frozen=True)
class Verification:
    """Whether the program reproduces a reference; notebooks show the table.

    Attributes:
        is_equal: Whether all numbers agree: bit for bit without a network, and within the bounds
            of the reference for networks on other machines.
        table: Verdict by simulator, and what differs, in Markdown.

    """

    is_equal: bool
    table: Markdown

    def __bool__(self) -> bool:
        return self.is_equal

    def _repr_markdown_(self) -> str:
        return str(self.table)


def verify(
    reference: PathLike | None = None,
    *,
    quick: bool = False,
    scenarios: Sources = None,
    deviations: PathLike | None = None,
    weights: Mapping[str, PathLike] | None = None,
    jobs: int | None = None,
    batch: int | None = None,
    progress: bool = True,
) -> Verification:
    """Runs the simulators of a reference again, and compares every number.

    Args:
        reference: Name or folder of the reference of a run or study; the reference of the shipped
            benchmark by default.
        quick: Run networks only on every 15th scenario.
        scenarios: Scenarios of the runs, unless they ship with the program.
        deviations: File of deviated AVs, if the reference has one.
        weights: Files of weights that do not ship with the program, by simulator.
        jobs: Number of threads; one per core by default.
        batch: Scenarios that a thread steps together.
        progress: Show the messages of the program.

    Raises:
        ReactsimError: The reference is damaged, or for another program or benchmark.

    """
    given = [
        ("--quick", quick),
        *each("--scenarios", paths(scenarios)),
        ("--deviations", deviations),
        *settings("--model-weights", weights or {}),
        ("--jobs", jobs),
        ("--batch", batch),
    ]
    command = ["verify", *arguments(given, [] if reference is None else [reference])]
    output = invoke(command, codes=(0, 1), show=progress)
    return Verification(output.code == 0, Markdown(output.text))
