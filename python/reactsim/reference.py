"""The reference of the package as a page: `python -m reactsim.reference FILE.html`.

It has all public names with their signatures and docstrings.
"""

from __future__ import annotations

import enum
import functools
import html
import importlib
import inspect
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import reactsim

__all__ = ["entries", "main", "page"]

FURTHER = {
    "reactsim": ("Env", "VectorEnv", "ParallelEnv"),
    "reactsim.environment": ("REWARD",),
    "reactsim.parallel": ("AGENT_REWARD",),
    "reactsim.sb3": ("VecEnv",),
    "reactsim.nuplan": ("wrap",),
}
"""Public names besides `reactsim.__all__`, some of which need optional packages."""

OVERVIEWS = ("reactsim", "reactsim.client", "reactsim.environment", "reactsim.parallel")
"""Modules whose docstrings describe what several names share, such as units and shapes."""

STYLE = """
body { font: 16px/1.5 sans-serif; max-width: 56em; margin: 2em auto; padding: 0 1em; }
code, pre { font-family: monospace; background: #f4f4f4; }
pre { padding: .6em; white-space: pre-wrap; }
section { border-top: 1px solid #ccc; }
section section { margin-left: 2em; border: 0; }
dt { font-family: monospace; }
"""


def entries() -> Iterator[tuple[str, Any]]:
    """Iterates over the public names with what they are.

    Names whose optional packages are not installed are left out.
    """
    for name in sorted(reactsim.__all__):
        yield f"reactsim.{name}", getattr(reactsim, name)
    for module, names in FURTHER.items():
        try:
            values = [getattr(importlib.import_module(module), name) for name in names]
        except ImportError:
            continue
        yield from ((f"{module}.{name}", value) for name, value in zip(names, values))


def members(kind: type) -> Iterator[tuple[str, Any]]:
    """Iterates over the public methods and properties that a class of the package defines."""
    for name, value in inspect.getmembers(kind):
        owner = next((base for base in kind.__mro__ if name in vars(base)), kind)
        if name.startswith("_") or not owner.__module__.startswith("reactsim"):
            continue
        kinds = (property, functools.cached_property)
        if inspect.isfunction(value) or isinstance(inspect.getattr_static(kind, name), kinds):
            yield name, value


def page() -> str:
    """Returns the page, HTML."""
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8"><title>reactsim: reference</title>',
        f"<style>{STYLE}</style></head><body>",
        f"<h1>reactsim {html.escape(reactsim.__version__)}</h1>",
    ]
    for module in OVERVIEWS:
        try:
            text = inspect.getdoc(importlib.import_module(module))
        except ImportError:
            continue
        parts.append(f"<h2>{module}</h2>{_described(text)}")
    parts.append("<h2>Names</h2>")
    for name, value in entries():
        parts.append(f'<section id="{name}"><h3>{name}</h3>')
        if isinstance(value, type) and issubclass(value, enum.Enum):
            values = ", ".join(f"{one.name} = {one.value}" for one in value)
            parts.append(f"{_described(value.__doc__)}<p><code>{values}</code></p>")
        elif callable(value):
            parts += [_signature(name, value), _described(inspect.getdoc(value))]
        else:
            parts.append(f"<pre>{html.escape(repr(value))}</pre>")
        if isinstance(value, type):
            for member, inner in members(value):
                is_function = inspect.isfunction(inner)
                head = _signature(member, inner) if is_function else f"<pre>{member}</pre>"
                parts.append(f"<section>{head}{_described(inspect.getdoc(inner))}</section>")
        parts.append("</section>")
    return "\n".join([*parts, "</body></html>"]) + "\n"


def _signature(name: str, value: Any) -> str:
    try:
        text = str(inspect.signature(value))
    except ValueError:
        text = ""
    return f"<pre>{html.escape(name.rpartition('.')[2] + text)}</pre>"


def _described(text: str | None) -> str:
    """Returns a docstring as HTML: paragraphs, lists, examples and sections with items."""
    parts: list[str] = []
    for block in (text or "").strip().split("\n\n"):
        lines = block.split("\n")
        if re.fullmatch(r"(Args|Attributes|Raises|Returns):", lines[0]):
            parts.append(f"<h4>{lines[0][:-1]}</h4><dl>{_items(lines[1:])}</dl>")
        elif lines[0].startswith("    "):
            parts.append(f"<pre>{html.escape(inspect.cleandoc(block))}</pre>")
        elif lines[0].startswith("- "):
            items = re.split(r"(?:^|\n)- ", block)[1:]
            parts.append(f"<ul>{''.join(f'<li>{_inline(item)}</li>' for item in items)}</ul>")
        else:
            parts.append(f"<p>{_inline(block)}</p>")
    return "".join(parts)


def _items(lines: list[str]) -> str:
    """Returns lines `name: text`, which indented lines continue, as terms and their texts."""
    found: list[list[str]] = []
    for line in lines:
        if line.startswith("        ") and found:
            found[-1][1] += f" {line.strip()}"
        else:
            name, _, text = line.strip().partition(": ")
            found.append([name, text])
    return "".join(f"<dt>{html.escape(name)}</dt><dd>{_inline(text)}</dd>" for name, text in found)


def _inline(text: str) -> str:
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", html.escape(text, quote=False))


def main() -> None:
    """Writes the page to the file that the command line names."""
    if len(sys.argv) != 2 or sys.argv[1].startswith("-"):
        raise SystemExit("usage: python -m reactsim.reference FILE.html")
    Path(sys.argv[1]).write_text(page(), "utf-8")


if __name__ == "__main__":
    main()
