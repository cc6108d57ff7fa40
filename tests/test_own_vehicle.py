"""The example of a vehicle of one's own: installed into a place of its own and run from outside."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

EXAMPLE = Path(__file__).parents[1] / "examples" / "own_vehicle"

pytestmark = [
    pytest.mark.skipif(importlib.util.find_spec("pip") is None, reason="needs pip"),
    pytest.mark.skipif(importlib.util.find_spec("hatchling") is None, reason="needs hatchling"),
]


@pytest.fixture(scope="module")
def outside(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, dict[str, str]]:
    """Install the example into a place of its own; return its sources, a folder to be in, and an environment."""
    folder = tmp_path_factory.mktemp("own")
    source, site, outside = folder / "source", folder / "site", folder / "outside"
    shutil.copytree(EXAMPLE, source, ignore=shutil.ignore_patterns("__pycache__", ".*"))
    outside.mkdir()
    pip = [sys.executable, "-m", "pip", "--no-input", "--disable-pip-version-check", "install", "--quiet", "--no-index"]
    command = [*pip, "--no-deps", "--no-build-isolation", "--target", str(site), str(source)]
    subprocess.run(command, check=True, capture_output=True, cwd=outside)
    return source, outside, os.environ | {"PYTHONPATH": str(site)}


def test_its_own_tests_pass_from_outside(outside: tuple[Path, Path, dict[str, str]]) -> None:
    source, folder, environment = outside
    tests = ["-q", "-p", "no:cacheprovider", "-c", str(source / "pyproject.toml"), str(source)]
    command = [sys.executable, "-m", "pytest", *tests]
    result = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    assert " passed" in result.stdout
    assert "skipped" not in result.stdout


def test_it_drives_in_a_scenario_from_outside(outside: tuple[Path, Path, dict[str, str]]) -> None:
    _, folder, environment = outside

    def formation(*arguments: str) -> str:
        command = [sys.executable, "-m", "cosim", *arguments]
        result = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout

    subprocess.run([sys.executable, "-m", "kinematic_bicycle"], check=True, env=environment, cwd=folder)
    formation("new", "bike.xml", "--vehicle", "kinematic_bicycle", "--followers", "3")
    assert "v_command 1 m/s" in formation("check", "bike.xml")
    assert "it can be driven as it is" in formation("inspect", "fmus/kinematic_bicycle.fmu")
    printed = formation("run", "bike.xml")
    assert printed.count("holds ") == 3
    assert "torque" not in printed
    with xr.open_dataset(folder / "runs" / "bike" / "result.nc") as result:
        assert result["command"].dims == ("time", "robot", "command_component")
        assert list(result["command_component"].values) == ["v_command", "gamma_command"]
        assert list(result["command_component_units"].values) == ["m/s", "rad"]
        assert set(result["vehicle_kind"].values) == {"kinematic_bicycle"}
        assert np.abs(result["range_error"].values[-1]).max() < 0.01


def test_the_page_shows_entry_points_and_outline_as_they_are() -> None:
    page = (EXAMPLE.parents[1] / "docs" / "own_model.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    assert blocks
    for block in blocks:
        assert block.strip() in (EXAMPLE / "pyproject.toml").read_text(encoding="utf-8")
    (outline,) = re.findall(r"def outline\(bicycle\):\n(.*?)```", page, re.DOTALL)
    assert outline in (EXAMPLE / "kinematic_bicycle" / "kind.py").read_text(encoding="utf-8")
