"""Runs in units as Ray tasks; skipped where Ray is not installed."""

from __future__ import annotations

import importlib.util
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import reactsim
import reactsim.ray
from fakes import PACKAGE
from reactsim.program import call
from reactsim.ray import _Job, _run_task, merge_units, plan_units, run_units
from test_units import MINI, assert_equal

pytestmark = [
    pytest.mark.program,
    pytest.mark.usefixtures("with_program"),
    pytest.mark.skipif(sys.platform == "win32", reason="signals and shell scripts"),
]

LIMIT = 60.0  # seconds until a test gives up waiting
UNITS = 30


def arguments(out: Path) -> list[str]:
    """A run of 30 scenarios with enough rollouts for units of about a quarter of a second."""
    run = ["run", "--models", "log-replay,idm", "--limit", "30", "--rollouts", "40"]
    return [*run, "--out", str(out)]


def wait_for(condition: Callable[[], Any], what: str) -> Any:
    end = time.monotonic() + LIMIT
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        time.sleep(0.02)
    raise AssertionError(f"waited {LIMIT:.0f} s for {what}")


def processes(text: str) -> list[int]:
    """Returns the ids of the processes with these arguments, each of which ends with NUL."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            if text.encode() in (path / "cmdline").read_bytes():
                found.append(int(path.name))
        except OSError:
            pass
    return found


def programs(folder: Path) -> list[int]:
    """Returns the ids of the processes that carry out units of a folder."""
    return processes(f"\0shard\0run\0--jobs=1\0--\0{folder}\0")


def state(process: int) -> tuple[str, str]:
    """Returns the state of a process, X if it is gone, and the id of its parent."""
    try:
        stat = Path(f"/proc/{process}/stat").read_text()
    except OSError:
        return "X", ""
    fields = stat.rpartition(")")[2].split()
    return fields[0], fields[1]


def is_running(process: int) -> bool:
    """Returns whether a process exists and is no zombie."""
    return state(process)[0] not in "ZX"


def wait_until_ended(process: int) -> None:
    wait_for(lambda: not is_running(process), "the end of a process")


def parent_worker(process: int) -> int | None:
    """Returns the id of the Ray worker that started a process, or None if it is gone."""
    parent = state(process)[1]
    try:
        title = Path(f"/proc/{parent}/cmdline").read_bytes()
    except OSError:
        return None
    return int(parent) if title.startswith(b"ray::") else None


def finished(folder: Path) -> int:
    return len(list(folder.glob("unit-*")))


class TestTasks:
    """The body of a task, without Ray."""

    @pytest.fixture
    def units(self, tmp_path: Path) -> Path:
        folder = tmp_path / "units"
        run = ["run", str(MINI), "--models", "idm", "--out", str(tmp_path / "run")]
        plan_units(folder, run, unit=1, estimate=0, progress=False)
        return folder

    def names(self, folder: Path, *numbers: int) -> list[tuple[int, str]]:
        units = reactsim.ray._read_plan(folder).units
        return [(number, units[number].folder) for number in numbers]

    def test_units(self, units: Path) -> None:
        job = _Job(str(units), os.getcwd(), None, 1)
        outcome = _run_task(job, self.names(units, 2, 5))
        assert (outcome.finished, outcome.error) == ({2: 0, 5: 0}, "")
        assert _run_task(job, self.names(units, 5)).finished == {5: 0}
        assert json.loads(call(["shard", "status", str(units)]))["finished"] == 2

    def test_missing_folder(self, tmp_path: Path) -> None:
        outcome = _run_task(_Job(str(tmp_path), str(tmp_path), None, 1), [(0, "unit-000000-x")])
        assert outcome.finished == {}
        assert f"no plan.json in {tmp_path}" in outcome.error

    def test_missing_program(
        self, units: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        job = _Job(str(units), str(tmp_path), "/nowhere/reactsim", 1)
        assert "/nowhere/reactsim, the program" in _run_task(job, self.names(units, 0)).error
        monkeypatch.setenv("REACTSIM_BINARY", "/nowhere/else")
        job = job._replace(program=None)
        assert "`/nowhere/else`" in _run_task(job, self.names(units, 0)).error
        broken = tmp_path / "broken"
        broken.write_bytes(b"not a program")
        broken.chmod(0o755)
        outcome = _run_task(job._replace(program=str(broken)), self.names(units, 0))
        assert f"cannot start {broken}" in outcome.error

    def test_missing_working_folder(self, units: Path, program: str, tmp_path: Path) -> None:
        job = _Job(str(units), str(tmp_path / "gone"), program, 1)
        # Absolute paths do not need it.
        assert _run_task(job, self.names(units, 0)).finished == {0: 0}
        text = (units / "plan.json").read_text().replace(str(MINI), "scenarios/nowhere")
        (units / "plan.json").write_text(text)
        outcome = _run_task(job, self.names(units, 1))
        assert "code 2" in outcome.error and "scenarios/nowhere" in outcome.error
        assert f"no folder {tmp_path / 'gone'}" in outcome.error

    @pytest.mark.skipif(sys.platform != "linux", reason="a mechanism of Linux")
    def test_child_ends_with_its_parent(self, tmp_path: Path) -> None:
        sleep = shutil.which("sleep")
        code = f"from reactsim.ray import _run_child; _run_child([{sleep!r}, '47'], '.')"
        env = {**os.environ, "PYTHONPATH": str(PACKAGE)}
        parent = subprocess.Popen([sys.executable, "-c", code], env=env)

        def children() -> list[int]:
            found = processes(f"{sleep}\00047\0")
            return [process for process in found if state(process)[1] == str(parent.pid)]

        (child,) = wait_for(children, "the child")
        parent.kill()
        parent.wait()
        wait_until_ended(child)


def test_without_ray(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    assert reactsim.ray.main([str(tmp_path)]) == 2
    assert "pip install 'reactsim[ray]'" in capsys.readouterr().err


@pytest.fixture(scope="module")
def whole(program: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run folder of one process."""
    out = tmp_path_factory.mktemp("whole") / "run"
    subprocess.run([program, *arguments(out), "--quiet"], check=True, stdout=subprocess.DEVNULL)
    return out


@pytest.fixture(scope="class")
def shared_cluster() -> Iterator[None]:
    ray = pytest.importorskip("ray", reason="Ray is not installed")
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    options = {"include_dashboard": False, "log_to_driver": False, "logging_level": "ERROR"}
    ray.init(address="local", num_cpus=2, object_store_memory=100_000_000, **options)
    yield
    ray.shutdown()


@pytest.mark.usefixtures("shared_cluster")
class TestCluster:
    """Runs on a cluster that is initialised in this process."""

    @pytest.fixture
    def wrapper(self, program: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
        """A script that runs `case.sh` and then the program."""
        path = tmp_path / "wrapper"
        path.write_text(f'#!/bin/sh\n. "{tmp_path}/case.sh"\nexec "{program}" "$@"\n')
        path.chmod(0o755)
        (tmp_path / "case.sh").touch()
        monkeypatch.setenv("REACTSIM_BINARY", str(path))
        return path

    def plan(self, tmp_path: Path) -> tuple[Path, Path]:
        units, out = tmp_path / "units", tmp_path / "run"
        run = ["run", str(MINI), "--models", "idm", "--out", str(out)]
        plan_units(units, run, unit=1, estimate=0, progress=False)
        return units, out

    def test_batches(self, program: str, tmp_path: Path, capsys: Any) -> None:
        units, out = self.plan(tmp_path)
        call(["shard", "run", str(units), "4", "--jobs", "1"])
        report = run_units(units, batch_units=5, in_flight=1)
        assert report[:3] == (12, 12, 0)
        assert "12 of 12 units, 12 of 12 scenarios" in capsys.readouterr().err
        merge_units(units)
        again = run_units(units)
        assert again[:3] == (12, 12, 0) and again.seconds < 5.0
        whole = tmp_path / "whole"
        command = [program, "run", str(MINI), "--models", "idm", "--out", str(whole), "--quiet"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        assert_equal(whole, out)

    def test_failing_unit(self, tmp_path: Path, wrapper: Path, capsys: Any) -> None:
        units, _ = self.plan(tmp_path)
        # As part of a batch, and then alone.
        case = 'case " $* " in "shard run"*|*" run "*" 3 "*) echo "error: disk" >&2; exit 2;; esac'
        (tmp_path / "case.sh").write_text(case.replace('"shard run"*|', "") + "\n")
        with pytest.raises(reactsim.ReactsimError) as error:
            run_units(units, batch_units=2, retries=1)
        text = str(error.value)
        assert "1 unit given up: 3;" in text
        assert re.search(r"unit 3, on \S+: `reactsim shard run --jobs=1 -- .* 3` ended", text)
        assert "with code 2:\nerror: disk" in text
        assert "attempt 2 of 2: unit 3" in capsys.readouterr().err
        status = json.loads(call(["shard", "status", str(units)]))
        assert status["missing"] == [3]

    def test_repeated_units(self, tmp_path: Path, wrapper: Path) -> None:
        units, _ = self.plan(tmp_path)
        # The first process of every unit kills itself.
        case = f'm="{tmp_path}/started-$6"\n' + (
            'if [ "$2" = run ] && [ ! -e "$m" ]; then touch "$m"; kill -9 $$; fi\n'
        )
        (tmp_path / "case.sh").write_text(case)
        report = run_units(units, retries=1, progress=False)
        assert report[:3] == (12, 12, 0)
        assert len(list(tmp_path.glob("started-*"))) == 12

    def test_stops_if_everything_fails(self, tmp_path: Path, wrapper: Path) -> None:
        units, _ = self.plan(tmp_path)
        case = f'if [ "$2" = run ]; then echo $6 >> "{tmp_path}/calls"; exit 2; fi\n'
        (tmp_path / "case.sh").write_text(case)
        with pytest.raises(reactsim.ReactsimError, match=r"stopped after 5 units in a row"):
            run_units(units, retries=0, in_flight=1, progress=False)
        assert len((tmp_path / "calls").read_text().split()) == 5

    def test_failed_scenarios(self, tmp_path: Path) -> None:
        units, out = tmp_path / "units", tmp_path / "run"
        broken = tmp_path / "broken.json"
        text = (MINI / "merge.json").read_text()
        broken.write_text(text[: len(text) // 2])
        run = ["run", str(MINI / "merge.json"), str(broken), "--models", "idm", "--out", str(out)]
        plan_units(units, run, unit=1, estimate=0, progress=False)
        report = run_units(units, progress=False)
        assert report[:3] == (2, 2, 1)
        assert reactsim.ray.main([str(units), "--quiet"]) == 1
        assert len(reactsim.Results(out).failures) == 1

    def test_lost_cluster_resources(self, tmp_path: Path, capsys: Any) -> None:
        ray = pytest.importorskip("ray")
        reactsim.ray._check_resources(ray, False, 2, 0.0)
        assert capsys.readouterr().err == ""
        reactsim.ray._check_resources(ray, False, 3, 0.0)
        assert "no node has 3 CPUs and 0 GPUs" in capsys.readouterr().err
        with pytest.raises(reactsim.ReactsimError, match="this machine has 2 and"):
            reactsim.ray._check_resources(ray, True, 3, 0.0)


@pytest.mark.skipif(sys.platform != "linux", reason="finds processes in /proc")
class TestCommand:
    """The command, which starts and ends a cluster of its own."""

    @pytest.fixture(autouse=True)
    def cluster(self) -> None:
        pytest.importorskip("ray", reason="Ray is not installed")

    def start(self, units: Path, out: Path, *options: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "reactsim.ray", str(units), "--unit", "1"]
        command += ["--estimate", "0", "--in-flight", "2", *options, "--", *arguments(out)]
        env = {**os.environ, "PYTHONPATH": str(PACKAGE)}
        env.pop("RAY_ADDRESS", None)
        pipe = subprocess.PIPE
        return subprocess.Popen(
            command,
            stdout=pipe,
            stderr=pipe,
            text=True,
            env=env,
            start_new_session=True,
            # Tests in the background of a shell ignore interrupts, and so would the driver.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )

    def test_killed_workers(self, whole: Path, tmp_path: Path) -> None:
        """Workers and processes of the program die at random; the results are the same."""
        random_ = random.Random(1)
        units, out = tmp_path / "units", tmp_path / "run"
        killed: list[str] = []
        with self.start(units, out, "--retries", "9") as driver:
            for kill in ("worker", "program", "worker", "program", "worker"):
                while driver.poll() is None and not programs(units):
                    time.sleep(0.02)
                time.sleep(random_.uniform(0.0, 0.15))
                for process in programs(units)[:1]:
                    worker = parent_worker(process)
                    if worker is None:
                        continue
                    os.kill(worker if kill == "worker" else process, signal.SIGKILL)
                    wait_until_ended(process)
                    killed.append(kill)
            output, errors = driver.communicate(timeout=LIMIT)
        assert driver.returncode == 0, errors
        assert {*killed} == {"worker", "program"}
        assert "| IDM " in output
        assert f"{UNITS} of {UNITS} units, 30 of 30 scenarios" in errors
        assert_equal(whole, out)

    def stopped(self, units: Path, out: Path, number: int) -> tuple[int, str]:
        """Stops a driver between its units by a signal; returns its exit code and its messages."""
        random_ = random.Random(2)
        for _ in range(10):
            before = finished(units)
            with self.start(units, out) as driver:
                while driver.poll() is None and finished(units) == before:
                    time.sleep(0.02)
                time.sleep(random_.uniform(0.0, 0.1))
                driver.send_signal(number)
                _, errors = driver.communicate(timeout=LIMIT)
            wait_for(lambda: not programs(units), "the end of the program")
            if finished(units) < UNITS:
                return driver.returncode, errors
            # The units were faster than the signal: once more.
            shutil.rmtree(units)
            shutil.rmtree(out, ignore_errors=True)
        raise AssertionError("all drivers finished before they were stopped")

    def test_killed_and_interrupted_drivers(self, whole: Path, tmp_path: Path) -> None:
        """The driver is killed, then interrupted, and then left to finish."""
        units, out, copy = tmp_path / "units", tmp_path / "run", tmp_path / "copy"
        for number in (signal.SIGKILL, signal.SIGINT):
            code, errors = self.stopped(units, out, number)
            assert 0 < finished(units) < UNITS
            assert not out.exists()
            if number == signal.SIGINT:
                assert code == 130, errors
                assert "interrupted: finished units stay" in errors
                assert "Traceback" not in errors
        options = (
            () if importlib.util.find_spec("fsspec") is None else ("--upload", f"file://{copy}")
        )
        with self.start(units, out, *options) as driver:
            output, errors = driver.communicate(timeout=LIMIT)
        assert driver.returncode == 0, errors
        assert "| IDM " in output
        assert not list(units.glob("partial-*"))
        assert_equal(whole, out)
        if options:
            assert_equal(whole, copy)
