"""Pages that the program serves to a browser on this machine."""

from __future__ import annotations

import collections
import html
import subprocess
import threading
import weakref
from collections.abc import Sequence
from typing import IO, Any, cast

from .options import Run, Sources, each, folders, paths
from .program import (
    CHECK,
    LAST_LINES,
    ReactsimError,
    arguments,
    find_program,
    interrupt,
    pass_on,
    start,
)

__all__ = ["Page", "open_page", "view"]


class Page:
    """A page that the program serves, on this machine only, until it is closed.

    It is a context manager, and is closed with the last reference to it. Notebooks show a link.
    """

    def __init__(
        self, url: str, program: subprocess.Popen[bytes], messages: threading.Thread
    ) -> None:
        self.url = url
        """Address of the page; it contains a secret."""
        self._close = weakref.finalize(self, _end, program, messages)

    @property
    def is_open(self) -> bool:
        """Whether the page was not closed yet."""
        return self._close.alive

    def close(self) -> None:
        """Ends the program that serves the page."""
        self._close()

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Page({self.url!r})"

    def _repr_html_(self) -> str:
        url = html.escape(self.url)
        return f'<a href="{url}" target="_blank">{url}</a>'


def view(
    runs: Run | Sequence[Run],
    *,
    scenarios: Sources = None,
    port: int = 0,
    open_browser: bool = False,
) -> Page:
    """Serves a page of runs or studies: tables, figures, every scene from above.

    Args:
        runs: Runs that kept their rollouts: folders, `Results` or `Study`.
        scenarios: Scenarios of the runs, unless they ship with the program.
        port: Port of the page, on this machine only; 0 for any free one.
        open_browser: Open the page in the browser of this desktop.

    Raises:
        ReactsimError: The runs cannot be shown; the message is that of the program.

    """
    given = [*each("--scenarios", paths(scenarios)), ("--port", port), ("--open", open_browser)]
    return open_page(["view", *arguments(given, folders(runs))])


def open_page(command: Sequence[str]) -> Page:
    """Starts a command of the program that serves a page, whose address it prints."""
    program = start(
        [find_program(), *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    output, errors = (cast("IO[bytes]", stream) for stream in (program.stdout, program.stderr))
    last: collections.deque[str] = collections.deque(maxlen=LAST_LINES)
    messages = threading.Thread(target=pass_on, args=(errors, last, False), daemon=True)
    messages.start()
    try:
        url = output.readline().decode("utf-8", "replace").strip()
    except BaseException:
        _end(program, messages)
        raise
    if not url.startswith("http"):
        _end(program, messages)
        raise ReactsimError("\n".join(last).strip() or f"the program showed no page; {CHECK}")
    return Page(url, program, messages)


def _end(program: subprocess.Popen[bytes], messages: threading.Thread) -> None:
    if program.poll() is None:
        interrupt(program)
    if program.poll() is None:
        program.kill()
        program.wait()
    if program.stdout is not None:
        program.stdout.close()
    # A browser that the program opened can keep the stream open.
    messages.join(5.0)
    if program.stderr is not None and not messages.is_alive():
        program.stderr.close()
