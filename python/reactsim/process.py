"""Processes of the program that exchange frames with this one."""

from __future__ import annotations

import collections
import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import weakref
from collections.abc import Iterable, Mapping, Sequence
from typing import IO, Any, Callable, cast

import numpy as np

from .client import Array, ProtocolError, Session, read_frame, write_frame
from .program import (
    CHECK,
    LAST_LINES,
    Output,
    ReactsimError,
    find_program,
    invoke,
    pass_on,
    start,
)

__all__ = ["ProgramProcess", "attend", "first_errors", "own_session", "shared_request"]

PIPE_SIZE = 1 << 20  # bytes; the largest one that Linux gives every user
END_LIMIT = 2.0  # seconds that the process has to end after its input is closed


def own_session(
    program: Any,
    role: str,
    *,
    batch: int | None = None,
    on_end: Callable[[int], None] | None = None,
    copies: bool = False,
) -> Session:
    """Returns what answers for a simulator or planner of this process.

    `copies`: several batches of it can be open, each in an instance of its own.

    Raises ValueError if it has another role, and TypeError if it cannot be copied.
    """
    session = Session(program, batch=batch, on_end=on_end, copies=copies)
    if session.role != role:
        raise ValueError(f"{session.title} is a {session.role}, expected a {role}")
    return session


def first_errors(sessions: Iterable[Session]) -> str:
    """Returns the first error of each session, as lines to append to a message."""
    failed = [session for session in sessions if session.first_error]
    return "".join(f"\nfirst error of the {of.role}:\n{of.first_error}" for of in failed)


class _Programs:
    """Simulators and planners of this process, which the program asks by their names."""

    def __init__(self, sessions: Mapping[str, Session]) -> None:
        self._sessions = {(name, "0"): session for name, session in sessions.items()}
        self._open: set[tuple[str, str]] = set()
        self.raised: BaseException | None = None
        """The last exception of a simulator or planner."""

    def respond(self, frame: tuple[dict[str, str], dict[str, Array]], writer: IO[bytes]) -> bool:
        """Answers a request. Returns whether more can follow."""
        metadata, _ = frame
        if "to" not in metadata or (metadata["to"], "0") not in self._sessions:
            raise ProtocolError(f"`{metadata['type']}` is for no simulator or planner here")
        key = metadata["to"], metadata.get("worker", "0")
        if metadata["type"] == "bye":
            self._open.discard(key)
            return bool(self._open)
        if key not in self._sessions:
            self._sessions[key] = self._sessions[key[0], "0"].copy()
        self._open.add(key)
        self.raised = self._sessions[key].respond(frame, writer) or self.raised
        return True


def attend(
    command: Sequence[str],
    sessions: Mapping[str, Session],
    *,
    codes: Sequence[int] = (0,),
    show: bool = False,
) -> Output:
    """Like `invoke`, for a command that asks simulators and planners of this process.

    `sessions` has them by their names, for which the command has `NAME=@stdio`.
    """
    if not sessions:
        return invoke(command, codes=codes, show=show)

    def answer(program: subprocess.Popen[bytes], last: collections.deque[str]) -> None:
        requests, answers = cast("IO[bytes]", program.stdout), cast("IO[bytes]", program.stdin)
        try:
            programs, frame, more = _Programs(sessions), read_frame(requests), True
            while frame is not None and more:
                try:
                    more = programs.respond(frame, answers)
                except BrokenPipeError:
                    pass  # It waits for no answer; the last `bye`, or its end, follows.
                frame = read_frame(requests) if more else None
        except ProtocolError as error:
            program.kill()
            last.append(f"error: {error}")
        # After the last `bye` the program writes its tables and ends.
        _close(answers)

    return invoke(command, codes=codes, show=show, answer=answer)


def _close(stream: IO[bytes]) -> None:
    try:
        stream.close()
    except OSError:
        pass


class ProgramProcess:
    """`reactsim session`: one process, which one thread uses at a time.

    It ends when it is closed, when the object is collected, and with this process. While it works
    on a request it may ask simulators of this process, which `sessions` has by their names.
    """

    def __init__(self, sessions: Mapping[str, Session] | None = None) -> None:
        self._programs = _Programs(sessions or {})
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
        _enlarge(self._answers)
        self._last: collections.deque[str] = collections.deque(maxlen=LAST_LINES)
        self._messages = threading.Thread(
            target=pass_on, args=(errors, self._last, False), daemon=True, name="reactsim session"
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
        self.send(kind, arguments, tensors)
        return self.receive()

    def send(
        self, kind: str, arguments: Mapping[str, Any], tensors: Mapping[str, Array] | None = None
    ) -> None:
        """Sends a request as `request` does; `receive` must follow."""
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
            # Headers of frames are bounded: texts of any length are arrays, in both directions.
            text = np.frombuffer(json.dumps(arguments, default=_plain).encode(), np.uint8)
            self._seq += 1
            self._programs.raised = None
            sent = {**(tensors or {}), "arguments": text}
            write_frame(self._requests, kind, str(self._seq), None, sent)
        except (BrokenPipeError, ConnectionResetError):
            pass  # The end of the answers follows.
        except TypeError:
            self._lock.release()
            raise
        except BaseException:
            self.close()
            self._lock.release()
            raise

    def receive(self, room: Mapping[str, Array] | None = None) -> tuple[Any, dict[str, Array]]:
        """Waits for the answer to the request that was sent, and returns it as `request` does.

        Arrays are read into those of `room` with their names, types and shapes.
        """
        try:
            return self._receive(room)
        finally:
            self._lock.release()

    def _receive(self, room: Mapping[str, Array] | None) -> tuple[Any, dict[str, Array]]:
        seq = str(self._seq)
        try:
            answer = read_frame(self._answers, room)
            while answer is not None and "to" in answer[0]:
                self._programs.respond(answer, self._requests)
                answer = read_frame(self._answers, room)
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
        text = arrays.pop("document").tobytes().decode() if "document" in arrays else "null"
        document = {} if text == "{}" else json.loads(text)
        if metadata["type"] == "error":
            cause = self._programs.raised
            raise ReactsimError(document or "the program gives no reason") from cause
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


def _enlarge(pipe: IO[bytes]) -> None:
    """Lets a whole answer fit into a pipe, so that the program does not wait for its reader."""
    if sys.platform == "linux":
        import fcntl

        with contextlib.suppress(OSError):  # a lower limit
            # `F_SETPIPE_SZ`, which Python 3.9 does not name
            fcntl.fcntl(pipe, 1031, PIPE_SIZE)


def _plain(value: Any) -> Any:
    """Returns a number or flag of numpy as one that JSON can represent."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{value!r} is a {type(value).__name__}, expected a number, a text or a list")


def _end(program: subprocess.Popen[bytes], owner: int) -> None:
    """Ends the process, unless this is a copy of its owner that a fork made."""
    if os.getpid() != owner:
        return
    _close(cast("IO[bytes]", program.stdin))
    try:
        program.wait(END_LIMIT)
    except subprocess.TimeoutExpired:
        program.kill()
        program.wait()
    cast("IO[bytes]", program.stdout).close()
