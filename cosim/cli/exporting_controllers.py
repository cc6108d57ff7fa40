"""``formation export-controller``: controllers of a scenario as FMUs, to use elsewhere."""

from __future__ import annotations

import argparse

from cosim.cli.console import out, safe
from cosim.cli.named_scenarios import read
from cosim.errors import OutputError
from cosim.team_fmu import team_fmus


def export_controllers(options: argparse.Namespace) -> int:
    """Build the FMU of each controller of a scenario, and print its path."""
    scenario = read(options.scenario, options)
    try:
        made = team_fmus(scenario, options.out, fmi=options.fmi, platforms=options.platform, controllers=options.only)
    except OSError as error:
        raise OutputError(f"an FMU cannot be written to {options.out}: {error.strerror}") from None
    for path in made.values():
        out().print(safe(str(path)), soft_wrap=True)
    return 0
