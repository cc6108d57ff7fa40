"""``formation check``: whether a scenario could be run."""

from __future__ import annotations

import argparse
from contextlib import ExitStack

from cosim.cli.console import out, report
from cosim.cli.reading import read
from cosim.errors import FormationError
from cosim.setup import set_up


def check(options: argparse.Namespace) -> int:
    """Read and validate each scenario with all that it names, and start nothing; return 2 if one is wrong."""
    status = 0
    for path in options.scenarios:
        try:
            scenario = read(path, options)
            with ExitStack() as cleanup:
                set_up(scenario, cleanup, {})
        except FormationError as error:
            report(error)
            status = max(status, error.exit_status)
        else:
            out().print(
                f"{path}: {scenario.name}, {len(scenario.followers)} followers, {scenario.horizon:g} s "
                f"in {scenario.ticks} steps",
                markup=False,
                soft_wrap=True,
            )
    return status
