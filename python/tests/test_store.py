"""Files behind URLs: the helper of the program, and runs that read through it."""

from __future__ import annotations

import functools
import http.server
import io
import json
import os
import shlex
import shutil
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import reactsim
from fakes import ROOT
from reactsim import store
from reactsim.program import call, environment
from reactsim.ray import merge_units, plan_units, run_units
from test_units import MINI, arguments, assert_equal, program_needed

fsspec = pytest.importorskip("fsspec")


def request(*parts: str) -> bytes:
    return store.respond(["1", *parts])


def failure(*parts: str) -> tuple[str, str]:
    """Returns kind and text of the failure of a request."""
    with pytest.raises(store.StoreError) as error:
        request(*parts)
    return error.value.kind, str(error.value)


@pytest.fixture
def memory() -> Iterator[Any]:
    """The file system `memory://` with some files below `memory://data`."""
    system = fsspec.filesystem("memory")
    system.pipe_file("/data/a.json", b"0123456789")
    system.pipe_file("/data/inner/b.json", b"")
    yield system
    system.rm("/data", recursive=True)


@pytest.fixture
def no_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "WAITS", (0.0, 0.0, 0.0))


class Failing:
    """A file system that fails a number of times before it reads."""

    def __init__(self, errors: list[Exception]) -> None:
        self.errors = errors

    def cat_file(self, path: str, start: int, end: int) -> bytes:
        if self.errors:
            raise self.errors.pop()
        return b"x" * (end - start)


class TestRequests:
    @pytest.mark.usefixtures("memory")
    def test_list(self) -> None:
        for url in ("memory://data", "memory://data/"):
            lines = request("list", url).decode().splitlines()
            sizes = {line.split("\t")[2]: line.split("\t")[0] for line in lines}
            assert sizes == {"a.json": "10", "inner/b.json": "0"}
        size, version, name = request("list", "memory://data/a.json").decode()[:-1].split("\t")
        assert (size, name) == ("10", "") and version.startswith("created ")

    @pytest.mark.usefixtures("memory")
    def test_lists_and_files_have_the_same_version(self, tmp_path: Path) -> None:
        (tmp_path / "a.json").write_bytes(b"0123456789")
        for url in ("memory://data", tmp_path.as_uri()):
            listed = request("list", url).decode().splitlines()[0]
            assert listed == request("info", f"{url}/a.json").decode() + "\ta.json"

    @pytest.mark.usefixtures("memory")
    def test_read(self) -> None:
        url = "memory://data/a.json"
        assert request("read", url, "2", "3", "", "") == b"234"
        size, version = request("info", url).decode().split("\t")
        assert request("read", url, "0", "10", size, version) == b"0123456789"
        assert request("read", url, "0", "0", size, version) == b""

    def test_changed_files(self, memory: Any, tmp_path: Path) -> None:
        local = tmp_path / "a.json"
        local.write_bytes(b"0123456789")
        os.utime(local, (1, 1))
        for url in ("memory://data/a.json", local.as_uri()):
            size, version = request("info", url).decode().split("\t")
            memory.pipe_file("/data/a.json", b"9876543210")
            local.write_bytes(b"9876543210")
            kind, text = failure("read", url, "0", "5", size, version)
            assert kind == "changed" and "10 bytes" in text and "start again" in text

    @pytest.mark.usefixtures("memory")
    def test_failures(self) -> None:
        for url in ("memory://data/none", "memory://none/", "memory://none"):
            assert failure("list", url)[0] == "missing"
        assert failure("info", "memory://data/none") == (
            "missing",
            "there is no such file; check the URL",
        )
        assert failure("info", "memory://data") == ("unsupported", "it is a folder, not a file")
        kind, text = failure("info", "abc://data")
        assert kind == "unsupported" and "abc" in text and "s3://bucket/folder" in text
        assert "chained" in failure("list", "simplecache::memory://data")[1]
        assert "unknown request" in failure("write", "memory://data")[1]

    def test_missing_packages(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "gcsfs", None)
        kind, text = failure("list", "gs://bucket/folder")
        assert kind == "unsupported" and "gcsfs" in text and sys.executable in text
        monkeypatch.setitem(sys.modules, "fsspec", None)
        kind, text = failure("list", "s3://bucket/folder")
        assert kind == "unsupported" and "pip install fsspec" in text

    @pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root reads all")
    def test_no_permission(self, tmp_path: Path) -> None:
        path = tmp_path / "a.json"
        path.write_bytes(b"a")
        path.chmod(0)
        assert failure("read", path.as_uri(), "0", "1", "", "")[0] == "forbidden"

    @pytest.mark.usefixtures("no_waits")
    def test_failures_that_pass(self, monkeypatch: pytest.MonkeyPatch) -> None:
        class DeniedError(Exception):
            status = 403

        def read(*errors: Exception) -> bytes:
            monkeypatch.setattr(store, "_open", lambda url: (Failing(list(errors)), url))
            return request("read", "x://a", "0", "2", "", "")

        assert read(*[TimeoutError("slow")] * 3) == b"xx"
        cases: list[tuple[list[Exception], str, str]] = [
            (
                [TimeoutError("slow\nserver")] * 4,
                "failed",
                "TimeoutError: slow server, in 4 attempts",
            ),
            ([PermissionError("no")], "forbidden", "check the credentials"),
            ([DeniedError()], "forbidden", "DeniedError; check the credentials"),
            ([NotImplementedError("parts")], "failed", "copy it to a file system"),
            ([FileNotFoundError("gone")], "missing", "check the URL"),
        ]
        for errors, kind, part in cases:
            with pytest.raises(store.StoreError) as error:
                read(*errors)
            assert error.value.kind == kind and part in str(error.value)

    def test_answers(self) -> None:
        answers = io.BytesIO()
        requests = b"7\tinfo\tmemory://none\n8\tlist\n"
        before = threading.active_count()
        store.serve(io.BytesIO(requests), answers)
        while threading.active_count() > before:
            pass
        text = answers.getvalue().decode()
        assert text.startswith("reactsim-store 1\n")
        assert "7\tmissing\t36\nthere is no such file; check the URL" in text
        assert "8\tfailed\t" in text


def answer(command: list[str], file: Path, path: Path, cwd: Path | None = None) -> bytes:
    """Returns greeting and answer of a helper that reads three bytes of a file."""
    helper = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": os.fspath(path)},
    )
    assert helper.stdin is not None and helper.stdout is not None
    helper.stdin.write(f"0\tread\t{file.as_uri()}\t0\t3\t\t\n".encode())
    helper.stdin.flush()
    text = helper.stdout.read(len(b"reactsim-store 1\n0\tok\t3\nabc"))
    helper.stdin.close()
    assert helper.wait(10) == 0
    helper.stdout.close()
    return text


class TestProcess:
    def test_prints_stay_out_of_the_answers(self, tmp_path: Path) -> None:
        (tmp_path / "sitecustomize.py").write_text(
            "import atexit, threading, time\n"
            "def speak():\n"
            "    for _ in range(20):\n"
            "        print('noise', flush=True)\n"
            "        time.sleep(0.01)\n"
            "threading.Timer(0.3, speak).start()\n"
        )
        (tmp_path / "a").write_bytes(b"abc")
        command = [sys.executable, os.fspath(ROOT / "python/reactsim/store.py")]
        text = answer(command, tmp_path / "a", tmp_path)
        assert text == b"reactsim-store 1\n0\tok\t3\nabc"

    @pytest.mark.parametrize("has_file", [True, False])
    def test_modules_of_the_current_folder_are_not_imported(
        self, has_file: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        (tmp_path / "reactsim").mkdir()
        for name in ("reactsim/__init__", "reactsim/store", "fsspec", "http", "numpy"):
            (tmp_path / f"{name}.py").write_text("raise SystemExit(1)")
        (tmp_path / "a").write_bytes(b"abc")
        monkeypatch.delenv("REACTSIM_STORE", raising=False)
        if not has_file:
            monkeypatch.setattr(os.path, "isfile", lambda path: False)
        command = shlex.split(environment()["REACTSIM_STORE"])
        text = answer(command, tmp_path / "a", ROOT / "python", tmp_path)
        assert text == b"reactsim-store 1\n0\tok\t3\nabc"

    def test_the_program_gets_this_python(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.delenv("REACTSIM_STORE", raising=False)
        assert environment()["REACTSIM_STORE"].startswith(sys.executable)
        monkeypatch.setenv("REACTSIM_STORE", "mine")
        assert environment()["REACTSIM_STORE"] == "mine"


class Handler(http.server.SimpleHTTPRequestHandler):
    """Serves files and parts of files; what is below `denied` and `busy` is not served."""

    failures = 0

    def do_GET(self) -> None:
        part = self.headers.get("Range")
        path = Path(self.translate_path(self.path))
        if "denied" in self.path:
            self.send_error(403)
        elif "circle" in self.path:
            self.send_response(302)
            self.send_header("Location", self.path)
            self.end_headers()
        elif "unsatisfiable" in self.path and part is not None:
            self.send_error(416)
        elif "busy" in self.path and Handler.failures > 0:
            Handler.failures -= 1
            self.send_error(503)
        elif part is None or "whole" in self.path or not path.is_file():
            super().do_GET()
        else:
            first, last = part.removeprefix("bytes=").split("-")
            content = path.read_bytes()[int(first) : int(last) + 1]
            self.send_response(206)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

    def do_HEAD(self) -> None:
        if "denied" in self.path:
            self.send_error(403)
        elif "circle" in self.path:
            self.do_GET()
        else:
            super().do_HEAD()

    def log_message(self, format: str, *args: Any) -> None:
        pass


@pytest.fixture
def web(tmp_path: Path) -> Iterator[tuple[str, Path]]:
    """URL and folder of a local web server."""
    pytest.importorskip("aiohttp")
    folder = tmp_path / "web"
    folder.mkdir()
    handler = functools.partial(Handler, directory=os.fspath(folder))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}", folder
    server.shutdown()
    server.server_close()


def run(scenarios: str, out: Path) -> None:
    call(["run", scenarios, *arguments(out)[2:]])


@pytest.fixture(scope="module")
def whole(program: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run folder of the scenarios from a file system."""
    out = tmp_path_factory.mktemp("whole") / "run"
    subprocess.run([program, *arguments(out), "--quiet"], check=True, stdout=subprocess.DEVNULL)
    return out


def test_strange_servers(web: tuple[str, Path]) -> None:
    url, folder = web
    (folder / "unsatisfiable").write_bytes(b"content")
    for command in ("info", "list"):
        kind, text = failure(command, f"{url}/circle")
        assert kind == "failed" and "redirects in a circle" in text
    kind, text = failure("read", f"{url}/unsatisfiable", "0", "3", "", "")
    assert kind == "unsupported" and "refuses parts of the file (416)" in text


class TestRuns:
    pytestmark = program_needed

    def test_files(self, whole: Path, tmp_path: Path) -> None:
        run(MINI.as_uri(), tmp_path / "run")
        assert_equal(whole, tmp_path / "run")

    def test_memory(self, whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        script = tmp_path / "with files.py"
        script.write_text(
            "import fsspec\n"
            f"fsspec.filesystem('memory').put({os.fspath(MINI)!r}, '/mini', recursive=True)\n"
            "from reactsim import store\n"
            "store.main()\n"
        )
        monkeypatch.setenv("PYTHONPATH", os.fspath(ROOT / "python"))
        monkeypatch.setenv("REACTSIM_STORE", f"{sys.executable} '{script}'")
        run("memory://mini", tmp_path / "run")
        assert_equal(whole, tmp_path / "run")

    def test_web(self, web: tuple[str, Path], whole: Path, tmp_path: Path) -> None:
        url, folder = web
        shutil.copytree(MINI, folder / "mini")
        run(f"{url}/mini/", tmp_path / "run")
        assert_equal(whole, tmp_path / "run")

    def test_web_faults(self, web: tuple[str, Path], tmp_path: Path) -> None:
        url, folder = web
        for name in ("a.json", "denied.json", "busy.json", "whole.json"):
            shutil.copy(MINI / "crossing.json", folder / name)
        with (folder / "whole.json").open("a") as file:
            file.write(" " * 100_000)  # more than the first part that the program reads
        Handler.failures = 2
        call(["inspect", f"{url}/busy.json?key=a/b.txt"])
        with socket.socket() as unused:
            unused.bind(("127.0.0.1", 0))
            closed = f"http://127.0.0.1:{unused.getsockname()[1]}"
        for place, part in [
            (f"{url}/none.json", "there is no such file"),
            (f"{url}/denied.json", "check the credentials"),
            (f"{url}/whole.json", "the server sends the whole file for a part"),
            (f"{closed}/a.json", "in 4 attempts; check the connection"),
            ("gs+x://bucket/a.json", "Protocol not known: gs+x"),
        ]:
            with pytest.raises(reactsim.ReactsimError) as error:
                run(place, tmp_path / "run")
            assert f"{place}: could not read: " in str(error.value) and part in str(error.value)

    def test_units(self, whole: Path, tmp_path: Path) -> None:
        units, out = tmp_path / "units", tmp_path / "run"
        command = ["run", MINI.as_uri(), *arguments(out)[2:]]
        plan_units(units, command, unit=1, estimate=0, progress=False)
        call(["shard", "run", str(units), "--missing", "--jobs", "1"])
        merge_units(units)
        assert_equal(whole, out)

    def test_ray(self, whole: Path, tmp_path: Path) -> None:
        pytest.importorskip("ray")
        units, out = tmp_path / "units", tmp_path / "run"
        command = [sys.executable, "-m", "reactsim.ray", str(units), "--unit", "4", "--"]
        done = subprocess.run(
            [*command, "run", MINI.as_uri(), *arguments(out)[2:]],
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "PYTHONPATH": os.fspath(ROOT / "python")},
        )
        assert done.returncode == 0, done.stderr
        assert_equal(whole, out)

    def test_a_file_that_changes(self, tmp_path: Path) -> None:
        """A file that grows between the plan and its units is refused by its digest."""
        data, units = tmp_path / "data", tmp_path / "units"
        shutil.copytree(MINI, data)
        command = ["run", data.as_uri(), "--models", "idm", "--out", str(tmp_path / "run")]
        plan_units(units, command, unit=1, estimate=0, progress=False)
        path = data / "crossing.json"
        scenario = json.loads(path.read_text())
        path.write_text(json.dumps(scenario) + " ")
        with pytest.raises(reactsim.ReactsimError, match=r"in the plan and .* here"):
            call(["shard", "run", str(units), "--missing"])

    def test_folders(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.chdir(tmp_path)
        url = "s3://bucket/units"
        simulator = reactsim.Simulator()
        calls: list[Callable[[], object]] = [
            lambda: plan_units(url, arguments(tmp_path / "run"), progress=False),
            lambda: run_units(url),
            lambda: merge_units(url),
            lambda: reactsim.Results(url),
            lambda: reactsim.run(simulator, out=url),
        ]
        for one in calls:
            with pytest.raises(reactsim.ReactsimError, match="s3://bucket/units is a URL"):
                one()
        assert list(tmp_path.iterdir()) == []

    def test_outputs(self, tmp_path: Path) -> None:
        for out in ("s3://bucket/run", tmp_path.as_uri()):
            with pytest.raises(reactsim.ReactsimError, match="--out is the URL"):
                call(["run", str(MINI), "--models", "idm", "--out", out], folder=str(tmp_path))
        assert list(tmp_path.iterdir()) == []
