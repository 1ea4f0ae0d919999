"""Pictures and animations that the program draws."""

from __future__ import annotations

import shlex
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .client import Array
from .display import Gif
from .options import PathLike, of_keywords, paths, whole
from .program import ReactsimError, arguments, invoke

__all__ = ["SavesMp4", "drawing", "picture", "save_drawing"]


class SavesMp4:
    """What environments have for videos, by their method `save_gif`."""

    def save_gif(self, path: PathLike | None, *args: Any, **options: Any) -> Gif:
        """Writes an animation of an episode so far, if there is a path, and returns it."""
        raise NotImplementedError

    def save_mp4(self, path: PathLike, *args: Any, **options: Any) -> None:
        """Writes the animation as MP4, with the arguments of `save_gif`. Needs `ffmpeg`."""
        self.save_gif(None, *args, **options).save_mp4(path)


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


def drawing(
    *,
    size: int = 480,
    radius: float | None = None,
    every: int | None = None,
    follow: bool = False,
) -> dict[str, Any]:
    """Returns the arguments of a request for a picture, or with `every` for an animation."""
    return {
        "size": whole("size", size, least=100, most=1200),
        "radius": None if radius is None else float(radius),
        "follow": bool(follow),
        "every": None if every is None else whole("every", every, least=1),
        "slot": 0,
    }


def save_drawing(path: PathLike | None, answer: Mapping[str, Array]) -> Gif:
    """Writes the animation of an answer, if there is a path, and returns it."""
    gif = Gif(answer["gif"].tobytes())
    if path is not None:
        Path(path).write_bytes(gif)
    return gif
