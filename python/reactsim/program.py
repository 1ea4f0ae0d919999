"""Finds and starts the program `reactsim`."""

from __future__ import annotations

import collections
import html
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import sysconfig
import threading
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple, Union, cast

import numpy as np

__all__ = [
    "CHECK",
    "LAST_LINES",
    "Output",
    "PathLike",
    "ReactsimError",
    "arguments",
    "find_program",
    "invoke",
    "local_folder",
    "pass_on",
    "produce",
    "start",
    "text_of",
]

PathLike = Union[str, "os.PathLike[str]"]

CHECK = "check that REACTSIM_BINARY, or `reactsim` in PATH, is the program of this package"
"""What to do if another program was found."""

LAST_LINES = 30  # lines of standard error in a message
PAGE_HEIGHT = 800  # height of a page in a notebook, CSS pixels
MESSAGES_LIMIT = 5.0  # seconds after the end of the program in which its messages arrive
INTERRUPT_LIMIT = 30.0  # seconds that the program has after an interrupt to write what is finished


class ReactsimError(RuntimeError):
    """The program cannot be started, or it has failed.

    Attributes:
        results: The finished run, if `reactsim.run` failed in a metric of your own after it.

    """

    results: Any = None


def find_program() -> str:
    """Returns the absolute path of the program, which holds in any working folder.

    In this order: the environment variable REACTSIM_BINARY, the program installed with this
    package, and the folders in PATH.
    """
    given = os.environ.get("REACTSIM_BINARY")
    if given:
        found = shutil.which(given)
        if found is None:
            raise ReactsimError(f"REACTSIM_BINARY is `{given}`, which is not an executable file")
        return os.path.abspath(found)
    name = "reactsim.exe" if sys.platform == "win32" else "reactsim"
    user = sysconfig.get_path("scripts", f"{os.name}_user")
    for folder in (sysconfig.get_path("scripts"), os.path.dirname(sys.executable), user):
        found = shutil.which(os.path.join(folder, name))
        if found is not None:
            return os.path.abspath(found)
    found = shutil.which(name)
    if found is None:
        raise ReactsimError(
            "the program `reactsim` was not found: install it with `pip install .` or"
            " `cargo install --path .` in a checkout, or set REACTSIM_BINARY to its path"
        )
    return os.path.abspath(found)


def arguments(
    options: Sequence[tuple[str, Any]] = (),
    positionals: Sequence[PathLike] = (),
    further: Sequence[str] = (),
) -> list[str]:
    """Returns arguments for the program, of which no name or path can become another option.

    Args:
        options: Names and values. True gives an option without a value; None and False give none.
        positionals: Paths and other positional arguments.
        further: Options as a user has written them.

    """
    plain = [(name, bool(v) if isinstance(v, np.bool_) else v) for name, v in options]
    given = [(name, value) for name, value in plain if value is not None and value is not False]
    texts = [name if value is True else f"{name}={text_of(value)}" for name, value in given]
    return [*texts, *further, *(["--", *map(text_of, positionals)] if positionals else [])]


def text_of(value: Any) -> str:
    """Returns a value as the program reads it."""
    return os.fspath(value) if isinstance(value, os.PathLike) else str(value)


def local_folder(path: PathLike) -> Path:
    """Returns the path of a folder of a file system.

    Raises ReactsimError for a URL, which a path would turn into the name of a relative folder.
    """
    text = os.fspath(path)
    if re.match(r"[A-Za-z][A-Za-z0-9+.:-]+://", text):
        raise ReactsimError(f"{text} is a URL, where a folder of a file system is needed")
    return Path(text)


def start(command: Sequence[str], **options: Any) -> subprocess.Popen[bytes]:
    """Starts the program; `options` are those of `subprocess.Popen`. Its input is empty by default.

    Raises ReactsimError if the file cannot be executed.
    """
    try:
        options = {"stdin": subprocess.DEVNULL, **options}
        return subprocess.Popen(command, **options)
    except OSError as error:
        # So it is with a script whose first line names no interpreter, and a program of another
        # system.
        raise ReactsimError(f"`{command[0]}` cannot be started ({error}); {CHECK}") from None


class Output(NamedTuple):
    """What a command of the program wrote. Notebooks show its text, or its page.

    Attributes:
        code: Exit code.
        text: Standard output.
        messages: Last lines of standard error.
        path: File or folder of the option `--out`.

    """

    code: int
    text: str
    messages: list[str]
    path: Path | None

    def __str__(self) -> str:
        return self.text

    @property
    def document(self) -> Any:
        """Standard output, parsed as JSON. Raises ReactsimError if it is something else."""
        try:
            return json.loads(self.text)
        except ValueError as error:
            raise ReactsimError(
                f"the result of the program is no JSON ({error}); {CHECK}"
            ) from None

    def _repr_html_(self) -> str:
        text = html.escape(self.text)
        if not self.text.startswith("<!doctype html>"):
            return f"<pre>{text}</pre>"
        # The frame contains the text of the page itself, so that its styles and scripts and those
        # of the notebook do not meet.
        style = f'width="100%" height="{PAGE_HEIGHT}" style="border: 0"'
        return f'<iframe srcdoc="{text}" {style}></iframe>'


def invoke(
    command: Sequence[str],
    *,
    codes: Sequence[int] = (0,),
    show: bool = False,
    answer: Callable[[subprocess.Popen[bytes], collections.deque[str]], None] | None = None,
) -> Output:
    """Runs a command of the program to its end. All functions of the package call it through this.

    An interrupt is passed on to the program, which then writes what is finished.

    Args:
        command: Arguments of the program, such as `["compare", *arguments(options, runs)]`.
        codes: Exit codes that are no failure.
        show: Copy the messages of the program to standard error.
        answer: Converses with the process over its standard input and output, and can add to its
            last messages, before the rest of the output is read. The input is empty by default.

    Raises:
        ReactsimError: The program could not be started, or ended with another code; the message has
            its last lines.

    """
    program = start(
        [find_program(), *command],
        stdin=subprocess.DEVNULL if answer is None else subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        # An interrupt reaches only this process, which passes it on.
        start_new_session=True,
    )
    last: collections.deque[str] = collections.deque(maxlen=LAST_LINES)
    messages = threading.Thread(target=pass_on, args=(program.stderr, last, show), daemon=True)
    messages.start()
    with cast("IO[bytes]", program.stdout) as output:
        try:
            if answer is not None:
                answer(program, last)
            data = output.read()
            code = program.wait()
        except BaseException:
            interrupt(program)
            raise
        finally:
            if program.poll() is None:
                program.kill()
                program.wait()
            messages.join(None if answer is None else MESSAGES_LIMIT)
    if code not in codes:
        text = "\n".join(last).strip() or CHECK
        raise ReactsimError(f"`reactsim {shlex.join(command)}` ended with code {code}:\n{text}")
    return Output(code, data.decode("utf-8", "replace"), list(last), _path_of(command))


def _path_of(command: Sequence[str]) -> Path | None:
    for word, following in zip(command, [*command[1:], ""]):
        if word == "--out" or word.startswith("--out="):
            return Path(following if word == "--out" else word[len("--out=") :])
        if word == "--":
            break
    return None


def produce(command: Sequence[str], out: PathLike, *, show: bool) -> Output:
    """Runs a command that writes `out`.

    Warns with the messages of the program if some scenarios failed (exit code 1).
    """
    output = invoke(command, codes=(0, 1), show=show)
    if not os.path.exists(out):
        raise ReactsimError(f"`reactsim {shlex.join(command)}` did not write {out}; {CHECK}")
    if output.code == 1:
        text = "\n".join(output.messages)
        warnings.warn(f"`reactsim {command[0]}`: some scenarios failed:\n{text}", stacklevel=3)
    return output


def interrupt(program: subprocess.Popen[bytes]) -> None:
    """Asks the program to write what is finished, and waits for it."""
    try:
        program.send_signal(signal.SIGINT)
        if program.stdin is not None:
            program.stdin.close()
        program.wait(INTERRUPT_LIMIT)
    except (OSError, ValueError, subprocess.TimeoutExpired, KeyboardInterrupt):
        pass


def pass_on(stream: IO[bytes], last: collections.deque[str], show: bool) -> None:
    """Keeps the last messages of the program, and copies all to standard error if `show`."""
    with stream:
        for line in stream:
            text = line.decode("utf-8", "replace").rstrip()
            last.append(text)
            if show:
                print(text, file=sys.stderr, flush=True)
