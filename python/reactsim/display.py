"""Texts and pictures that notebooks show."""

from __future__ import annotations

import base64
import html
import os
import re
import shutil
import subprocess
import sys
from typing import Any

from .options import PathLike
from .program import ReactsimError

__all__ = ["Gif", "Markdown", "Svg"]

_RULE = re.compile(r"\|[-:| ]+\|")
"""The line between the names of columns and the rows."""


class Markdown(str):
    """Markdown text that notebooks render.

    `print` divides tables that are wider than the terminal. The text itself is complete.
    """

    def __str__(self) -> str:
        if sys.stdout is None or not sys.stdout.isatty():
            return self[:]
        width = shutil.get_terminal_size().columns
        return "\n\n".join(_divided(block, width) for block in self.rstrip().split("\n\n")) + "\n"

    def _repr_markdown_(self) -> str:
        return self[:]

    def _repr_html_(self) -> str:
        return "\n".join(_as_html(block) for block in self.rstrip().split("\n\n"))


def _rows(block: str) -> list[list[str]]:
    """Returns the cells of a table with their padding, or nothing for other texts."""
    lines = block.split("\n")
    if len(lines) < 2 or not _RULE.fullmatch(lines[1]):
        return []
    return [re.split(r"(?<!\\)\|", line)[1:-1] for line in lines]


def _divided(block: str, width: int) -> str:
    """Returns a table as several ones, each with the first column and as many as fit."""
    rows = _rows(block)
    sizes = [len(cell) + 1 for cell in rows[0]] if rows else []
    if 1 + sum(sizes) <= width or len(sizes) < 2:
        return block
    groups: list[list[int]] = []
    for column in range(1, len(sizes)):
        if not groups or 1 + sizes[0] + sum(sizes[k] for k in [*groups[-1], column]) > width:
            groups.append([])
        groups[-1].append(column)
    tables = (
        "\n".join("|" + "|".join(row[k] for k in [0, *group]) + "|" for row in rows)
        for group in groups
    )
    return "\n\n".join(tables)


def _as_html(block: str) -> str:
    rows = _rows(block)
    if not rows:
        return f"<p>{html.escape(block)}</p>".replace("\n", "<br>")
    rule = rows.pop(1)

    def line(row: list[str], tag: str) -> str:
        cells = (
            f'<{tag} style="text-align: {"right" if side.endswith(":") else "left"}">'
            f"{html.escape(cell.strip())}</{tag}>"
            for cell, side in zip(row, rule)
        )
        return f"<tr>{''.join(cells)}</tr>"

    head, body = line(rows[0], "th"), "".join(line(row, "td") for row in rows[1:])
    return f"<table><thead>{head}</thead><tbody>{body}</tbody></table>"


class Svg(str):
    """A picture as SVG text that notebooks render."""

    def _repr_svg_(self) -> str:
        return str(self)


class Gif(bytes):
    """An animation as the bytes of a GIF file that notebooks show."""

    def save_mp4(self, path: PathLike) -> None:
        """Writes the animation as MP4 (H.264), with the program `ffmpeg`."""
        program = shutil.which("ffmpeg")
        if program is None:
            raise ReactsimError("videos need the program `ffmpeg`: install it, or write a GIF")
        # H.264 needs even sizes, and players the usual resolution of colours.
        even = "scale=trunc(iw/2)*2:trunc(ih/2)*2,format=yuv420p"
        options = ["-i", "pipe:0", "-vf", even, "-movflags", "+faststart", "-y", os.fspath(path)]
        command = [program, "-loglevel", "error", "-f", "gif", *options]
        done = subprocess.run(command, input=bytes(self), capture_output=True, check=False)
        if done.returncode != 0:
            why = done.stderr.decode("utf-8", "replace").strip()
            raise ReactsimError(f"`ffmpeg` could not write {os.fspath(path)}: {why}")

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, str]:
        return {"image/gif": base64.b64encode(self).decode("ascii")}

    def __repr__(self) -> str:
        return f"Gif({len(self)} bytes)"

    __str__ = __repr__
