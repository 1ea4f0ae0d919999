"""Runs the partitions of a command on a Ray cluster or on this machine, and merges them.

    python -m reactsim.ray FOLDER --partitions 64 -- run SCENARIOS --models idm --out RUN

Every partition is a process of the program, `reactsim run … --partition I/64`, and a folder
`I-of-64` in FOLDER, which all nodes reach by the same path. A folder gets this name when it is
finished, so the same command continues after an interruption. Partitions that are lost or fail are
repeated. `reactsim merge` joins all of them into the output of the whole command.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import importlib
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent import futures
from pathlib import Path
from typing import NamedTuple

from .program import PathLike, ReactsimError, find_program, invoke, local_folder

__all__ = ["main", "run_partitions"]

Submit = Callable[[int], "futures.Future[str]"]  # starts a partition by its number

RECORD = "partition.json"  # last file of a finished partition
LAST_LINES = 10  # lines of standard error in a message

# Starts the program so that it does not outlive the process that waits for it: the kernel ends it
# (PR_SET_PDEATHSIG) even if that one is killed. A process in between is safer than `preexec_fn` in
# a process with many threads.
LAUNCHER = """
import ctypes, os, signal, sys
ctypes.CDLL(None).prctl(1, signal.SIGKILL)
os.getppid() == int(sys.argv[1]) and os.execv(sys.argv[2], sys.argv[2:])
"""


class _Job(NamedTuple):
    """What is the same for all partitions."""

    folder: str
    arguments: list[str]
    partitions: int
    program: str | None  # if None, every node finds its own
    threads: int
    cwd: str  # relative paths in the arguments refer to it

    def target(self, number: int) -> Path:
        return Path(self.folder) / f"{number}-of-{self.partitions}"


def _run(job: _Job, number: int) -> str:
    """Works on a partition; returns the reason why there is no result, or nothing."""
    target, place = job.target(number), f"on {platform.node()}"
    try:
        program = job.program or find_program()
        # Processes of lost nodes may still write to folders of earlier attempts.
        out = tempfile.mkdtemp(prefix=f"{target.name}.", dir=job.folder)
    except (OSError, ReactsimError) as error:
        return f"{place}: {error}; all nodes need the program, and {job.folder} by this path"
    own = [f"--jobs={job.threads}", f"--partition={number}/{job.partitions}", f"--out={out}"]
    command = [program, *job.arguments, *own]
    if sys.platform == "linux":
        # -I and -S: no environment and no site packages, for a fast start.
        command = [sys.executable, "-ISc", LAUNCHER, str(os.getpid()), *command]
    done = subprocess.run(command, capture_output=True, check=False, cwd=job.cwd)
    lines = done.stderr.decode("utf-8", "replace").splitlines()
    if os.path.exists(os.path.join(out, RECORD)):
        # Another attempt may have been faster; its results are the same.
        if not target.exists():
            os.rename(out, target)
        return ""
    shutil.rmtree(out, ignore_errors=True)
    return "\n".join([f"{place}, exit code {done.returncode}", *lines[-LAST_LINES:]])


@contextlib.contextmanager
def _processes(job: _Job, limit: int | None) -> Iterator[Submit]:
    """Gives what starts a process on this machine."""
    pool = futures.ThreadPoolExecutor(limit or max(1, (os.cpu_count() or 1) // job.threads))
    try:
        yield lambda number: pool.submit(_run, job, number)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


@contextlib.contextmanager
def _cluster(job: _Job, address: str | None, gpus: float, retries: int) -> Iterator[Submit]:
    """Connects to a Ray cluster and gives what starts a task there."""
    try:
        import ray
    except ImportError as error:
        text = f"Ray cannot be imported ({error}): pip install 'reactsim[ray]'"
        raise ReactsimError(text) from None
    is_own = not ray.is_initialized()
    if is_own:
        ray.init(address=address, logging_level="ERROR", log_to_driver=False)
    # By value: nodes need Python with Ray and the program, and not this package.
    for module in (_run.__module__, find_program.__module__):
        ray.cloudpickle.register_pickle_by_value(sys.modules[module])
    # Ray repeats tasks whose worker or node was lost.
    task = ray.remote(num_cpus=job.threads, num_gpus=gpus, max_retries=retries)(_run)
    try:
        yield lambda number: task.remote(job, number).future()
    finally:
        # The end of the connection ends workers and programs.
        if is_own:
            ray.shutdown()


def run_partitions(
    folder: PathLike,
    arguments: Sequence[str],
    *,
    partitions: int,
    address: str | None = None,
    processes: int | None = None,
    cpus: int = 1,
    gpus: float = 0.0,
    retries: int = 2,
    progress: bool = True,
) -> tuple[Path, int]:
    """Runs a command in partitions and merges them; another call continues after an error.

    Returns the path after "--out", and the exit code: 1 if scenarios failed, else 0.

    Args:
        folder: Folder for the partitions, on all nodes. Finished ones in it are not run again.
        arguments: Command of the program, its arguments, and "--out" with the place for results.
        partitions: Number of partitions.
        address: Ray cluster, such as "auto"; by default the environment variable RAY_ADDRESS, the
            cluster to which this process is connected, or processes of this machine.
        processes: Number of processes at a time, without Ray; by default one per core.
        cpus: Threads of a partition, and CPUs that a Ray task reserves.
        gpus: GPUs that a Ray task reserves; may be a fraction.
        retries: How often a partition is repeated.
        progress: Print messages.

    """
    if partitions < 1:
        raise ReactsimError("give 1 partition or more")
    path, (given, out) = Path(os.path.abspath(local_folder(folder))), _divided(arguments)
    if out.is_dir() and any(out.iterdir()):
        raise ReactsimError(f"{out} exists and is not empty; choose another --out, or remove it")
    path.mkdir(parents=True, exist_ok=True)
    # Nodes do not get the environment of this process.
    program = find_program() if os.environ.get("REACTSIM_BINARY") else None
    job = _Job(os.fspath(path), given, partitions, program, cpus, os.getcwd())
    queue = [n for n in range(1, partitions + 1) if not _is_finished(job, n)]
    if queue:
        address = address or os.environ.get("RAY_ADDRESS")
        is_connected = getattr(sys.modules.get("ray"), "is_initialized", bool)()
        if processes is None and (address or is_connected):
            pool = _cluster(job, address, gpus, retries)
        else:
            pool = _processes(job, processes)
        with pool as submit:
            _work(job, submit, queue, retries, progress)
    folders = [os.fspath(job.target(number)) for number in range(1, partitions + 1)]
    merged = invoke(["merge", "--out", os.fspath(out), *folders], codes=(0, 1), show=progress)
    if progress:
        print(merged.text, end="", flush=True)
    for left in path.glob(f"*-of-{partitions}.*"):
        shutil.rmtree(left, ignore_errors=True)
    return out, merged.code


def _divided(arguments: Sequence[str]) -> tuple[list[str], Path]:
    """Returns the arguments without `--out`, and its value."""
    given = list(arguments)
    for index, argument in enumerate(given):
        name, has_value, value = argument.partition("=")
        if name == "--out" and (has_value or index + 1 < len(given)):
            end = index + (1 if has_value else 2)
            return given[:index] + given[end:], Path(value or given[index + 1])
    raise ReactsimError("give --out with the place for the results among the arguments")


def _is_finished(job: _Job, number: int) -> bool:
    """Returns whether a partition is there. Raises ReactsimError if it is of another command."""
    path = job.target(number) / RECORD
    if not path.exists():
        return False
    # The last three arguments are those of the driver.
    if json.loads(path.read_text("utf-8"))["arguments"][:-3] != job.arguments:
        raise ReactsimError(f"{path.parent} is of another command: choose another folder")
    return True


def _work(job: _Job, submit: Submit, queue: list[int], retries: int, progress: bool) -> None:
    """Runs partitions until all are finished."""
    running = {submit(number): number for number in queue}
    attempts: collections.Counter[int] = collections.Counter()
    while running:
        done, _ = futures.wait(running, return_when=futures.FIRST_COMPLETED)
        for future in done:
            number = running.pop(future)
            attempts[number] += 1
            error = future.exception()
            problem = f"the task failed: {error}" if error else future.result()
            text = f"partition {number}/{job.partitions}"
            if not problem:
                text += f" is finished, {len(running)} left"
            elif attempts[number] > retries:
                raise ReactsimError(f"{text} failed; finished ones stay: {problem}")
            else:
                running[submit(number)] = number
                text = f"warning: {text} is repeated: {problem}"
            if progress:
                print(text, file=sys.stderr, flush=True)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line; returns 0, 1 if scenarios failed, or 2 after an error."""
    usage = "%(prog)s FOLDER --partitions N [options] -- COMMAND ARGUMENTS --out RESULTS"
    parser = argparse.ArgumentParser("python -m reactsim.ray", usage, allow_abbrev=False)
    add = parser.add_argument
    add("folder", metavar="FOLDER", help="folder of the partitions, on all nodes")
    add("--partitions", type=int, required=True, metavar="N", help="number of partitions")
    add("--address", help="Ray cluster (default: RAY_ADDRESS, or processes of this machine)")
    add("--processes", type=int, metavar="N", help="processes at a time, without Ray")
    add("--cpus", type=int, default=1, metavar="N", help="CPUs and threads of a partition")
    add("--gpus", type=float, default=0.0, metavar="N", help="GPUs of a partition")
    add("--retries", type=int, default=2, metavar="N", help="repetitions of a partition")
    given = list(sys.argv[1:] if argv is None else argv)
    split = given.index("--") if "--" in given else len(given)
    options = vars(parser.parse_args(given[:split]))
    try:
        return run_partitions(options.pop("folder"), given[split + 1 :], **options)[1]
    except (ReactsimError, OSError, RuntimeError) as error:  # those of Ray, too
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted: the same command continues", file=sys.stderr, flush=True)
        os._exit(130)  # does not wait for threads, whose programs end with this process


if __name__ == "__main__":
    sys.exit(importlib.import_module("reactsim.ray").main())  # workers know it by this name
