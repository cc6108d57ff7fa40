"""``formation study``: make the runs of a study, print what came of it, and keep its table."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from textwrap import shorten

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from cosim.cli.console import err, out, safe, say, taking_a_while, warn
from cosim.cli.indices import print_sensitivities
from cosim.cli.summary import print_verdict
from cosim.cli.wide_table import WideColumn, print_wide
from cosim.errors import InputError
from cosim.master.interrupt import HeldSignals
from cosim.report.page import PAGE, save_study_report
from cosim.results.files import save, writable_file, writable_folder, write
from cosim.results.junit import Outcome, junit_xml
from cosim.studies import by_case
from cosim.studies.by_case import CaseRow
from cosim.studies.cases import own_text
from cosim.studies.conduct import StudyOutcome, conduct
from cosim.studies.earlier_files import CASES, KEPT, SUMMARY, TABLE, TO_SEE, TRIALS, replaced
from cosim.studies.kept_results import keep_results
from cosim.studies.plan import run_of
from cosim.studies.read_keep import keeping
from cosim.studies.reader import read_study
from cosim.studies.reproduce import as_variant
from cosim.studies.row import BROKEN, FAILED, PASSED, Row
from cosim.studies.store import FILE, Store
from cosim.studies.study import Study, Tune
from cosim.studies.summary import Spread, as_json, counts, remarkable, spreads
from cosim.studies.table import as_csv, as_result
from cosim.studies.trial import mean_cost
from cosim.studies.tuned_files import best_values, trials_csv, tuned_variant
from cosim.studies.tuning import Tuned
from cosim.unforeseen import lack_of

_MOST_CASES = 40
"""Rows of cases that are printed."""
_MOST_BROKEN, _LONGEST = 3, 300
"""Reasons why runs are broken that are printed, and their characters; the table has all."""
_MOST_KEPT = 5
"""Folders with full results that are printed."""


def study(options: argparse.Namespace) -> int:
    """Conduct a study; return 0 if all holds that must, else 1."""
    for name in ("workers", "runs"):
        given = getattr(options, name)
        if given is not None and given < 1:
            raise InputError(f"--{name} {given}: at least 1 is needed")
    if options.junit is not None:
        writable_file(options.junit, "--junit")
    began, told = time.perf_counter(), Outcome(options.study.stem, options.study)
    try:
        told.summary = outcome = _conducted(options, told)
        return 0 if outcome.passed else 1
    except BaseException as error:
        told.error = error
        raise
    finally:
        told.seconds = time.perf_counter() - began
        if options.junit is not None:
            with HeldSignals():
                write(options.junit, junit_xml([told]))


def _conducted(options: argparse.Namespace, told: Outcome) -> StudyOutcome:
    read = keeping(read_study(options.study, options.set), options.keep, "--keep")
    told.name = read.name
    where = options.out / read.name
    folder = writable_folder(where, "--out").absolute()
    with _going_on(where / FILE):
        store = Store(folder, read.name)
    with store:  # open until all files are written: no other study sets some aside
        return _with_files(read, where, folder, store, options)


def _with_files(read: Study, where: Path, folder: Path, store: Store, options: argparse.Namespace) -> StudyOutcome:
    """Conduct a study, write its files, and print what came of it; the folder is absolute, and as the user named it."""
    with _going_on(where / FILE), _progress(read) as progress:
        outcome = conduct(
            read,
            folder,
            store=store,
            workers=options.workers,
            scheduler=options.scheduler,
            runs=options.runs,
            progress=progress,
        )
    writable_folder(folder, "--out")  # somebody may have removed it since
    write(folder / "runs.csv", as_csv(outcome).encode())
    save(as_result(outcome), folder / TABLE)
    write(folder / SUMMARY, as_json(outcome).encode())
    cases = by_case.by_case(outcome)
    if cases:
        write(folder / CASES, by_case.as_csv(outcome).encode())
    pictures: dict[str, bytes] = {}
    if options.figure:
        with taking_a_while("drawing the figure"):
            pictures = _pictures(outcome)
            for name, data in pictures.items():
                write(folder / name, data)
    files = ["runs.csv", TABLE, *[CASES] * bool(cases), SUMMARY, *_write_tuned(outcome, folder)]
    files += pictures
    written = _write_remarkable(read, outcome, folder / TO_SEE)
    waiting = taking_a_while("making the full results that are kept") if read.keep else nullcontext()
    with _going_on(where / FILE), waiting:
        kept = keep_results(outcome, folder, options.workers)
    if options.report:
        save_study_report(where, folder / PAGE)
        files.append(PAGE)
    replaced(folder, outcome.mark)
    _print(out(), outcome, cases)
    out().print(safe(f"results in {where}/: {', '.join(files)}"), soft_wrap=True)
    if written:
        out().print(safe(f"worst, failed and broken runs as scenarios in {where}/{TO_SEE}/"), soft_wrap=True)
    if kept:
        names = ", ".join(f"{one.name}/" for one in kept[:_MOST_KEPT])
        more = f" and {len(kept) - _MOST_KEPT} more" if len(kept) > _MOST_KEPT else ""
        out().print(safe(f"full results in {where}/{KEPT}/: {names}{more}"), soft_wrap=True)
    return outcome


@contextmanager
def _going_on(rows: Path) -> Iterator[None]:
    """Say, if the user interrupts what is done here, or the machine lacks something, that nothing is lost."""
    try:
        yield
    except BaseException as error:
        why = "interrupted" if isinstance(error, KeyboardInterrupt) else lack_of(error)
        if why:
            warn(f"{why}: the runs so far are kept in {rows}; the same command goes on")
        raise


def _pictures(outcome: StudyOutcome) -> dict[str, bytes]:
    """Return the pictures of a study, by the names of their files."""
    from cosim.studies import figure, figure_envelope, figure_search, figure_tuning

    own = figure if outcome.study.search is None else figure_search
    own = own if outcome.study.tune is None else figure_tuning
    found = {"figure.png": own.picture(outcome)}
    return found | ({"envelope.png": figure_envelope.picture(outcome)} if outcome.bundles else {})


def _write_tuned(outcome: StudyOutcome, folder: Path) -> list[str]:
    """Write the trials of a study that tunes, and a scenario with the best values of each case; return their names."""
    tune = outcome.study.tune
    if tune is None:
        return []
    write(folder / TRIALS, trials_csv(outcome.study, tune, outcome.tuned).encode())
    names = [TRIALS]
    for one in outcome.tuned:
        name, text = tuned_variant(outcome.study, one, folder)
        write(folder / name, text.encode())
        names.append(name)
    return names


def _write_remarkable(read: Study, outcome: StudyOutcome, folder: Path) -> bool:
    """Write remarkable runs as scenarios."""
    numbers = remarkable(outcome)
    if numbers:
        folder.mkdir(exist_ok=True)
        rows = {row.number: row for row in outcome.rows}
        for number in numbers:
            run = run_of(read, number, rows[number].draw, rows[number].values)
            write(folder / f"run_{number}.xml", as_variant(read, run, folder).encode())
    return bool(numbers)


def _print(console: Console, outcome: StudyOutcome, cases: Sequence[CaseRow]) -> None:
    of = outcome.study
    ends = counts(outcome)
    console.print(f"[bold]{safe(of.name)}: {safe(of.title)}[/]")
    before = [f"{outcome.before} of them from before"] if outcome.before else []
    parts = [f"{len(outcome.rows)} runs", *before]
    if outcome.early:
        why = "the verdict is certain enough" if of.search is None else "a run fails"
        parts.append(f"ended early, of {outcome.planned}: {why}")
    elif len(outcome.rows) < outcome.planned and not outcome.verdicts:
        parts.append(f"a first look at {outcome.planned}, so without a verdict")
    parts.append(", ".join(f"{ends[status]} {status}" for status in ends))
    say(console, "; ".join(parts))
    if of.tune is not None:
        _print_tuned(console, of, of.tune, outcome.tuned)
    found = spreads(outcome)
    if found:
        _print_spreads(console, found, "tuned, on held-out draws" if of.tune is not None else "")
    if len(cases) > 1:
        _print_cases(console, outcome, cases)
    print_sensitivities(console, of.sample.method, outcome.sensitivities)
    broken: dict[str, list[int]] = {}
    for row in outcome.rows:
        if row.status == BROKEN:
            broken.setdefault(shorten(row.message, _LONGEST, placeholder=" ..."), []).append(row.number)
    for message, numbers in list(broken.items())[:_MOST_BROKEN]:
        others = f" and {len(numbers) - 1} more" if len(numbers) > 1 else ""
        say(console, f"[yellow]broken:[/] run {numbers[0]}{others}: {safe(message)}")
    for verdict in outcome.verdicts:
        print_verdict(console, verdict)


def _print_tuned(console: Console, of: Study, tune: Tune, found: Sequence[Tuned]) -> None:
    """Show the best values of each case beside the scenario's own, and the costs of both in training."""
    for one in found:
        own = [own_text(of, one.cases, index) for index in one.best.values]
        best = best_values(of, one)
        names = [of.vary[index].name for index in one.best.values]
        costs = [_number(mean_cost(tune, trial.rows.values())) for trial in (one.trials[0], one.best)]
        print_wide(
            console,
            safe(f"tuned: {one.name}" if one.name else "tuned"),
            [WideColumn("value", [*names, "cost in training"], is_name=True)],
            [WideColumn("own", [*own, costs[0]]), WideColumn("tuned", [*(best[name] for name in names), costs[1]])],
        )
        console.print(f"{best_trial(one)}, in restart {one.best.restart} of {tune.restarts}")
        for sentence in one.at_bounds:
            say(console, f"[yellow]at a bound:[/] {safe(sentence)}")


def best_trial(one: Tuned) -> str:
    """Return the number of the best trial, as ``trials.csv`` has it over all cases, and of how many it is the best."""
    pruned = sum(trial.pruned for trial in one.trials)
    return f"trial {one.best.number}, the best of {len(one.trials)}" + (f", {pruned} of them pruned" if pruned else "")


def _print_spreads(console: Console, found: Sequence[Spread], title: str) -> None:
    quantiles = {
        "least": [spread.least for spread in found],
        "25 %": [spread.quarter for spread in found],
        "median": [spread.median for spread in found],
        "75 %": [spread.three_quarters for spread in found],
        "greatest": [spread.greatest for spread in found],
    }
    names = [f"{spread.measure} [{spread.unit}]" if spread.unit else spread.measure for spread in found]
    figures = [WideColumn(heading, list(map(_number, values))) for heading, values in quantiles.items()]
    worst = WideColumn("worst\nrun", [str(spread.worst_run) for spread in found])
    print_wide(console, title, [WideColumn("measure", names, is_name=True)], [*figures, worst])


def _print_cases(console: Console, outcome: StudyOutcome, cases: Sequence[CaseRow]) -> None:
    """Print the worst figure of each measure by case; the file has them all."""
    shown = cases[:_MOST_CASES]
    kept = [
        WideColumn(name, [case.names[place] for case in shown], is_name=True)
        for place, name in enumerate(by_case.compared(outcome))
    ]
    passed = WideColumn("passed", list(map(_ends, shown)))
    figures = [
        WideColumn(
            f"{measured.name}\n[{measured.unit}]" if measured.unit else measured.name,
            [_number(case.figures[place].worst) for case in shown],
        )
        for place, measured in enumerate(outcome.study.measures)
    ]
    print_wide(console, f"worst of the runs of each of the {len(cases)} cases", kept, [passed, *figures])
    if len(cases) > _MOST_CASES:
        console.print(f"{len(cases) - _MOST_CASES} more in cases.csv")


def _ends(case: CaseRow) -> str:
    broken = f",\n{case.broken} broken" if case.broken else ""
    return f"{case.passed} of {case.passed + case.failed + case.broken}{broken}"


def _number(value: float) -> str:
    """Return a figure; "none" where no run has one, as all are broken."""
    return "none" if math.isnan(value) else f"{value:.4g}".replace("inf", "infinite")


@contextmanager
def _progress(read: Study) -> Iterator[Callable[[Sequence[Row], int], None] | None]:
    """Show a progress bar on a terminal; elsewhere print a line if the study takes long."""
    if not err().is_terminal:
        with taking_a_while(f"running {read.name}"):
            yield None
        return
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[ends]}"),
        TimeRemainingColumn(),
        console=err(),
        transient=True,
    ) as progress:
        bar = progress.add_task(safe(read.name), total=None, ends="")
        ends = dict.fromkeys((PASSED, FAILED, BROKEN), 0)

        def advance(rows: Sequence[Row], left: int) -> None:
            for row in rows:
                ends[row.status] += 1
            done = sum(ends.values())
            told = ", ".join(f"{number} {status}" for status, number in ends.items())
            progress.update(bar, completed=done, total=done + left, ends=told)

        yield advance
