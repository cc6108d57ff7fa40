"""Studies that tune: the optimum of a known problem, the same trials however they are run, and what is refused."""

import csv
import io
import json
import math
import random
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

import cosim
from cosim.cli import main, studying
from cosim.cli.studying import best_trial
from cosim.errors import InputError
from cosim.studies.conduct import StudyOutcome, check_study, conduct
from cosim.studies.figure_tuning import picture
from cosim.studies.plan import Run
from cosim.studies.row import FAILED, PASSED, Row
from cosim.studies.store import FILE
from cosim.studies.study import Study
from cosim.studies.trial import Trial, is_worse, score
from cosim.studies.tuned_files import best_values, trials_csv, tuned_variant
from cosim.studies.tuning import Tuned
from cosim.studies.tuning_search import stages_of
from cosim.tests.studies import LAST, SEEDS, Played, small_study, write_study

GAINS = """<vary name="K_p" select="//gain[@name='K_p']/@value"><log_uniform from="0.1" to="1000"/></vary>
<vary name="k_d" select="//gain[@name='k_d']/@value"><uniform from="0" to="20"/></vary>"""
CASES = """<vary name="law" cross="yes">
  <case name="plain"/>
  <case name="soft"><set select="//gain[@name='epsilon_t']/@value" value="1"/></case>
</vary>"""


def tune(cost: str = '<cost of="last" per="10 mm"/>', **attributes: str) -> str:
    given = {
        "values": "K_p k_d",
        "evaluations": "150",
        "restarts": "2",
        "training": "1 to 3",
        "held_out": "11 to 18",
        "confidence": "0.95",
        **attributes,
    }
    return f"<tune {' '.join(f'{name}={value!r}' for name, value in given.items() if value)}>{cost}</tune>"


def bowl(run: Run, key: str) -> Row:
    """Return the row of a convex problem with its optimum at K_p = 3 and k_d = 15; the soft case is 1 mm better."""
    named = dict(zip(("K_p", "k_d"), (run.values[0], run.values[1]), strict=True))
    kp, kd = (float(named[name] or 10.0) for name in ("K_p", "k_d"))
    noise = random.Random(run.values[2]).uniform(0.0, 0.2)
    figure = 5.0 + math.log10(kp / 3.0) ** 2 + ((kd - 15.0) / 20.0) ** 2 + noise - ("soft" in run.values)
    return Row(key, run.number, run.draw, run.values, PASSED, (figure,), (1.0,), "", 1.0)


def played(
    folder: Path, patch: pytest.MonkeyPatch, study: Study, play: Callable[[Run, str], Row] = bowl
) -> StudyOutcome:
    (folder / "out").mkdir(exist_ok=True)
    return conduct(study, folder / "out", executor=Played(patch, play), workers=3)


@pytest.mark.parametrize("method", ["cma_es", "tpe"])
def test_the_optimum_of_a_convex_problem_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str) -> None:
    study = small_study(tmp_path, GAINS + SEEDS, tune(method=method, evaluations="240" if method == "cma_es" else "80"))
    outcome = played(tmp_path, monkeypatch, study)
    (tuned,) = outcome.tuned
    found = {name: float(value) for name, value in best_values(study, tuned).items()}
    near = 0.01 if method == "cma_es" else 0.15
    assert found["K_p"] == pytest.approx(3.0, rel=10 * near)
    assert found["k_d"] == pytest.approx(15.0, abs=20 * near)
    assert tuned.at_bounds == ()
    assert outcome.passed
    assert "in 8 of 8 pairs" in outcome.verdicts[0].detail
    assert tuned.trials[0].values == {0: None, 1: None}
    assert len(tuned.trials) == int(study.tune.evaluations if study.tune else 0)
    assert len(outcome.rows) == outcome.planned


def test_an_optimum_at_an_end_of_its_range_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    narrow = GAINS.replace('from="0.1"', 'from="5"').replace('to="20"', 'to="12"')
    outcome = played(tmp_path, monkeypatch, small_study(tmp_path, narrow + SEEDS, tune()))
    least, greatest = outcome.tuned[0].at_bounds
    assert re.fullmatch(r"K_p = 5(\.\d+)? is at the least value of its range: widen it", least)
    assert greatest.startswith("k_d = 12 is at the greatest value")


def test_trials_in_which_a_run_fails_come_after_all_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def steep(run: Run, key: str) -> Row:
        row = bowl(run, key)
        least = 0.5 * float(run.values[0] or 10.0) - 4.0  # K_p must be 8 or more
        return row if least > 0.0 else replace(row, status=FAILED, least=least, message="too soft")

    outcome = played(tmp_path, monkeypatch, small_study(tmp_path, GAINS + SEEDS, tune(evaluations="300")), steep)
    values = best_values(outcome.study, outcome.tuned[0])
    assert 8.0 < float(values["K_p"]) < 8.5
    assert outcome.passed


def test_what_is_not_better_on_other_draws_is_not_called_better(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lucky(run: Run, key: str) -> Row:
        """Return noise alone, of the draw and the values: some trial is better on the draws of training."""
        figure = random.Random(" ".join(map(str, run.values))).uniform(1.0, 2.0)
        return replace(bowl(run, key), measures=(figure,))

    known = tune(fails="no gain matters")
    outcome = played(tmp_path, monkeypatch, small_study(tmp_path, GAINS + SEEDS, known), lucky)
    (tuned,) = outcome.tuned
    assert tuned.best.score < tuned.trials[0].score
    assert not outcome.passed
    assert outcome.verdicts[0].as_marked


def test_pruning_saves_runs_and_finds_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wide = tune(training="1 to 20", held_out="101 to 120", evaluations="120")
    pruned = wide.replace("confidence", "prune='0.05' confidence")
    studies = [small_study(tmp_path, GAINS + SEEDS, text) for text in (wide, pruned)]
    whole, short = (played(tmp_path, monkeypatch, study) for study in studies)
    assert len(short.rows) < 0.6 * len(whole.rows)
    assert {len(trial.rows) for trial in short.tuned[0].trials} == {6, 20}
    assert short.tuned[0].best.score == pytest.approx(whole.tuned[0].best.score, rel=1e-3)
    assert not short.tuned[0].best.pruned
    studying._print(console := Console(file=io.StringIO(), width=120), short, [])
    assert isinstance(console.file, io.StringIO)
    assert "better than the scenario's own" in console.file.getvalue()
    assert "first look" not in console.file.getvalue()


def test_cases_are_tuned_alike_and_compared_on_the_same_draws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = '<vary name="extra" case="soft" select="//gain[@name=\'gamma_w\']/@value"><uniform from="1" to="20"/></vary>'
    better = '<better of="cost" vary="law" case="soft" than="plain" confidence="0.95"/>'
    text = tune(values="K_p k_d extra", cost='<cost of="last" per="10 mm"/><cost of="last"/>')
    study = small_study(tmp_path, GAINS + SEEDS + CASES + own, text, rest=LAST + better)
    outcome = played(tmp_path, monkeypatch, study)
    plain, soft = outcome.tuned
    assert [plain.name, soft.name] == ["plain", "soft"]
    assert len(plain.trials) == len(soft.trials) == 150
    assert (4 in plain.best.values, 4 in soft.best.values) == (False, True)
    assert [run.values[2] for run in plain.held_out] == [run.values[2] for run in soft.held_out]
    assert outcome.verdicts[-1].passed
    assert "in 8 of 8 pairs" in outcome.verdicts[-1].detail
    lines = list(csv.DictReader(trials_csv(study, study.tune, outcome.tuned).splitlines()))  # type: ignore[arg-type]
    assert [line["case"] for line in lines] == ["plain"] * 150 + ["soft"] * 150
    costs = [float(line["least_cost_so_far"]) for line in lines[:75]]
    assert costs == sorted(costs, reverse=True)
    name, xml = tuned_variant(study, soft, tmp_path)
    (tmp_path / name).write_text(xml)
    read = cosim.read_scenario(tmp_path / "tuned-soft.xml")
    gains = {gain.name: gain.value for gain in next(iter(read.controllers.values())).gains}
    assert gains["K_p"] == best_values(study, soft)["K_p"]
    assert gains["epsilon_t"] == "1"
    assert picture(outcome)[:4] == b"\x89PNG"


def test_an_entry_of_several_numbers_is_tuned_by_itself(tmp_path: Path) -> None:
    pair = "".join(
        f'<vary name="K_{at}" select="//gain[@name=\'K_p\']/@value" entry="{at}"><uniform from="1" to="30"/></vary>'
        for at in (1, 2)
    )
    path = write_study(tmp_path, pair + SEEDS, tune(values="K_1 K_2", evaluations="6", restarts="1", batch="5"))
    base = tmp_path / "base.xml"
    base.write_text(base.read_text().replace('name="K_p" value="10"', 'name="K_p" value="10 12"'))
    (tmp_path / "out").mkdir()
    outcome = conduct(cosim.studies.reader.read_study(path), tmp_path / "out", workers=0)
    assert {row.status for row in outcome.rows} == {PASSED}
    assert outcome.rows[0].measures != outcome.rows[3].measures
    base.write_text(base.read_text().replace("10 12", "10"))
    with pytest.raises(InputError, match="has no entry 2"):
        cosim.studies.reader.read_study(path)


def test_the_same_trials_with_one_worker_or_four_and_after_any_interruption(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = small_study(tmp_path, GAINS + SEEDS + CASES, tune(evaluations="60", prune="0.3"))
    whole = played(tmp_path, monkeypatch, study)
    lines = (tmp_path / "out" / FILE).read_bytes().splitlines(keepends=True)
    order = random.Random(1)
    for kept in (0, 100, 300):
        rows = lines[1:]
        order.shuffle(rows)
        (tmp_path / "out" / FILE).write_bytes(lines[0] + b"".join(rows[:kept]))
        for workers in (1, 4):
            again = conduct(study, tmp_path / "out", executor=Played(monkeypatch, bowl), workers=workers)
            assert again.rows == whole.rows
            assert [trial.score for one in again.tuned for trial in one.trials] == [
                trial.score for one in whole.tuned for trial in one.trials
            ]
        assert again.made == 0


def test_the_command_writes_trials_and_a_scenario_with_the_best_values(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_study(tmp_path, GAINS + SEEDS, tune(evaluations="8", restarts="1", batch="7"))
    assert main(["check", "study.xml"]) == 0
    checked = capsys.readouterr().out
    assert "8 trials, 40 runs: each trial on 3 draws" in checked
    assert re.search(r"takes about [\d.]+ \w+ on \d+ process", checked)
    assert main(["study", "study.xml", "--workers", "2"]) == 0
    printed = capsys.readouterr().out
    assert "40 runs; 40 passed" in printed
    assert "tuned.xml" in printed
    assert re.search(r"K_p +10 +\d", printed)
    narrow = Console(file=io.StringIO(), width=40, force_terminal=True, color_system=None)
    with monkeypatch.context() as patch:
        patch.setattr(studying, "out", lambda: narrow)
        assert main(["study", "study.xml"]) == 0
    framed = [line for line in narrow.file.getvalue().splitlines() if line.startswith(("│", "╭", "╰", "├"))]
    assert max(map(len, framed)) <= 40
    assert not any("…" in line for line in framed)
    summary = json.loads((tmp_path / "runs/small/summary.json").read_text())
    assert main(["check", "study.xml"]) == 0
    assert "as fast as the runs before" in capsys.readouterr().out
    (told,) = summary["tuned"]
    assert (told["trials"], summary["holds"]) == (8, True)
    assert main(["run", "runs/small/tuned.xml", "--no-figure"]) == 0
    look = cosim.study("study.xml", runs=5)
    assert look.sizes["run"] == 5


BAD = {
    "no cost": (tune(cost=""), "<tune> is incomplete; expected next: <cost>"),
    "unknown measure": (tune(cost='<cost of="lest"/>'), "no measure 'lest': did you mean 'last'?"),
    "unit": (tune(cost='<cost of="last" per="1 kg"/>'), "does not fit"),
    "unknown value": (tune(values="K_q k_d"), "nothing varies that is named 'K_q': did you mean 'K_p'?"),
    "twice": (tune(values="K_p K_p"), "is given twice in values"),
    "count": (tune(values="K_p seed"), "'seed' cannot be tuned: a continuous range with two ends is needed"),
    "budget": (tune(evaluations="0"), 'evaluations="0" of <tune> is not a whole number from 1'),
    "restarts": (tune(evaluations="5", restarts="3"), "too few for 3 restarts"),
    "overlap": (tune(held_out="3 to 9"), "draw 3 is in training and in held_out"),
    "order": (tune(held_out="9 to 8"), "9 is after 8"),
    "draws": (tune(held_out="none"), 'is not numbers of draws such as "1 to 4"'),
    "confidence": (tune(confidence="95"), "is not between 0 and 1"),
}


@pytest.mark.parametrize(("text", "said"), BAD.values(), ids=BAD)
def test_what_makes_no_sense(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        small_study(tmp_path, GAINS + SEEDS, text)
    assert caught.value.where is not None
    assert caught.value.where.file.endswith("study.xml")


def test_a_list_is_no_range_to_tune_in(tmp_path: Path) -> None:
    listed = GAINS.replace('<uniform from="0" to="20"/>', '<list values="1, 2"/>')
    with pytest.raises(InputError, match="'k_d' cannot be tuned: a continuous range"):
        small_study(tmp_path, listed + SEEDS, tune())


CHECKED = {
    "nothing is drawn": (GAINS, tune(), "same values as draw 1 of training, as nothing is drawn"),
    "few seeds": (
        GAINS + SEEDS.replace("count from", 'range to="9" from'),
        tune(),
        "is held out and has the same values as draw",
    ),
    "one value": (GAINS + SEEDS, tune(values="K_p"), 'needs two values or more: use method="tpe"'),
    "batch": (GAINS + SEEDS, tune(batch="2"), 'batch="2" is too small'),
    "many runs": (GAINS + SEEDS, tune(evaluations="1000000"), "more than 1,000,000"),
}


@pytest.mark.parametrize(("vary", "text", "said"), CHECKED.values(), ids=CHECKED)
def test_what_cannot_be_tuned(tmp_path: Path, vary: str, text: str, said: str) -> None:
    study = small_study(tmp_path, vary if "k_d" in text else GAINS.splitlines()[0] + SEEDS, text)
    with pytest.raises(InputError, match=re.escape(said)) as caught:
        check_study(study)
    assert caught.value.where is not None


@pytest.mark.parametrize(("method", "package"), [("cma_es", "cmaes"), ("tpe", "optuna")])
def test_a_package_that_is_missing_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str, package: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match=re.escape(f"{package!r}, which is not installed: pip install")):
        check_study(small_study(tmp_path, GAINS + SEEDS, tune(method=method)))


def test_the_best_trial_of_a_later_case_is_told_by_its_number() -> None:
    trials = tuple(Trial(number, 1, 1, None, {}, pruned=number == 643) for number in (641, 642, 643))
    assert best_trial(Tuned((1,), "second", trials, trials[1], ())) == "trial 642, the best of 3, 1 of them pruned"


def test_a_failure_at_the_very_bound_is_worse_than_any_cost(tmp_path: Path) -> None:
    study = small_study(tmp_path, GAINS + SEEDS, tune())
    assert study.tune is not None
    passed = Row("k", 1, 1, (), PASSED, (1e9,) * len(study.measures), (0.0,), "", least=0.0)
    assert score(study.tune, [replace(passed, status=FAILED)]) > score(study.tune, [passed])


def test_a_trial_that_is_as_good_is_dropped_no_more_often_than_the_study_allows(tmp_path: Path) -> None:
    """Of trials that differ from the best one by chance alone, and on every third draw not at all."""
    text = tune(training="1 to 40", held_out="101 to 120", prune="0.1")
    study = small_study(tmp_path, GAINS + SEEDS, text)
    assert study.tune is not None
    stages, error = stages_of(study.tune)
    assert (stages, error) == ([5, 10, 20, 40], pytest.approx(0.1 / 3.0))
    generator, dropped = random.Random(3), 0
    for number in range(400):
        one, best = (Trial(number, 0, 1, None, {}) for _ in range(2))
        for draw in range(1, 41):
            figures = [generator.gauss(5.0, 1.0) for _ in range(2)] if draw % 3 else [5.0, 5.0]
            for trial, figure in zip((one, best), figures, strict=True):
                trial.rows[draw] = Row("", draw, draw, (), PASSED, (figure,), (1.0,), "", 1.0)
        for stage in stages[:-1]:
            seen = replace(one, rows={draw: row for draw, row in one.rows.items() if draw <= stage})
            if is_worse(study.tune, seen, best, error):
                dropped += 1
                break
    assert 0 < dropped <= 400 * 0.1
