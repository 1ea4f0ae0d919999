"""Runs in units: the verbs of the program, the example scripts, and uploads."""

from __future__ import annotations

import filecmp
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import reactsim
from fakes import EXAMPLES, ROOT
from reactsim.program import call
from reactsim.ray import merge_units, plan_units
from reactsim.upload import check_url, upload_run

MINI = ROOT / "scenarios" / "mini"

program_needed = [pytest.mark.program, pytest.mark.usefixtures("with_program")]


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


class TestVerbs:
    pytestmark = program_needed

    def test_any_order_and_again(self, whole: Path, tmp_path: Path) -> None:
        units, out = tmp_path / "units", tmp_path / "run"
        plan_units(units, arguments(out), unit=1, estimate=0, progress=False)
        status = json.loads(call(["shard", "status", str(units)]))
        assert (status["units"], status["records"], status["finished"]) == (12, 12, 0)
        assert status["missing"] == list(range(12))
        call(["shard", "run", str(units), "7", "3", "--jobs", "1"])
        call(["shard", "run", str(units), "3", "--jobs", "1"])  # is finished already
        status = json.loads(call(["shard", "status", str(units)]))
        assert (status["finished"], status["finished_records"], status["failed"]) == (2, 2, 0)
        assert 3 not in status["missing"] and 7 not in status["missing"]
        with pytest.raises(reactsim.ReactsimError, match="10 of 12 units are not finished"):
            merge_units(units)
        call(["shard", "run", str(units), "--missing", "--jobs", "1"])
        assert merge_units(units) == out
        assert_equal(whole, out)
        assert merge_units(units) == out  # is merged already

    def test_other_commands(self, tmp_path: Path) -> None:
        units, out = tmp_path / "units", tmp_path / "logs.parquet"
        command = ["generate", "--preset", "train", "--count", "3", "--out"]
        plan_units(units, [*command, str(out)], unit=2, estimate=0, progress=False)
        call(["shard", "run", str(units), "--missing"])
        assert merge_units(units) == out
        whole = tmp_path / "whole.parquet"
        call([*command, str(whole)])
        assert filecmp.cmp(out, whole, shallow=False)

    def test_plan_of_another_run(self, tmp_path: Path) -> None:
        units, run = tmp_path / "units", arguments(tmp_path / "run")
        plan_units(units, run, unit=5, estimate=0, progress=False)
        # Files of mini have one record each, so no unit has more.
        plan_units(units, run, unit=1, progress=False)
        before = (units / "plan.json").read_bytes()
        with pytest.raises(reactsim.ReactsimError) as error:
            plan_units(units, [*run, "--seed", "1"], progress=False)
        assert f"planned: {' '.join(run)}\n" in str(error.value)
        assert f"given:   {' '.join(run)} --seed 1" in str(error.value)
        assert (units / "plan.json").read_bytes() == before

    def test_size_of_units(self, tmp_path: Path) -> None:
        run = ["run", "--models", "idm", "--limit", "5", "--out", str(tmp_path / "run")]
        plan_units(tmp_path, run, unit=2, estimate=0, progress=False)
        plan_units(tmp_path, run, unit=2, progress=False)
        for other in (1, 3):
            with pytest.raises(reactsim.ReactsimError, match=f"up to 2 records, not {other}"):
                plan_units(tmp_path, run, unit=other, progress=False)

    def test_wrong_arguments(self, tmp_path: Path) -> None:
        with pytest.raises(reactsim.ReactsimError, match="--out"):
            plan_units(tmp_path, ["run", str(MINI)], progress=False)

    def test_damaged_plans(self, tmp_path: Path) -> None:
        with pytest.raises(reactsim.ReactsimError, match=r"has no plan\.json: .*shard plan"):
            merge_units(tmp_path)
        for text in ("", "{}", '{"units": [{}]}', "[]"):
            (tmp_path / "plan.json").write_text(text)
            with pytest.raises(reactsim.ReactsimError, match="is not a plan of"):
                merge_units(tmp_path)


@pytest.mark.skipif(sys.platform == "win32", reason="shell scripts")
class TestScripts:
    pytestmark = program_needed

    @pytest.fixture
    def env(self, program: str, tmp_path: Path) -> dict[str, str]:
        """Environment in which the program is in PATH."""
        (tmp_path / "bin").mkdir()
        (tmp_path / "bin" / "reactsim").symlink_to(program)
        env = {name: value for name, value in os.environ.items() if not name.startswith("SLURM_")}
        return {**env, "PATH": f"{tmp_path / 'bin'}{os.pathsep}{env['PATH']}"}

    def test_xargs(self, whole: Path, tmp_path: Path, env: dict[str, str]) -> None:
        units, out = tmp_path / "units", tmp_path / "run"
        command = [str(EXAMPLES / "xargs_units.sh"), str(units), "2", *arguments(out)]
        env["UNIT"] = "1"
        # A unit that cannot be written: everything else is carried out, and nothing is merged.
        broken = tmp_path / "bin" / "reactsim"
        real = broken.resolve()
        broken.unlink()
        broken.write_text(
            '#!/bin/sh\ncase "$*" in "shard run "*" 4 "*) echo broken >&2; exit 2;; esac\n'
            f'exec "{real}" "$@"\n'
        )
        broken.chmod(0o755)
        done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
        assert done.returncode == 123 and "broken" in done.stderr
        assert not out.exists()
        assert json.loads(call(["shard", "status", str(units)]))["missing"] == [4]
        broken.unlink()
        broken.symlink_to(real)
        done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert "| IDM " in done.stdout
        assert_equal(whole, out)

    @pytest.mark.parametrize("tasks", [1, 5, 14])
    def test_slurm_array(
        self, whole: Path, tmp_path: Path, env: dict[str, str], tasks: int
    ) -> None:
        units, out = tmp_path / "units", tmp_path / "run"
        plan_units(units, arguments(out), unit=1, estimate=0, progress=False)
        least = 1  # such as --array=1-5
        variables = {
            "SLURM_ARRAY_TASK_COUNT": str(tasks),
            "SLURM_ARRAY_TASK_MIN": str(least),
            "SLURM_ARRAY_TASK_MAX": str(least + tasks - 1),
            "SLURM_CPUS_PER_TASK": "1",
        }
        for task in reversed(range(least, least + tasks)):
            done = subprocess.run(
                [EXAMPLES / "slurm_array.sh", units],
                env={**env, **variables, "SLURM_ARRAY_TASK_ID": str(task)},
                capture_output=True,
                text=True,
                check=False,
            )
            assert done.returncode == 0, done.stderr
            numbers = range(task - least, 12, tasks)
            assert done.stderr.count("unit ") == len(numbers)
            assert all(f"unit {number}: 1 record" in done.stderr for number in numbers)
        call(["shard", "merge", str(units)])
        assert_equal(whole, out)

    def test_slurm_array_with_gaps(self, tmp_path: Path, env: dict[str, str]) -> None:
        gaps = {"COUNT": "2", "MIN": "3", "MAX": "7", "ID": "7"}
        env.update({f"SLURM_ARRAY_TASK_{name}": value for name, value in gaps.items()})
        done = subprocess.run(
            [EXAMPLES / "slurm_array.sh", tmp_path], env=env, capture_output=True, check=False
        )
        assert done.returncode == 2
        assert b"consecutive tasks" in done.stderr


class TestUpload:
    @pytest.fixture(autouse=True)
    def fsspec(self) -> None:
        pytest.importorskip("fsspec", reason="uploads need fsspec")

    @pytest.fixture
    def run(self, tmp_path: Path) -> Path:
        folder = tmp_path / "run"
        folder.mkdir()
        for name in ("provenance.json", "rows.jsonl", "values.parquet", "summary.json"):
            (folder / name).write_text(f"this is {name}\n" * 1000)
        (folder / "failures.jsonl").touch()
        return folder

    def test_file(self, run: Path, tmp_path: Path) -> None:
        target = tmp_path / "a" / "b"
        # An interrupted copy.
        target.mkdir(parents=True)
        (target / "provenance.json").write_text("old")
        (target / "rows.jsonl.part").write_text("trunc")
        upload_run(run, f"file://{target}/")
        assert_equal(run, target)
        upload_run(run, f"file://{target}")  # is complete
        (run / "summary.json").write_text("of another run")
        with pytest.raises(reactsim.ReactsimError, match="results of another run"):
            upload_run(run, f"file://{target}")

    def test_files_only(self, run: Path) -> None:
        import fsspec

        (run / "values.parquet").unlink()
        (run / "values.parquet").symlink_to(run)  # cannot be copied, and is no file
        upload_run(run, "memory://first/run")
        paths = fsspec.filesystem("memory").find("/first/run")
        assert {path.rsplit("/", 1)[1] for path in paths} == {
            "provenance.json",
            "rows.jsonl",
            "failures.jsonl",
            "summary.json",
        }

    def test_failed_copy(self, run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        from fsspec.implementations.memory import MemoryFileSystem

        put, copied = MemoryFileSystem.put_file, []

        def fail(self: object, path: str, target: str, **options: object) -> None:
            if "values" in path:
                raise OSError("no space")
            copied.append(target)
            put(self, path, target, **options)

        monkeypatch.setattr(MemoryFileSystem, "put_file", fail)
        with pytest.raises(reactsim.ReactsimError, match=r"cannot copy values\.parquet .*no space"):
            upload_run(run, "memory://second/run")
        assert copied and not MemoryFileSystem().exists("/second/run/summary.json")
        monkeypatch.setattr(MemoryFileSystem, "put_file", put)
        upload_run(run, "memory://second/run")
        system = MemoryFileSystem()
        for path in run.iterdir():
            assert system.cat_file(f"/second/run/{path.name}") == path.read_bytes()

    def test_unfinished_run(self, run: Path) -> None:
        (run / "summary.json").unlink()
        with pytest.raises(reactsim.ReactsimError, match="not finished"):
            upload_run(run, "memory://third")

    def test_unknown_url(self) -> None:
        with pytest.raises(reactsim.ReactsimError, match="cannot upload to nowhere://x"):
            check_url("nowhere://x")
