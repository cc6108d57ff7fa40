"""A law that stays Python: a process beside the FMU runs it, and C has its inputs and its commands."""

from __future__ import annotations

import json
import math
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from formation_controllers.gains import GainInfo, Gains

from cosim.control import host
from cosim.control.host_process import START_LIMIT
from cosim.control.law import Law, LawGains
from cosim.control.team import Team
from cosim.scenario.scenario import TIME_LIMIT
from cosim.team_fmu.c_text import number
from cosim.team_fmu.ports import gain_ports, telemetry_outputs
from cosim.translation import CSource, Entry
from plants.sampled import Port

_TEMPLATE = Path(__file__).parent / "template"
_MESSAGE = 300
"""Bytes of a message with the law's name before it, see template/child.c."""


@dataclass(frozen=True)
class LawInHost:
    """A team whose law a process beside the FMU runs.

    Attributes
    ----------
    team : Team
        The team.
    label : str
        The end of its names in C.
    number : int
        Its place among the teams of the FMU.
    accelerates : bool
        Whether the leader's accelerations are known.
    """

    team: Team
    label: str
    number: int
    accelerates: bool
    entries: tuple[Entry, ...] = ()

    @property
    def taken(self) -> str:
        """The inputs of a tick, in C."""
        return f"memory->team_{self.label}"

    def remembered(self, source: CSource) -> str:
        """Return the type in C of what it remembers."""
        return f"Team_{self.label}"

    def type_in_c(self) -> str:
        """Return the type of inputs, commands and telemetry: numbers alone, in the order that the host has."""
        names = (*host.INPUTS, "command", "telemetry")
        members = [
            f"    double {name}{''.join(f'[{size}]' for size in shape)};\n"
            for name, shape in zip(names, self.team.shapes, strict=True)
            if math.prod(shape)
        ]
        return f"typedef struct {{\n{''.join(members)}}} Team_{self.label};\n"

    def gains(self, index: int, robot: str) -> Iterator[tuple[Port, str]]:
        """Yield the gains of a robot that are parameters; they have no place in C, see `about`."""
        for name, value in pairs(self.team.gains[index]):
            facts = self.team.law.gain_facts[name]
            known = {f.name: facts[f.name] for f in fields(GainInfo) if f.name in facts}
            for port, _ in gain_ports(name, GainInfo(**known), value, robot, tunable=False):
                yield port, ""

    def starts(self) -> Iterator[str]:
        """Yield the statements before the first tick."""
        yield from ()

    def declares(self, source: CSource) -> Iterator[str]:
        """Yield the declaration of the inputs of a tick."""
        yield from ()

    def ticks(self, gains: Sequence[str]) -> Iterator[str]:
        """Yield the statements of a tick."""
        label, own = self.label, f"memory->team_{self.label}"
        yield f"const size_t given_{label} = offsetof(Team_{label}, command);"
        yield f"const size_t taken_{label} = sizeof {own} - given_{label};"
        yield f"const char *const fault_{label} ="
        yield f"    child_tick(tool, {self.number}, tick, &{own}, given_{label}, {own}.command, taken_{label});"
        yield f"if (fault_{label} != NULL) return fault_{label};"

    @property
    def command(self) -> str:
        """Its commands, in C."""
        return f"memory->team_{self.label}.command"

    def telemetry(self, index: int, robot: str, depends: tuple[str, ...]) -> Iterator[tuple[Port, str]]:
        """Yield the signals of a robot, each with its place in C."""
        for column, (port, _) in enumerate(telemetry_outputs(self.team, robot, depends)):
            yield port, f"memory->team_{self.label}.telemetry[{index}][{column}]"

    def about(self, names: Mapping[str, int]) -> dict[str, Any]:
        """Return what the host is told of the team, given the places of the FMU's parameters by their names."""
        team = self.team
        return {
            "robots": team.robots,
            "gains": [
                [[name, value, _places(f"{robot}.{name}", value, names)] for name, value in pairs(own)]
                for robot, own in zip(team.robots, team.gains, strict=True)
            ],
            **team.for_host(self.accelerates),
            "shapes": team.shapes,
        }


def files_of(laws: Sequence[LawInHost], parameters: Sequence[Port]) -> tuple[dict[str, str], dict[str, bytes]]:
    """Return the sources in C and the resources of an FMU of some teams, which share a law."""
    law = laws[0].team.law
    named = f"the controller '{law.source.name}' of {law.package} {law.version}"
    shown = re.sub(r"[^A-Za-z0-9 ._'+-]", "_", named)[:120]
    limit = law.source.time_limit
    room = 8 * max(len(parameters), *(2 + sum(map(math.prod, own.team.shapes[: len(host.INPUTS)])) for own in laws))
    header = (
        "/* The law, which Python runs. */\n#ifndef LAW_H\n#define LAW_H\n\n"
        f'#define LAW "{shown}"\n\n'
        f"#define CHILD_START_LIMIT {number(START_LIMIT)} /* s, for the start and the first tick */\n"
        f"#define CHILD_LIMIT {number(TIME_LIMIT if limit is None else limit)} /* s, for a tick */\n\n"
        f"enum {{ CHILD_ROOM = {room} }}; /* bytes of the longest request */\n\n#endif\n"
    )
    sources = {name: (_TEMPLATE / name).read_text("utf-8") for name in ("child.c", "child.h")}
    places = {port.name: place for place, port in enumerate(parameters)}
    about = {
        "name": law.source.name,
        "package": law.package,
        "version": law.version,
        "longest": _MESSAGE - len(shown),
        "teams": [own.about(places) for own in laws],
    }
    resources = {
        "host.py": Path(host.__file__).read_bytes(),
        "law.json": (json.dumps(about, indent=1) + "\n").encode(),
        "interpreter.txt": os.fsencode(f"{interpreter(law)}\n"),
    }
    return sources | {"law.h": header}, resources


def interpreter(law: Law) -> Path:
    """Return the Python of a law's environment."""
    return Path(sys.executable) if law.host is None else law.host.environment.interpreter.absolute()


def pairs(gains: LawGains) -> list[tuple[str, Any]]:
    """Return gains as names and values."""
    if isinstance(gains, Gains):
        return [(f.name, getattr(gains, f.name)) for f in fields(gains)]
    return list(gains)


def _places(name: str, value: Any, names: Mapping[str, int]) -> Any:
    if isinstance(value, tuple):
        return [names.get(f"{name}[{i + 1}]") for i in range(len(value))]
    return names.get(name)
