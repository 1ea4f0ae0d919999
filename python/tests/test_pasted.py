"""The commands of the README, the tutorial and the guides run as they are pasted.

They run in a folder that is empty but for stand-ins of the files that they name. Runs and studies
take the first scenarios only, and pages are written instead of served.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Dict, List

import pytest
import reactsim
from fakes import IMPORTED, ROOT

pytestmark = [
    pytest.mark.program,
    pytest.mark.usefixtures("with_program"),
    pytest.mark.skipif(sys.platform == "win32", reason="commands of a POSIX shell"),
]

GUIDES = ROOT / "docs" / "guides"
README, TUTORIAL = ROOT / "README.md", ROOT / "docs" / "tutorial.md"
HERE = [
    README,
    TUTORIAL,
    *(GUIDES / f"{name}.md" for name in ("deviated-avs", "environment", "external-simulators")),
    *(GUIDES / f"{name}.md" for name in ("logs", "planners", "results", "studies")),
]
"""Documents whose commands run here."""

ELSEWHERE = {
    "adapting": "tests/it/trained.rs: minutes of training",
    "clusters": "tests/it/partitions.rs, python/tests/test_ray.py: shared folders and clusters",
    "graphics-processors": "a graphics processor",
    "official-benchmark": "tests/it/import.rs: nuPlan's logs",
    "python": "python/tests/test_guide.py",
    "sim-agents": "tests/it/wosac.rs: Waymo's logs",
    "training": "tests/it/trained.rs: hours of training",
}
"""Guides whose commands need something else, and where that is tested."""

FILES: Dict[Path, Dict[str, Path]] = {
    README: {"mine.py": README, "my_planner.py": GUIDES / "planners.md"},
    TUTORIAL: {"mine.py": README},
    GUIDES / "external-simulators.md": {"mine.py": GUIDES / "external-simulators.md"},
    GUIDES / "planners.md": {"straight.py": GUIDES / "planners.md"},
}
"""Names under which a document says to save the first example in Python of a document."""

OUT_OF_REACH = re.compile(
    r"nuplan|av2/|womd/|_20s|docker|ssh |srun |diffusion|planned\.parquet|decisions|--count \d{3}"
    r"|verify(?! --quick)|leaderboard|reference |references/|runs/(before|deviated|x)|histories"
    r"|avs\.json|rollouts\.(json|parquet) --scenarios|score rollouts"
)
"""Commands that need recordings, machines or results that are not there, or too much time."""


MOST = 5
"""Number of logs, and of scenarios of the benchmark in a run."""


def commands(text: str) -> List[str]:
    """Returns the commands `reactsim` of a document, as pasted."""
    blocks = re.findall(r"```sh\n(.*?)```", text, re.DOTALL)
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    return [line for line in lines if line.split(" ")[0] == "reactsim"]


def shortened(command: str) -> str:
    """Returns the command on a few scenarios, or one that writes the page that it serves."""
    command = command.partition("  #")[0].rstrip()
    if command == "reactsim":
        command = "reactsim run"
    if command.startswith("reactsim view "):
        return f"reactsim report {command[len('reactsim view ') :]} --format html --out view.html"
    if re.match(r"reactsim (run|study) ", f"{command} ") and "--limit" not in command:
        is_on_benchmark = re.match(r"reactsim study \w* ?--", command)
        command += " --limit 1" if is_on_benchmark else f" --limit {MOST}"
    return command.replace("--limit 20", f"--limit {MOST}")


def examples(text: str) -> List[str]:
    return re.findall(r"```python\n(.*?)```", text, re.DOTALL)


@pytest.fixture(scope="module")
def logs(program: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files that documents name."""
    folder = tmp_path_factory.mktemp("logs")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("REACTSIM_BINARY", program)
        out, mini = folder / "training.tfrecord", ROOT / "scenarios" / "mini"
        reactsim.command("generate", preset="train", count=MOST, seed=1, out=out, progress=False)
        reactsim.command("convert", mini, out=folder / "scenarios.parquet", progress=False)
    (folder / "logs").mkdir()
    shutil.copy(out, folder / "logs" / "a.parquet")
    return folder


def test_every_document_is_run_somewhere() -> None:
    guides = {path.stem for path in GUIDES.glob("*.md")}
    here = {path.stem for path in HERE if path.parent == GUIDES}
    assert here | set(ELSEWHERE) == guides and not here & set(ELSEWHERE)
    for place in ELSEWHERE.values():
        for path in re.findall(r"[\w/]+\.(?:rs|py)", place):
            assert (ROOT / path).is_file(), path


@pytest.mark.parametrize("path", HERE, ids=lambda path: path.stem)
def test_commands_run_as_pasted(path: Path, program: str, logs: Path, tmp_path: Path) -> None:
    text = path.read_text("utf-8")
    home, programs = tmp_path / "home", tmp_path / "programs"
    shutil.copytree(logs, home)
    programs.mkdir()
    (programs / "reactsim").symlink_to(program)
    (programs / "python").write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')
    (programs / "python").chmod(0o755)
    environment = {
        **os.environ,
        "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(IMPORTED),
        "REACTSIM_BINARY": program,
    }

    def run(line: str) -> None:
        ended = subprocess.run(
            ["bash", "-c", line],
            cwd=home,
            env=environment,
            check=False,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=300,
        )
        assert ended.returncode == 0, f"{line}\n{ended.stdout.decode()[-2000:]}"

    for name, source in FILES.get(path, {}).items():
        (home / name).write_text(examples(source.read_text("utf-8"))[0])
    if path.stem == "environment":
        pytest.importorskip("gymnasium")
        pytest.importorskip("pettingzoo")
        (home / "guide.py").write_text("\n".join(examples(text)))
        run("python guide.py")
        return
    lines = [shortened(line) for line in commands(text) if not OUT_OF_REACH.search(line)]
    assert len(lines) >= 2
    scenario = next(iter(reactsim.scenarios(home / "scenarios.parquet"))).id
    log = next(iter(reactsim.scenarios(home / "training.tfrecord"))).id
    if path.stem == "studies":
        # What other guides have made.
        options = "--av brake:4 --models log-replay,idm --keep-rollouts --out runs/brake"
        run(f"reactsim run training.tfrecord {options}")
        run("reactsim curate training.tfrecord --out deviations.parquet")
    for line in lines:
        run(line.replace("--id ID", f"--id {log if 'training' in line else scenario}"))
