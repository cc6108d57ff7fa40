"""A sensitivity finds what is known: functions stand in for the runs, from the draws to the indices."""

import io
import json
import math
import re
import sys
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from rich.console import Console

from cosim.cli.indices import print_sensitivities
from cosim.errors import InputError
from cosim.quantity import split
from cosim.results.files import save
from cosim.studies.conduct import StudyOutcome, check_study
from cosim.studies.plan import Plan
from cosim.studies.requirements import requirements_of
from cosim.studies.row import BROKEN, FAILED, PASSED, Row
from cosim.studies.sensitivity import Sensitivity
from cosim.studies.summary import as_json
from cosim.studies.table import as_result
from cosim.tests.studies import LAST, SEEDS, small_study

PI = repr(math.pi)


def value(name: str, place: str, values: str) -> str:
    return f'<vary name="{name}" select="leader/pose/@{place}">{values}</vary>'


def uniform(least: str, greatest: str) -> str:
    return f'<uniform from="{least}" to="{greatest}"/>'


ANGLES = "".join(
    value(name, place, uniform(f"-{PI} {unit}", f"{PI} {unit}"))
    for name, place, unit in (("a", "x", "m"), ("b", "y", "m"), ("c", "psi", "rad"))
)
LAWS = '<vary name="law" cross="yes"><case name="one"/><case name="two"/></vary>'


def outcome(
    folder: Path,
    vary: str,
    sample: str,
    figure: Callable[..., float],
    lost: Sequence[int] = (),
    runs: int | None = None,
) -> StudyOutcome:
    """Return what comes of a study whose figures are a function of its values, each as it would reach a run."""
    study = small_study(folder, vary, f"<sample {sample}/>")
    plan = Plan(study)
    rows = []
    for run in (plan[index] for index in range(runs or len(plan))):
        numbers = [split(text)[0] if re.match(r"[-.\d]", str(text)) else text for text in run.values]
        broken = run.number in lost
        made = math.nan if broken else figure(*numbers)
        rows.append(Row("", run.number, run.draw, run.values, BROKEN if broken else PASSED, (made,), (), ""))
    return StudyOutcome(study, tuple(rows), len(plan), (), len(rows), False)


def sensitivity(*given: object, **named: object) -> Sensitivity:
    (found,) = (one for one in outcome(*given, **named).sensitivities if one.measure == "last")  # type: ignore[arg-type]
    return found


def ishigami(a: float, b: float, c: float) -> float:
    return math.sin(a) + 7.0 * math.sin(b) ** 2 + 0.1 * c**4 * math.sin(a)


def test_indices_of_ishigami_s_function_are_the_known_ones(tmp_path: Path) -> None:
    parts = np.array([0.5 * (1.0 + 0.1 * math.pi**4 / 5.0) ** 2, 7.0**2 / 8.0, 0.0])
    pair = 0.1**2 * math.pi**8 * (1 / 18 - 1 / 50)
    whole = parts.sum() + pair
    found = sensitivity(tmp_path, ANGLES, 'method="saltelli" runs="8192" second_order="yes"', ishigami)
    assert (found.groups, found.left_out, found.note) == (1024, 0, "")
    known = {
        "first": parts / whole,
        "total": (parts + np.array([pair, 0.0, pair])) / whole,
    }
    for name, expected in known.items():
        off = np.abs(np.array(found.figures[name]) - expected)
        assert (off <= np.array(found.figures[f"{name}_plus_minus"])).all(), "within the interval"
        assert off.max() < 0.02
    pairs = {("a", "b"): 0.0, ("a", "c"): pair / whole, ("b", "c"): 0.0}
    assert list(found.pairs) == list(pairs)
    for names, expected in pairs.items():
        index, plus_minus = found.pairs[names]
        assert abs(index - expected) <= plus_minus
        assert abs(index - expected) < 0.05


def test_indices_of_a_linear_model_are_its_shares_of_the_variance_whatever_the_distributions(tmp_path: Path) -> None:
    vary = (
        value("flat", "x", uniform("2 m", "6 m"))
        + value("bell", "y", '<normal mean="3 m" deviation="50 cm"/>')
        + value("ratio", "psi", '<log_uniform from="0.1 rad" to="1 rad"/>')
        + '<vary name="two" select="follower[1]/pose/@x"><list values="1 m, 3 m"/></vary>'
        + SEEDS
    )

    def linear(flat: float, bell: float, ratio: float, two: float, seed: float) -> float:
        return flat - 2.0 * bell + 3.0 * math.log10(ratio) + two + 0.0 * seed

    found = sensitivity(tmp_path, vary, 'method="saltelli" runs="4000" seed="3"', linear)
    assert found.names == ("flat", "bell", "ratio", "two", "seed")
    parts = np.array([4.0**2 / 12, (2.0 * 0.5) ** 2, 3.0**2 / 12, 1.0, 0.0])
    for name in ("first", "total"):
        off = np.abs(np.array(found.figures[name]) - parts / parts.sum())
        assert (off <= np.array(found.figures[f"{name}_plus_minus"])).all()
        assert off.max() < 0.02
    assert found.groups == 512


def test_effects_of_a_linear_model_are_its_changes_over_each_range(tmp_path: Path) -> None:
    vary = (
        value("flat", "x", uniform("2 m", "6 m"))
        + value("none", "y", uniform("0 m", "1 m"))
        + value("ratio", "psi", '<log_uniform from="0.1 rad" to="1 rad"/>')
        + SEEDS
    )

    def model(flat: float, none: float, ratio: float, seed: float) -> float:
        return -2.0 * flat + 3.0 * math.log10(ratio) + seed

    found = sensitivity(tmp_path, vary, 'method="morris" runs="104"', model)
    assert found.groups == 20  # of 5 runs each
    assert found.figures["mean"] == pytest.approx((-8.0, 0.0, 3.0, 1.0), abs=1e-8), "of a count, its step"
    assert found.figures["mean_absolute"] == pytest.approx((8.0, 0.0, 3.0, 1.0), abs=1e-8)
    assert found.figures["deviation"] == pytest.approx((0.0,) * 4, abs=1e-8)


def test_effects_that_depend_on_other_values_deviate(tmp_path: Path) -> None:
    found = sensitivity(tmp_path, ANGLES, 'method="morris" runs="400"', lambda a, b, c: 3.0 * a + b * c)
    mean, deviation = (dict(zip(found.names, found.figures[name], strict=True)) for name in ("mean", "deviation"))
    assert mean["a"] == pytest.approx(3.0 * 2.0 * math.pi)
    assert deviation["a"] == pytest.approx(0.0, abs=1e-6)
    assert min(deviation["b"], deviation["c"]) > 1.0


# The draws ----------------------------------------------------------------------------------------------------


def values_of(folder: Path, vary: str, sample: str) -> list[list[str | None]]:
    return [list(run.values) for run in Plan(small_study(folder, vary, f"<sample {sample}/>"))]


@pytest.mark.parametrize("more", ["", ' second_order="yes"'])
def test_a_group_of_saltelli_has_one_value_of_the_other_point(tmp_path: Path, more: str) -> None:
    runs = values_of(tmp_path, ANGLES + SEEDS, f'method="saltelli" runs="999"{more}')
    size = 10 if more else 6
    assert len(runs) == size * (64 if more else 128), "a whole power of 2"
    for begin in range(0, len(runs), size):
        one, *between, other = runs[begin : begin + size]
        assert all(own != its for own, its in zip(one, other, strict=True))
        for place in range(4):
            assert between[place] == [*one[:place], other[place], *one[place + 1 :]]
            if more:
                assert between[4 + place] == [*other[:place], one[place], *other[place + 1 :]]
    seeds = {int(str(run[3])) for run in runs}
    assert seeds == set(range(7, 7 + 2 * len(runs) // size)), "of each point its own"


@pytest.mark.parametrize("method", ["saltelli", "morris"])
def test_more_runs_keep_those_that_are_there(tmp_path: Path, method: str) -> None:
    few, many = (values_of(tmp_path, ANGLES + SEEDS, f'method="{method}" runs="{runs}"') for runs in (48, 96))
    assert many[: len(few)] == few
    assert few != values_of(tmp_path, ANGLES + SEEDS, f'method="{method}" runs="48" seed="1"')


def test_a_trajectory_changes_each_value_once_by_two_thirds_of_its_range(tmp_path: Path) -> None:
    vary = value("x", "x", uniform("0 m", "3 m")) + value("y", "y", uniform("0 m", "3 m")) + SEEDS
    runs = values_of(tmp_path, vary, 'method="morris" runs="43"')
    assert len(runs) == 40
    for begin in range(0, 40, 4):
        group = runs[begin : begin + 4]
        changed = [[place for place in range(3) if one[place] != next_one[place]] for one, next_one in pairwise(group)]
        assert sorted(changed) == [[0], [1], [2]]
        for place in (0, 1):
            numbers = [split(str(run[place]))[0] for run in group]
            assert max(numbers) - min(numbers) == pytest.approx(2.0)
            assert {round(number, 9) for number in numbers} <= {0.0, 1.0, 2.0, 3.0}
        assert (group[0][2], group[-1][2]) == (str(7 + begin // 2), str(8 + begin // 2))


# What is left out, and what is refused ------------------------------------------------------------------------


def test_groups_with_a_broken_run_are_left_out_and_said(tmp_path: Path) -> None:
    sample = 'method="saltelli" runs="320"'
    whole, few, many = (
        sensitivity(tmp_path, ANGLES, sample, ishigami, lost=lost) for lost in ((), (3, 4, 11), range(1, 320, 15))
    )
    assert (whole.groups, whole.left_out, whole.note) == (64, 0, "")
    assert (few.groups, few.left_out) == (62, 2)
    assert few.note == "said of the others only: 2 of 64 groups of runs have a run without a figure"
    assert few.figures["first"] == pytest.approx(whole.figures["first"], abs=0.2)
    assert (many.left_out, many.figures) == (22, {})
    assert many.note == "22 of 64 groups of runs have a run without a figure, which is too many"


def test_a_figure_that_is_infinite_is_none(tmp_path: Path) -> None:
    found = sensitivity(tmp_path, ANGLES, 'method="morris" runs="160"', lambda a, b, c: math.inf if a > 3 else a)
    assert found.figures == {}
    assert "without a figure, which is too many" in found.note


def test_what_is_the_same_in_all_runs_depends_on_nothing(tmp_path: Path) -> None:
    found = sensitivity(tmp_path, ANGLES, 'method="saltelli" runs="40"', lambda *_: 3.0)
    assert (found.figures, found.note) == ({}, "the same in all runs")


def test_a_first_look_counts_whole_groups(tmp_path: Path) -> None:
    found = sensitivity(tmp_path, ANGLES, 'method="saltelli" runs="320"', ishigami, runs=44)
    assert (found.groups, found.left_out) == (8, 0)
    found = sensitivity(tmp_path, ANGLES, 'method="saltelli" runs="320"', ishigami, runs=16)
    assert found.note == "only 3 groups of runs are there, and 4 are needed"


def test_each_value_that_is_crossed_has_indices_of_its_own(tmp_path: Path) -> None:
    def model(a: float, b: float, c: float, law: str) -> float:
        return a if law == "one" else b

    made = outcome(tmp_path, ANGLES + LAWS, 'method="saltelli" runs="160"', model)
    assert made.planned == 320
    one, two = made.sensitivities
    assert (one.cases, two.cases, one.groups) == (("one",), ("two",), 32)
    assert np.argmax(one.figures["total"]) == 0
    assert np.argmax(two.figures["total"]) == 1


def test_whether_a_run_passes_is_a_measure(tmp_path: Path) -> None:
    made = outcome(tmp_path, ANGLES, 'method="saltelli" runs="640"', ishigami)
    rows = tuple(
        Row("", row.number, row.draw, row.values, PASSED if "-" in str(row.values[1]) else FAILED, (1.0,), (), "")
        for row in made.rows
    )
    _, passed = StudyOutcome(made.study, rows, made.planned, (), 0, False).sensitivities
    assert passed.measure == "passed"
    assert passed.figures["total"] == pytest.approx((0.0, 1.0, 0.0), abs=0.05)


ONE = value("a", "x", uniform("0 m", "1 m"))
BAD = {
    "one value": (ONE, 'method="saltelli" runs="99"', "two or more have to vary, not 1"),
    "crossed alone": (LAWS, 'method="morris" runs="99"', "two or more have to vary, not 0"),
    "too few": (
        ANGLES,
        'method="saltelli" runs="19"',
        'needs 5 runs at a time for 3 values, and at least 4 times: give runs="20"',
    ),
    "no runs": (ANGLES, 'method="morris"', "needs runs"),
    "always the same": (
        ONE + value("b", "y", '<list values="1 m"/>'),
        'method="morris" runs="99"',
        "'b' is always the same",
    ),
    "no range": (
        ONE + value("b", "y", '<list values="1 m, 2 m"/>'),
        'method="morris" runs="99"',
        "'b' has no range",
    ),
    "no end": (
        ONE + value("b", "y", '<normal mean="1 m" deviation="1 m" from="0 m"/>'),
        'method="morris" runs="99"',
        "'b' has no end",
    ),
    "pairs": (ANGLES, 'method="morris" runs="99" second_order="yes"', 'only method="saltelli" has them'),
    "too many": (
        ANGLES,
        'method="saltelli" runs="9000000000"',
        "5,368,709,120 draws, which is more than 1,000,000 runs, the most of a study: at 0.1 s a run, they would take "
        "a processor 17 years",
    ),
}


@pytest.mark.parametrize(("vary", "sample", "said"), BAD.values(), ids=BAD)
def test_sensitivities_that_make_no_sense(tmp_path: Path, vary: str, sample: str, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        Plan(small_study(tmp_path, vary, f"<sample {sample}/>"))
    assert caught.value.where is not None
    assert caught.value.where.file.endswith("study.xml")


def test_confidence_is_refused_of_runs_that_depend_on_each_other(tmp_path: Path) -> None:
    sample = '<sample method="saltelli" runs="40"/>'
    for text in (
        '<mean of="last" below="1 m" confidence="0.9"/>',
        '<probability of="passed" above="0.5" confidence="0.9"/>',
    ):
        study = small_study(tmp_path, ANGLES, sample, LAST + text)
        with pytest.raises(InputError, match="depend on each other") as caught:
            requirements_of(study)
        assert caught.value.where == study.requirements[0].where
    requirements_of(small_study(tmp_path, ANGLES, sample, LAST + '<worst of="last" below="1 m"/>'))


def test_a_package_that_is_missing_is_named_before_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "SALib", None)
    study = small_study(tmp_path, ANGLES, '<sample method="saltelli" runs="40"/>')
    with pytest.raises(
        InputError, match=r"needs the package 'SALib'.*pip install \"formation-cosim\[study\]\""
    ) as caught:
        check_study(study)
    assert caught.value.where == study.sample.where


# What is told -------------------------------------------------------------------------------------------------


def test_the_summary_the_dataset_and_the_terminal_tell_the_same(tmp_path: Path) -> None:
    made = outcome(tmp_path, ANGLES, 'method="saltelli" runs="512" second_order="yes"', ishigami)
    (found,) = made.sensitivities
    (told,) = json.loads(as_json(made))["sensitivity"]
    assert [value["first"] for value in told["values"]] == list(found.figures["first"])
    assert told["pairs"][1]["names"] == ["a", "c"]
    dataset = as_result(made).dataset
    assert dataset["sensitivity_total"].dims == ("measured", "varied")
    assert dataset["sensitivity_total"].sel(measured="last", varied="b") == found.figures["total"][1]
    second = dataset["sensitivity_second"].sel(measured="last")
    assert (
        second.sel(varied="a", with_varied="c") == second.sel(varied="c", with_varied="a") == found.pairs["a", "c"][0]
    )
    assert dataset["last"].dims == ("run",)
    save(as_result(made), tmp_path / "runs.nc")
    assert xr.load_dataset(tmp_path / "runs.nc").identical(dataset)
    console = Console(file=io.StringIO(), width=80)
    print_sensitivities(console, "saltelli", made.sensitivities)
    text = console.file.getvalue()
    assert f"{found.figures['total'][0]:.2f} ± {found.figures['total_plus_minus'][0]:.2f}" in text
    assert text.index(" a ") < text.index(" c ") < text.index("a with c")


def test_the_table_of_a_narrow_terminal_leaves_nothing_out(tmp_path: Path) -> None:
    long = "".join(value(f"mass_of_the_{place}_payload", place, uniform("0 m", "1 m")) for place in ("x", "y"))
    made = outcome(tmp_path, long, 'method="morris" runs="60"', lambda x, y: 1000.0 * x + y**2)
    console = Console(file=io.StringIO(), width=60, force_terminal=True, color_system=None)
    print_sensitivities(console, "morris", made.sensitivities)
    text = console.file.getvalue()
    assert max(map(len, text.splitlines())) <= 60
    assert "…" not in text
    for column in ("magnitude", "mean", "deviation"):
        assert len(re.findall(rf" {column} ", text)) == 1
    assert "1000 ±" in text


def test_crossed_values_are_a_dimension(tmp_path: Path) -> None:
    made = outcome(tmp_path, ANGLES + LAWS, 'method="morris" runs="80"', lambda a, b, c, law: a)
    save(as_result(made), tmp_path / "runs.nc")
    mean = xr.load_dataset(tmp_path / "runs.nc")["sensitivity_mean"]
    assert mean.identical(as_result(made).dataset["sensitivity_mean"])
    assert mean.dims == ("crossed", "measured", "varied")
    assert mean.sel(crossed="two", measured="last", varied="a") == pytest.approx(2 * math.pi)
