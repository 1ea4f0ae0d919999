"""Simulators as child processes, driven over their standard streams."""

from __future__ import annotations

import os
import re
import shutil
import signal
import sys
from pathlib import Path
from typing import Callable, Iterator, Tuple

import numpy as np
import pytest
from fakes import EXAMPLES, IMPORTED, Child, make_scenes, roll_out

STOP = (EXAMPLES / "stop.py").read_text()
Positions = Iterator[Tuple[float, float]]

NOISY = """
import os
import subprocess
import sys
import reactsim
print("print at import")
os.write(1, b"raw write at import\\n")

class Noisy(reactsim.Simulator):
    name = "noisy"

    def begin(self, scenes):
        print("print in begin")
        sys.stdout.write("without line end")

    def plan(self, seen):
        os.write(1, b"raw write in plan\\n")
        subprocess.run([sys.executable, "-c", "print('grandchild', input.__name__)"], check=True)
        assert sys.stdin.read() == ""
        if seen.frame == 20:
            raise RuntimeError("broken at frame 20")
        import numpy as np
        return np.repeat(seen.states[:, :, -1:, :3], seen.steps, axis=2)

if __name__ == "__main__":
    print("print before serve")
    reactsim.serve(Noisy())
"""


def constant_velocity(x: float, y: float, vx: float, vy: float, steps: int) -> Positions:
    for k in range(steps):
        time = 0.1 * float(k + 1)
        yield x + vx * time, y + vy * time


def stop(x: float, y: float, vx: float, vy: float, steps: int) -> Positions:
    for _ in range(steps):
        speed = (vx * vx + vy * vy) ** 0.5
        slower = max(speed - 3.4 * 0.1, 0.0)
        if speed > 0.0:
            vx, vy = vx * (slower / speed), vy * (slower / speed)
        x, y = x + vx * 0.1, y + vy * 0.1
        yield x, y


@pytest.mark.parametrize("reference", [constant_velocity, stop])
@pytest.mark.parametrize("steps", [1, 5, 40])
def test_examples(reference: Callable[..., Positions], steps: int) -> None:
    """Examples compute like the baselines of the program, one agent after the other."""

    def planned(states: np.ndarray, steps: int) -> np.ndarray:
        plan = np.zeros((*states.shape[:2], steps, 3))
        for place in np.ndindex(states.shape[:2]):
            x, y, plan[(*place, slice(None), 2)], vx, vy = states[place].tolist()
            if not (np.isfinite(vx) and np.isfinite(vy)):
                vx = vy = 0.0
            plan[(*place, slice(None), slice(2))] = list(reference(x, y, vx, vy, steps))
        return plan

    with Child(str(EXAMPLES / f"{reference.__name__}.py")) as child:
        assert child.hello()["type"] == "welcome"
        for seed in range(2):
            tensors = make_scenes(seed=seed)
            plans = roll_out(child, tensors, steps)
            states = child.states
            # The states that the simulator saw at each plan, and its answer, to the last bit.
            for k, plan in enumerate(plans):
                seen = states[:, :, 10 + k * steps]
                expected = planned(seen, plan.shape[2])
                used = np.arange(seen.shape[1]) < tensors["n_agents"][:, None]
                assert plan[used].tobytes() == expected[used].tobytes()
        child.bye()
        assert child.wait() == (0, "")


def test_end_of_input() -> None:
    with Child(str(EXAMPLES / "stop.py")) as child:
        child.hello()
        assert child.wait() == (0, "")


@pytest.mark.parametrize("how", ["variable", "serve", "module", "file"])
def test_prints_do_not_break_the_protocol(how: str, tmp_path: Path) -> None:
    # Without the variable, only what is written before `serve` and is not buffered can get through.
    text = NOISY
    if how == "serve":
        text = text.replace('os.write(1, b"raw write at import\\n")', "")
        assert "raw write at import" not in text
    (tmp_path / "noisy.py").write_text(text)
    env = {"PYTHONPATH": os.pathsep.join([str(IMPORTED), str(tmp_path)]), "PYTHONUNBUFFERED": ""}
    if how == "variable":
        env["REACTSIM_EXTERNAL"] = "1"
    command = {
        "module": ["-m", "reactsim.serve", "noisy:Noisy"],
        "file": ["-m", "reactsim.serve", str(tmp_path / "noisy.py") + ":Noisy"],
    }.get(how, [str(tmp_path / "noisy.py")])
    with Child(*command, env=env) as child:
        assert child.hello()["name"] == "noisy"
        assert child.begin(make_scenes())[0]["type"] == "begun"
        assert child.plan(5)[0]["type"] == "planned"
        assert child.plan(5)[0]["type"] == "planned"
        metadata, _ = child.plan(5)
        assert metadata["type"] == "failed"
        assert "RuntimeError: broken at frame 20" in metadata["error"]
        assert child.end()[0]["type"] == "ended"
        # The process goes on.
        assert child.begin(make_scenes())[0]["type"] == "begun"
        assert child.plan(5)[0]["type"] == "planned"
        child.bye()
        code, errors = child.wait()
    assert code == 0
    for part in (
        "print at import",
        "print in begin\n",
        "without line end",
        "raw write in plan",
        "grandchild",
    ):
        assert part in errors


def check_stop(folder: Path, script: str, **env: str) -> None:
    """Asserts that a script serves the simulator of the example."""
    (folder / "mine.py").write_text(script)
    with Child(str(folder / "mine.py"), env=env) as child:
        assert child.hello()["name"] == "stop-py"
        roll_out(child, make_scenes())
        child.bye()
        assert child.wait() == (0, "")


def test_a_script_that_runs_its_simulator_serves_it_too(tmp_path: Path) -> None:
    runs = r"print(reactsim.run(\1, limit=1).table())"
    text = re.sub(r"reactsim\.serve\((\w+\(\))\)", runs, STOP)
    check_stop(tmp_path, text + '    print("after")\n', REACTSIM_EXTERNAL="1")


def test_copied_client(tmp_path: Path) -> None:
    """The client works as a single file in another repository."""
    shutil.copy(IMPORTED / "reactsim" / "client.py", tmp_path)
    text = STOP.replace("import reactsim", "import client as reactsim")
    check_stop(tmp_path, text, PYTHONPATH=str(tmp_path))


def test_two_copies_of_the_client(tmp_path: Path) -> None:
    """A copy of the client that did not claim the streams uses those of the copy that did."""
    shutil.copy(IMPORTED / "reactsim" / "client.py", tmp_path)
    check_stop(tmp_path, "import client\n" + STOP, REACTSIM_EXTERNAL="1")


def test_broken_frames() -> None:
    with Child(str(EXAMPLES / "stop.py")) as child:
        child.writer.write(b"\x08" + bytes(7) + b"not safe")
        code, errors = child.wait()
        assert code == 1
        assert errors.startswith("reactsim: safetensors:")


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_interrupt() -> None:
    with Child(str(EXAMPLES / "stop.py")) as child:
        child.hello()
        child.process.send_signal(signal.SIGINT)
        # Closing standard input would end it too, with another code.
        child.process.wait(timeout=30)
        code, errors = child.wait()
        assert code == 130
        assert "Traceback" not in errors


@pytest.mark.parametrize(
    ("target", "message"),
    [
        ("noisy", "write MODULE:NAME"),
        ("stop:Missing", "has no `Missing`"),
        ("not_there:Stop", "No module named 'not_there'"),
    ],
)
def test_wrong_targets(target: str, message: str) -> None:
    env = {"PYTHONPATH": os.pathsep.join([str(IMPORTED), str(EXAMPLES)])}
    with Child("-m", "reactsim.serve", target, env=env) as child:
        code, errors = child.wait()
        assert code == 1
        assert message in errors


def test_serve_is_a_function_and_a_module() -> None:
    code = "import reactsim.serve, sys; reactsim.serve(type('A', (), {'plan': lambda s, o: None}))"
    with Child("-c", code) as child:
        assert child.hello()["name"] == "A"
        assert child.wait() == (0, "")


def test_import_needs_only_numpy() -> None:
    optional = "{'pandas', 'pyarrow', 'matplotlib'}"
    code = f"import reactsim, sys; assert not {optional} & set(sys.modules)"
    with Child("-c", code) as child:
        assert child.wait() == (0, "")
