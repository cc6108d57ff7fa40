"""Whatever an FMU does, only its own scenario fails, with what it had recorded, and nothing is left behind.

The page on trust says what happens; ``python -m tests.safety`` writes its tables.
"""

import sys
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from tests.safety import ALL, BEFORE, GOOD, MODES, PAGE, ROWS, SOME, Command, passed, run, tables, with_tables

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="a process is forked on Linux alone")


@pytest.fixture(scope="module")
def commands(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Command]:
    """Return the command of each mode: all rows in the supervised process, some in processes of their own."""
    folder = tmp_path_factory.mktemp("safety")
    shorter = [replace(row, options={**row.options, "lines": 50_000}) if row.options else row for row in ROWS]
    rows = {"supervised": shorter, "isolated": [row for row in ROWS if row.name in SOME]}
    return {mode: run(folder / mode, mode, rows[mode]) for mode in MODES}


@pytest.mark.parametrize("mode", MODES)
def test_nothing_that_an_fmu_does_harms_others(commands: Mapping[str, Command], mode: str) -> None:
    command = commands[mode]
    assert command.status == 3
    assert "Traceback" not in command.printed
    assert command.left == [], "processes, folders and files that are left"
    good = command.outcomes[GOOD.name]
    assert (good.status, good.samples) == (0, ALL)


@pytest.mark.parametrize("mode", MODES)
def test_every_verdict_is_true(commands: Mapping[str, Command], mode: str) -> None:
    """No run that did not reach its end passes, its FMU is named, and what it had recorded is kept."""
    reference = commands[mode].outcomes[GOOD.name].poses
    wrong = []
    for name, outcome in commands[mode].outcomes.items():
        named = f"{name}.fmu" in outcome.told and (outcome.status == 2 or outcome.told.startswith("follower_1 at t ="))
        right = {0: outcome.samples == ALL, 2: outcome.samples == 0, 3: BEFORE - 1 <= outcome.samples < ALL}
        if not (
            right[outcome.status]
            and passed(commands[mode].folder / name) == (outcome.status == 0)
            and (named or outcome.status == 0)
            and np.array_equal(outcome.poses, reference[: outcome.samples])
        ):
            wrong.append((name, outcome.status, outcome.samples, outcome.told))
    assert wrong == []


def test_the_page_says_what_happened(commands: Mapping[str, Command]) -> None:
    supervised, isolated = (commands[mode].outcomes for mode in MODES)
    found = {"supervised": supervised, "isolated": {**supervised, **isolated}}
    page = PAGE.read_text(encoding="utf-8")
    assert with_tables(page, tables(found)) == page, "python -m tests.safety writes the tables anew"


def test_the_rows_are_known() -> None:
    assert {*SOME} <= {row.name for row in ROWS}
    assert len({row.name for row in ROWS}) == len(ROWS)
