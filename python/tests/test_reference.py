"""The page of all names, and what their docstrings state."""

from __future__ import annotations

import dataclasses
import enum
import inspect
import re
from html.parser import HTMLParser
from typing import Any, List

import pytest
import reactsim
from reactsim import reference

EMPTY = ("meta",)


class Balanced(HTMLParser):
    """Checks that every element is closed in turn."""

    def __init__(self) -> None:
        super().__init__()
        self.open: List[str] = []

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_page_has_all_names(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "reference.html"
    monkeypatch.setattr("sys.argv", ["reference", str(path)])
    reference.main()
    text = path.read_text("utf-8")
    parser = Balanced()
    parser.feed(text)
    assert parser.open == []
    for name in reactsim.__all__:
        assert f'<section id="reactsim.{name}">' in text, name
    assert '<dt>av</dt><dd>Driver of the AV: "deviated"' in text and "<h4>Args</h4>" in text
    assert "<pre>table(" in text and "<pre>rows</pre>" in text
    assert "<pre>run(simulators: &#x27;Any&#x27; = None" in text
    monkeypatch.setattr("sys.argv", ["reference"])
    with pytest.raises(SystemExit, match="usage"):
        reference.main()


def test_attributes_and_arguments_are_described() -> None:
    missing = []
    for name, value in reference.entries():
        text = inspect.getdoc(value) or ""
        if isinstance(value, type):
            fields = list(getattr(value, "_fields", ()))
            if dataclasses.is_dataclass(value):
                fields = [field.name for field in dataclasses.fields(value)]
            if not issubclass(value, enum.Enum):
                missing += [f"{name}.{f}" for f in fields if not described(f, text)]
            for member, inner in reference.members(value):
                if not inspect.getdoc(inner):
                    missing.append(f"{name}.{member}")
        elif "Args:" in text:
            kinds = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
            parameters = inspect.signature(value).parameters.values()
            own = [one.name for one in parameters if one.kind in kinds]
            missing += [f"{name}({one})" for one in own if not described(one, text)]
    assert missing == []


def described(name: str, text: str) -> bool:
    return re.search(rf"^    {name}: ", text, re.MULTILINE) is not None
