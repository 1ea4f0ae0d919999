"""Pictures and animations that the program draws."""

from __future__ import annotations

import shlex
import tempfile
from pathlib import Path
from typing import Any

from .options import PathLike, of_keywords, paths
from .program import ReactsimError, arguments, invoke

__all__ = ["picture"]


def picture(kind: str, source: PathLike | None, **options: Any) -> bytes:
    """Returns a picture of a scenario or rollout: `kind` is "svg" or "gif".

    Other arguments are options of `reactsim inspect`, as for `command`.
    """
    with tempfile.TemporaryDirectory(prefix="reactsim-") as folder:
        path = Path(folder, "picture")
        given = [*of_keywords(options), (f"--{kind}", path)]
        command = ["inspect", *arguments(given, paths(source))]
        invoke(command)
        if not path.is_file():
            raise ReactsimError(f"`reactsim {shlex.join(command)}` wrote no picture")
        return path.read_bytes()
