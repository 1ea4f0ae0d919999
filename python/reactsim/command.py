"""Runs any command of the program."""

from __future__ import annotations

import os
import shlex
import warnings
from collections.abc import Mapping
from typing import Any

from .client import Session
from .options import PathLike, of_keywords
from .process import attend, first_errors, own_session
from .program import Output, arguments, text_of

__all__ = ["command"]


def command(*words: PathLike, progress: bool = True, **options: Any) -> Output:
    """Runs a command of the program and returns its exit code, its text and the path it wrote.

    `reactsim.command("generate", preset="train", count=5, out="logs.parquet")` is
    `reactsim generate --preset=train --count=5 --out=logs.parquet`.

    Args:
        words: Command, options and paths, as on the command line. Paths that may begin with `-`
            follow `"--"`.
        progress: Show the messages of the program.
        options: Options by name, with `_` for `-`. True is an option without a value; None and
            False leave it out; a list is an option per value, a dictionary one per `KEY=VALUE`.
            Values of the dictionaries `external` and `planner` may be simulators and planners of
            this process: `reactsim.command("study", "planners", external={"mine": Mine()}, ...)`.

    Raises:
        ReactsimError: The exit code is neither 0 nor 1; the message has the last lines of the
            program. Exit code 1 (scenarios that failed, numbers that differ) is a warning.

    """
    line = [text_of(word) for word in words]
    end = line.index("--") if "--" in line else len(line)
    sessions: dict[str, Session] = {}
    for option, role in (("external", "simulator"), ("planner", "planner")):
        named = options.get(option)
        if not isinstance(named, Mapping):
            continue
        own = {key: to for key, to in named.items() if not isinstance(to, (str, os.PathLike))}
        sessions.update({key: own_session(to, role) for key, to in own.items()})
        options[option] = {**named, **dict.fromkeys(own, "@stdio")}
    line[end:end] = arguments(of_keywords(options))
    output = attend(line, sessions, codes=(0, 1), show=progress)
    if output.code == 1:
        text = "\n".join(output.messages) + first_errors(sessions.values())
        warnings.warn(f"`reactsim {shlex.join(line)}` ended with code 1:\n{text}", stacklevel=2)
    return output
