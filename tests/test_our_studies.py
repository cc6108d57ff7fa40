"""The project's own study files: each can be read, and its runs can be planned."""

import importlib
from dataclasses import replace
from pathlib import Path

import pytest

from cosim.scenario.edits import set_horizon, without_expectations
from cosim.studies.held_out import with_cost
from cosim.studies.plan import Plan
from cosim.studies.reader import read_study
from cosim.studies.requirements import requirements_of

ROOT = Path(__file__).parent.parent
FILES = sorted((ROOT / "studies").glob("*.xml"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_the_study_can_be_read_and_planned(file: Path) -> None:
    study = read_study(file)
    assert study.name == file.stem
    requirements_of(with_cost(study))
    plan = Plan(study)
    assert plan[len(plan) - 1].number == len(plan)


def test_the_pages_name_every_study() -> None:
    pages = [
        (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8") for name in ("reproduction", "comparison", "studies")
    ]
    missing = [file.name for file in FILES if not any(f"studies/{file.name}" in page for page in pages)]
    assert missing == []


def test_a_reading_of_the_law_acts_or_ends_its_study(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "studies"))
    study = importlib.import_module("law_readings")
    path, short = ROOT / "scenarios" / "clmr_line.xml", (set_horizon(0.2), without_expectations())
    as_read = study.checked_outcome(path, "as read", study.Reading(short))
    start = replace(study.LAW["observer: q̂(0) = 0 (q(0))"], changes=short)
    assert study.checked_outcome(path, "start", start).range_rms != as_read.range_rms

    # `begin` has set the observer by then.
    idle = study.Reading(short, {(study.ObserverPid, "start_states"): lambda *_: None})
    with pytest.raises(RuntimeError, match="clmr_line, idle: this reading changes no bit of the runs"):
        study.checked_outcome(path, "idle", idle)
    assert study.checked_outcome(path, "idle", replace(idle, may_be_idle=True)) == as_read
