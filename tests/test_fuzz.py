"""A short run of the fuzzers; ``python -m tests.fuzz`` is the long one."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from cosim.scenario.reader import read_scenario
from tests.fuzz.fuzz import run, run_limited
from tests.fuzz.large import REPEATED, repeated
from tests.fuzz.seeds import seeds

REFUSED = {"changes of a place", "elements that nobody knows", "attributes"}
"""Pieces that no scenario may have, or not twice."""


@pytest.mark.parametrize(
    ("kind", "cases"), [("scenarios", range(150)), ("fmus", range(60)), ("hosts", range(30)), ("files", range(30))]
)
def test_nothing_but_results_and_refusals(
    kind: str, cases: range, tmp_path: Path, make: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tests.fuzz.fuzz.SECONDS", 60.0)  # the machine may be busy
    assert list(run(kind, cases, tmp_path, seeds(make) if kind == "fmus" else ())) == []


@pytest.mark.skipif(sys.platform != "linux", reason="looks at the processes and files that Linux shows")
@pytest.mark.parametrize(("kind", "cases"), [("calls", range(1, 7)), ("interrupts", range(1, 31))])
def test_nothing_but_results_and_errors_of_calls(kind: str, cases: range, tmp_path: Path) -> None:
    """In a process of their own, as they are about all that a process holds."""
    assert list(run_limited(kind, cases, tmp_path)) == []


@pytest.mark.parametrize("piece", sorted(REPEATED.keys() - REFUSED))
def test_large_scenarios_are_made_of_pieces_that_are_read(piece: str, tmp_path: Path) -> None:
    """A piece that is refused at its first occurrence would tell nothing of many."""
    path = tmp_path / "few.xml"
    path.write_text(repeated(*REPEATED[piece], most=120), encoding="utf-8")
    assert read_scenario(path).name == "large"
