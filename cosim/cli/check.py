"""``formation check``: whether a scenario could be run."""

from __future__ import annotations

import argparse

from cosim.cli.console import err, out, report
from cosim.errors import FormationError
from cosim.scenario import read_scenario
from cosim.team import identify


def check(options: argparse.Namespace) -> int:
    """Read and validate each scenario; return 2 if one is wrong."""
    status = 0
    for path in options.scenarios:
        try:
            scenario = read_scenario(path, options.set)
            for controller in scenario.controllers.values():
                identify(controller)
        except FormationError as error:
            report(error)
            status = max(status, error.exit_status)
        else:
            out().print(
                f"{path}: {scenario.name}, {len(scenario.followers)} followers, {scenario.horizon:g} s "
                f"in {scenario.ticks} steps",
                markup=False,
            )
    if status:
        err().print(f"checked {len(options.scenarios)} scenario(s), not all are right")
    return status
