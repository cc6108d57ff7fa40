"""The benchmarks run: shortened, and without other masters."""

import json
import subprocess
import sys
from pathlib import Path

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


def run(*arguments: object) -> str:
    command = [sys.executable, *map(str, arguments)]
    done = subprocess.run(command, cwd=BENCHMARKS.parent, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_masters(tmp_path: Path) -> None:
    few = ("--robots", 1, "--followers", 4, "--rounds", 1, "--masters", "ours")
    printed = run(BENCHMARKS / "masters.py", *few, "--out", tmp_path)
    assert "Error" not in printed
    costs = json.loads((tmp_path / "masters.json").read_text(encoding="utf-8"))
    assert json.dumps(costs).count('"ours"') >= 2
    assert (tmp_path / "masters.png").stat().st_size > 10_000


def test_profile_of_a_run() -> None:
    assert "whole process" in run(BENCHMARKS / "profile_run.py", "--runs", 1)


def test_reading_a_scenario() -> None:
    assert "times lxml's parsing" in run(BENCHMARKS / "read_scenario.py")
