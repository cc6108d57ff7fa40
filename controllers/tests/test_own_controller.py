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


@pytest.fixture(scope="module")
def installed_example(tmp_path_factory):
    """Return an environment in which the example is installed, and a folder outside of the project."""
    folder = tmp_path_factory.mktemp("own")
    source, site, outside = folder / "source", folder / "site", folder / "outside"
    shutil.copytree(EXAMPLE, source, ignore=shutil.ignore_patterns("__pycache__", ".*"))
    outside.mkdir()
    pip = [sys.executable, "-m", "pip", "--no-input", "--disable-pip-version-check", "install", "--quiet", "--no-index"]
    command = [*pip, "--no-deps", "--no-build-isolation", "--target", str(site), str(source)]
    subprocess.run(command, check=True, capture_output=True, cwd=outside)
    return os.environ | {"PYTHONPATH": str(site)}, outside, source


def run(environment, outside, *arguments):
    command = [sys.executable, *arguments]
    return subprocess.run(command, env=environment, cwd=outside, capture_output=True, text=True, check=False)


def test_an_installed_package_brings_its_controller(installed_example):
    environment, outside, _ = installed_example
    code = (
        "from formation_controllers import *; i = installed()['look-ahead']; print(i.package, i.version, load(i.name))"
    )
    done = run(environment, outside, "-c", code)
    assert done.stdout.strip() == "look-ahead-controller 0.1.0 <class 'look_ahead.LookAhead'>", done.stderr


def test_its_own_tests_pass_from_outside(installed_example):
    environment, outside, source = installed_example
    done = run(
        environment,
        outside,
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
        "-c",
        str(source / "pyproject.toml"),
        str(source),
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "4 passed" in done.stdout


def test_the_page_shows_the_example_as_it_is():
    """Every Python and TOML block of the page is a part of the example's files."""
    page = PAGE.read_text(encoding="utf-8")
    files = [file.read_text(encoding="utf-8") for file in EXAMPLE.rglob("*") if file.suffix in (".py", ".toml")]
    blocks = re.findall(r"```(?:python|toml)\n(.*?)```", page, re.DOTALL)
    assert len(blocks) >= 4
    for block in blocks:
        assert any(block.strip() in text for text in files), block
