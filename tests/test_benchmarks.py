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


def test_closed_loop_against_c(tmp_path: Path) -> None:
    short = ("--followers", 4, "--rounds", 1, "--ticks", 250)
    printed = run(BENCHMARKS / "closed_loop.py", *short, "--json", tmp_path / "times.json")
    assert "4 followers, 250 ticks" in printed
    result = json.loads((tmp_path / "times.json").read_text(encoding="utf-8"))["4"]
    apart = result["apart"]
    motion = {"pose", "velocity", "measured_pose", "torque", "range", "bearing", "weight_norm", "torque_command"}
    assert apart["C"].keys() > motion
    assert max(apart["C"].values()) <= 1e-10
    assert max(apart["parts alone, C"].values()) <= 1e-10
    # With the functions that ours calls, those that the plant's FMU brings or else the C library's: the same bits.
    assert set(apart.get("C, own functions", apart["C"]).values()) == {0.0}
    assert set(apart["parts alone, ours"].values()) == {0.0}
    assert result["nanoseconds"]["loop, all recorded"]["ours to C"]["min"] > 0


def test_prepared_runs(tmp_path: Path) -> None:
    printed = run(BENCHMARKS / "prepared.py", "--runs", 4, "--workers", 1, "--json", tmp_path / "times.json")
    assert "1 processes: " in printed
    told = json.loads((tmp_path / "times.json").read_text(encoding="utf-8"))
    assert told["milliseconds"].keys() == {"prepared", "alone", "in C"}
    assert min(told["parts"].values()) > 0


def test_isolation(tmp_path: Path) -> None:
    short = ("--followers", 4, "--rounds", 1, "--ticks", 250)
    printed = run(BENCHMARKS / "isolation.py", *short, "--json", tmp_path / "costs.json")
    assert "the same bits" in printed
    costs = json.loads((tmp_path / "costs.json").read_text(encoding="utf-8"))["4"]
    assert len(costs) == 4
    assert all(min(own["wall"] + own["CPU"]) > 0 for own in costs.values())


def test_studies(tmp_path: Path) -> None:
    printed = run(BENCHMARKS / "studies.py", "--runs", 3, "--workers", 1, "--json", tmp_path / "times.json")
    assert "1 workers: " in printed
    told = json.loads((tmp_path / "times.json").read_text(encoding="utf-8"))
    assert min(*told["prepared"], *told["workers"]["1"]["whole"]) > 0


def test_closed_loop_refuses_another_motion_in_c() -> None:
    code = """
import closed_loop, numpy as np
ours = np.ones(3)
for wrong in (ours + 1e-9, ours * np.nan, ours[1:]):
    try:
        closed_loop.apart(ours, wrong, "the pose")
    except SystemExit as refusal:
        print(refusal)
print(closed_loop.apart(ours, ours + 1e-12, "the pose") > 0)
"""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=BENCHMARKS, capture_output=True, text=True, check=False, timeout=300)
    first, second, third, rounding = done.stdout.splitlines()
    assert first == "the pose is 1e-09 off in C: a comparison would mean nothing"
    assert second == "the pose is nan off in C: a comparison would mean nothing"
    assert third == "the pose has shape (3,), and (2,) in C"
    assert rounding == "True"


def test_profile_of_a_run() -> None:
    assert "whole process" in run(BENCHMARKS / "profile_run.py", "--runs", 1)


def test_reading_a_scenario() -> None:
    assert "times lxml's parsing" in run(BENCHMARKS / "read_scenario.py")


def test_checkpoints_change_nothing() -> None:
    printed = run(BENCHMARKS / "checkpoints.py", "clmr_line", "--rounds", 1, "--horizon", "4 s", "--every", "1 s")
    assert "clmr_line: loop " in printed
    assert " times that" in printed
