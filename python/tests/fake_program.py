"""A stand-in for the program `reactsim`, started by tests of `reactsim.run` and
`reactsim.scenarios`."""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path

import numpy as np
from fakes import Parent, make_scenes, roll_out
from reactsim.client import write_frame


def write_folder(folder: Path, failed: bool = False) -> None:
    """Writes the files of a small run."""
    folder.mkdir(parents=True, exist_ok=True)
    simulators = [{"id": "idm", "title": "IDM"}, {"id": "mine", "title": "mine"}]
    row = {
        "input": 0,
        "record": 0,
        "scenario": "first",
        "digest": "00",
        "simulator": "idm",
        "rollout": 0,
        "category": "lateral",
        "metrics": {
            "aa-collision": {"rate": [1, 4]},
            "aav-collision": {"count": 2},
            "ade": {"value": 0.5},
        },
        "deviation": {"ade": 1.5},
    }
    over_all = {**row, "rollout": None, "deviation": {}, "metrics": {"min-ade": {"mean": [3.0, 2]}}}
    empty = {**row, "simulator": "mine", "metrics": {"ade": None, "aa-collision": {"rate": [0, 0]}}}
    event = {
        "input": 0,
        "record": 0,
        "scenario": "first",
        "simulator": "idm",
        "rollout": 0,
        "metric": "aav-collision",
        "step": 3,
        "last_step": 5,
        "agent": "1",
        "partner": "0",
        "reason": None,
        "counted": True,
        "values": {"speed": 3.5},
    }
    failure = {
        "input": 0,
        "record": 1,
        "simulator": "mine",
        "file": "a.parquet",
        "scenario": "second",
        "error": "it is broken",
    }
    files = {
        "provenance.json": json.dumps({"version": "0.0.0", "simulators": simulators}),
        "summary.json": json.dumps({"simulators": {"idm": {"scenarios": 1}}}),
        "summary.md": "| Method |\n|---|\n| IDM |\n\nLateral deviations:\n\n| Method |\n",
        "rows.jsonl": "".join(json.dumps(r) + "\n" for r in (row, over_all, empty)) + '{"trunc',
        "events.jsonl": json.dumps(event) + "\n",
        "failures.jsonl": json.dumps(failure) + "\n" if failed else "",
    }
    for name, text in files.items():
        (folder / name).write_text(text)


def value(arguments: list[str], option: str) -> str:
    """Returns the value of an option."""
    return next(text for text in arguments if text.startswith(f"{option}=")).split("=", 1)[1]


def run(arguments: list[str]) -> int:
    """Plays `reactsim run` with an external simulator over standard input and output."""
    folder = Path(value(arguments, "--out"))
    if "slow" in arguments:
        try:
            Path(os.environ["FAKE_NOTES"], "waiting").touch()
            time.sleep(60)
        except KeyboardInterrupt:
            Path(os.environ["FAKE_NOTES"], "interrupted").touch()
            return 130
    parent = Parent(sys.stdin.buffer, sys.stdout.buffer)
    parent.to["to"] = value(arguments, "--external")[: -len("=@stdio")]
    Path(os.environ["FAKE_NOTES"], "welcome.json").write_text(json.dumps(parent.hello()))
    if "broken" in arguments:
        sys.stderr.write("error: the scenarios cannot be read\n")
        return 2
    if "garbage" in arguments:
        sys.stdout.write("this is no frame" * 100)
        sys.stdout.flush()
        time.sleep(60)
    failed = False
    try:
        roll_out(parent, make_scenes())
    except AssertionError as error:
        sys.stderr.write(f"warning: failed: {error}\n")
        failed = True
    parent.bye()
    write_folder(folder, failed)
    return int(failed)


def scenes(arguments: list[str]) -> int:
    """Plays `reactsim export scenes`."""
    if "missing" in arguments:
        sys.stderr.write("error: missing: no such file\n")
        return 2
    for k in range(3):
        tensors = make_scenes(episodes=1, agents=4, seed=k)
        metadata = {
            "scenario_ids": json.dumps([f"scenario-{k}"]),
            "agent_ids": json.dumps([["av", "b", "c", "d"]]),
            "origins": json.dumps([[100.0, 200.0]]),
        }
        tensors["heights"] = np.full((1, 4, 11), np.nan)
        tensors["point_heights"] = np.full(len(tensors["points"]), np.nan)
        tensors["obstacle_heights"] = np.full(len(tensors["obstacle"]), np.nan)
        if "--with-future" in arguments:
            tensors["future_heights"] = np.full((1, 4, 80), np.nan)
            tensors["future"] = np.full((1, 4, 80, 5), float(k))
            tensors["future_valid"] = np.ones((1, 4, 80), np.uint8)
            tensors["light_future"] = np.full((1, 80), 6, np.uint8)
            if k == 1:
                tensors["av"] = np.zeros((80, 5))
        write_frame(sys.stdout.buffer, "scene", str(k), metadata, tensors)
        if "truncated" in arguments:
            return 0
    write_frame(sys.stdout.buffer, "bye", "3")
    return 0


def main() -> int:
    """Runs a command; notes its arguments."""
    command, *arguments = sys.argv[1:]
    Path(os.environ["FAKE_NOTES"], "arguments.json").write_text(json.dumps(sys.argv[1:]))
    if command == "inspect":
        Path(value(arguments, "--svg")).write_text("<svg></svg>")
        return 0
    if command == "export":
        assert arguments.pop(0) == "scenes"
        return scenes(arguments)
    assert command == "run"
    return run(arguments)


if __name__ == "__main__":
    sys.exit(main())
