"""Fixtures of the tests."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Iterator

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import reactsim
from fakes import EXAMPLES, IMPORTED, ROOT, executable

sys.path.insert(0, str(EXAMPLES))


@pytest.fixture(scope="session")
def program() -> str:
    """Path of the program; tests are skipped without it."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    built = [target / build / "reactsim" for build in ("release", "debug")]
    found = next((str(path) for path in built if path.is_file()), "")
    if not found or "REACTSIM_BINARY" in os.environ:
        try:
            found = reactsim.find_program()
        except reactsim.ReactsimError as error:
            pytest.skip(str(error))
    text = subprocess.run(
        [found, "run", "--help"], capture_output=True, text=True, check=False
    ).stdout
    if "--external" not in text:
        pytest.skip(f"{found} does not support external simulators")
    return os.path.abspath(found)


@pytest.fixture(scope="session")
def checkout() -> Path:
    """Folder of a checkout of github.com/NVlabs/catk; tests are skipped without it."""
    if "SMART_CHECKOUT" not in os.environ:
        pytest.skip("SMART_CHECKOUT is not set: a folder of github.com/NVlabs/catk")
    return Path(os.environ["SMART_CHECKOUT"]).resolve()


@pytest.fixture(scope="module")
def with_program(program: str) -> Iterator[None]:
    """Makes the package use the program of the tests, also in fixtures of a module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("REACTSIM_BINARY", program)
        yield


@pytest.fixture
def fake_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A stand-in for the program that the package starts; returns the folder of its notes."""
    script = Path(__file__).with_name("fake_program.py")
    path = executable(tmp_path / "reactsim", f'exec "{sys.executable}" "{script}" "$@"')
    monkeypatch.setenv("REACTSIM_BINARY", str(path))
    monkeypatch.setenv("FAKE_NOTES", str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", str(IMPORTED))
    return tmp_path
