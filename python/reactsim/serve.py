"""`python -m reactsim.serve MODULE:NAME` serves a simulator of a module or of a file.

`MODULE` is the name of a module or the path of a file, `NAME` a class, a function without arguments
that returns a simulator, or a simulator. Standard output is moved before the module is imported, so
that prints at import time cannot break the protocol.
"""

from __future__ import annotations

import importlib
import os
import runpy
import sys
import types
from typing import Any

from .client import claim_streams, serve

__all__ = ["load", "main"]


def load(target: str) -> Any:
    """Returns the simulator, or the class of simulators, that `MODULE:NAME` names."""
    module, colon, name = target.rpartition(":")
    if not colon or not module or not name:
        raise SystemExit(
            f"reactsim.serve: `{target}`: write MODULE:NAME, such as mine:Policy or mine.py:Policy"
        )
    space: Any
    if module.endswith(".py"):
        sys.path.insert(0, os.path.dirname(os.path.abspath(module)))
        space = types.SimpleNamespace(**runpy.run_path(module, run_name="reactsim_simulator"))
    else:
        if "" not in sys.path and os.getcwd() not in sys.path:
            sys.path.insert(0, os.getcwd())
        space = importlib.import_module(module)
    try:
        for part in name.split("."):
            space = getattr(space, part)
    except AttributeError:
        raise SystemExit(f"reactsim.serve: `{module}` has no `{name}`") from None
    is_factory = callable(space) and not isinstance(space, type) and not hasattr(space, "plan")
    return space() if is_factory else space


def main() -> None:
    """Serves the simulator that the command line names."""
    if len(sys.argv) != 2 or sys.argv[1] in ("-h", "--help"):
        raise SystemExit("usage: python -m reactsim.serve MODULE:NAME")
    if not sys.stdin.isatty():
        claim_streams()
    serve(load(sys.argv[1]))


class _CallableModule(types.ModuleType):
    """Keeps `reactsim.serve(...)` a call after this module was imported."""

    def __call__(self, *programs: Any) -> None:
        serve(*programs)


if __name__ == "__main__":
    main()
else:
    sys.modules[__name__].__class__ = _CallableModule
