"""The project's own study files: each can be read, and its runs can be planned."""

from pathlib import Path

import pytest

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
