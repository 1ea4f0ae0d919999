"""Texts and pictures that notebooks show."""

from __future__ import annotations

import base64
from typing import Any

__all__ = ["Gif", "Markdown", "Svg"]


class Markdown(str):
    """Markdown text that notebooks render."""

    def _repr_markdown_(self) -> str:
        return str(self)


class Svg(str):
    """A picture as SVG text that notebooks render."""

    def _repr_svg_(self) -> str:
        return str(self)


class Gif(bytes):
    """An animation as the bytes of a GIF file that notebooks show."""

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, str]:
        return {"image/gif": base64.b64encode(self).decode("ascii")}

    def __repr__(self) -> str:
        return f"Gif({len(self)} bytes)"

    __str__ = __repr__
