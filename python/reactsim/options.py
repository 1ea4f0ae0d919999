"""Options that several commands of the program have."""

from __future__ import annotations

import operator
import os
from collections.abc import Mapping, Sequence
from typing import Any, Union

import numpy as np

from .program import PathLike, text_of

__all__ = [
    "Options",
    "PathLike",
    "Sources",
    "each",
    "joined",
    "of_keywords",
    "paths",
    "reading",
    "selection",
    "settings",
    "several",
    "texts",
    "whole",
]

Sources = Union[PathLike, Sequence[PathLike], None]
"""A file, folder or URL of scenarios, or several; None for the shipped benchmark."""

Options = list[tuple[str, Any]]
"""Names and values, as `program.arguments` takes them."""


def paths(sources: Sources) -> list[str]:
    """Returns the paths of scenarios: none for the shipped benchmark."""
    return [] if sources is None else [os.fspath(path) for path in several(sources)]


def several(values: Any) -> list[Any]:
    """Returns values, of which a single text or path is one."""
    return [values] if isinstance(values, (str, os.PathLike)) else list(values)


def each(name: str, values: Any) -> Options:
    """Returns an option for each value; a single text or path is one value."""
    return [(name, value) for value in several(values)]


def joined(values: str | Sequence[Any]) -> str | None:
    """Returns values of an option that takes them separated by commas; None for no values."""
    text = values if isinstance(values, str) else ",".join(map(str, values))
    return text or None


def texts(values: Mapping[str, Any] | None) -> dict[str, str]:
    """Returns values by their names as the program reads them; None is no values."""
    return {name: text_of(value) for name, value in (values or {}).items()}


def settings(name: str, values: Mapping[str, Any] | None) -> Options:
    """Returns an option NAME=KEY=VALUE for each key."""
    return [(name, f"{key}={value}") for key, value in texts(values).items()]


def of_keywords(keywords: Mapping[str, Any]) -> Options:
    """Returns options for keyword arguments, whose names have `_` instead of `-`."""
    options: Options = []
    for keyword, value in keywords.items():
        name = "--" + keyword.replace("_", "-")
        if isinstance(value, Mapping):
            options += settings(name, value)
        elif isinstance(value, Sequence):
            options += each(name, value)
        else:
            options.append((name, value))
    return options


def whole(name: str, value: Any, least: int = 0, most: int | None = None) -> int:
    """Returns a whole number of any type, such as those of numpy.

    Raises ValueError, with the name of the argument, for other values and numbers out of range.
    """
    expected = f"{least} or more" if most is None else f"{least} to {most}"
    try:
        number = operator.index(value)
    except TypeError:
        number = least - 1
    is_flag, is_above = isinstance(value, (bool, np.bool_)), most is not None and number > most
    if is_flag or is_above or number < least:
        raise ValueError(f"`{name}` is {value!r}, expected a whole number, {expected}")
    return number


def selection(ids: Sequence[str], categories: Sequence[str]) -> Options:
    """Returns the options that select scenarios."""
    return [*each("--id", ids), *each("--category", categories)]


def reading(
    current_frame: int | None,
    window_step: int | None,
    history: int | None,
    future: int | str | None,
    all_agents: bool,
) -> Options:
    """Returns the options that determine how recordings become scenarios."""
    return [
        ("--current-frame", current_frame),
        ("--window-step", window_step),
        ("--history", history),
        ("--future", future),
        ("--all-agents", all_agents),
    ]
