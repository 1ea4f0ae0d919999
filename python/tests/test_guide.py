"""The guide `docs/guides/python.md`: its examples run, and print what it shows.

REACTSIM_UPDATE_GUIDE=1 writes the present output into the guide.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
from pathlib import Path
from typing import Any, Dict

import pytest
import reactsim
from fakes import ROOT

GUIDE = ROOT / "docs" / "guides" / "python.md"

EXAMPLE = re.compile(r"```python\n(.*?)```\n(?:\n```text\n(.*?)```\n)?", re.DOTALL)


def render(text: str) -> str:
    """Runs all examples in one name space; returns the text with their output."""
    names: Dict[str, Any] = {}

    def run(match: "re.Match[str]") -> str:
        output = io.StringIO()
        with contextlib.redirect_stdout(output):
            exec(compile(match[1], "guide", "exec"), names)
        printed = "\n".join(line.rstrip() for line in output.getvalue().splitlines())
        if match[2] is None:
            assert printed == "", f"the output of this example is not shown:\n{match[1]}"
            return match[0]
        return f"```python\n{match[1]}```\n\n```text\n{printed}\n```\n"

    return EXAMPLE.sub(run, text)


@pytest.mark.program
@pytest.mark.usefixtures("with_program")
def test_examples_print_what_the_guide_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = GUIDE.read_text("utf-8")
    rendered = render(text)
    if os.environ.get("REACTSIM_UPDATE_GUIDE"):
        GUIDE.write_text(rendered, "utf-8")
    else:
        assert rendered == text


def test_the_guide_has_every_function() -> None:
    text = GUIDE.read_text("utf-8")
    functions = [
        name
        for name in reactsim.__all__
        if name.islower() and callable(getattr(reactsim, name)) and name != "serve"
    ]
    assert len(functions) > 8
    assert [name for name in functions if not re.search(rf"\b{name}\b", text)] == []
