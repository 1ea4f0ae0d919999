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
from typing import Union

__all__ = ["ReactsimError", "call", "environment", "find_program", "local_folder"]

PathLike = Union[str, "os.PathLike[str]"]


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


def call(arguments: Sequence[str], folder: str | None = None) -> str:
    """Runs the program with these arguments and returns its standard output.

    Raises ReactsimError with the message of the program if it fails.
    """
    done = subprocess.run(
        [find_program(), *arguments],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        cwd=folder,
        env=environment(),
        check=False,
    )
    if done.returncode != 0:
        text = done.stderr.decode("utf-8", "replace").strip()
        raise ReactsimError(
            f"`reactsim {' '.join(arguments)}` ended with code {done.returncode}:\n{text}"
        )
    return done.stdout.decode("utf-8")
