"""Python has every command and option of the command line, or names the reason why not."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any, Callable, Dict, List, Set

import pytest
import reactsim
from fakes import ROOT
from reactsim import training
from reactsim.comparison import Comparisons
from reactsim.curation import Candidates
from reactsim.ray import plan_units
from reactsim.wosac import score_run
from stop import Stop

pytestmark = [
    pytest.mark.program,
    pytest.mark.skipif(sys.platform == "win32", reason="the recorder is a script"),
]

GUIDE = ROOT / "docs" / "guides" / "python.md"

# What Python does not have, with the reason. The guide lists the commands.
LEFT_OUT_COMMANDS = {
    "completions": "is for shells",
    "export reactsim-bench": "is done once, for the official evaluation",
    "import reactsim-bench": "is done once; its files are inputs of `run`",
    "man": "is for shells",
    "reference tables": "edits the documents of the repository of the program",
    "session": "is what `reactsim.Env` and `reactsim.score_states` start",
    "shard merge": "is `reactsim.ray.merge_units`",
    "shard run": "is `reactsim.ray.run_units`",
    "shard status": "is printed by `python -m reactsim.ray`",
}
ANYWHERE = {
    "--filter": "a selection of nuPlan frames contains it",
    "--maps": "a selection of nuPlan frames contains it",
    "--nuplan": "a selection of nuPlan frames contains it",
    "--help": "docstrings replace it",
    "--version": "`Results.provenance` has the version",
    "--quiet": "`progress=False`",
    "--verbose": "lines for terminals; their numbers are in `Results.rows`",
}
OF_TABLES = ("--by", "--columns", "--also", "--bold", "--caption", "--label")
TABLES = dict.fromkeys(OF_TABLES, "`reactsim.report` makes the tables of a run folder")
OF_STUDIES = {option: reason for option, reason in TABLES.items() if option != "--by"}
FORMAT = {"--format": "`reactsim.report` makes tables in all formats"}
STUDIES = ("replan", "realism", "guards", "vocabulary", "planners", "errors")
LEFT_OUT_OPTIONS: Dict[str, Dict[str, str]] = {
    "run": {**TABLES, **FORMAT},
    "score": TABLES,
    "verify": {"--run": "compares a run with the paper's row; the table is for reading"},
    **{f"study {kind}": {**OF_STUDIES, **FORMAT} for kind in STUDIES},
}

READING: Dict[str, Any] = {"current_frame": 20, "window_step": 10, "all_agents": True}
SELECTION: Dict[str, Any] = {"limit": 1, "ids": ["a"], "categories": ["lateral"], **READING}

# Options of `run` and `study` that callers give in `options`.
EXTERNAL = [
    *("--external=a=b", "--planner=a=b", "--external-workers=2", "--external-batch=2"),
    *("--external-start-limit=9s", "--external-first-limit=9s", "--external-limit=9s"),
    *("--allow=jumps", "--pose=centre", "--metric-option=a=b", "--backend=flex", "--batch=2"),
]
OF_RUN = [
    *("--model-weights=a=b", "--set=a=b", "--smooth=qp", "--av-lookahead=0", "--check-batch=1"),
]


def run() -> List[Callable[[], Any]]:
    common: Dict[str, Any] = {
        **SELECTION,
        "protocol": "realism",
        "replan": "1hz",
        "rollouts": 2,
        "seed": 1,
        "baselines": ["idm"],
        "deviations": "d",
        "jobs": 1,
        "out": "out",
        "resume": True,
        "reveal_ids": True,
        "progress": False,
        "options": [*EXTERNAL, *OF_RUN],
    }
    return [lambda: reactsim.run(Stop(), av="log", **common)]


def study(kind: str, **parts: Any) -> List[Callable[[], Any]]:
    def call() -> Any:
        return reactsim.study(
            kind,
            "logs",
            out="out",
            models=["idm"],
            weights={"a": "b"},
            parameters={"a.b": 1},
            av="log",
            deviations="d",
            keep_rollouts=True,
            jobs=1,
            resume=True,
            progress=False,
            options=[*EXTERNAL, "--reveal-ids"],
            **SELECTION,
            **parts,
        )

    return [call]


def candidates(path: Path) -> Candidates:
    path.touch()
    return Candidates(path)


def calls(folder: Path) -> Dict[str, List[Callable[[], Any]]]:
    """Returns calls of the functions by command, which together have every argument."""
    picture: Dict[str, Any] = {
        "id": "a",
        "category": "lateral",
        "case": "cut-in",
        "rollout": "run",
        "index": 1,
        "radius": 9.0,
        **READING,
    }
    page: Dict[str, Any] = {"scenarios": "s", "cases": 1, "case": ["a"], "all_scenes": True}
    table: Dict[str, Any] = {
        "by": "category",
        "columns": "ade",
        "also": ["ade"],
        "bold": True,
        "caption": "a",
        "label": "b",
    }
    lists = ["models", "metrics", "metric-options", "formats", "weights", "maps", "cases"]
    lists += ["tasks", "backends"]
    file = folder / "candidates"
    return {
        **{f"list {name}": [lambda name=name: reactsim.catalog(name)] for name in lists},  # type: ignore[misc]
        "list parameters": [lambda: reactsim.catalog("parameters", "idm")],
        "list scenarios": [lambda: reactsim.list_scenarios("s", deviations="d", **SELECTION)],
        "inspect": [
            lambda: reactsim.inspect("s", id="a", category="b", case="c", **READING),
            lambda: reactsim.draw("s", simulator="idm", steps=[0, 8], **picture),
            lambda: reactsim.animate(
                "s", simulators=["a", "b"], size=200, every=2, follow=True, **picture
            ),
        ],
        "view": [lambda: reactsim.view("a", scenarios="s", port=1, open_browser=True)],
        "report": [
            lambda: reactsim.report("a", format="html", out="o", **page),
            lambda: reactsim.report(["a", "b"], format="latex", **table),
        ],
        "compare": [
            lambda: reactsim.compare(
                "a", "b", models=["x", "y"], despite="av", worse={"ade": 1.0}, seed=1
            ),
            lambda: Comparisons([], [], [], ["a", "b"]).table(top=1),
        ],
        "run": run(),
        "study replan": study("replan", intervals=[1, 5], protocol="realism", rollouts=2),
        "study realism": study("realism", replan="1hz", rollouts=2, reactive_rollouts=1),
        "study guards": study("guards", replan="1hz", rollouts=2),
        "study vocabulary": study("vocabulary", vocabularies={"a": "b"}),
        "study planners": study(
            "planners",
            planners=["idm"],
            tracker="lqr",
            plan_every="2steps",
            replan="1hz",
            rollouts=2,
        ),
        "study errors": study("errors", replan="1hz", rollouts=2),
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
            ),
            lambda: reactsim.score_document("d", metric_options={"a": "b"}),
            lambda: score_run("a", "s", simulator="idm", partial=True, jobs=1),
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
        "curate stats": [candidates(file).stats],
        "curate review": [lambda: candidates(file).review("o", first=1, limit=1)],
        "curate apply": [lambda: candidates(file).apply(["b"], "o", allow_rejected=True)],
        "generate": [
            lambda: reactsim.generate("o", count=1, maps=["a"], density=1.0, jobs=1, progress=False)
        ],
        "convert": [
            lambda: reactsim.convert(
                "s",
                "o",
                ids="a",
                categories="b",
                futures="f",
                certificates="c",
                history_only=True,
                model="idm",
                progress=False,
                **READING,
            )
        ],
        "export av": [lambda: reactsim.export_av("s", "o", deviations="d", **SELECTION)],
        "export scenes": [lambda: list(reactsim.scenarios("s", deviations="d", **SELECTION))],
        "export wosac": [
            lambda: reactsim.export_wosac(
                "a", "o", scenarios="s", metadata="m", simulator="idm", shards=2
            )
        ],
        "train": [
            lambda: reactsim.train(
                "a",
                {"s": 2},
                out="o",
                recipe="r",
                parameters={"a": 1},
                inputs={"a": "b"},
                start="w",
                resume=True,
                cache="c",
                exclude="e",
                backend="flex",
                jobs=1,
                checkpoint_every="1m",
                closed_loop="v",
                most_closed_loop=1,
                closed_loop_rollouts=1,
                progress=False,
            ),
            lambda: training.recipe("a", "r"),
        ],
        "train adapt": [
            lambda: reactsim.train_adapt(
                "l",
                "o",
                exclude="x",
                resume=True,
                jobs=1,
                current_frame=9,
                window_step=10,
                all_agents=True,
                progress=False,
            )
        ],
        "train quick": [lambda: reactsim.train_quick("o", resume=True, jobs=1, progress=False)],
        "train split": [lambda: training.split("s", "o", parts={"a": 0.5, "b": 0.5})],
        "train open-loop": [
            lambda: training.open_loop("s", weights="w", with_parked=True, limit=1, backend="flex")
        ],
        "train intentions": [
            lambda: training.intentions("s", "o", points=1, places=1, limit=1, progress=False)
        ],
        "train vocabulary": [
            lambda: training.vocabulary(
                "s",
                "o",
                map_out="m",
                tokens=1,
                tolerance=1.0,
                symmetric=True,
                segments=1,
                fill=True,
                limit=1,
                progress=False,
            )
        ],
        "verify": [
            lambda: reactsim.verify(
                "r",
                quick=True,
                scenarios="s",
                deviations="d",
                weights={"a": "b"},
                jobs=1,
                batch=1,
                progress=False,
            )
        ],
        "reference make": [
            lambda: reactsim.make_reference(
                "a", "o", name="n", title="t", commands="c", aggregates_only=True
            )
        ],
        "leaderboard": [lambda: reactsim.leaderboard("a", scenarios="s", html="h")],
        "shard plan": [
            lambda: plan_units(folder / "u", ["run"], unit=1, estimate=1, progress=False)
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
    path, notes = tmp_path / "reactsim", tmp_path / "notes"
    path.write_text(f"#!/bin/sh\nprintf '%s\\0' \"$@\" >'{notes}'\nexit 3\n")
    path.chmod(0o755)
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
    """Returns what Python lacks, and what it gives to commands that do not have it."""
    found = []
    functions = calls(folder)
    parents = {name.rsplit(" ", 1)[0] for name in command_line if " " in name} - set(functions)
    for name in sorted(set(command_line) - set(functions) - parents - {""}):
        if name not in LEFT_OUT_COMMANDS:
            found.append(f"no function calls `{name}`")
    for name in sorted({*functions, *LEFT_OUT_COMMANDS, *LEFT_OUT_OPTIONS} - set(command_line)):
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


def test_python_has_the_command_line(
    command_line: Dict[str, Set[str]], recorded: Callable[[Any], List[str]], tmp_path: Path
) -> None:
    assert len(command_line) > 40
    assert problems(command_line, recorded, tmp_path) == []


def test_what_is_missing_is_found(
    command_line: Dict[str, Set[str]], recorded: Callable[[Any], List[str]], tmp_path: Path
) -> None:
    changed = {name: set(options) for name, options in command_line.items()}
    changed["fly"] = set()
    changed["verify"] |= {"--slowly"}
    changed["convert"] -= {"--model"}
    del changed["man"]
    assert sorted(problems(changed, recorded, tmp_path)) == [
        "`convert` has no --model",
        "no function calls `fly`",
        "no function gives --slowly to `verify`",
        "there is no command `man`",
    ]


def test_the_guide_lists_what_is_left_out() -> None:
    text = GUIDE.read_text("utf-8")
    for name in LEFT_OUT_COMMANDS:
        assert f"`{name}`" in text, name
