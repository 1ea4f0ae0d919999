"""Copies run folders to object stores and other file systems that fsspec knows."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Union

from .program import ReactsimError

__all__ = ["check_url", "upload_run"]

PathLike = Union[str, "os.PathLike[str]"]

SUMMARY = "summary.json"  # the last file of a run folder

# File systems in which a file is visible while it is written, and can be renamed. Object stores
# show an object when it is complete, and rename by copying.
RENAMING = {
    *("file", "local", "memory", "sftp", "ssh", "ftp", "smb"),
    *("hdfs", "arrow_hdfs", "webhdfs", "dbfs"),
}


def check_url(url: str) -> None:
    """Checks that fsspec and what it needs for the URL are installed.

    Raises:
        ReactsimError: They are not, or the URL is unknown.

    """
    _open(url)


def upload_run(folder: PathLike, url: str) -> None:
    """Copies a finished run folder to a URL, such as `s3://bucket/runs/idm`.

    `summary.json` is copied last, so that a run that has it there is complete. A copy that was
    interrupted is made again; a complete one is left as it is.

    Args:
        folder: The run folder.
        url: The folder to write, as fsspec knows it.

    Raises:
        ReactsimError: The run is not finished, the URL has the results of another run, or a file
            could not be written.

    """
    folder = Path(folder)
    names = sorted(path.name for path in folder.iterdir() if path.is_file())
    if SUMMARY not in names:
        raise ReactsimError(f"{folder} has no {SUMMARY}: the run is not finished")
    names.remove(SUMMARY)
    system, root = _open(url)
    is_renamed = not RENAMING.isdisjoint(_protocols(system))
    name = SUMMARY
    try:
        if system.exists(f"{root}/{SUMMARY}"):
            if system.cat_file(f"{root}/{SUMMARY}") == (folder / SUMMARY).read_bytes():
                return
            raise ReactsimError(f"{url} has the results of another run: choose another URL")
        if is_renamed:
            system.makedirs(root, exist_ok=True)
        for name in [*names, SUMMARY]:
            _put(system, folder / name, f"{root}/{name}", is_renamed)
    except ReactsimError:
        raise
    except Exception as error:  # every file system has its own
        reason = f"{type(error).__name__}: {error}"
        raise ReactsimError(
            f"cannot copy {name} of {folder} to {url}: {reason}; the same command tries it again"
        ) from error


def _open(url: str) -> tuple[Any, str]:
    """Returns the file system of a URL, and the path in it."""
    try:
        import fsspec
    except ImportError:
        raise ReactsimError(
            "uploads need fsspec, and s3fs for s3://: pip install fsspec s3fs"
        ) from None
    try:
        system, root = fsspec.core.url_to_fs(url)
    except ImportError as error:
        raise ReactsimError(f"cannot upload to {url}: {error}") from None
    except Exception as error:  # every file system has its own
        raise ReactsimError(
            f"cannot upload to {url}: {error}; write a URL such as s3://bucket/folder"
        ) from None
    return system, root.rstrip("/")


def _protocols(system: Any) -> set[str]:
    protocol = system.protocol
    return {protocol} if isinstance(protocol, str) else set(protocol)


def _put(system: Any, path: Path, target: str, is_renamed: bool) -> None:
    """Copies a file, so that it is there as a whole or not at all."""
    name = f"{target}.part" if is_renamed else target
    system.put_file(os.fspath(path), name)
    if is_renamed:
        if system.exists(target):
            system.rm_file(target)
        system.mv(name, target)
    system.invalidate_cache()
    size, expected = system.info(target)["size"], path.stat().st_size
    if size != expected:
        raise ReactsimError(f"{target} has {size} of {expected} bytes after it was copied")
