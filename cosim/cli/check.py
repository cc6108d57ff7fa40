"""``formation check``: whether a scenario can be run, and its content."""

from __future__ import annotations

import argparse
from contextlib import ExitStack

from cosim.cli.console import out, verbatim, warn
from cosim.cli.ending import ended_by
from cosim.cli.fmi_rules import rules_kept
from cosim.cli.named_scenarios import read
from cosim.cli.overview import described_plants, doubtful_plants, print_overview
from cosim.errors import InputError
from cosim.master.setup import set_up


def check(options: argparse.Namespace) -> int:
    """Check each scenario with everything that it names, show it, and start no plant; return 2 if one is wrong."""
    if options.resolved and len(options.scenarios) > 1:
        raise InputError(f"--resolved prints one scenario: name one file, not {len(options.scenarios)}")
    status = 0
    for path in options.scenarios:
        try:
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
