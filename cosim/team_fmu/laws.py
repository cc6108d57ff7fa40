"""The law of a team as C: its start, its tick, and what it keeps."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from formation_controllers import elementary
from formation_controllers.interface import CompiledTick, TickInputs
from formation_controllers.team_records import TeamRecords

from cosim.control.team_here import TeamHere
from cosim.errors import InputError
from cosim.translation import CSource, Entry

PRIMITIVES = elementary.PRIMITIVES
"""The smallest parts of the elementary functions of laws."""


@dataclass(frozen=True)
class LawInC:
    """A team whose law can be translated.

    Attributes
    ----------
    team : TeamHere
        The team.
    label : str
        The end of its names in C.
    records : TeamRecords
        What it keeps, as it is before the first tick.
    prepared : bool
        Whether some of its states follow from gains and desired places before the first tick, in Python.
    entries : tuple of Entry
        Its functions.
    """

    team: TeamHere
    label: str
    records: TeamRecords
    prepared: bool
    entries: tuple[Entry, Entry]

    def types(self, source: CSource) -> tuple[str, str]:
        """Return the names in C of its inputs and of its records."""
        found = re.search(r"\(\s*const (\w+) \*\w+,\s*(\w+) \*", source.prototypes[f"tick_{self.label}"])
        if found is None:  # the translator has another form
            raise RuntimeError(source.prototypes[f"tick_{self.label}"])
        return found[1], found[2]


def law_in_c(team: TeamHere, label: str, prepare: Callable[[TeamHere], None]) -> LawInC:
    """Return the law of a team.

    Parameters
    ----------
    team
        The team.
    label
        The end of its names in C.
    prepare
        Starts the controller of a team whose law prepares states in Python.

    Raises
    ------
    InputError
        It is no compiled law of the package's kind: free Python, which has no translation.
    """
    controller, source = team.controller, team.law.source
    tick: CompiledTick | None = controller.compiled_tick()
    start = getattr(controller, "compiled_start", lambda: None)()
    if tick is None or start is None or not isinstance(tick.own, TeamRecords):
        lacks = "tick" if tick is None else "start" if start is None else "records of the usual kind"
        raise InputError(
            f"the controller {source.name!r} has no compiled {lacks}: only a law whose tick and start are compiled "
            "functions, as a CompiledLaw's are, becomes an FMU",
            source.where,
        )
    if start.prepared:
        prepare(team)
    size, vehicle = len(team.robots), team.vehicle
    poses, velocities = len(vehicle.pose), len(vehicle.velocity)
    inputs = TickInputs(
        np.zeros((size, poses)),
        np.zeros((size, velocities)),
        np.zeros(poses),
        np.zeros(velocities),
        np.zeros(velocities),
        *(np.zeros((size, 2)) for _ in range(3)),
    )
    command = np.zeros((size, len(vehicle.command)))
    records = tick.own._replace(state=_only(tick.own.state, start.prepared))
    entries = (
        Entry(f"start_{label}", start.function, (inputs, start.own)),
        Entry(f"tick_{label}", tick.function, (inputs, tick.own, command)),
    )
    return LawInC(team, label, records, bool(start.prepared), entries)


def _only(state: np.ndarray[Any, Any], names: Sequence[str]) -> np.ndarray[Any, Any]:
    """Return records in which all but some fields are zero."""
    kept = np.zeros_like(state)
    for name in names:
        kept[name] = state[name]
    return kept
