"""Reads files behind URLs for the program `reactsim`, which starts this module with the first one.

    python reactsim/store.py

URLs are those of fsspec: `s3://` with s3fs, `gs://` with gcsfs, `https://` with aiohttp, and so on,
with the credentials and settings that fsspec knows. This file needs only Python and fsspec.

The first line on standard output is `reactsim-store 1`. Requests are lines on standard input with
parts between tabs; requests are answered in any order, several at the same time:

    ID list URL                                 files at the URL or below it
    ID info URL                                 size and version of a file
    ID read URL OFFSET LENGTH SIZE VERSION      bytes of a file

If a request to read has a SIZE, the file must have this size and version after it is read. An
answer is a line `ID KIND LENGTH`, also with tabs, and LENGTH bytes. KIND is `ok`, or the kind of a
failure, whose reason follows as text: missing, forbidden, changed, unsupported, failed. A list has
a line `SIZE VERSION NAME` per file, with names relative to the URL; the name is empty if the URL is
a file itself, and size and version are empty where a server states them for single files only.
`info` has the line `SIZE VERSION`. VERSION is a tag of the content, or the time of its last change.
"""

from __future__ import annotations

import datetime
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping
from typing import IO, Any, NamedTuple

__all__ = ["main"]

GREETING = b"reactsim-store 1\n"
WAITS = (0.5, 2.0, 4.0)
"""Seconds before a request that failed is tried again."""
VERSION_KEYS = (
    *("ETag", "etag", "md5Hash", "content_md5", "generation", "version", "VersionId", "checksum"),
    *("LastModified", "Last-Modified", "last_modified", "mtime", "updated", "modified", "created"),
)
"""Keys by which file systems describe the content of a file, the most exact ones first."""


class StoreError(Exception):
    """A request cannot be answered."""

    def __init__(self, kind: str, text: str) -> None:
        super().__init__(text)
        self.kind = kind


class File(NamedTuple):
    """Size and version of a file; the size is None if the server does not state it."""

    size: int | None
    version: str

    def text(self) -> str:
        """Returns them as parts of an answer."""
        return (
            f"{'' if self.size is None else self.size}\t{'' if self.size is None else self.version}"
        )


def main() -> None:
    """Answers requests until standard input ends."""
    # Libraries that print must not print into the protocol.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    # An interrupt at the terminal is for the program, which still reads what it needs.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    serve(sys.stdin.buffer, answers)
    # Threads that wait for a server end with the process.
    os._exit(0)


def serve(requests: IO[bytes], answers: IO[bytes]) -> None:
    """Answers requests, each in a thread of its own: the program limits their number."""
    lock = threading.Lock()

    def answer(parts: list[str]) -> None:
        try:
            kind, content = "ok", respond(parts)
        except StoreError as error:
            kind, content = error.kind, str(error).encode("utf-8", "replace")
        except BaseException as error:
            kind, content = "failed", _describe(error).encode("utf-8", "replace")
        try:
            with lock:
                answers.write(f"{parts[0]}\t{kind}\t{len(content)}\n".encode())
                answers.write(content)
                answers.flush()
        except OSError:  # the program has ended
            os._exit(0)

    answers.write(GREETING)
    answers.flush()
    for line in requests:
        parts = line.decode("utf-8", "replace").rstrip("\n").split("\t")
        threading.Thread(target=answer, args=(parts,), daemon=True).start()


def respond(parts: list[str]) -> bytes:
    """Returns the content that a request asks for.

    Raises:
        StoreError: It cannot be read.

    """
    if len(parts) == 3 and parts[1] == "list":
        return _list(parts[2])
    if len(parts) == 3 and parts[1] == "info":
        system, path = _open(parts[2])
        file: File = _attempt(lambda: _info(system, path))
        if file.size is None:
            raise StoreError(
                "unsupported", "the server does not state its size; copy it to a file system"
            )
        return file.text().encode()
    if len(parts) == 7 and parts[1] == "read":
        url, offset, length, size, version = parts[2:]
        expected = File(int(size), version) if size else None
        return _read(url, int(offset), int(length), expected)
    raise StoreError("failed", f"unknown request {parts[1:]}: install the version of the program")


def _open(url: str) -> tuple[Any, str]:
    """Returns the file system of a URL, and the path in it."""
    try:
        import fsspec
    except ImportError:
        raise StoreError(
            "unsupported",
            f"{sys.executable} has no fsspec: pip install fsspec, and s3fs for s3:// or gcsfs for gs://",
        ) from None
    if "::" in url:
        raise StoreError(
            "unsupported", "chained URLs are not read: give the URL of a file or folder"
        )
    try:
        system, path = fsspec.core.url_to_fs(url)
    except ImportError as error:  # names the package
        raise StoreError("unsupported", f"{error} (for {sys.executable})") from None
    except ValueError as error:
        raise StoreError(
            "unsupported", f"{error}; write a URL such as s3://bucket/folder"
        ) from None
    except Exception as error:  # every file system has its own
        raise StoreError("failed", _describe(error)) from None
    return system, path


def _list(url: str) -> bytes:
    system, root = _open(url)
    system.invalidate_cache()
    folder = {"type": "directory"}
    info: Mapping[str, Any] = folder if url.endswith("/") else _attempt_info(system, root) or folder
    if info["type"] == "file":
        return f"{_file(info).text()}\t\n".encode()
    found: dict[str, Any] = _attempt(lambda: system.find(root, detail=True))
    root = root.rstrip("/")
    lines = []
    for name, about in found.items():
        below = name[len(root) :].lstrip("/") if name.startswith(root) else ""
        if not below or below.endswith("/"):  # marks of folders
            continue
        if any(ord(c) < 32 or ord(c) == 127 for c in below):
            raise StoreError(
                "unsupported", f"the name {below!r} has control characters; rename the file"
            )
        lines.append(f"{_file(about).text()}\t{below}\n")
    if not lines:
        raise StoreError("missing", "there is no such file, and no file below it; check the URL")
    return "".join(lines).encode("utf-8", "replace")


def _attempt_info(system: Any, path: str) -> Mapping[str, Any] | None:
    """Returns what is known of a file or folder, or None: folders need not exist by themselves."""
    try:
        info: Mapping[str, Any] = _attempt(lambda: system.info(path))
    except StoreError as error:
        if error.kind == "missing":
            return None
        raise
    return info


def _info(system: Any, path: str) -> File:
    info = system.info(path)
    if info["type"] != "file":
        raise IsADirectoryError(path)
    return _file(info)


def _file(info: Mapping[str, Any]) -> File:
    size = info.get("size")
    key = next((key for key in VERSION_KEYS if info.get(key)), None)
    version = info[key] if key else ""
    # Lists and single files state the same time and the same tag in different forms.
    if isinstance(version, datetime.datetime):
        version = version.timestamp()
    text = " ".join(str(version).strip('"').split())
    return File(None if size is None else int(size), f"{key} {text}" if key else "")


def _read(url: str, offset: int, length: int, expected: File | None) -> bytes:
    system, path = _open(url)

    def read() -> bytes:
        content: bytes = system.cat_file(path, start=offset, end=offset + length)
        return content

    content: bytes = _attempt(read) if length else b""
    if len(content) > length:
        raise StoreError(
            "unsupported", "the server sends the whole file for a part; copy it to a file system"
        )
    if expected is not None:
        system.invalidate_cache(system._parent(path))
        found = _attempt(lambda: _info(system, path))
        # A server may describe the version in one answer otherwise than in another.
        is_comparable = found.version.split(" ")[0] == expected.version.split(" ")[0]
        if found.size != expected.size or (is_comparable and found.version != expected.version):
            raise StoreError(
                "changed",
                f"it was changed since this program found it: {_name(expected)} then,"
                f" {_name(found)} now; start again when it is complete",
            )
    return content


def _name(file: File) -> str:
    return f"{file.size} bytes" + (f" ({file.version})" if file.version else "")


def _attempt(call: Callable[[], Any]) -> Any:
    """Calls a function of a file system, several times if it fails for a reason that may pass."""
    for wait in WAITS:
        try:
            return call()
        except Exception as error:  # every file system has its own
            lasting = _lasting(_origin(error))
            if lasting is not None:
                raise lasting from None
        time.sleep(wait)
    try:
        return call()
    except Exception as error:
        reason = f"{_describe(_origin(error))}, in {len(WAITS) + 1} attempts"
        raise StoreError("failed", f"{reason}; check the connection and the URL") from None


def _lasting(error: BaseException) -> StoreError | None:
    """Returns the failure for an error that would occur again, and None for other errors."""
    status = getattr(error, "status", None)
    names = {kind.__name__ for kind in type(error).__mro__}
    if "TooManyRedirects" in names:
        text = "the server redirects in a circle; check the URL in a browser"
        return StoreError("failed", text)
    if status == 416:
        text = "the server refuses parts of the file (416); copy it to a file system"
        return StoreError("unsupported", text)
    if isinstance(error, FileNotFoundError):
        return StoreError("missing", "there is no such file; check the URL")
    if isinstance(error, IsADirectoryError):
        return StoreError("unsupported", "it is a folder, not a file")
    if isinstance(error, ImportError):
        return StoreError("unsupported", f"{error} (for {sys.executable})")
    if (
        isinstance(error, PermissionError)
        or status in (401, 403)
        or not names.isdisjoint({"NoCredentialsError", "DefaultCredentialsError", "RefreshError"})
    ):
        mend = "check the credentials and the permissions of this URL"
        return StoreError("forbidden", f"{_describe(error)}; {mend}")
    # Not what json, sockets and clients raise for answers that are cut off.
    if type(error) in (NotImplementedError, TypeError, ValueError, KeyError, AttributeError):
        return StoreError("failed", f"{_describe(error)}; copy it to a file system")
    return None


def _origin(error: BaseException) -> BaseException:
    """Returns the error of a web server that fsspec reports as a missing file."""
    cause = error.__cause__
    if isinstance(error, FileNotFoundError) and type(cause).__module__.startswith("aiohttp"):
        status = getattr(cause, "status", None)
        return error if cause is None or status in (404, 410) else cause
    return error


def _describe(error: BaseException) -> str:
    """Returns an error on one line."""
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


if __name__ == "__main__":
    if not (sys.flags.isolated or getattr(sys.flags, "safe_path", False)):
        # The folder of this file has modules named like others. With `-m` it is the current folder,
        # which may have any modules.
        sys.path.pop(0)
    main()
