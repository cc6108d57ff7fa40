"""``formation check``: whether a scenario can be run, and its content."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from cosim.cli.console import out, safe, say, verbatim, warn
from cosim.cli.ending import ended_by
from cosim.cli.fmi_rules import rules_kept
from cosim.cli.named_scenarios import read, take_name
from cosim.cli.overview import described_plants, doubtful_plants, print_overview
from cosim.cli.wide_table import WideColumn, print_wide
from cosim.errors import InputError, printable
from cosim.master.setup import set_up
from cosim.quantity import spelled
from cosim.scenario.root_element import root_of
from cosim.studies.cases import case_name, own_text, tuned_in
from cosim.studies.conduct import check_study, planned_runs
from cosim.studies.crews import usual_workers
from cosim.studies.duration import told_duration
from cosim.studies.plan import Plan, Run
from cosim.studies.reader import read_study
from cosim.studies.searching import Searching
from cosim.studies.study import Study, Tune
from cosim.studies.tuning import most_runs
from cosim.studies.values import Random

_SHOWN = 5
"""Runs of a study that are shown."""


def _check_study(path: Path, options: argparse.Namespace) -> None:
    """Check a study with its scenarios, and show its runs."""
    if options.resolved:
        raise InputError(f"--resolved prints a scenario, and {path} is a study: the files of its runs are scenarios")
    study = read_study(path, options.set)
    plan, _, requirements = check_study(study)
    if study.tune is not None:
        _print_tune(path, study, study.tune)
    else:
        many = f"{bases} scenarios" if (bases := len(study.bases)) > 1 else "one scenario"
        of = f"{len(plan)} runs of {many}"
        told = of if study.search is None else f"a search for the worst case in at most {of}"
        out().print(safe(f"{path}: {study.name}, {told}"), soft_wrap=True)
        _print_runs(study, plan if study.search is None else Searching(study, study.search, _SHOWN).ask(_SHOWN))
    duration = told_duration(study, planned_runs(study, plan), usual_workers(), Path("runs") / study.name)
    say(out(), f"takes {duration}")
    for one in requirements:
        say(out(), safe(f"expected: {one.text}"))


def _print_runs(study: Study, plan: Plan | Sequence[Run]) -> None:
    """Show the first runs of a study, and the last one."""
    if isinstance(plan, Plan) and plan.design is not None:
        out().print(f'{study.sample.method}: {plan.design}; runs="{study.sample.runs}" allows no more', soft_wrap=True)
    first = min(len(plan), _SHOWN)
    runs = [plan[index] for index in range(first)] + ([plan[len(plan) - 1]] if len(plan) > first else [])
    values = [
        WideColumn(vary.name, ["as it is" if (value := run.values[place]) is None else value for run in runs], True)
        for place, vary in enumerate(study.vary)
    ]
    numbers = WideColumn("run", [str(run.number) for run in runs])
    print_wide(out(), safe(f"{study.name}: {study.title}"), [numbers], values)


def _print_tune(path: Path, study: Study, tune: Tune) -> None:
    """Show what a study tunes: its runs, and the range of each value."""
    cases = f" in each of {len(study.bases)} cases" if len(study.bases) > 1 else ""
    pruned = "at most " if tune.prune is not None else ""
    out().print(
        safe(
            f"{path}: {study.name}, {tune.evaluations} trials{cases}, {pruned}{most_runs(study, tune)} runs: each "
            f"trial on {len(tune.training)} draws, the best one and the scenario's own on {len(tune.held_out)} others"
        ),
        soft_wrap=True,
    )
    rows, ends = [], []
    for cases_of in study.bases:
        for index in tuned_in(study, tune, cases_of):
            values = study.vary[index].values
            assert isinstance(values, Random)
            limits = (spelled(end, values.unit) for end in (values.least, values.greatest))
            rows.append((study.vary[index].name, case_name(study, cases_of), own_text(study, cases_of, index), *limits))
        ends.append(len(rows) - 1)
    names, of_cases, *others = zip(*rows, strict=True)
    kept = [WideColumn("value", names, is_name=True)]
    kept += [WideColumn("case", of_cases, is_name=True)] * (len(study.bases) > 1)
    columns = [WideColumn(heading, cells) for heading, cells in zip(("own", "from", "to"), others, strict=True)]
    print_wide(out(), safe(f"{study.name}: {study.title}"), kept, columns, ends)


def check(options: argparse.Namespace) -> int:
    """Check each scenario with everything that it names, show it, and start no plant; return 2 if one is wrong."""
    if options.resolved and len(options.scenarios) > 1:
        raise InputError(f"--resolved prints one scenario: name one file, not {len(options.scenarios)}")
    status = 0
    names: dict[str, Path] = {}
    for path in options.scenarios:
        try:
            if root_of(path) == "study":
                _check_study(path, options)
                continue
            scenario = read(path, options)
            take_name(names, scenario, path)
            with ExitStack() as cleanup:
                setup = set_up(scenario, cleanup, {})
                for fmu in setup.fmus.values():
                    rules_kept(fmu, options.strict)
                plants, doubts = list(described_plants(scenario, setup)), list(doubtful_plants(scenario, setup))
        except (Exception, SystemExit) as error:  # whatever it is, the other scenarios are checked
            status = max(status, ended_by(error, path, several=len(options.scenarios) > 1)[1])
        else:
            if options.resolved:
                verbatim(scenario.text)
                continue
            out().print(
                f"{printable(str(path))}: {printable(scenario.name)}, {len(scenario.followers)} followers, "
                f"{scenario.horizon:.12g} s in {scenario.ticks} steps",
                markup=False,
                soft_wrap=True,
            )
            print_overview(out(), scenario, setup, plants)
            for doubt in doubts:
                warn(doubt)
    return status
