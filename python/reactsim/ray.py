"""Carries out a command in units on a Ray cluster, or on all cores of this machine.

    python -m reactsim.ray FOLDER --unit 512 -- run SCENARIOS --models idm --out RUN

`reactsim shard plan` divides `run`, `study`, `curate`, `generate` or `score --wosac` into units,
`reactsim shard run` carries out a unit, and `reactsim shard merge` joins the results. This module
submits one Ray task per unit, or per few units; a task starts the program as a child process. Only
the path of the folder and the numbers of units pass through Ray. Plan and results are files in the
folder, which all nodes must reach by the same path; so an interrupted run continues with the same
command.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import json
import os
import platform
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Union

from .program import ReactsimError, call, find_program, local_folder, start
from .program import arguments as program_arguments
from .results import Results
from .upload import check_url, upload_run

__all__ = ["Report", "main", "merge_units", "plan_units", "run_units"]

PathLike = Union[str, "os.PathLike[str]"]

PLAN = "plan.json"  # the plan, in the folder of units
UNIT = "unit.json"  # the record of a finished unit, in the folder of the unit

LAST_LINES = 10  # lines of standard error in a message
LAST_BYTES = 8192  # end of standard error that is read for them
MAX_WARNINGS = 20  # failed attempts that are printed
MAX_GIVEN_UP = 5  # units given up in a row until the run stops
PROGRESS_INTERVAL = 5.0  # seconds between two lines of progress
UNCHANGED_INTERVAL = 60.0  # the same while no unit is finished
CONNECTION_LIMIT = 10.0  # seconds to wait for an answer from an address
OBJECT_STORE_BYTES = 100_000_000  # of a local cluster; near the minimum, as no data pass through it

# Starts the program so that it does not outlive the Ray worker. A worker that is killed cannot end
# its child, so the kernel does: PR_SET_PDEATHSIG (1) survives `exec`, and the kernel sends SIGKILL
# when the thread that started this process ends. Ray runs tasks in the main thread of a worker. A
# process between worker and program is safer than `preexec_fn`, which runs Python between `fork`
# and `exec` of a process with many threads. Its start takes some 20 ms.
LAUNCHER = """
import ctypes, os, signal, sys
ctypes.CDLL(None).prctl(1, signal.SIGKILL)
if os.getppid() != int(sys.argv[1]):
    sys.exit("the Ray worker ended")
try:
    os.execv(sys.argv[2], sys.argv[2:])
except OSError as error:
    sys.exit(f"cannot start {sys.argv[2]}: {error.strerror}")
"""


class Report(NamedTuple):
    """State of a run in which all units are finished."""

    units: int
    """Number of units."""
    records: int
    """Number of records (scenarios) of all units."""
    failed: int
    """Number of failures in them, as `reactsim shard status` counts them."""
    seconds: float
    """Duration of this call, including the start of a local cluster."""


class _Unit(NamedTuple):
    """A unit of the plan."""

    number: int
    folder: str
    """Name of the folder with its results, once it is finished."""
    records: int


class _Plan(NamedTuple):
    """The plan in a folder of units."""

    folder: Path
    arguments: list[str]
    subject: Any
    """Everything that determines the results."""
    units: list[_Unit]
    sizes: set[int]
    """Numbers of records of the units that are not the last of their file."""


class _Job(NamedTuple):
    """Settings that are the same for all tasks."""

    folder: str
    working_folder: str
    """Folder to which relative paths in the plan refer."""
    program: str | None
    """Path of the program; if None, every node finds its own."""
    threads: int


class _Outcome(NamedTuple):
    """Outcome of a task."""

    node: str
    finished: dict[int, int]
    """Number of failures by number of the finished unit."""
    error: str
    """Reason why other units of the task are not finished; may be empty."""


def plan_units(
    folder: PathLike,
    arguments: Sequence[str],
    *,
    unit: int | None = None,
    estimate: int | None = None,
    progress: bool = True,
) -> None:
    """Divides a command into units, unless the folder has its plan already.

    Args:
        folder: Folder of the plan and the units.
        arguments: Arguments of the program: "run" or another command, its arguments, and "--out"
            with the place for its results.
        unit: Records per unit; the program's default otherwise.
        estimate: Number of records that are worked on to estimate time and space; the program's
            default otherwise.
        progress: Show the messages of the program.

    Raises:
        ReactsimError: The folder has the plan of another run, or the program failed.

    """
    folder, planned = local_folder(folder), list(arguments)
    if not (folder / PLAN).exists():
        given = [("--unit", unit), ("--estimate", estimate)]
        try:
            _call(["shard", "plan", *program_arguments(given, [folder, *planned])], progress)
            return
        except ReactsimError:
            # A driver that was killed may have left a process that wrote the plan meanwhile.
            if not (folder / PLAN).exists():
                raise
    plan = _read_plan(folder)
    if plan.arguments != planned:
        raise ReactsimError(
            f"{folder / PLAN} is the plan of another run: choose another folder, or leave the"
            " arguments out to continue the planned run\n"
            f"planned: {' '.join(plan.arguments)}\n"
            f"given:   {' '.join(planned)}"
        )
    if unit is not None and (
        plan.sizes - {unit} or any(planned.records > unit for planned in plan.units)
    ):
        largest = max(planned.records for planned in plan.units)
        raise ReactsimError(
            f"the units in {folder / PLAN} have up to {largest} records, not {unit}: leave --unit"
            " out to continue the planned run, or choose another folder"
        )


def run_units(
    folder: PathLike,
    *,
    address: str | None = None,
    cpus_per_unit: int = 1,
    gpus_per_unit: float = 0.0,
    in_flight: int | None = None,
    retries: int = 2,
    batch_units: int = 1,
    progress: bool = True,
) -> Report:
    """Carries out all units of a plan that are not finished, as Ray tasks.

    If Ray is initialised in this process, that cluster is used and stays up; after an interrupt, it
    still carries out the tasks that were submitted.

    Args:
        folder: Folder of the plan and the units. All nodes must reach it by this path.
        address: Address of the cluster; by default the environment variable RAY_ADDRESS, or else a
            cluster on this machine that ends with the call.
        cpus_per_unit: Number of CPUs that a task reserves, and of threads of the program in it.
        gpus_per_unit: Number of GPUs that a task reserves; may be a fraction. Ray hides all GPUs
            from tasks that reserve none.
        in_flight: Maximum number of submitted tasks that are not finished; by default twice as many
            as the cluster can run at once.
        retries: How often a task is repeated after its worker died, and how often a unit is
            repeated after its process failed.
        batch_units: Units per task, which one process of the program carries out one after the
            other. Units of a task that failed are repeated one by one.
        progress: Show progress and failed attempts.

    Raises:
        ReactsimError: Units could not be finished; the message has their numbers, the node and the
            last lines of the program. Finished units stay, and another call continues.
            Failures of scenarios are no errors: `Report.failed` counts them.

    """
    begin = time.monotonic()
    folder = Path(os.path.abspath(local_folder(folder)))
    plan = _read_plan(folder)
    status = _status(folder)
    missing = [plan.units[number] for number in status["missing"]]
    job = _Job(
        os.fspath(folder),
        os.getcwd(),
        # Nodes do not get the environment of this process.
        os.path.abspath(find_program()) if os.environ.get("REACTSIM_BINARY") else None,
        cpus_per_unit,
    )
    failed = status["failed"]
    # Without missing units there is no need for a cluster.
    if missing:
        with _cluster(address) as (ray, is_local):
            _check_resources(ray, is_local, cpus_per_unit, gpus_per_unit)
            driver = _Driver(
                ray,
                job,
                cpus=cpus_per_unit,
                gpus=gpus_per_unit,
                in_flight=in_flight,
                retries=retries,
                progress=_Progress(plan, status) if progress else None,
            )
            size = max(1, batch_units)
            driver.run([missing[i : i + size] for i in range(0, len(missing), size)])
        failed += driver.failed
    records = sum(unit.records for unit in plan.units)
    return Report(len(plan.units), records, failed, time.monotonic() - begin)


def merge_units(folder: PathLike, *, show: bool = False) -> Path:
    """Joins the results of all units, and returns where they are: the path after `--out`.

    `reactsim.Results` opens the folder of a run. Results that have been merged already stay as they
    are.

    Args:
        folder: Folder of the plan and the units.
        show: Print the tables and the messages of the program.

    Raises:
        ReactsimError: Units are missing or damaged, or the program failed.

    """
    return _merge(_read_plan(local_folder(folder)), show)[0]


def _merge(plan: _Plan, show: bool) -> tuple[Path, int]:
    """Returns the results, and 1 if they lack scenarios that failed."""
    out = _results(plan)
    if not _is_merged(out, plan):
        return out, _call(["shard", "merge", *program_arguments(positionals=[plan.folder])], show)
    if show:
        print(f"{out} is merged already", file=sys.stderr)
    if not _is_run(plan):
        return out, 0
    results = Results(out)
    if show:
        print(results.table(details=True), end="", flush=True)
    return out, 1 if len(results.failures) > 0 else 0


def _read_plan(folder: Path) -> _Plan:
    path = folder / PLAN
    try:
        plan = json.loads(path.read_text("utf-8"))
        units = [
            # The program names folders of finished units by number and key.
            _Unit(number, f"unit-{number:06}-{unit['key'][:16]}", unit["count"])
            for number, unit in enumerate(plan["units"])
        ]
        pairs = zip(plan["units"], plan["units"][1:])
        sizes = {unit["count"] for unit, following in pairs if _input(unit) == _input(following)}
        return _Plan(folder, list(plan["arguments"]), plan["subject"], units, sizes)
    except FileNotFoundError:
        raise ReactsimError(
            f"{folder} has no {PLAN}: give the arguments of the run, or write the plan with"
            " `reactsim shard plan`"
        ) from None
    except OSError as error:
        raise ReactsimError(f"{path} cannot be read: {error.strerror}") from None
    except (ValueError, KeyError, TypeError) as error:
        raise ReactsimError(f"{path} is not a plan of `reactsim shard plan`: {error!r}") from None


def _status(folder: Path) -> dict[str, Any]:
    """Returns what `reactsim shard status` prints."""
    command = ["shard", "status", *program_arguments(positionals=[folder])]
    status: dict[str, Any] = json.loads(call(command))
    return status


def _input(unit: dict[str, Any]) -> tuple[int, int]:
    """Returns part and input of a unit in the file of the plan."""
    return unit.get("part", 0), unit["input"]


def _is_run(plan: _Plan) -> bool:
    return plan.arguments[:1] == ["run"]


def _results(plan: _Plan) -> Path:
    """Returns the path after `--out` in the arguments of the plan."""
    for argument, value in zip(plan.arguments, [*plan.arguments[1:], ""]):
        if argument == "--out":
            return Path(value)
        if argument.startswith("--out="):
            return Path(argument[len("--out=") :])
    raise ReactsimError(f"{plan.folder / PLAN} has no --out among its arguments")


def _is_merged(out: Path, plan: _Plan) -> bool:
    """Returns whether the finished results of the plan are there.

    Files of `curate` and `generate` do not tell; they are merged again.
    """
    last = {"run": "summary.json", "study": "study.md", "score": "wosac.json"}
    name = last.get(plan.arguments[0])
    if name is None or not (out / name).is_file():
        return False
    if not _is_run(plan):
        return True
    try:
        provenance = json.loads((out / "provenance.json").read_text("utf-8"))
        return bool(provenance == plan.subject["runs"][0]["provenance"])
    except (OSError, ValueError, LookupError, TypeError):
        return False


def _call(arguments: list[str], show: bool) -> int:
    """Runs the program and returns its exit code; with `show` passes its output and messages on.

    Messages are part of errors in any case. Exit code 1 is no error: scenarios failed, and the
    results list them.
    """
    last: collections.deque[str] = collections.deque(maxlen=LAST_LINES)
    with start(
        [find_program(), *arguments],
        stdout=None if show else subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    ) as process:
        assert process.stderr is not None
        for line in process.stderr:
            text = line.decode("utf-8", "replace").rstrip()
            last.append(text)
            if show:
                print(text, file=sys.stderr, flush=True)
    if process.returncode not in (0, 1):
        text = "\n".join(last)
        raise ReactsimError(
            f"`reactsim {' '.join(arguments[:3])}` {_ending(process.returncode)}:\n{text}"
        )
    return process.returncode


def _ending(code: int) -> str:
    """Returns how a process ended, as text."""
    if code >= 0:
        return f"ended with code {code}"
    try:
        return f"was ended by {signal.Signals(-code).name}"
    except ValueError:
        return f"was ended by signal {-code}"


# --- tasks, in the Ray workers --------------------------------------------------------------------


def _run_task(job: _Job, units: list[tuple[int, str]]) -> _Outcome:
    """Carries out units, which are given by number and folder, in a process of the program."""
    node = platform.node()
    if not os.path.isfile(os.path.join(job.folder, PLAN)):
        return _Outcome(
            node,
            {},
            f"there is no {PLAN} in {job.folder} on this node: all nodes must reach the folder by"
            " this path",
        )
    if job.program is not None and shutil.which(job.program) is None:
        reason = f"{job.program}, the program of REACTSIM_BINARY, is not executable on this node"
        return _Outcome(node, {}, reason)
    try:
        program = job.program or find_program()
    except ReactsimError as error:
        return _Outcome(node, {}, str(error))
    numbers = [str(number) for number, _ in units]
    given = program_arguments([("--jobs", job.threads)], [job.folder, *numbers])
    arguments = ["shard", "run", *given]
    has_folder = os.path.isdir(job.working_folder)
    code, text = _run_child([program, *arguments], job.working_folder if has_folder else job.folder)
    # What is on disk counts, whatever the exit code: another process may have been faster.
    finished = {}
    for number, folder in units:
        failed = _failed(os.path.join(job.folder, folder, UNIT))
        if failed is not None:
            finished[number] = failed
    if len(finished) == len(units):
        return _Outcome(node, finished, "")
    reason = f"`reactsim {' '.join(arguments)}` {_ending(code)}:\n{text}"
    if not has_folder:
        reason += (
            f"\nthis node has no folder {job.working_folder}, to which relative paths in the plan"
            " refer: start the run in a folder that all nodes reach, or plan with absolute paths"
        )
    return _Outcome(node, finished, reason)


def _failed(path: str) -> int | None:
    """Returns the number of failures in the record of a finished unit, or None if it has none."""
    try:
        with open(path, encoding="utf-8") as file:
            return int(json.load(file)["failed"])
    except (OSError, ValueError, KeyError):
        return None


def _run_child(command: list[str], folder: str) -> tuple[int, str]:
    """Runs a process that ends with this one; returns its exit code and its last lines."""
    if sys.platform == "linux":
        # -I and -S: no environment and no site packages, for a fast start.
        command = [sys.executable, "-ISc", LAUNCHER, str(os.getpid()), *command]
    # A file has no reader to wait for, even if a grandchild keeps it open.
    with tempfile.TemporaryFile() as errors:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            cwd=folder,
            # An interrupt in a terminal reaches the driver alone, which ends its workers.
            start_new_session=True,
        )
        try:
            code = process.wait()
        except BaseException:  # Ray cancels tasks with a KeyboardInterrupt
            process.kill()
            process.wait()
            raise
        errors.seek(max(0, errors.seek(0, os.SEEK_END) - LAST_BYTES))
        lines = errors.read().decode("utf-8", "replace").splitlines()
    return code, "\n".join(lines[-LAST_LINES:])


# --- the driver -----------------------------------------------------------------------------------


def _import_ray() -> Any:
    try:
        import ray
    except ImportError as error:
        raise ReactsimError(
            f"Ray cannot be imported ({error}): pip install 'reactsim[ray]'"
        ) from None
    return ray


@contextlib.contextmanager
def _cluster(address: str | None) -> Iterator[tuple[Any, bool]]:
    """Connects to a cluster; gives Ray and whether the cluster was started for this run."""
    ray = _import_ray()
    if ray.is_initialized():
        yield ray, False
        return
    address = address or os.environ.get("RAY_ADDRESS") or "local"
    is_local = address == "local"
    _check_address(address)
    options: dict[str, Any] = {"logging_level": "ERROR", "log_to_driver": False}
    if is_local:
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # nothing is reported to anybody
        options.update(include_dashboard=False, object_store_memory=OBJECT_STORE_BYTES)
    try:
        ray.init(address=address, **options)
    except (OSError, RuntimeError, ValueError) as error:
        raise ReactsimError(f"cannot connect to Ray at `{address}`: {error}") from None
    try:
        yield ray, is_local
    finally:
        ray.shutdown()


def _check_address(address: str) -> None:
    """Checks that something answers at an address; Ray itself tries for many minutes."""
    found = re.fullmatch(r"(?:ray://)?([^/:]+):(\d+)", address)
    if found is None:
        return
    try:
        socket.create_connection((found[1], int(found[2])), timeout=CONNECTION_LIMIT).close()
    except (OSError, OverflowError) as error:
        raise ReactsimError(f"no Ray cluster answers at `{address}`: {error}") from None


def _check_resources(ray: Any, is_local: bool, cpus: int, gpus: float) -> None:
    """Checks that some node can carry out a task."""
    nodes = [node["Resources"] for node in ray.nodes() if node["Alive"]]
    if any(node.get("CPU", 0) >= cpus and node.get("GPU", 0) >= gpus for node in nodes):
        return
    text = (
        f"no node has {cpus} CPUs and {gpus:g} GPUs, which --cpus-per-unit and --gpus-per-unit"
        " reserve"
    )
    if is_local:
        has = f"{nodes[0].get('CPU', 0):g} and {nodes[0].get('GPU', 0):g}"
        raise ReactsimError(f"{text}: this machine has {has}")
    print(f"warning: {text}: tasks wait until one joins the cluster", file=sys.stderr, flush=True)


class _Driver:
    """Submits tasks and receives their outcomes."""

    def __init__(
        self,
        ray: Any,
        job: _Job,
        *,
        cpus: int,
        gpus: float,
        in_flight: int | None,
        retries: int,
        progress: _Progress | None,
    ) -> None:
        self.ray = ray
        self.job = job
        self.cpus = cpus
        self.in_flight = in_flight
        self.retries = retries
        self.progress = progress
        self.failed = 0
        # By value: nodes need Python with Ray and the program, and not this package.
        for module in (_run_task.__module__, find_program.__module__):
            ray.cloudpickle.register_pickle_by_value(sys.modules[module])
        task = ray.remote(num_cpus=cpus, num_gpus=gpus, max_retries=retries)(_run_task)
        self.task = task.options(name="reactsim shard run")
        self.queue: collections.deque[list[_Unit]] = collections.deque()
        self.pending: dict[Any, list[_Unit]] = {}
        self.attempts: collections.Counter[int] = collections.Counter()
        self.errors: dict[int, str] = {}
        self.given_up = 0  # units in a row
        self.limit = 0
        self.limit_time = -PROGRESS_INTERVAL

    def run(self, tasks: Iterable[list[_Unit]]) -> None:
        """Carries out the units of these tasks."""
        self.queue.extend(tasks)
        # Nothing is cancelled after an interrupt: `ray.cancel` of a task that is just ending can
        # abort this process (Ray 2.60). The end of the connection ends workers and programs.
        while (self.queue or self.pending) and self.given_up < MAX_GIVEN_UP:
            self._submit()
            ready, _ = self.ray.wait(list(self.pending), num_returns=1, timeout=PROGRESS_INTERVAL)
            for reference in ready:
                self._receive(reference)
            if self.progress is not None:
                self.progress.show(len(self.errors))
        if self.progress is not None:
            self.progress.show(len(self.errors), is_last=True)
        if self.errors:
            raise ReactsimError(self._summary())

    def _submit(self) -> None:
        """Submits tasks up to the limit, which follows the size of the cluster."""
        now = time.monotonic()
        if self.in_flight is not None:
            self.limit = max(1, self.in_flight)
        elif now - self.limit_time >= PROGRESS_INTERVAL:
            self.limit_time = now
            cpus = self.ray.cluster_resources().get("CPU", 0)
            self.limit = max(2, int(2 * cpus / self.cpus))
        while self.queue and len(self.pending) < self.limit:
            units = self.queue.popleft()
            named = [(unit.number, unit.folder) for unit in units]
            self.pending[self.task.remote(self.job, named)] = units

    def _receive(self, reference: Any) -> None:
        """Counts the finished units of a task, and repeats or gives up the others."""
        units = self.pending.pop(reference)
        exceptions = self.ray.exceptions
        was_repeated = False
        try:
            outcome = self.ray.get(reference)
        except exceptions.RayTaskError as error:
            outcome = _Outcome("a node", {}, str(error.cause or error))
        except exceptions.RayError as error:
            # The worker or its node died, and Ray repeated the task in vain.
            was_repeated = len(units) == 1
            outcome = _Outcome("a node", {}, f"the Ray worker died: {_first_line(error)}")
        for unit in units:
            if unit.number in outcome.finished:
                self.failed += outcome.finished[unit.number]
                self.given_up = 0
                if self.progress is not None:
                    self.progress.add(unit.records, outcome.finished[unit.number])
                continue
            self.attempts[unit.number] += 1
            attempt = self.attempts[unit.number]
            text = f"unit {unit.number}, on {outcome.node}: {outcome.error}"
            if attempt > self.retries or was_repeated:
                self.errors[unit.number] = text
                self.given_up += 1
            else:
                self.queue.append([unit])
            if self.progress is not None:
                self.progress.warn(f"attempt {attempt} of {self.retries + 1}: {text}")

    def _summary(self) -> str:
        """Returns which units are not finished, and why."""
        numbers = sorted(self.errors)
        first = ", ".join(map(str, numbers[:10])) + (", …" if len(numbers) > 10 else "")
        is_stopped = bool(self.queue or self.pending)
        stopped = f" (stopped after {MAX_GIVEN_UP} units in a row)" if is_stopped else ""
        return (
            f"{len(numbers)} {'unit' if len(numbers) == 1 else 'units'} given up{stopped}: {first};"
            " finished units stay, and the same command tries again\n"
            f"{self.errors[numbers[0]]}"
        )


def _first_line(error: Exception) -> str:
    return next(iter(str(error).strip().splitlines()), type(error).__name__)


class _Progress:
    """Prints progress to standard error, a line every few seconds."""

    def __init__(self, plan: _Plan, status: dict[str, Any]) -> None:
        self.units = len(plan.units)
        self.records = status["records"]
        self.finished_units = status["finished"]
        self.finished_records = status["finished_records"]
        self.failed = status["failed"]
        self.begin = self.shown = time.monotonic()
        self.done = 0  # records of this run
        self.shown_units = -1
        self.warnings = 0

    def add(self, records: int, failed: int) -> None:
        """Counts a finished unit."""
        self.finished_units += 1
        self.finished_records += records
        self.failed += failed
        self.done += records

    def show(self, given_up: int, is_last: bool = False) -> None:
        """Prints a line if enough time has passed."""
        now = time.monotonic()
        changed = self.finished_units != self.shown_units
        interval = PROGRESS_INTERVAL if changed else UNCHANGED_INTERVAL
        if not (is_last and changed) and now - self.shown < interval:
            return
        self.shown, self.shown_units = now, self.finished_units
        parts = [
            f"{self.finished_units} of {self.units} units",
            f"{self.finished_records} of {self.records} scenarios",
        ]
        if self.done > 0:
            rate = self.done / (now - self.begin)
            parts.append(f"{rate:.1f}/s")
            if self.finished_records < self.records:
                parts.append(f"{_duration((self.records - self.finished_records) / rate)} left")
        parts += [f"{self.failed} failed"] if self.failed else []
        parts += [f"{given_up} units given up"] if given_up else []
        print(", ".join(parts), file=sys.stderr, flush=True)

    def warn(self, text: str) -> None:
        """Prints a warning, unless there were many."""
        self.warnings += 1
        if self.warnings <= MAX_WARNINGS:
            print(f"warning: {text}", file=sys.stderr, flush=True)


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"


# --- the command line -----------------------------------------------------------------------------


def _parse(argv: Sequence[str]) -> tuple[argparse.Namespace, list[str]]:
    """Returns the options, and the arguments of the run after `--`."""
    parser = argparse.ArgumentParser(
        prog="python -m reactsim.ray",
        usage="%(prog)s FOLDER [options] [-- COMMAND ARGUMENTS --out RESULTS]",
        description="Carries out run, study, curate, generate or score --wosac in units on a Ray"
        " cluster, or on all cores of this machine, and merges the results. The same command"
        " continues after an interruption.",
        allow_abbrev=False,
    )
    add = parser.add_argument
    add("folder", metavar="FOLDER", help="folder of the plan and the units, on all nodes")
    add("--unit", type=_count, metavar="N", help="records per unit, if there is no plan yet")
    add("--estimate", type=int, metavar="N", help="records to work on for the estimate of the plan")
    add("--address", help="address of the cluster (default: RAY_ADDRESS, or this machine)")
    add("--cpus-per-unit", type=_count, default=1, metavar="N", help="CPUs and threads of a task")
    add("--gpus-per-unit", type=float, default=0.0, metavar="N", help="GPUs of a task")
    add("--batch-units", type=_count, default=1, metavar="K", help="units per task")
    add("--in-flight", type=_count, metavar="N", help="maximum number of submitted tasks")
    add("--retries", type=int, default=2, metavar="N", help="repetitions of a failed unit")
    add(
        "--merge",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="merge the results when all units are finished",
    )
    add(
        "--upload", metavar="URL", help="copy the merged run folder to this URL, as fsspec knows it"
    )
    add("--quiet", action="store_true", help="print tables and errors only")
    argv = list(argv)
    split = argv.index("--") if "--" in argv else len(argv)
    options, unknown = parser.parse_known_args(argv[:split])
    if unknown:
        parser.error(f"unknown: {' '.join(unknown)}; the command comes after `--`")
    if options.upload is not None and not options.merge:
        parser.error("--upload needs the merged results: leave --no-merge out")
    return options, argv[split + 1 :]


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"`{text}` is not a number from 1")
    return int(text)


def main(argv: Sequence[str] | None = None) -> int:
    """Carries out the command line and returns the exit code.

    0: all is done; 1: it is done, and scenarios failed; 2: an error; 130: interrupted.
    """
    options, arguments = _parse(sys.argv[1:] if argv is None else argv)
    try:
        # What can be checked at once is, before a run of hours.
        _import_ray()
        if options.upload is not None:
            check_url(options.upload)
        if arguments:
            plan_units(
                options.folder,
                arguments,
                unit=options.unit,
                estimate=options.estimate,
                progress=not options.quiet,
            )
        plan = _read_plan(local_folder(options.folder))
        if options.upload is not None and not _is_run(plan):
            raise ReactsimError("--upload copies the folder of a run: copy other results yourself")
        report = run_units(
            options.folder,
            address=options.address,
            cpus_per_unit=options.cpus_per_unit,
            gpus_per_unit=options.gpus_per_unit,
            in_flight=options.in_flight,
            retries=options.retries,
            batch_units=options.batch_units,
            progress=not options.quiet,
        )
        failed = report.failed
        if options.merge:
            results, failed = _merge(plan, show=True)
        if options.upload is not None:
            upload_run(results, options.upload)
            if not options.quiet:
                print(f"uploaded to {options.upload}", file=sys.stderr)
    except ReactsimError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("interrupted: finished units stay, and the same command continues", file=sys.stderr)
        return 130
    return 1 if failed else 0


if __name__ == "__main__":
    # As a module with its own name, which is not that of every script on the workers.
    from reactsim.ray import main as main_of_module

    sys.exit(main_of_module())
