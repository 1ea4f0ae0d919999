"""Typed functions have every option of their command, or the reason why not is named here."""

from __future__ import annotations

import inspect
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

# Options of `run` that callers give in `options`.
OF_RUN = [
    *("--external=a=b", "--planner=a=b", "--external-workers=2", "--external-batch=2"),
    *("--external-start-limit=9s", "--external-first-limit=9s", "--external-limit=9s"),
    *("--allow=jumps", "--pose=centre", "--metric-option=a=b", "--backend=flex", "--batch=2"),
    *("--model-weights=a=b", "--set=a=b", "--smooth=qp", "--av-lookahead=0", "--check-batch=1"),
    "--entering=log",
]


def sample(parameter: inspect.Parameter) -> Any:
    """Returns a value of an argument that is unlike its default."""
    if isinstance(parameter.default, bool):
        return not parameter.default
    samples = {"Mapping": {"a": 1.0}, "Sequence": ["a"], "int": 1, "float": 1.0}
    return next((samples[kind] for kind in samples if kind in parameter.annotation), "a")


def full(function: Callable[..., Any], *given: Any, **special: Any) -> Callable[[], Any]:
    """Returns a call with every keyword argument."""
    parameters = inspect.signature(function).parameters.values()
    options = {p.name: sample(p) for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY}
    return lambda: function(*given, **{**options, **special})


def calls(folder: Path) -> Dict[str, List[Callable[[], Any]]]:
    """Returns calls of the functions by command, which together have every argument."""
    file = folder / "candidates"
    file.touch()
    return {
        "compare": [
            full(reactsim.compare, "a", "b"),
            lambda: Comparisons([], [], [], ["a", "b"]).table(top=1),
        ],
        "run": [full(reactsim.run, Stop(), planner=None, metrics=(), options=OF_RUN)],
        "score": [
            full(reactsim.score, ["r"], "s"),
            full(score_run, "a", "s"),
            lambda: add_document("a", {"metrics": [], "rollouts": []}),
        ],
        "curate": [full(reactsim.curate, "s", "o")],
        "curate stats": [Candidates(file).stats],
        "export scenes": [lambda: list(full(reactsim.scenarios, "s", future="15s")())],
        "train adapt": [full(reactsim.train_adapt, "l", "o")],
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
