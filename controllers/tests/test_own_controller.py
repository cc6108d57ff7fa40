"""The example of a controller of one's own: installed into a place of its own and run from outside."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PROJECT = Path(__file__).parents[2]
EXAMPLE = PROJECT / "examples" / "own_controller"
PAGE = PROJECT / "docs" / "own_controller.md"

pytestmark = [
    pytest.mark.skipif(not EXAMPLE.exists(), reason="the example is part of the project, not of this package"),
    pytest.mark.skipif(importlib.util.find_spec("pip") is None, reason="needs pip"),
    pytest.mark.skipif(importlib.util.find_spec("hatchling") is None, reason="needs hatchling"),
]


OUTSIDE = """
import sys
import pytest
from formation_controllers import installed, load
found = installed()["look-ahead"]
print(found.package, found.version, load(found.name))
sys.exit(pytest.main(sys.argv[1:]))
"""


@pytest.fixture(scope="module")
def from_outside(tmp_path_factory):
    """Install the example into a place of its own; find it and run its tests from outside of the project."""
    folder = tmp_path_factory.mktemp("own")
    source, site, outside = folder / "source", folder / "site", folder / "outside"
    shutil.copytree(EXAMPLE, source, ignore=shutil.ignore_patterns("__pycache__", ".*"))
    outside.mkdir()
    pip = [sys.executable, "-m", "pip", "--no-input", "--disable-pip-version-check", "install", "--quiet", "--no-index"]
    command = [*pip, "--no-deps", "--no-build-isolation", "--target", str(site), str(source)]
    subprocess.run(command, check=True, capture_output=True, cwd=outside)
    tests = ["-q", "-p", "no:cacheprovider", "-c", str(source / "pyproject.toml"), str(source)]
    return subprocess.run(
        [sys.executable, "-c", OUTSIDE, *tests],
        env=os.environ | {"PYTHONPATH": str(site)},
        cwd=outside,
        capture_output=True,
        text=True,
        check=False,
    )


def test_an_installed_package_brings_its_controller(from_outside):
    first = from_outside.stdout.partition("\n")[0]
    assert first == "look-ahead-controller 0.1.0 <class 'look_ahead.LookAhead'>", from_outside.stderr


def test_its_own_tests_pass_from_outside(from_outside):
    assert from_outside.returncode == 0, from_outside.stdout + from_outside.stderr
    assert "4 passed" in from_outside.stdout


def test_the_page_shows_the_example_as_it_is():
    """Every Python and TOML block of the page is a part of the example's files."""
    page = PAGE.read_text(encoding="utf-8")
    files = [file.read_text(encoding="utf-8") for file in EXAMPLE.rglob("*") if file.suffix in (".py", ".toml")]
    blocks = re.findall(r"```(?:python|toml)\n(.*?)```", page, re.DOTALL)
    assert len(blocks) >= 4
    for block in blocks:
        assert any(block.strip() in text for text in files), block
