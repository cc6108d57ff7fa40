"""``formation check``: whether a scenario can be run, and its content."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from pathlib import Path

from cosim.cli.console import out, safe, table, verbatim, warn
from cosim.cli.ending import ended_by
from cosim.cli.fmi_rules import rules_kept
from cosim.cli.named_scenarios import read
from cosim.cli.overview import described_plants, doubtful_plants, print_overview
from cosim.errors import InputError
from cosim.master.setup import set_up
from cosim.scenario.root_element import root_of
from cosim.studies.conduct import check_study
from cosim.studies.reader import read_study

_SHOWN = 5
"""Runs of a study that are shown."""


def _check_study(path: Path, options: argparse.Namespace) -> None:
    """Check a study with its scenarios, and show its runs."""
    if options.resolved:
        raise InputError(f"--resolved prints a scenario, and {path} is a study: the files of its runs are scenarios")
    study = read_study(path, options.set)
    plan, _, requirements = check_study(study)
    out().print(safe(f"{path}: {study.name}, {len(plan)} runs of {len(study.bases)} scenarios"), soft_wrap=True)
    shown = table(out(), safe(f"{study.name}: {study.title}"))
    for heading in ("run", *(vary.name for vary in study.vary)):
        shown.add_column(safe(heading), justify="right" if heading == "run" else "left")
    first = min(len(plan), _SHOWN)
    for run in [plan[index] for index in range(first)] + ([plan[len(plan) - 1]] if len(plan) > first else []):
        shown.add_row(str(run.number), *("as it is" if value is None else safe(value) for value in run.values))
    out().print(shown)
    for one in requirements:
        out().print(safe(f"expected: {one.text}"), soft_wrap=True)


def check(options: argparse.Namespace) -> int:
    """Check each scenario with everything that it names, show it, and start no plant; return 2 if one is wrong."""
    if options.resolved and len(options.scenarios) > 1:
        raise InputError(f"--resolved prints one scenario: name one file, not {len(options.scenarios)}")
    status = 0
    for path in options.scenarios:
        try:
            if root_of(path) == "study":
                _check_study(path, options)
                continue
            scenario = read(path, options)
            with ExitStack() as cleanup:
                setup = set_up(scenario, cleanup, {})
                for fmu in setup.fmus.values():
                    rules_kept(fmu, options.strict)
                plants, doubts = list(described_plants(scenario, setup)), list(doubtful_plants(scenario, setup))
        except (Exception, SystemExit) as error:  # whatever it is, the other scenarios are checked
            status = max(status, ended_by(error, path)[1])
        else:
            if options.resolved:
                verbatim(scenario.text)
                continue
            out().print(
                f"{path}: {scenario.name}, {len(scenario.followers)} followers, {scenario.horizon:g} s "
                f"in {scenario.ticks} steps",
                markup=False,
                soft_wrap=True,
            )
            print_overview(out(), scenario, setup, plants)
            for doubt in doubts:
                warn(doubt)
    return status
