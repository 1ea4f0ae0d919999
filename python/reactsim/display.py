"""Texts and pictures that notebooks show."""

from __future__ import annotations

import base64
import html
from typing import Any

__all__ = ["Gif", "Html", "Markdown", "Svg", "Text"]

PAGE_HEIGHT = 800  # height of a page in a notebook, CSS pixels


class Markdown(str):
    """Markdown text that notebooks render."""

    def _repr_markdown_(self) -> str:
        return str(self)


class Text(str):
    """Plain text in columns, which notebooks show as it is."""

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(self)}</pre>"


class Html(str):
    """A self-contained HTML page that notebooks show.

    A notebook shows it in a frame that contains the text of the page itself, so that the styles and
    scripts of the page and the notebook do not meet. No file and no server is needed.
    """

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{html.escape(self)}" width="100%" height="{PAGE_HEIGHT}"'
            ' style="border: 0"></iframe>'
        )


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
