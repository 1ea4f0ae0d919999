"""The count of AVs that stand at the end of a lane on a free road."""

import json
import runpy
import sys
from pathlib import Path

import pytest
import reactsim
from fakes import ROOT


def road(folder: Path, linked: bool) -> Path:
    """Write a road of two lanes, one after the other, that the AV drives along."""
    first = {"id": "first", "speed_limit": 13.9, "points": [[-50, 0], [25, 0]]}
    if linked:
        first["successors"] = ["second"]
    scenario = {
        "format": "reactsim-scenario-v1",
        "id": "road",
        "intent": "A road of two lanes.",
        "agents": [
            {
                "id": "av",
                "length": 4.5,
                "width": 1.8,
                "motion": {"at": [0.0, 0.0], "speed": 10.0},
            }
        ],
        "map": {
            "lanes": [
                first,
                {"id": "second", "speed_limit": 13.9, "points": [[25, 0], [400, 0]]},
            ]
        },
        "av": "av",
    }
    file = folder / f"{linked}.json"
    file.write_text(json.dumps(scenario))
    return file


@pytest.mark.usefixtures("with_program")
@pytest.mark.parametrize("linked", [True, False])
def test_avs_that_stand_at_the_end_of_a_lane_are_counted(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    linked: bool,
) -> None:
    file, folder = road(tmp_path, linked), tmp_path / "run"
    reactsim.run(
        baselines=["log-replay"],
        scenarios=file,
        av="planner:idm",
        out=folder,
        progress=False,
    )
    monkeypatch.setattr(sys, "argv", ["lane_ends.py", str(folder), str(file)])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(ROOT / "benches/lane_ends.py"), run_name="__main__")
    counted = 0 if linked else 1
    assert ended.value.code == counted
    assert capsys.readouterr().out.startswith(f"{counted} of 1 rollouts")
