"""The picture of a study shows what its rows hold."""

import json
import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from cosim.quantity import quantity
from cosim.studies.conduct import StudyOutcome
from cosim.studies.figure import draw, picture
from cosim.studies.plan import Plan
from cosim.studies.requirements import requirements_of
from cosim.studies.row import BROKEN, FAILED, PASSED, Row
from cosim.studies.summary import as_json
from cosim.tests.studies import LAST, MASS, SEEDS, UNIFORM, small_study

X = '<vary name="x" select="leader/pose/@x"><list values="0 m, 1 m, 2 m"/></vary>'
HEAVY = f'<vary name="mass" select="{MASS}"><list values="25 kg, 30 kg"/></vary>'
LAWS = """<vary name="law" cross="yes"><case name="a"/><case name="b"/></vary>"""
WORST = '<worst of="last" below="20 mm"/>'


def outcome(
    folder: Path, vary: str, sample: str, figures: list[float], statuses: list[str], rest: str = LAST + WORST
) -> StudyOutcome:
    study = small_study(folder, vary, sample, rest)
    rows = [
        Row("", run.number, run.draw, run.values, status, (figure,), (), "")
        for run, figure, status in zip(Plan(study), figures, statuses, strict=True)
    ]
    return StudyOutcome(study, tuple(rows), len(rows), (), len(rows), False)


def test_distribution_and_scatter(tmp_path: Path) -> None:
    figures = [5.0, 1.0, 3.0, math.inf, math.nan, 2.0]
    statuses = [FAILED, PASSED, PASSED, FAILED, BROKEN, PASSED]
    figure = draw(outcome(tmp_path, UNIFORM + SEEDS, '<sample method="random" runs="6"/>', figures, statuses))
    share, scatter = figure.axes
    assert (share.get_xlabel(), scatter.get_xlabel(), scatter.get_ylabel()) == ("last [mm]", "mass [kg]", "last [mm]")
    steps, bound = share.lines
    assert steps.get_xdata().tolist() == [1.0, 2.0, 3.0, 5.0]
    assert np.allclose(steps.get_ydata(), np.arange(1, 5) / 6), "runs without a figure count"
    assert set(bound.get_xdata()) == {20.0}
    assert share.get_title(loc="left") == "2 of 6 runs without a figure"
    passed, failed = scatter.collections
    assert sorted(passed.get_offsets()[:, 1]) == [1.0, 2.0, 3.0]
    assert failed.get_offsets()[:, 1].tolist() == [5.0]
    (endless,) = scatter.lines
    assert len(endless.get_xdata()) == 1


def test_cases_are_words_side_by_side(tmp_path: Path) -> None:
    made = outcome(tmp_path, LAWS + SEEDS, '<sample method="random" runs="2"/>', [1.0, 2.0, 3.0, 4.0], [PASSED] * 4)
    _, scatter = draw(made).axes
    assert [label.get_text() for label in scatter.get_xticklabels()] == ["a", "b"]
    offsets = scatter.collections[0].get_offsets()
    assert [round(x) for x in offsets[:, 0]] == [0, 1, 0, 1]


def test_words_are_in_the_order_of_the_study_and_long_ones_do_not_touch(tmp_path: Path) -> None:
    names = ["none", *(f"a_change_of_gain_{number}" for number in range(8))]
    laws = "".join(f'<case name="{name}"/>' for name in names)
    vary = f'<vary name="law" cross="yes">{laws}</vary>' + SEEDS
    figures = [-15000.0 + 1000 * run for run in range(9)]
    figure = draw(outcome(tmp_path, vary, '<sample method="random" runs="1"/>', figures, [PASSED] * 9))
    figure.canvas.draw()
    spread, scatter = figure.axes
    assert [label.get_text() for label in scatter.get_xticklabels()] == names
    assert {label.get_rotation() for label in scatter.get_xticklabels()} == {40.0}
    boxes = [label.get_window_extent() for label in spread.get_xticklabels() if label.get_text()]
    assert not any(one.overlaps(other) for one, other in pairwise(boxes)), "numbers do not touch each other"


def test_a_grid_of_two_values_is_a_map(tmp_path: Path) -> None:
    figures = [1.0, 2.0, 3.0, 4.0, math.inf, 6.0]
    _, shown, colours = draw(outcome(tmp_path, X + HEAVY, '<sample method="grid"/>', figures, [PASSED] * 6)).axes
    (image,) = shown.images
    assert np.array_equal(image.get_array().filled(math.nan), [[1.0, 3.0, math.nan], [2.0, 4.0, 6.0]], equal_nan=True)
    assert (shown.get_xlabel(), shown.get_ylabel()) == ("x [m]", "mass [kg]")
    assert colours.get_ylabel() == "last [mm]; white: none"


def test_a_grid_of_one_value_is_a_curve_with_a_band_over_its_seeds(tmp_path: Path) -> None:
    seeds = '<vary name="seed" select="simulation/@seed"><range from="1" to="3"/></vary>'
    figures = [1.0, 3.0, 2.0, 4.0, 4.0, 4.0, 5.0, math.inf, math.inf]
    made = outcome(tmp_path, X + seeds, '<sample method="grid"/>', figures, [PASSED] * 9)
    spread, curve = draw(made).axes
    median, endless, bound = curve.lines
    assert np.array_equal(median.get_ydata(), [2.0, 4.0, math.nan], equal_nan=True)
    assert endless.get_xdata().tolist() == [2.0], "where a run has no figure"
    assert set(bound.get_ydata()) == {20.0}
    assert curve.get_title(loc="left") == "median, and 5 % to 95 % of the runs"
    assert spread.get_title(loc="left") == "2 of 9 runs without a figure"
    assert not spread.collections, "runs of a grid are no draws, which would have a confidence"


def test_there_is_a_band_of_confidence_unless_a_curve_has_several_runs_of_a_draw(tmp_path: Path) -> None:
    gains = '<vary name="gain" cross="yes" select="//gain[@name=\'K_p\']/@value"><list values="5, 10"/></vary>'
    sample = '<sample method="random" runs="4"/>'
    for vary, bands in ((LAWS + UNIFORM, 2), (gains + UNIFORM, 0)):
        made = outcome(tmp_path, vary, sample, [float(number) for number in range(8)], [PASSED] * 8)
        assert len(draw(made).axes[0].collections) == bands


def test_a_broken_run_is_the_worst_at_its_place_also_where_less_is_worse(tmp_path: Path) -> None:
    seeds = '<vary name="seed" select="simulation/@seed"><range from="1" to="3"/></vary>'
    figures = [1.0, math.nan, 2.0, 4.0, 4.0, 4.0, 5.0, 6.0, 7.0]
    statuses = [BROKEN if math.isnan(figure) else PASSED for figure in figures]
    near = '<measure name="near" figure="distance" unit="mm"/>'
    made = outcome(tmp_path, X + seeds, '<sample method="grid"/>', figures, statuses, rest=near)
    median, broken = draw(made).axes[1].lines
    assert median.get_ydata().tolist() == [1.0, 4.0, 6.0]
    assert broken.get_xdata().tolist() == [0.0]


def test_each_of_a_few_cases_has_a_curve(tmp_path: Path) -> None:
    figures = [1.0, 10.0, 2.0, 20.0, 3.0, 30.0]
    made = outcome(tmp_path, X + LAWS, '<sample method="grid"/>', figures, [PASSED] * 6)
    spread, curve = draw(made).axes
    assert [line.get_ydata().tolist() for line in curve.lines[:2]] == [[1.0, 2.0, 3.0], [10.0, 20.0, 30.0]]
    for panel in (spread, curve):
        assert [text.get_text() for text in panel.get_legend().get_texts()] == ["a", "b"]


def test_a_bound_that_is_of_some_runs_alone_says_of_which(tmp_path: Path) -> None:
    given = '<given vary="law" is="b"/>'
    wanted = f'<worst of="last" below="40 mm"/><worst of="last" below="20 mm">{given}</worst>'
    vary = X.replace("<vary ", '<vary cross="yes" ')
    quantile = f'<quantile of="last" at="0.5" below="35 mm" confidence="0.5">{given}</quantile>'
    rest, seeds = LAST + wanted + quantile, SEEDS
    figures = [float(number) for number in range(12)]
    made = outcome(tmp_path, vary + LAWS + seeds, '<sample method="random" runs="2"/>', figures, [PASSED] * 12, rest)
    (shown,) = (one for one in requirements_of(made.study) if one.text.startswith("0.5 quantile"))
    made = replace(made, verdicts=(shown.judge(made.rows),))
    panels = draw(made).axes
    told = [text.get_text() for text in panels[0].get_legend().get_texts()]
    assert told[:2] == ["a", "b"]
    assert told[2].startswith("0.5 quantile given law b: at most ")
    assert [(text.get_text(), text.xy[0]) for text in panels[0].texts] == [("given law b", 20.0), ("given law b", 35.0)]
    of_laws = outcome(tmp_path, X + LAWS, '<sample method="grid"/>', figures[:6], [PASSED] * 6, LAST + wanted)
    curve = draw(of_laws).axes[1]
    assert [(text.get_text(), text.xy[1]) for text in curve.texts] == [("given law b", 20.0)]
    assert [line.get_ydata()[0] for line in curve.lines[-2:]] == [40.0, 20.0]
    bounds = json.loads(as_json(made))["bounds"]
    assert [bound.get("given") for bound in bounds] == [None, "given law b", "given law b"]


def test_one_at_a_time_is_a_tornado(tmp_path: Path) -> None:
    figures = [5.0, 4.0, 5.5, 6.0, 9.0, math.inf]
    made = outcome(tmp_path, X + HEAVY, '<sample method="one_at_a_time"/>', figures, [PASSED] * 6)
    (panel,) = draw(made).axes
    assert [text.get_text() for text in panel.get_yticklabels()] == ["mass", "x"], "the widest first"
    bars = [(bar.get_x(), bar.get_x() + bar.get_width()) for bar in panel.patches]
    assert bars == [(5.0, 5.0), (5.0, 9.0), (5.0, 4.0), (5.0, 6.0)]
    told = [text.get_text().strip() for text in panel.texts]
    assert told == ["", "25 kg", "no figure: 30 kg", "0 m", "2 m"]
    assert set(panel.lines[0].get_xdata()) == {5.0}


def test_a_sensitivity_has_bars_with_intervals(tmp_path: Path) -> None:
    vary = UNIFORM + X.replace('<list values="0 m, 1 m, 2 m"/>', '<uniform from="0 m" to="2 m"/>')
    study = small_study(tmp_path, vary, '<sample method="saltelli" runs="64"/>', LAST)
    rows = [
        Row("", run.number, run.draw, run.values, PASSED, (quantity(run.values[1] or "", "m"),), (), "")
        for run in Plan(study)
    ]
    bars, scatter = draw(StudyOutcome(study, tuple(rows), 64, (), 64, False)).axes
    assert [text.get_text() for text in bars.get_yticklabels()] == ["x", "mass"]
    assert bars.get_xlabel() == "share of the variance of last"
    assert [text.get_text() for text in bars.get_legend().get_texts()] == ["in all", "alone"]
    total = [bar.get_width() for bar in bars.containers[1]]
    assert total[0] > 0.8
    assert abs(total[1]) < 1e-9
    assert (scatter.get_xlabel(), scatter.get_ylabel()) == ("x [m]", "last [mm]")


@pytest.mark.parametrize("rest", ["", LAST])
def test_whatever_the_study_there_is_a_picture(tmp_path: Path, rest: str) -> None:
    study = small_study(tmp_path, rest=rest)
    assert picture(StudyOutcome(study, (), 6, (), 0, False)).startswith(b"\x89PNG")
    broken = Row("", 1, 1, ("30 kg", "7"), BROKEN, (math.nan,) * len(study.measures), (), "x")
    assert picture(StudyOutcome(study, (broken,), 6, (), 0, False)).startswith(b"\x89PNG")
