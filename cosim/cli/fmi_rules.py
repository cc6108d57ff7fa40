"""Rules of FMI that an FMU breaks: warnings, as many FMUs in use break some; or refused by ``--strict``."""

from __future__ import annotations

from cosim.cli.console import warn
from cosim.errors import InputError
from cosim.fmu.description import summed_up
from cosim.fmu.package import Package

SHOWN = 10
"""Number of warnings about an FMU that are shown without ``--all``."""


def rules_kept(package: Package, strict: bool, *, every: bool = False) -> None:
    """Warn of the rules that an FMU breaks.

    Raises
    ------
    InputError
        It breaks one, and `strict` asks for the refusal.
    """
    found = list(package.problems) if every else summed_up(package.problems)
    for sentence in found if every else found[:SHOWN]:
        warn(f"{package.path.name} breaks a rule of FMI: {sentence}")
    if not every and len(found) > SHOWN:
        warn(f"{package.path.name} breaks {len(found) - SHOWN} more rules: formation inspect --all shows them")
    if strict and found:
        raise InputError(f"the FMU {package.path} breaks rules of FMI, which --strict refuses")
