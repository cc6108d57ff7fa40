"""A sensitivity of runs: at the command line, resumed, and equal to what the same rows give."""

import json
from pathlib import Path

import numpy as np
import pytest

from cosim.cli import main
from cosim.studies.conduct import conduct
from cosim.studies.reader import read_study
from cosim.studies.row import BROKEN
from cosim.tests.studies import LAST, MASS, SEEDS, write_study

START = """<vary name="start" select="follower[@id='follower_1']/pose/@x"><uniform from="-5.5 m" to="-4.5 m"/></vary>"""
GAIN = """<vary name="gain" select="//gain[@name='gamma_w']/@value"><log_uniform from="9" to="11"/></vary>"""
FIRST = LAST.replace("unit", 'robots="follower_1" unit')


@pytest.mark.parametrize("method", ["saltelli", "morris"])
def test_a_start_decides_the_last_error_of_a_short_run(
    tmp_path: Path, method: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_study(tmp_path, START + GAIN + SEEDS, f'<sample method="{method}" runs="45"/>', FIRST)
    monkeypatch.chdir(tmp_path)
    assert main(["check", "study.xml"]) == 0
    groups, size = {"saltelli": (8, 5), "morris": (11, 4)}[method]
    assert f"{groups * size} runs" in capsys.readouterr().out
    folder = tmp_path / "runs/small"
    folder.mkdir(parents=True)
    look = conduct(read_study(path), folder, workers=0, runs=13)
    assert look.sensitivities[0].figures == {}
    whole = conduct(read_study(path), folder, workers=0)
    assert whole.made == groups * size - 13
    assert main(["study", "study.xml", "--no-figure"]) == 0
    printed = capsys.readouterr().out
    assert printed.index(" start ") < printed.index(" gain ")
    (told,) = json.loads((folder / "summary.json").read_text())["sensitivity"]
    (found,) = whole.sensitivities
    assert told == found.as_data() | {"cases": []}
    start, *others = found.figures["total" if method == "saltelli" else "mean"]
    assert np.abs(others).max() < 0.01 * abs(start)
    if method == "morris":
        assert -1000.0 < start < -500.0  # mm, over a range of 1 m


def test_a_normal_beyond_a_bound_of_the_scenario_breaks_runs_that_are_left_out(tmp_path: Path) -> None:
    light = f'<vary name="mass" select="{MASS}"><normal mean="25 kg" deviation="15 kg"/></vary>'
    path = write_study(tmp_path, START + light, '<sample method="saltelli" runs="64"/>', FIRST)
    outcome = conduct(read_study(path), tmp_path, workers=0)
    broken = [row for row in outcome.rows if row.status == BROKEN]
    negative = [row for row in outcome.rows if str(row.values[1]).startswith("-")]
    assert negative
    assert all(row in broken and "m_c" in row.message for row in negative)
    lost = {(row.draw - 1) // 4 for row in broken}
    last, *_ = outcome.sensitivities
    assert (last.groups, last.left_out) == (16 - len(lost), len(lost))
    assert f"{len(lost)} of 16 groups of runs have a run without a figure" in last.note
