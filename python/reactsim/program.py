"""Finds and starts the program `reactsim`."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Union

__all__ = [
    "CHECK",
    "ReactsimError",
    "arguments",
    "call",
    "environment",
    "find_program",
    "local_folder",
    "start",
]

PathLike = Union[str, "os.PathLike[str]"]

CHECK = "check that REACTSIM_BINARY, or `reactsim` in PATH, is the program of this package"
"""What to do if another program was found."""


class ReactsimError(RuntimeError):
    """The program cannot be started, or it has failed."""


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
            "the program `reactsim` was not found: install it with `pip install reactsim` or"
            " `cargo install reactsim`, or set REACTSIM_BINARY to its path"
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
    given = [(name, value) for name, value in options if value is not None and value is not False]
    texts = [name if value is True else f"{name}={_text(value)}" for name, value in given]
    return [*texts, *further, *(["--", *map(_text, positionals)] if positionals else [])]


def _text(value: Any) -> str:
    return os.fspath(value) if isinstance(value, os.PathLike) else str(value)


def environment() -> dict[str, str]:
    """Returns the environment for the program, which reads URLs with this Python."""
    store = os.path.join(os.path.dirname(os.path.abspath(__file__)), "store.py")
    # Ray workers can have this function without the package. `-m` would look for modules in the
    # current folder.
    code = "import sys; sys.path = [p for p in sys.path if p]; import reactsim.store as s; s.main()"
    arguments = [store] if os.path.isfile(store) else ["-c", code]
    return {"REACTSIM_STORE": shlex.join([sys.executable, *arguments]), **os.environ}


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
        options = {"stdin": subprocess.DEVNULL, "env": environment(), **options}
        return subprocess.Popen(command, **options)
    except OSError as error:
        # So it is with a script whose first line names no interpreter, and a program of another
        # system.
        raise ReactsimError(f"`{command[0]}` cannot be started ({error}); {CHECK}") from None


def call(command: Sequence[str], folder: str | None = None) -> str:
    """Runs a command of the program and returns its standard output.

    Raises ReactsimError with the message of the program if it fails.
    """
    program = [find_program(), *command]
    with start(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=folder) as process:
        output, errors = process.communicate()
    if process.returncode != 0:
        text = errors.decode("utf-8", "replace").strip()
        raise ReactsimError(
            f"`reactsim {shlex.join(command)}` ended with code {process.returncode}:\n{text}"
        )
    return output.decode("utf-8")
