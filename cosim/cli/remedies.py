"""Remedies that a command adds to an error with its cause as data."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

from cosim.errors import FormationError, InputError, UnboundVelocities


def advice(error: FormationError) -> str:
    """Return a remedy for an error, to follow its message; empty if the message has it."""
    if not isinstance(error, UnboundVelocities):
        return ""
    from cosim.fmu.package import open_package  # which is slow to import
    from cosim.swap.proposal import velocity_hints
    from cosim.vehicle.kinds import kind_named

    try:
        package = open_package(Path(error.fmu))
    except InputError:  # it has changed meanwhile
        return ""
    with closing(package):
        hints = velocity_hints(package.description, kind_named(error.vehicle), error.roles, error.played)
    return "".join(f"; {hint}" for hint in hints)
