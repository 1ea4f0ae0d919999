"""Typed functions have every option of their command, or the reason why not is named here."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any, Callable, Dict, List, Set

import pytest
import reactsim
from fakes import executable
from reactsim.comparison import Comparisons
from reactsim.curation import Candidates
from reactsim.metric import add_document
from reactsim.wosac import score_run
from stop import Stop

pytestmark = [
    pytest.mark.program,
    pytest.mark.skipif(sys.platform == "win32", reason="the recorder is a script"),
]

ANYWHERE = {
    "--filter": "a selection of nuPlan frames contains it",
    "--maps": "a selection of nuPlan frames contains it",
    "--nuplan": "a selection of nuPlan frames contains it",
    "--help": "docstrings replace it",
    "--partition": "`reactsim.ray.run_partitions` gives it",
    "--version": "`Results.provenance` has the version",
    "--quiet": "`progress=False`",
    "--verbose": "lines for terminals; their numbers are in `Results.rows`",
}
OF_TABLES = ("--by", "--columns", "--also", "--bold", "--caption", "--label")
TABLES = dict.fromkeys(OF_TABLES, "`report` makes the tables of a run folder")
LEFT_OUT_OPTIONS: Dict[str, Dict[str, str]] = {
    "run": {
        **TABLES,
        "--format": "`report` makes tables in all formats",
        "--print-spec": "`Results.spec` has it",
    },
    "score": TABLES,
}

READING: Dict[str, Any] = {
    "current_frame": 20,
    "window_step": 10,
    "history": 21,
    "future": "15s",
    "all_agents": True,
}
SELECTION: Dict[str, Any] = {"limit": 1, "ids": ["a"], "categories": ["lateral"], **READING}

# Options of `run` that callers give in `options`.
OF_RUN = [
    *("--external=a=b", "--planner=a=b", "--external-workers=2", "--external-batch=2"),
    *("--external-start-limit=9s", "--external-first-limit=9s", "--external-limit=9s"),
    *("--allow=jumps", "--pose=centre", "--metric-option=a=b", "--backend=flex", "--batch=2"),
    *("--model-weights=a=b", "--set=a=b", "--smooth=qp", "--av-lookahead=0", "--check-batch=1"),
    "--entering=log",
]


def calls(folder: Path) -> Dict[str, List[Callable[[], Any]]]:
    """Returns calls of the functions by command, which together have every argument."""
    file = folder / "candidates"
    file.touch()
    return {
        "compare": [
            lambda: reactsim.compare(
                "a", "b", models=["x", "y"], despite="av", worse={"ade": 1.0}, seed=1
            ),
            lambda: Comparisons([], [], [], ["a", "b"]).table(top=1),
        ],
        "run": [
            lambda: reactsim.run(
                Stop(),
                av="log",
                protocol="realism",
                replan="1hz",
                rollouts=2,
                seed=1,
                baselines=["idm"],
                deviations="d",
                jobs=1,
                out="out",
                resume=True,
                reveal_ids=True,
                progress=False,
                options=OF_RUN,
                **SELECTION,
            )
        ],
        "score": [
            lambda: reactsim.score(
                ["r"],
                "s",
                out="o",
                deviations="d",
                allow="jumps",
                pose="centre",
                metric_options={"a": "b"},
                jobs=1,
                progress=False,
                **READING,
            ),
            lambda: score_run("a", "s", simulator="idm", partial=True, jobs=1),
            lambda: add_document("a", {"metrics": [], "rollouts": []}),
        ],
        "curate": [
            lambda: reactsim.curate(
                "s",
                "o",
                temperature=1.0,
                candidates=2,
                limit=1,
                jobs=1,
                scenes=False,
                min_vehicles=1,
                radius=9.0,
                max_ttc=1.0,
                min_ade=1.0,
                drivable_tolerance=1.0,
                comfort=True,
                progress=False,
                **READING,
            )
        ],
        "curate stats": [Candidates(file).stats],
        "export scenes": [lambda: list(reactsim.scenarios("s", deviations="d", **SELECTION))],
        "train adapt": [
            lambda: reactsim.train_adapt(
                "l",
                "o",
                reward="realism",
                exclude="x",
                resume=True,
                jobs=1,
                progress=False,
                **READING,
            )
        ],
    }


@pytest.fixture(scope="module")
def command_line(program: str) -> Dict[str, Set[str]]:
    """Options by command, from the completion script of the program."""
    script = subprocess.run(
        [program, "completions", "bash"], capture_output=True, text=True, check=True
    ).stdout
    names = dict(re.findall(r'(reactsim(?:__\w+)?)\)\n\s+opts="([^"]*)"', script))
    labels = _labels(script)
    commands = {}
    for key, words in names.items():
        label = labels.get(key)
        if label is not None:
            options = {word for word in words.split() if word.startswith("--")}
            commands[label] = options - {"--"}
    return commands


def _labels(script: str) -> Dict[str, str]:
    """Returns names of commands, such as `train open-loop`, by those of the script."""
    steps = re.findall(r"(reactsim(?:__\w+)?),(\S+)\)\n\s+cmd=\"(\w+)\"", script)
    labels = {"reactsim": ""}
    for _ in range(3):
        for parent, word, key in steps:
            if parent in labels and word != "help":
                labels[key] = f"{labels[parent]} {word}".strip()
    return labels


@pytest.fixture
def recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Any], List[str]]:
    """Calls a function with a program that notes its arguments and fails."""
    notes = tmp_path / "notes"
    path = executable(tmp_path / "reactsim", f"printf '%s\\0' \"$@\" >'{notes}'\nexit 3")
    monkeypatch.setenv("REACTSIM_BINARY", str(path))

    def call(function: Callable[[], Any]) -> List[str]:
        notes.write_text("")
        with pytest.raises(reactsim.ReactsimError):
            function()
        return notes.read_text().split("\0")[:-1]

    return call


def problems(
    command_line: Dict[str, Set[str]], recorded: Callable[[Any], List[str]], folder: Path
) -> List[str]:
    """Returns options that functions lack, and options that their commands lack."""
    found = []
    functions = calls(folder)
    for name in sorted({*functions, *LEFT_OUT_OPTIONS} - set(command_line)):
        found.append(f"there is no command `{name}`")
    for name, several in functions.items():
        given: Set[str] = set()
        for function in several:
            words = recorded(function)
            length = len(name.split())
            if words[:length] != name.split():
                found.append(f"`{name}` is not called, but {words}")
            options = words[length : words.index("--")] if "--" in words else words[length:]
            found += [f"{word!r} is no option" for word in options if not word.startswith("--")]
            given |= {word.split("=")[0] for word in options if word.startswith("--")}
        known = command_line.get(name, set())
        left_out = set(LEFT_OUT_OPTIONS.get(name, {}))
        for option in sorted(known - given - left_out - set(ANYWHERE)):
            found.append(f"no function gives {option} to `{name}`")
        for option in sorted(given - known):
            found.append(f"`{name}` has no {option}")
        for option in sorted(left_out - (known - given)):
            found.append(f"{option} of `{name}` is not left out")
    return found


def test_functions_have_the_options(
    command_line: Dict[str, Set[str]], recorded: Callable[[Any], List[str]], tmp_path: Path
) -> None:
    assert len(command_line) > 40
    assert problems(command_line, recorded, tmp_path) == []


def test_what_is_missing_is_found(
    command_line: Dict[str, Set[str]], recorded: Callable[[Any], List[str]], tmp_path: Path
) -> None:
    changed = {name: set(options) for name, options in command_line.items()}
    changed["score"] |= {"--slowly"}
    changed["curate"] -= {"--comfort"}
    del changed["train adapt"]
    assert [
        text for text in problems(changed, recorded, tmp_path) if "`train adapt` has" not in text
    ] == [
        "there is no command `train adapt`",
        "no function gives --slowly to `score`",
        "`curate` has no --comfort",
    ]
