"""`python -m reactsim` runs the program `reactsim` with the same arguments."""

from __future__ import annotations

import os
import subprocess
import sys

from .program import ReactsimError, find_program


def main() -> None:
    """Runs the program and ends with its exit code."""
    try:
        command = [find_program(), *sys.argv[1:]]
    except ReactsimError as error:
        raise SystemExit(f"reactsim: {error}") from None
    if sys.platform == "win32":
        raise SystemExit(subprocess.call(command))
    sys.stdout.flush()
    os.execv(command[0], command)


if __name__ == "__main__":
    main()
