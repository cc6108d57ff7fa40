"""Which runs a study has, and what is refused in its file."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtri

from cosim import run
from cosim.errors import InputError
from cosim.quantity import quantity
from cosim.studies.conduct import check_study, conduct
from cosim.studies.duration import estimated, keep_pace, told_duration
from cosim.studies.plan import Plan, Run
from cosim.studies.reader import read_study
from cosim.studies.reproduce import as_variant
from cosim.studies.requirements import requirements_of
from cosim.studies.sizes import in_words
from cosim.studies.values import Finite, has_spread
from cosim.tests.studies import LAST, MASS, SEEDS, UNIFORM, small_study

GRID = '<sample method="grid"/>'
X = '<vary name="x" select="leader/pose/@x"><list values="0 m, 1 m"/></vary>'
Y = '<vary name="y" select="leader/pose/@y"><grid from="1 m" to="100 m" points="3" scale="log"/></vary>'
LAWS = """<vary name="law" cross="yes">
  <case name="soft"><set select="//gain[@name='K_p']/@value" value="1"/></case>
  <case name="stiff"><set select="//gain[@name='K_p']/@value" value="20"/></case>
</vary>"""


def plan(folder: Path, *parts: str, **named: str) -> list[Run]:
    return list(Plan(small_study(folder, *parts, **named)))


def values(runs: list[Run]) -> list[tuple[str | None, ...]]:
    return [run.values for run in runs]


def test_a_grid_has_all_combinations_in_the_order_of_the_file(tmp_path: Path) -> None:
    runs = plan(tmp_path, X + Y + SEEDS, GRID)
    assert values(runs) == [
        ("0 m", "1 m", "7"),
        ("0 m", "10 m", "8"),
        ("0 m", "100 m", "9"),
        ("1 m", "1 m", "10"),
        ("1 m", "10 m", "11"),
        ("1 m", "100 m", "12"),
    ]
    assert runs[4].changes == ("leader/pose/@x=1 m", "leader/pose/@y=10 m", "simulation/@seed=11")
    assert [run.number for run in runs] == [1, 2, 3, 4, 5, 6]


@pytest.mark.parametrize("kind", ["plant/parameter[@name='m_f']", "controller/gain[@name='guard']"])
def test_a_value_that_the_scenario_leaves_out_may_vary(tmp_path: Path, kind: str) -> None:
    study = small_study(tmp_path, f'<vary name="one" select="{kind}/@value"><list values="12"/></vary>', GRID)
    assert next(iter(study.own.values())) == {f"{kind}/@value": ""}
    assert next(iter(Plan(study))).changes == (f"{kind}/@value=12",)


def test_one_at_a_time_leaves_the_others_as_they_are(tmp_path: Path) -> None:
    runs = plan(tmp_path, X + Y, '<sample method="one_at_a_time"/>')
    assert values(runs) == [
        (None, None),
        ("0 m", None),
        ("1 m", None),
        (None, "1 m"),
        (None, "10 m"),
        (None, "100 m"),
    ]
    assert runs[0].changes == ()


def test_a_value_that_the_scenario_has_is_the_scenario_as_it_is(tmp_path: Path) -> None:
    seeds = SEEDS.replace('<count from="7"/>', '<range from="1" to="2"/>')
    runs = plan(tmp_path, seeds, '<sample method="one_at_a_time"/>')
    assert values(runs) == [(None,), ("1",), ("2",)]
    assert [run.changes for run in runs] == [(), (), ("simulation/@seed=2",)]


@pytest.mark.parametrize("texts", ["1 2, 1 3", "3rd, 4th", "a.csv, b.csv", "1 m, 100 cm, 5 N"])
def test_texts_of_any_kind_have_a_spread(texts: str) -> None:
    assert has_spread(Finite(tuple(texts.split(", "))))
    assert not has_spread(Finite(("1 m", "100 cm")))


@pytest.mark.parametrize("method", ["random", "sobol"])
def test_more_draws_leave_the_first_ones_as_they_are(tmp_path: Path, method: str) -> None:
    few, many = (plan(tmp_path, UNIFORM + SEEDS, f'<sample method="{method}" runs="{n}" seed="3"/>') for n in (5, 70))
    assert few == many[:5]
    other = plan(tmp_path, UNIFORM, f'<sample method="{method}" runs="5" seed="4"/>')
    assert [run.values[0] for run in few] != [run.values[0] for run in other]


@pytest.mark.parametrize("method", ["latin_hypercube", "sobol"])
def test_draws_fill_their_range_evenly(tmp_path: Path, method: str) -> None:
    runs = plan(tmp_path, UNIFORM + X, f'<sample method="{method}" runs="64"/>')
    masses = [quantity(run.values[0] or "", "kg") for run in runs]
    counts, _ = np.histogram(masses, 64, (25.0, 40.0))
    assert counts.tolist() == [1] * 64
    assert [run.values[1] for run in runs].count("0 m") == 32


def test_a_crossed_value_shares_the_draws(tmp_path: Path) -> None:
    runs = plan(tmp_path, UNIFORM + LAWS + SEEDS)
    assert len(runs) == 12
    assert [run.draw for run in runs[:4]] == [1, 1, 2, 2]
    assert [run.cases for run in runs[:4]] == [(0,), (1,), (0,), (1,)]
    assert runs[0].values[::2] == runs[1].values[::2]
    assert runs[0].values[1] == "soft"


def test_random_values_have_their_distribution(tmp_path: Path) -> None:
    normal = f'<vary name="m" select="{MASS}"><normal mean="30 kg" deviation="2000 g" from="27 kg" to="34 kg"/></vary>'
    log = '<vary name="a" select="//gain[@name=\'K_p\']/@value"><log_uniform from="0.1" to="10"/></vary>'
    runs = plan(tmp_path, normal + log, '<sample method="sobol" runs="1024"/>')
    masses = np.sort([quantity(run.values[0] or "", "kg") for run in runs])
    low, high = (float(ndtri_inverse((end - 30) / 2)) for end in (27, 34))
    expected = 30 + 2 * ndtri(low + (high - low) * (np.arange(1024) + 0.5) / 1024)
    assert np.abs(masses - expected).max() < 0.03
    gains = np.sort([math.log10(float(run.values[1] or "")) for run in runs])
    assert np.abs(gains - np.linspace(-1, 1, 1024)).max() < 0.01
    assert all(len(re.sub(r"\D", "", value or "")) <= 12 for run in runs for value in run.values)


def ndtri_inverse(at: float) -> float:
    return 0.5 * math.erfc(-at / math.sqrt(2))


def test_other_places_follow_from_the_same_draw(tmp_path: Path) -> None:
    also = """<also select="plant/parameter[@name='I_c']/@value" factor="0.5 m2" offset="1 kg.m2"/>
              <also select="leader/pose/@psi" factor="1 deg/kg"/>"""
    vary = (
        UNIFORM.replace("</vary>", f"{also}</vary>").replace("uniform", "grid").replace("/><also", ' points="2"/><also')
    )
    runs = plan(tmp_path, vary, GRID)
    assert runs[0].changes == (
        f"{MASS}=25 kg",
        "plant/parameter[@name='I_c']/@value=13.5 kg.m2",
        "leader/pose/@psi=0.436332313 rad",
    )
    assert runs[1].values == ("40 kg",)


def test_a_case_may_be_another_scenario(tmp_path: Path) -> None:
    cases = """<vary name="which"><case name="here"/><case name="there" of="other.xml"/></vary>"""
    study_file = tmp_path / "other.xml"
    small_study(tmp_path)
    study_file.write_text((tmp_path / "base.xml").read_text().replace("0.2 s", "0.4 s"))
    study = small_study(tmp_path, cases, GRID)
    assert [scenario.ticks for scenario in study.bases.values()] == [10, 20]


def test_measures_are_expectations_of_the_scenario_that_do_not_count(tmp_path: Path) -> None:
    study = small_study(tmp_path)
    (scenario,) = study.bases.values()
    assert [one.kind for one in scenario.expectations] == ["final", "final"]
    assert scenario.expectations[1].where == study.measures[0].where
    assert scenario.expectations[1].where.file.endswith("study.xml")


BAD_VALUES = {
    "values=": ('<list values="1 m,,2 m"/>', "empty value"),
    "twice": ('<list values="1 m, 1 m"/>', "'1 m' is given twice"),
    "twice in other words": ('<list values="1 m, 2 m, 100 cm"/>', "'1 m' and '100 cm' are the same value"),
    "a seed twice": ('<list values="1, 01"/>', "'1' and '01' are the same value"),
    "a great seed twice": ('<list values="12345678901, 12345678902, +12345678901"/>', "'12345678901' and "),
    "not the same": ('<list values="30 kg, 30.0000000001 kg, 0.5, 0.5 1, 0.50, a, a"/>', "'a' is given twice"),
    "ends": ('<uniform from="2 m" to="1 m"/>', "is greater than to="),
    "units": ('<uniform from="2 m" to="3 kg"/>', "does not fit"),
    "logarithm": ('<log_uniform from="0 m" to="1 m"/>', "no logarithm"),
    "one point": ('<grid from="0 m" to="1 m" points="1"/>', "2 points or more"),
    "many points": (
        '<grid from="0 m" to="1 m" points="1000000000"/>',
        "1,000,000,000 points, more than 1,000,000 runs, .* a processor 3.2 years",
    ),
    "range": ('<range from="9" to="1"/>', "exchange from and to"),
    "deviation": ('<normal mean="1 m" deviation="0 m"/>', "greater than zero"),
    "cut": ('<normal mean="1 m" deviation="1 m" from="3 m" to="2 m"/>', "nothing is between"),
    "far cut": ('<normal mean="1 m" deviation="1 mm" from="3 m" to="4 m"/>', "less than one in a million"),
    "no number": ('<uniform from="one" to="2 m"/>', "not a number"),
}


@pytest.mark.parametrize(("values", "said"), BAD_VALUES.values(), ids=BAD_VALUES)
def test_values_that_make_no_sense(tmp_path: Path, values: str, said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        small_study(tmp_path, f'<vary name="x" select="leader/pose/@x">{values}</vary>')
    assert caught.value.where is not None
    assert caught.value.where.line == 3


BAD_STUDIES = {
    "selects nothing": ((X.replace("@x", "@nowhere"),), "selects nothing"),
    "selects two": ((X.replace("leader/pose", "//pose"),), "selects 5 nodes: expected one"),
    "same place": ((X + X.replace('"x"', '"again"'),), "what the value 'x' has already"),
    "same name": ((X + X,), "the value 'x' is given twice"),
    "nowhere": ((X.replace('select="leader/pose/@x"', ""),), "nothing gets the value 'x'"),
    "cases with a place": ((LAWS.replace("cross", 'select="leader/pose/@x" cross'),), "leave select"),
    "case twice": ((LAWS.replace("stiff", "soft"),), "the case 'soft' is given twice"),
    "case of nothing": ((LAWS.replace("K_p", "K_q").replace("//gain", "//nogain"),), "selects nothing"),
    "random grid": ((UNIFORM, GRID), "is random"),
    "another seed for each value": ((X + SEEDS, GRID.replace("grid", "one_at_a_time")), "give a <range>"),
    "runs of a grid": ((X, '<sample method="grid" runs="3"/>'), "leave runs=... out"),
    "no runs": ((X, '<sample method="random"/>'), "needs runs"),
    "crossed random": ((UNIFORM.replace("<vary", '<vary cross="yes"'),), "has no end"),
    "factor of a word": (
        (
            '<vary name="d" select="leader/pose/@x"><list values="a, b"/>'
            '<also select="leader/pose/@y" factor="2"/></vary>',
        ),
        "'a' is not a number",
    ),
    "measure without signal": ((X, GRID, '<measure name="a" figure="rms" unit="m"/>'), "needs signal"),
    "measure without unit": ((X, GRID, '<measure name="a" figure="rms" signal="range_error"/>'), "needs unit"),
    "measure with bands": ((X, GRID, LAST.replace("signal", 'range="1 m" signal')), "has no range"),
    "measure of a column": ((X, GRID, LAST.replace('"last"', '"margin_2"')), "has another 'margin_2'"),
    "value of a column": ((X.replace('"x"', '"status"'),), "has another 'status'"),
    "measure as a value": ((X, GRID, LAST.replace('"last"', '"x"')), "a value is named 'x', too"),
    "measure twice": ((X, GRID, LAST + LAST), "the measure 'last' is given twice"),
}


@pytest.mark.parametrize(("parts", "said"), BAD_STUDIES.values(), ids=BAD_STUDIES)
def test_studies_that_make_no_sense(tmp_path: Path, parts: tuple[str, ...], said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        small_study(tmp_path, *parts)
    assert caught.value.where is not None
    assert caught.value.where.file.endswith("study.xml")
    assert caught.value.where.line > 2


def test_a_study_that_is_too_large_is_refused_with_its_size(tmp_path: Path) -> None:
    large = X.replace('<list values="0 m, 1 m"/>', '<grid from="0 m" to="1 m" points="100000"/>')
    with pytest.raises(InputError, match=r"1,000,000,000 draws.*more than 1,000,000 runs.*processor 3\.2 years"):
        Plan(small_study(tmp_path, large + Y.replace('points="3"', 'points="10000"'), GRID))


HORIZONS = '<vary name="end" select="simulation/@horizon"><list values="0.2 s, 0.4 s"/></vary>'
LATER = '<measure name="later" figure="rms" signal="range_error" unit="m" to="0.4 s"/>'


def test_a_window_is_checked_against_each_horizon_of_the_runs(tmp_path: Path) -> None:
    """The scenario as it is lasts for 0.2 s."""
    with pytest.raises(InputError, match=r"0 s to 0.4 s is not within the run of 0.2 s$"):
        check_study(small_study(tmp_path, UNIFORM, rest=LATER))
    with pytest.raises(InputError, match=r"0 s to 0.4 s is not within the run of 0.2 s$") as caught:
        check_study(small_study(tmp_path, HORIZONS, GRID, LATER))
    assert caught.value.where is not None
    assert caught.value.where.file.endswith("study.xml")
    check_study(small_study(tmp_path, HORIZONS.replace("0.2 s", "0.6 s"), GRID, LATER))
    longer = HORIZONS.replace("0.2 s", "0.6 s").replace("0.4 s", "0.38 s")
    with pytest.raises(InputError, match=r"run of 0.38 s \(with a horizon of 0.38 s in steps of 0.02 s\)$"):
        check_study(small_study(tmp_path, longer, GRID, LATER))
    cases = """<vary name="end" cross="yes"><case name="long"><set select="simulation/@horizon" value="0.4 s"/></case>
      <case name="short"/></vary>"""
    with pytest.raises(InputError, match=r"run of 0.2 s \(in the case short\)$"):
        check_study(small_study(tmp_path, cases, GRID, LATER))


@pytest.mark.parametrize(
    ("place", "said"),
    [
        (MASS, r"m_c of .*: '1 s': s does not fit.* \(run 1 cannot begin, with x 1 s, law soft, and no other that"),
        (MASS.replace("m_c", "m_d"), "has no parameter 'm_d': did you mean"),
    ],
)
def test_a_study_of_which_no_run_can_begin_is_refused(tmp_path: Path, place: str, said: str) -> None:
    values = f'<vary name="x" select="{place}"><list values="1 s, 2 s, 3 s"/></vary>'
    with pytest.raises(InputError, match=said):
        check_study(small_study(tmp_path, values + LAWS, GRID))
    check_study(small_study(tmp_path, values.replace(place, MASS).replace("2 s", "2 kg"), GRID))


def test_a_window_may_begin_after_the_scenario_s_own_end_if_every_run_is_longer(tmp_path: Path) -> None:
    late = LATER.replace('to="0.4 s"', 'from="0.3 s"')
    longer = HORIZONS.replace("0.2 s", "0.6 s")
    study = small_study(tmp_path, longer, GRID, late)
    check_study(study)
    rows = conduct(study, tmp_path, workers=0).rows
    assert [row.status for row in rows] == ["passed", "passed"]
    alone = run(study.bases[()].edited(Plan(study)[1].changes))
    expected = np.sqrt((alone["range_error"].sel(time=slice(0.29, None)) ** 2).mean("time")).max()
    assert rows[1].measures[0] == pytest.approx(float(expected), rel=1e-12)
    for made in Plan(study):  # the longest horizon is that of the base, and not the scenario's own
        assert f'<set select="simulation/@horizon" value="{made.values[0]}"/>' in as_variant(study, made, tmp_path)
    with pytest.raises(InputError, match=r"at 0.3 s is after the end of the run at 0.2 s$"):
        small_study(tmp_path, longer, GRID.replace("grid", "one_at_a_time"), late)
    with pytest.raises(InputError, match=r"at 0.3 s is after the end .* \(with simulation/@horizon=0.28 s\)$"):
        check_study(small_study(tmp_path, longer.replace("0.4 s", "0.28 s"), GRID, late))


# How long ----------------------------------------------------------------------------------------------------


def test_how_long_a_study_takes_is_told_by_the_runs_before_or_by_its_size(tmp_path: Path) -> None:
    study = small_study(tmp_path)
    by_size = told_duration(study, 10_000, 2, tmp_path)
    assert re.fullmatch(r"about [\d.]+ (s|min) on 2 processes, by its steps and robots; --runs 20 measures it", by_size)
    keep_pace(tmp_path, 0.3)
    keep_pace(tmp_path, None)
    assert told_duration(study, 1000, 2, tmp_path) == "about 2.5 min on 2 processes, as fast as the runs before"
    assert told_duration(study, 1, 4, tmp_path) == "about 2 s on 4 processes, as fast as the runs before"
    (tmp_path / "pace.json").write_text("[]")
    assert told_duration(study, 10_000, 1, tmp_path).startswith("about ")


def test_the_size_of_a_study_decides_how_long_it_is_said_to_take(tmp_path: Path) -> None:
    """Ten times the steps take longer, of the order of ten times where runs are long."""
    seconds = []
    for horizon in ("1000 s", "10000 s"):
        small_study(tmp_path)
        base = tmp_path / "base.xml"
        base.write_text(base.read_text().replace('horizon="0.2 s"', f'horizon="{horizon}"'))
        seconds.append(min(estimated(read_study(tmp_path / "study.xml")) for _ in range(5)))
    assert 5.0 < seconds[1] / seconds[0] < 15.0


@pytest.mark.parametrize(
    ("seconds", "words"),
    [(0.1, "2 s"), (59.6, "60 s"), (200.0, "3.3 min"), (1500.0, "25 min"), (9000.0, "2.5 h"), (1e9, "32 years")],
)
def test_times_have_two_digits(seconds: float, words: str) -> None:
    assert in_words(seconds) == words


BAD_REQUIREMENTS = {
    "confidence": ('<probability of="passed" above="0.9" confidence="95"/>', "not between 0 and 1"),
    "measure": ('<worst of="lest" below="1 m"/>', "no measure 'lest': did you mean 'last'?"),
    "bounds": ('<worst of="last" below="1 m" above="1 m"/>', "needs one bound"),
    "unit": ('<mean of="last" below="1 kg" confidence="0.9"/>', "does not fit"),
    "vary": ('<better of="last" vary="x" case="a" than="b" confidence="0.9"/>', "nothing varies that is named 'x'"),
    "crossed": ('<better of="last" vary="mass" case="a" than="b" confidence="0.9"/>', "is not crossed"),
}


@pytest.mark.parametrize(("text", "said"), BAD_REQUIREMENTS.values(), ids=BAD_REQUIREMENTS)
def test_requirements_that_make_no_sense(tmp_path: Path, text: str, said: str) -> None:
    study = small_study(tmp_path, rest=LAST + text)
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        requirements_of(study)
    assert caught.value.where is not None


def test_a_scenario_is_no_study(tmp_path: Path) -> None:
    small_study(tmp_path)
    with pytest.raises(InputError, match="expected <study"):
        read_study(tmp_path / "base.xml")
