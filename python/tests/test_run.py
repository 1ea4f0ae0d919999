"""`reactsim.run`, `reactsim.scenarios` and pictures, with a stand-in for the program."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any, Callable, List

import numpy as np
import pytest
import reactsim
from fakes import executable
from stop import Stop


def arguments(notes: Path) -> List[str]:
    result: List[str] = json.loads((notes / "arguments.json").read_text())
    return result


def test_run(fake_program: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    results = reactsim.run(Stop(), batch=7)
    folder = str(results.folder)
    assert arguments(fake_program) == [
        *("run", "--external=stop-py=@stdio", f"--out={folder}", "--keep-rollouts"),
    ]
    assert json.loads((fake_program / "welcome.json").read_text())["batch"] == "7"
    assert results.simulators == ["idm", "mine"]
    assert results.table() == "| Method |\n|---|\n| IDM |\n"
    del results
    assert not Path(folder).exists()

    out = tmp_path / "out"
    capfd.readouterr()  # the first run shows its progress
    results = reactsim.run(
        Stop,
        [tmp_path / "a", "b"],
        name="mine",
        av="brake:4",
        deviations=tmp_path / "d",
        protocol="realism",
        replan="5steps",
        baselines=["idm", "stop"],
        rollouts=2,
        seed=3,
        limit=4,
        out=out,
        resume=True,
        options=["--av-lookahead", "0"],
        reveal_ids=True,
        jobs=2,
        progress=False,
    )
    assert arguments(fake_program) == [
        *("run", "--models=idm,stop", "--external=mine=@stdio", f"--out={out}", "--keep-rollouts"),
        *("--protocol=realism", "--replan=5steps", "--rollouts=2", "--seed=3", "--av=brake:4"),
        *(f"--deviations={tmp_path / 'd'}", "--limit=4", "--jobs=2", "--resume", "--reveal-ids"),
        *("--av-lookahead", "0", "--", str(tmp_path / "a"), "b"),
    ]
    assert results.folder == out
    assert capfd.readouterr() == ("", "")
    with pytest.raises(ValueError, match="needs the folder"):
        reactsim.run(Stop, resume=True)
    wrong: List[Any] = [["idm"], ["a.toml", "b.parquet"]]
    for given in wrong:
        with pytest.raises(ValueError, match=r"is no specification \(`.toml`\) in place of scen"):
            reactsim.run(*given)


class Failing(Stop):  # type: ignore[misc]
    def plan(self, seen: reactsim.Observation) -> Any:
        raise ZeroDivisionError("nothing to divide")


def test_failed_scenarios(fake_program: Path) -> None:
    with pytest.warns(UserWarning, match=r"1 scenarios failed(.|\n)*ZeroDivisionError: nothing"):
        results = reactsim.run(Failing())
    failures = results.failures
    rows = failures if isinstance(failures, list) else failures.to_dict("records")
    assert [(r["scenario"], r["error"]) for r in rows] == [("second", "it is broken")]


def test_failed_runs(fake_program: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(reactsim.ReactsimError, match=r"code 2:\nerror: the scenarios"):
        reactsim.run(Stop(), options=["broken"])
    assert "the scenarios cannot be read" in capfd.readouterr().err
    with pytest.raises(reactsim.ReactsimError, match="a frame of"):
        reactsim.run(Stop(), options=["garbage"], progress=False)


class Interrupted(Stop):  # type: ignore[misc]
    def plan(self, seen: reactsim.Observation) -> Any:
        raise KeyboardInterrupt


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_interrupts(fake_program: Path, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        reactsim.run(Interrupted(), out=tmp_path / "out", progress=False)

    def interrupt() -> None:
        while not (fake_program / "waiting").exists():
            time.sleep(0.05)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        reactsim.run(Stop(), options=["slow"], progress=False)
    assert time.monotonic() - start < 20
    assert (fake_program / "interrupted").exists()


def test_missing_program(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("REACTSIM_BINARY", str(tmp_path / "none"))
    with pytest.raises(reactsim.ReactsimError, match="not an executable file"):
        reactsim.run(Stop())
    monkeypatch.delenv("REACTSIM_BINARY")
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(sys, "executable", str(tmp_path / "python"))
    monkeypatch.setattr("sysconfig.get_path", lambda *_: str(tmp_path))
    with pytest.raises(reactsim.ReactsimError, match="was not found"):
        reactsim.scenarios()
    done = executable(tmp_path / "reactsim", "")
    assert reactsim.find_program() == str(done)


@pytest.mark.skipif(sys.platform == "win32", reason="scripts")
def test_other_programs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    done = executable(tmp_path / "done", "")
    broken = executable(tmp_path / "broken", "", "/no/such/interpreter")
    # The process that scores arrays runs already, and is another program's.
    with pytest.raises(reactsim.ReactsimError, match="no scenario could be scored"):
        reactsim.wosac([], [])
    calls: list[Callable[[], object]] = [
        lambda: reactsim.run(Stop(), progress=False),
        lambda: list(reactsim.scenarios()),
        lambda: reactsim.wosac([], []),
    ]
    for path in (done, broken):
        monkeypatch.setenv("REACTSIM_BINARY", str(path))
        for call in calls:
            with pytest.raises(reactsim.ReactsimError, match="check that REACTSIM_BINARY"):
                call()
    with pytest.raises(reactsim.ReactsimError, match=r"broken` cannot be started \(.*No such file"):
        reactsim.run(Stop())


NAMES = ["-q", "--help", "--limit=3", "=x", "a b", 'it\'s "so"', "two\nlines", "--"]


@pytest.mark.parametrize("name", NAMES)
def test_names_are_no_options(fake_program: Path, tmp_path: Path, name: str) -> None:
    given: dict[str, Any] = {"deviations": name, "ids": [name], "categories": name}
    results = reactsim.run(
        Stop(), name, name=name, av=name, replan=name, baselines=name, progress=False, **given
    )
    found = arguments(fake_program)
    assert found[-2:] == ["--", name]
    values = [f"--{option}={name}" for option in ("deviations", "id", "category")]
    values += [f"--{option}={name}" for option in ("av", "replan", "models")]
    assert set(values) < set(found[:-2])
    assert f"--external={name}=@stdio" in found[:-2]

    scenario = next(iter(reactsim.scenarios(name, **given)))
    found = arguments(fake_program)
    assert found[-2:] == ["--", name]
    assert set(values[:3]) < set(found[:-2])

    scenario.id = name
    scenario.svg()
    found = arguments(fake_program)
    assert (found[1], found[-2:]) == (f"--id={name}", ["--", name])
    results.svg(name, name, source=name)
    found = arguments(fake_program)
    assert found[1:4] == [f"--id={name}", f"--rollout={results.folder}", f"--simulator={name}"]
    assert found[-2:] == ["--", name]


def test_program_as_module(fake_program: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "reactsim", "export", "scenes", "missing"],
        capture_output=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr == b"error: missing: no such file\n"


def test_scenarios(fake_program: Path) -> None:
    scenarios = list(reactsim.scenarios())
    assert arguments(fake_program) == ["export", "scenes", "--with-future"]
    assert [s.id for s in scenarios] == ["scenario-0", "scenario-1", "scenario-2"]
    first, second, _ = scenarios
    assert first.agents == ["av", "b", "c", "d"]
    assert first.origin == (100.0, 200.0)
    assert first.states.shape == (4, 91, 5)
    assert first.present.shape == (4, 91)
    assert first.light_future is not None
    assert first.light_future.shape == (1, 80)
    assert first.av is None
    assert second.av is not None
    assert second.av.shape == (80, 5)
    assert len(second.lanes) == 2
    assert repr(first) == "Scenario('scenario-0', 4 agents)"
    assert first.svg(radius=30) == "<svg></svg>"
    assert arguments(fake_program)[:3] == ["inspect", "--id=scenario-0", "--radius=30"]

    source = reactsim.scenarios(Path("logs"), deviations="d", limit=2, future=False)
    scenario = next(iter(source))
    command = ["export", "scenes", "--deviations=d", "--limit=2", "--", "logs"]
    assert arguments(fake_program) == command
    assert scenario.future is None
    with pytest.raises(ValueError, match="future=True"):
        _ = scenario.states


def test_failed_scenes(fake_program: Path) -> None:
    with pytest.raises(reactsim.ReactsimError, match="missing: no such file"):
        list(reactsim.scenarios("missing"))
    with pytest.raises(reactsim.ReactsimError, match="before the message `bye`"):
        list(reactsim.scenarios("truncated"))


def test_pictures(fake_program: Path) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("agg")
    scenario = next(iter(reactsim.scenarios()))
    ax = reactsim.plot_scene(scenario, frame=50)
    assert len(ax.patches) == 4
    states = np.zeros((2, 80, 5))
    rollout = reactsim.Rollout("scenario-0", "idm", 0, ["av", "d"], states, (0.0, 0.0))
    assert rollout.frames == range(11, 91)
    assert len(reactsim.plot_rollout(scenario, rollout).patches) == 2
    assert len(reactsim.plot_rollout(scenario, np.zeros((4, 80, 3)), step=80).patches) == 4
    for step in (0, 81):
        with pytest.raises(ValueError, match="do not fit"):
            reactsim.plot_rollout(scenario, np.zeros((4, 80, 3)), step=step)
    with pytest.raises(ValueError, match="frame 91"):
        reactsim.plot_scene(scenario, frame=91)
