"""Texts and examples agree with the code."""

from __future__ import annotations

import re

import pytest
import reactsim
from fakes import EXAMPLES, PACKAGE, ROOT


def test_readme_contains_the_example() -> None:
    example = (EXAMPLES / "constant_velocity.py").read_text("utf-8")
    assert len(example.splitlines()) <= 30
    assert f"```python\n{example}```\n" in (PACKAGE / "README.md").read_text("utf-8")


@pytest.mark.parametrize(
    "path", ["python/README.md", "docs/guides/external-simulators.md", "docs/guides/python.md"]
)
def test_texts_name_what_exists(path: str) -> None:
    names = re.findall(r"\breactsim\.([A-Za-z_]\w*)\(", (ROOT / path).read_text("utf-8"))
    assert len(names) >= 2
    for name in names:
        assert hasattr(reactsim, name), name


def test_all_names_exist() -> None:
    assert len(set(reactsim.__all__)) == len(reactsim.__all__)
    for name in reactsim.__all__:
        assert hasattr(reactsim, name)


def test_both_ways_to_install_have_the_same_requirements() -> None:
    tomllib = pytest.importorskip("tomllib")
    whole, alone, cargo = (
        tomllib.loads((ROOT / path).read_text("utf-8"))
        for path in ("pyproject.toml", "python/pyproject.toml", "Cargo.toml")
    )
    for key in ("name", "requires-python", "license", "dependencies", "optional-dependencies"):
        assert whole["project"][key] == alone["project"][key], key
    version = cargo["workspace"]["package"]["version"]
    assert alone["project"]["version"] == reactsim.__version__ == version


def test_help_has_the_attributes() -> None:
    for kind, names in {
        reactsim.Observation: ("states", "av_next"),
        reactsim.Scenario: ("future", "av", "n_history", "n_steps"),
        reactsim.Scenes: ("history", "n_history", "n_steps"),
        reactsim.Simulator: ("batch", "any_length"),
        reactsim.Planner: ("name", "any_length"),
        reactsim.Event: ("metric", "last_step"),
        reactsim.Rollout: ("agents", "states", "n_history"),
    }.items():
        attributes = (kind.__doc__ or "").split("Attributes:")[1]
        assert all(f"\n        {name}: " in attributes for name in names), kind
