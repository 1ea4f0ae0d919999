"""The commands of the README, the tutorial and the guides run as they are pasted.

They run in a folder that is empty but for stand-ins of the files that they name. `SMALLER` says
what is replaced so that they take moments, and `ELSEWHERE` which commands do not run here and why.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, Dict, List

import pytest
import reactsim
from fakes import IMPORTED, MINI, ROOT, executable

pytestmark = [
    pytest.mark.program,
    pytest.mark.usefixtures("with_program"),
    pytest.mark.skipif(sys.platform == "win32", reason="commands of a POSIX shell"),
]

GUIDES = ROOT / "docs" / "guides"
DOCUMENTS = [ROOT / "README.md", ROOT / "docs" / "tutorial.md", *sorted(GUIDES.glob("*.md"))]

ELSEWHERE = {
    r"(git|pip|cargo|export) ": ".ci/run: builds and installs",
    r"reactsim .*\b(nuplan|val14|official)": "tests/it/import.rs: nuPlan's logs, or its devkit",
    r"reactsim .*(docker|ssh|srun) |docker ": "python/tests/test_process.py: other machines",
    r"job=\$\(sbatch |sbatch ": "python/tests/test_ray.py: Slurm",
    r"reactsim run (gs|s3)://|aws |gcloud |hf ": "crates/files/src/cloud.rs: object stores",
    r"reactsim score submission|reactsim export wosac": "tests/it/wosac.rs: recordings of Waymo",
    r"reactsim train quick|reactsim verify($| ref)": "tests/it/trained.rs, .ci/run: minutes",
    r"reactsim reference make": "tests/it/reference.rs: a program of committed sources",
}
"""Commands that need something else, and where that is tested."""

SMALLER = {
    # Numbers.
    r"--limit (20|64)": "--limit 5",
    r"--count \d+": "--count 2",
    r"--minutes 10": "--minutes 0.05",
    r"(--partitions |partitions=)64": r"\g<1>2",
    r"--set learning.epochs=\d+": "",
    r"^(reactsim train (?!adapt|intentions|open-loop|split|vocabulary)(?!.*--print-).*)": (
        r"\1 --set learning.epochs=0.03 --set learning.batch=1 --set learning.held_out=0.05"
        " --set learning.most_held_out=1"
    ),
    r"^(reactsim study (?=planners|\w* ?--).*)": r"\1 --limit 1",
    r"^(reactsim (run|study)\b(?!.*(--limit|entries/)).*)": r"\1 --limit 5",
    # Files and machines.
    r"/shared/": "shared/",
    r"(womd|av2)/\w+|(?<=adapt )logs/": "training.tfrecord",
    r" README.md docs/\*.md": " README.md",
    r"--backend cuda": "--backend flex",
    r"(--method trajtok)": r"\1 --fill",  # motions that few logs lack
    # A page is written instead of served.
    r"^reactsim view (.*)": r"reactsim report \1 --format html --out view.html",
    r"^reactsim$": "reactsim run --limit 5",
}
"""What is replaced in commands, in this order."""

FILES: Dict[str, Dict[str, str]] = {
    "README": {"mine.py": "README.md", "my_planner.py": "docs/guides/planners.md"},
    "tutorial": {"mine.py": "README.md"},
    "external-simulators": {"mine.py": "docs/guides/external-simulators.md"},
    "planners": {"straight.py": "docs/guides/planners.md"},
}
"""Names under which a document says to save the first example in Python of a document."""

BEFORE = {
    "clusters": ["mkdir -p shared/scenarios", "cp scenarios.parquet shared/scenarios/"],
    "deviated-avs": ["reactsim curate training.tfrecord --out planned.parquet"],
    "graphics-processors": ["cp training.tfrecord logs.parquet"],
    "results": [
        f"ln -s {ROOT}/references references",
        f"cp {ROOT}/README.md README.md",
        *(f"reactsim run --limit 5 --models idm --out runs/{name}" for name in ("before", "after")),
        "reactsim run --limit 5 --models idm --out runs/deviated",
        "reactsim run --limit 5 --models idm --av brake:2 --out runs/braking",
        "reactsim run scenarios.parquet --models idm --keep-rollouts --out runs/x",
        "cp runs/x/rollouts.parquet rollouts.parquet",
    ],
    "studies": [
        "reactsim run training.tfrecord --av brake:4 --models log-replay,idm --keep-rollouts"
        " --out runs/brake",
        "reactsim curate training.tfrecord --out deviations.parquet",
    ],
    "training": [
        "mkdir quick",
        "cp training.tfrecord quick/logs.parquet",
        "cp training.tfrecord quick/reactions.parquet",
        "reactsim train ntp-reactive quick/logs.parquet --recipe quick --out quick/training"
        " --set learning.epochs=0.1",
    ],
}
"""Commands that make what a document expects of its reader or of other documents."""

ROLLOUTS = {
    "format": "reactsim-rollouts-v1",
    "dt": 0.1,
    "scenarios": [
        {
            "id": "a",
            "current_index": 1,
            "num_future": 2,
            "av_index": 0,
            "agents": [
                {
                    "id": id,
                    "type": "vehicle",
                    "length": 4.8,
                    "width": 2.0,
                    "x": [x, x + 1, x + 2, x + 3],
                    "y": [0, 0, 0, 0],
                    "heading": [0, 0, 0, 0],
                    "valid": [True, True, True, True],
                }
                for id, x in (("av", 0), ("ahead", 20))
            ],
        }
    ],
}
"""The document `rollouts.json` of another program."""


def commands(text: str) -> List[str]:
    """Returns the commands of a document, as pasted."""
    blocks = re.findall(r"```sh\n(.*?)```", text, re.DOTALL)
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    return [line.partition("  #")[0].rstrip() for line in lines if line and line[0] != "#"]


def runs_elsewhere(command: str) -> bool:
    return any(re.match(pattern, command) for pattern in ELSEWHERE)


def smaller(text: str) -> str:
    """Returns commands or an example on small inputs."""
    for pattern, replacement in SMALLER.items():
        text = re.sub(pattern, replacement, text)
    return text


def examples(path: Path) -> List[str]:
    return re.findall(r"```python\n(.*?)```", path.read_text("utf-8"), re.DOTALL)


@pytest.fixture(scope="module")
def logs(with_program: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files that documents name."""
    folder = tmp_path_factory.mktemp("logs")

    def generate(path: Path, **options: Any) -> None:
        options = {"preset": "train", "seed": 1, "progress": False, "out": path, **options}
        reactsim.command("generate", **options)

    (folder / "logs").mkdir()
    generate(folder / "training.tfrecord", count=5)
    generate(folder / "training_20s.tfrecord", count=2, history=21, future="20s")
    # So many that there are cyclists.
    generate(folder / "logs" / "a.parquet", count=60)
    reactsim.command("convert", MINI, out=folder / "scenarios.parquet", progress=False)
    (folder / "rollouts.json").write_text(json.dumps(ROLLOUTS), "utf-8")
    (folder / "deviations.parquet.decisions.jsonl").touch()
    return folder


def test_what_does_not_run_here_is_in_documents_and_tested() -> None:
    all_commands = [line for path in DOCUMENTS for line in commands(path.read_text("utf-8"))]
    for pattern, place in ELSEWHERE.items():
        assert any(re.match(pattern, line) for line in all_commands), pattern
        for path in re.findall(r"[\w./]+/[\w.]+", place):
            assert (ROOT / path).is_file(), path
    assert sum(not runs_elsewhere(line) for line in all_commands) > 100


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.stem)
def test_commands_run_as_pasted(path: Path, program: str, logs: Path, tmp_path: Path) -> None:
    home, programs = tmp_path / "home", tmp_path / "programs"
    shutil.copytree(logs, home)
    programs.mkdir()
    (programs / "reactsim").symlink_to(program)
    executable(programs / "python", f'exec "{sys.executable}" "$@"')
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

    for name, source in FILES.get(path.stem, {}).items():
        (home / name).write_text(examples(ROOT / source)[0])
    scenario = next(iter(reactsim.scenarios(home / "scenarios.parquet"))).id
    log = next(iter(reactsim.scenarios(home / "training.tfrecord"))).id
    for line in BEFORE.get(path.stem, []):
        run(line)
    for line in commands(path.read_text("utf-8")):
        if not runs_elsewhere(line):
            id = log if "training" in line else scenario
            run(smaller(line).replace("--id ID", f"--id {id}"))
    if path.stem in ("clusters", "environment"):
        if path.stem == "environment":
            pytest.importorskip("gymnasium")
            pytest.importorskip("pettingzoo")
        else:
            shutil.rmtree(home / "shared" / "runs")
            shutil.rmtree(home / "shared" / "parts")
        (home / "guide.py").write_text(smaller("\n".join(examples(path))))
        run("python guide.py")
