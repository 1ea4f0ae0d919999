"""A process of the program that answers requests until it is closed."""

from __future__ import annotations

import collections
import json
import os
import signal
import subprocess
import threading
import weakref
from collections.abc import Mapping
from typing import IO, Any, cast

import numpy as np

from .client import Array, ProtocolError, read_frame, write_frame
from .program import CHECK, LAST_LINES, ReactsimError, find_program, pass_on, start

__all__ = ["ProgramProcess", "shared_request"]

END_LIMIT = 2.0  # seconds that the process has to end after its input is closed


class ProgramProcess:
    """`reactsim session`: one process, which one thread uses at a time.

    It ends when it is closed, when the object is collected, and with this process.
    """

    def __init__(self) -> None:
        self.path = find_program()
        self._program = start(
            [self.path, "session", "--parent", str(os.getpid())],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            # An interrupt reaches only this process.
            start_new_session=True,
        )
        self._requests, self._answers, errors = (
            cast("IO[bytes]", stream)
            for stream in (self._program.stdin, self._program.stdout, self._program.stderr)
        )
        self._last: collections.deque[str] = collections.deque(maxlen=LAST_LINES)
        self._messages = threading.Thread(
            target=_drain, args=(errors, self._last), daemon=True, name="reactsim session"
        )
        self._messages.start()
        self._owner = os.getpid()
        self._lock = threading.Lock()
        self._seq = 0
        self._end = weakref.finalize(self, _end, self._program, self._owner)

    @property
    def is_open(self) -> bool:
        """Whether requests can be sent: not closed, and not copied by a fork."""
        return self._end.alive and self._owner == os.getpid()

    def request(
        self, kind: str, arguments: Mapping[str, Any], tensors: Mapping[str, Array] | None = None
    ) -> tuple[Any, dict[str, Array]]:
        """Sends a request and returns the document and the arrays of its answer.

        Args:
            kind: Type of the request.
            arguments: Arguments, which JSON can represent; numbers may be of numpy.
            tensors: Arrays.

        Raises:
            ReactsimError: The request is wrong, and the text names the reason; or the process is
                closed, has ended, belongs to another process, or answers another thread.

        """
        if self._owner != os.getpid():
            raise ReactsimError(
                f"the process of the program belongs to process {self._owner}, and this is process"
                f" {os.getpid()}: create the object again after a fork"
            )
        if not self._end.alive:
            raise ReactsimError("the process of the program is closed: create the object again")
        if not self._lock.acquire(blocking=False):
            raise ReactsimError(
                "the process of the program answers another thread: use the object from one thread"
                " at a time, or create one per thread"
            )
        try:
            return self._exchange(kind, arguments, tensors or {})
        finally:
            self._lock.release()

    def _exchange(
        self, kind: str, arguments: Mapping[str, Any], tensors: Mapping[str, Array]
    ) -> tuple[Any, dict[str, Array]]:
        # Headers of frames are bounded: texts of any length are arrays, in both directions.
        text = np.frombuffer(json.dumps(arguments, default=_plain).encode(), np.uint8)
        self._seq += 1
        seq = str(self._seq)
        try:
            write_frame(self._requests, kind, seq, None, {**tensors, "arguments": text})
            answer = read_frame(self._answers)
        except (BrokenPipeError, ConnectionResetError):
            answer = None
        except ProtocolError as error:
            raise self._broken(str(error)) from None
        except BaseException:
            # The next request would receive the answer of this one.
            self.close()
            raise
        if answer is None:
            raise self._broken("it ended")
        metadata, arrays = answer
        if metadata["seq"] != seq:
            raise self._broken(f"it answered request {metadata['seq']}, expected {seq}")
        document = json.loads(arrays.pop("document").tobytes()) if "document" in arrays else None
        if metadata["type"] == "error":
            raise ReactsimError(document or "the program gives no reason")
        return document, arrays

    def _broken(self, problem: str) -> ReactsimError:
        self.close()
        self._messages.join(END_LIMIT)
        code = self._program.returncode
        ending = f"ended with code {code}"
        if code is not None and code < 0:
            ending = f"was ended by signal {-code}"
            if -code in {int(known) for known in signal.Signals}:
                ending += f" ({signal.Signals(-code).name})"
        # A process that has answered nothing may be another program.
        last = self._last or ([CHECK] if self._seq == 1 else [])
        text = "".join(f"\n{line}" for line in last)
        return ReactsimError(
            f"`reactsim session` {ending} ({problem}): create the object again{text}"
        )

    def close(self) -> None:
        """Ends the process. Further calls do nothing."""
        self._end()


_shared: list[ProgramProcess] = []
_shared_lock = threading.Lock()


def shared_request(
    kind: str, arguments: Mapping[str, Any], tensors: Mapping[str, Array] | None = None
) -> tuple[Any, dict[str, Array]]:
    """Sends a request to the process that all scores of arrays use, which the first one starts.

    A process of another program than `find_program` names now is replaced.
    """
    with _shared_lock:
        if _shared and _shared[0].path != find_program():
            _shared.pop().close()
        if not _shared or not _shared[0].is_open:
            _shared[:] = [ProgramProcess()]
        return _shared[0].request(kind, arguments, tensors)


def _plain(value: Any) -> Any:
    """Returns a number or flag of numpy as one that JSON can represent."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{value!r} is a {type(value).__name__}, expected a number, a text or a list")


def _end(program: subprocess.Popen[bytes], owner: int) -> None:
    """Ends the process, unless this is a copy of its owner that a fork made."""
    if os.getpid() != owner:
        return
    try:
        cast("IO[bytes]", program.stdin).close()
    except OSError:
        pass
    try:
        program.wait(END_LIMIT)
    except subprocess.TimeoutExpired:
        program.kill()
        program.wait()
    cast("IO[bytes]", program.stdout).close()


def _drain(errors: IO[bytes], last: collections.deque[str]) -> None:
    with errors:
        pass_on(errors, last, False)
