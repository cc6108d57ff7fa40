"""The law of a team as C: its start, its tick, and what it keeps."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from formation_controllers import elementary
from formation_controllers.interface import CompiledTick, TickInputs
from formation_controllers.team_records import TeamRecords

from cosim.control.team_here import TeamHere
from cosim.team_fmu.c_text import assignments, member
from cosim.team_fmu.ports import gain_parameters, telemetry_outputs
from cosim.translation import CSource, Entry
from plants.sampled import Port

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

    @property
    def taken(self) -> str:
        """The inputs of a tick, in C."""
        return f"in_{self.label}"

    def remembered(self, source: CSource) -> str:
        """Return the type in C of what it remembers."""
        return self.types(source)[1]

    def gains(self, index: int, robot: str) -> Iterator[tuple[Port, str]]:
        """Yield the gains of a robot that are parameters, each with its place in C."""
        if not self.prepared:
            for port, at in gain_parameters(self.team.controller.robot_gains[index], robot):
                yield port, f"memory->team_{self.label}.gains[{index}].{member(at)}"

    def starts(self) -> Iterator[str]:
        """Yield the statements before the first tick."""
        own = self.records
        telemetry = np.full_like(own.telemetry, np.nan)
        room = {name: np.zeros_like(getattr(own, name)) for name in ("seen", "columns")}
        yield from assignments(f"memory->team_{self.label}", own._replace(telemetry=telemetry, **room))

    def declares(self, source: CSource) -> Iterator[str]:
        """Yield the declaration of the inputs of a tick."""
        yield f"{self.types(source)[0]} {self.taken};"

    def ticks(self, gains: Sequence[str]) -> Iterator[str]:
        """Yield the statements of a tick, given those that set its gains."""
        label, taken, records = self.label, self.taken, f"memory->team_{self.label}"
        yield from gains
        yield f"if (tick == 0) team_start_{label}(&{taken}, &{records});"
        yield f"double command_{label}[{len(self.team.rows)}][{len(self.team.vehicle.command)}];"
        yield f"team_tick_{label}(&{taken}, &{records}, command_{label});"

    @property
    def command(self) -> str:
        """Its commands, in C."""
        return f"command_{self.label}"

    def telemetry(self, index: int, robot: str, depends: tuple[str, ...]) -> Iterator[tuple[Port, str]]:
        """Yield the signals of a robot, each with its place in C."""
        for port, at in telemetry_outputs(self.team, robot, depends):
            yield port, f"memory->team_{self.label}.telemetry[{index}].{member(at)}"

    def types(self, source: CSource) -> tuple[str, str]:
        """Return the names in C of its inputs and of its records."""
        found = re.search(r"\(\s*const (\w+) \*\w+,\s*(\w+) \*", source.prototypes[f"tick_{self.label}"])
        if found is None:  # the translator has another form
            raise RuntimeError(source.prototypes[f"tick_{self.label}"])
        return found[1], found[2]


def law_in_c(team: TeamHere, label: str, prepare: Callable[[TeamHere], None]) -> LawInC:
    """Return the law of a team; it `is_translatable`.

    Parameters
    ----------
    team
        The team.
    label
        The end of its names in C.
    prepare
        Starts the controller of a team whose law prepares states in Python.
    """
    tick, start = _compiled(team.controller)
    assert tick is not None
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


def is_translatable(team: TeamHere) -> bool:
    """Return whether a law states its start and its tick as compiled functions, as a CompiledLaw does."""
    tick, start = _compiled(team.controller)
    return tick is not None and start is not None and isinstance(tick.own, TeamRecords)


def _compiled(controller: Any) -> tuple[CompiledTick | None, Any]:
    return controller.compiled_tick(), getattr(controller, "compiled_start", lambda: None)()


def _only(state: np.ndarray[Any, Any], names: Sequence[str]) -> np.ndarray[Any, Any]:
    """Return records in which all but some fields are zero."""
    kept = np.zeros_like(state)
    for name in names:
        kept[name] = state[name]
    return kept
