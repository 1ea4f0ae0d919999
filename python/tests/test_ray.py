"""Partitions: the driver with processes of this machine and with Ray, and the Slurm script."""

from __future__ import annotations

import filecmp
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import reactsim
import reactsim.ray
from fakes import EXAMPLES, IMPORTED, MINI, executable, is_running
from reactsim.program import invoke
from reactsim.ray import run_partitions

pytestmark = [
    pytest.mark.program,
    pytest.mark.usefixtures("with_program"),
    pytest.mark.skipif(sys.platform == "win32", reason="signals and shell scripts"),
]


def arguments(out: Path) -> list[str]:
    return ["run", str(MINI), "--models", "log-replay,idm", "--out", str(out)]


def assert_equal(first: Path, second: Path) -> None:
    """Asserts that two run folders have the same files, byte for byte."""
    names = sorted(path.name for path in first.iterdir())
    assert "summary.json" in names
    assert names == sorted(path.name for path in second.iterdir())
    assert filecmp.cmpfiles(first, second, names, shallow=False) == (names, [], [])


@pytest.fixture(scope="module")
def whole(program: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run folder of one process."""
    out = tmp_path_factory.mktemp("whole") / "run"
    subprocess.run([program, *arguments(out), "--quiet"], check=True, stdout=subprocess.DEVNULL)
    return out


@pytest.fixture
def case(program: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file `case.sh`, which a stand-in for the program runs before the program."""
    case = tmp_path / "case.sh"
    path = executable(tmp_path / "wrapper", f'. "{case}"\nexec "{program}" "$@"')
    monkeypatch.setenv("REACTSIM_BINARY", str(path))
    return case


class TestProcesses:
    def test_any_number(self, whole: Path, tmp_path: Path) -> None:
        for partitions in (1, 5, 20):
            out = tmp_path / f"run-{partitions}"
            done = run_partitions(tmp_path / "parts", arguments(out), partitions=partitions)
            assert done == (out, 0)
            assert_equal(whole, out)

    def test_other_commands(self, tmp_path: Path) -> None:
        out, whole = tmp_path / "logs.parquet", tmp_path / "whole" / "logs.parquet"
        whole.parent.mkdir()
        command = ["generate", "--preset", "train", "--count", "3"]
        run_partitions(tmp_path / "parts", [*command, f"--out={out}"], partitions=2)
        invoke([*command, "--out", str(whole)])
        assert filecmp.cmp(out, whole, shallow=False)

    def test_repeated_partitions(
        self, whole: Path, tmp_path: Path, case: Path, capsys: Any
    ) -> None:
        # The first process of every partition kills itself.
        mark = f'm="{tmp_path}/started-$(echo "$*" | sed "s/.*partition=//; s,[/ ].*,,")"\n'
        kill = 'if [ "$1" = run ] && [ ! -e "$m" ]; then touch "$m"; kill -9 $$; fi\n'
        case.write_text(mark + kill)
        out, parts = tmp_path / "run", tmp_path / "parts"
        run_partitions(parts, arguments(out), partitions=3, retries=1)
        assert_equal(whole, out)
        assert len(list(tmp_path.glob("started-*"))) == 3
        assert sorted(path.name for path in parts.iterdir()) == ["1-of-3", "2-of-3", "3-of-3"]
        assert "warning: partition 1/3 is repeated" in capsys.readouterr().err

    def test_failing_partition(self, whole: Path, tmp_path: Path, case: Path) -> None:
        case.write_text('case "$*" in *=2/3*) echo "error: disk" >&2; exit 2;; esac\n')
        out, parts = tmp_path / "run", tmp_path / "parts"
        with pytest.raises(reactsim.ReactsimError) as error:
            run_partitions(parts, arguments(out), partitions=3, retries=1, processes=1)
        assert "partition 2/3 failed; finished ones stay: on" in str(error.value)
        assert "exit code 2\nerror: disk" in str(error.value)
        assert (parts / "1-of-3").is_dir() and not out.exists()
        # Finished ones are not run again.
        case.write_text('case "$*" in *=1/3*) exit 2;; esac\n')
        run_partitions(parts, arguments(out), partitions=3, progress=False)
        assert_equal(whole, out)

    def test_failed_scenarios(self, tmp_path: Path) -> None:
        broken = tmp_path / "broken.json"
        text = (MINI / "merge.json").read_text()
        broken.write_text(text[: len(text) // 2])
        out = tmp_path / "run"
        command = ["run", str(MINI / "merge.json"), str(broken), "--models", "idm", "--out"]
        given = [str(tmp_path / "parts"), "--partitions", "2", "--", *command, str(out)]
        assert reactsim.ray.main(given) == 1
        assert len(reactsim.Results(out).failures) == 1

    def test_refused(self, whole: Path, tmp_path: Path, capsys: Any) -> None:
        run = arguments(tmp_path / "run")
        with pytest.raises(reactsim.ReactsimError, match="give --out"):
            run_partitions(tmp_path / "parts", run[:-2], partitions=2)
        with pytest.raises(reactsim.ReactsimError, match="exists and is not empty"):
            run_partitions(tmp_path / "parts", arguments(whole), partitions=2)
        run_partitions(tmp_path / "parts", run, partitions=2)
        other = [*arguments(tmp_path / "other"), "--seed", "1"]
        with pytest.raises(reactsim.ReactsimError, match="is of another command"):
            run_partitions(tmp_path / "parts", other, partitions=2)
        with pytest.raises(reactsim.ReactsimError, match="is a URL"):
            run_partitions("s3://bucket/parts", other, partitions=2)
        given = [str(tmp_path / "new"), "--partitions", "0", "--", "run", "--out", "x"]
        assert reactsim.ray.main(given) == 2
        assert "error: give 1 partition or more" in capsys.readouterr().err

    @pytest.mark.skipif(sys.platform != "linux", reason="a mechanism of Linux")
    @pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
    def test_stopped_driver(self, whole: Path, tmp_path: Path, case: Path, number: int) -> None:
        """Programs end with the driver, and another call continues."""
        note = tmp_path / "pid"
        case.write_text(f'case "$*" in *=2/2*) echo $$ > "{note}"; exec sleep 600;; esac\n')
        out, parts = tmp_path / "run", tmp_path / "parts"
        command = [sys.executable, "-m", "reactsim.ray", str(parts), "--partitions", "2"]
        driver = subprocess.Popen(
            [*command, "--processes", "2", "--", *arguments(out)],
            stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": str(IMPORTED)},
            # Tests in the background of a shell ignore interrupts, and so would the driver.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )
        wait_for(lambda: note.exists() and note.read_text() and (parts / "1-of-2").is_dir())
        driver.send_signal(number)
        driver.communicate(timeout=60)
        assert driver.returncode == (130 if number == signal.SIGINT else -signal.SIGKILL)
        wait_for(lambda: not is_running(int(note.read_text())))
        case.write_text("")
        run_partitions(parts, arguments(out), partitions=2, progress=False)
        assert_equal(whole, out)


def wait_for(condition: Any) -> None:
    end = time.monotonic() + 60.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_without_ray(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    given = [str(tmp_path / "parts"), "--partitions", "1", "--address", "local", "--"]
    assert reactsim.ray.main([*given, *arguments(tmp_path / "run")]) == 2
    assert "pip install 'reactsim[ray]'" in capsys.readouterr().err


def test_ray(whole: Path, tmp_path: Path, case: Path) -> None:
    """Programs and workers die at random on a cluster; the results are the same."""
    ray = pytest.importorskip("ray", reason="Ray is not installed")
    mark = f'm="{tmp_path}/started-$(echo "$*" | sed "s/.*partition=//; s,[/ ].*,,")"\n'
    # The first process of a partition kills itself, or the worker that waits for it.
    kill = 'case "$*" in *=[135]/*) kill -9 $$;; *) kill -9 $PPID;; esac'
    case.write_text(f'{mark}if [ "$1" = run ] && [ ! -e "$m" ]; then touch "$m"; {kill}; fi\n')
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    options = {"include_dashboard": False, "log_to_driver": False, "logging_level": "ERROR"}
    ray.init(address="local", num_cpus=2, object_store_memory=100_000_000, **options)
    try:
        out = tmp_path / "run"
        run_partitions(tmp_path / "parts", arguments(out), partitions=6, retries=9)
    finally:
        ray.shutdown()
    assert_equal(whole, out)
    assert len(list(tmp_path.glob("started-*"))) == 6


def test_slurm(program: str, whole: Path, tmp_path: Path) -> None:
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "reactsim").symlink_to(program)
    env = {name: value for name, value in os.environ.items() if not name.startswith("SLURM_")}
    env["PATH"] = f"{tmp_path / 'bin'}{os.pathsep}{env['PATH']}"
    parts, out = tmp_path / "parts", tmp_path / "run"
    script = ["bash", str(EXAMPLES / "slurm_array.sh"), str(parts), *arguments(out)[:-2]]
    for task in (1, 2, 3, 2):
        slurm = {"SLURM_ARRAY_TASK_ID": str(task), "SLURM_ARRAY_TASK_COUNT": "3"}
        subprocess.run(script, check=True, env={**env, **slurm}, stdout=subprocess.DEVNULL)
    invoke(["merge", *map(str, sorted(parts.iterdir())), "--out", str(out)])
    assert_equal(whole, out)
