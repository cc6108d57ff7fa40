"""Sensors and actuators as C: the effects, translated, and the amounts that they get, tick by tick."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cosim.signals.chain import Chain
from cosim.signals.effects.effect import Plan
from cosim.signals.random import words_of_names
from cosim.team_fmu.c_text import number, numbers, table
from cosim.translation import Entry


class ChainInC:
    """A chain of effects on the channels of some robots.

    Parameters
    ----------
    name
        ``sense`` or ``actuate``, with which its names begin.
    chain
        The effects.
    first_stream
        The number of the first stream of random numbers.

    Attributes
    ----------
    entries : list of Entry
        The functions to translate.
    streams : list
        The names of the streams, in order.
    tables : list of str
        Constants.
    members : list of str
        What the chain remembers, as members of a struct.
    function : str
        The function that changes the values of a tick; empty if there are no effects.
    """

    def __init__(self, name: str, chain: Chain, first_stream: int) -> None:
        self.name = name
        self.entries: list[Entry] = []
        self.streams: list[tuple[str, str]] = []
        self.tables: list[str] = []
        self.members: list[str] = []
        self._first_stream = first_stream
        robots, width = chain.arrays.amounts.shape[2:]
        self._shape = robots, width
        lines = []
        for effect in chain.effects:
            label = f"{name}_{effect.element}"
            values = np.zeros((robots, width))
            remembered = np.zeros((effect.remembers, robots, width))
            self.entries.append(Entry(label, effect.act, (0, values, values.copy(), remembered)))
            given = "NULL"
            if effect.remembers:
                self.members.append(f"double {label}[{effect.remembers}][{robots}][{width}];")
                given = f"memory->{label}"
            lines += [f"/* {effect.element} */", *self._amounts(label, effect.plan())]
            lines += [f"team_{label}(tick, values, amount, {given});"]
        self.function = self._function(lines) if lines else ""

    def _function(self, lines: list[str]) -> str:
        robots, width = self._shape
        body = "".join(f"    {line}\n" for line in lines)
        unused = "" if "memory" in body else "    (void)memory;\n"
        return (
            f"static void {self.name}(long long tick, double values[{robots}][{width}], Memory *memory)\n"
            f"{{\n    double amount[{robots}][{width}];\n{unused}{body}}}\n"
        )

    def _amounts(self, label: str, plan: Plan) -> Iterator[str]:
        robots, width = self._shape
        count = len(plan.switches)
        self.tables.append(numbers(f"double {label}_levels[{count * robots * width}]", plan.levels))
        level = "0"
        if count > 1:
            self.tables.append(table(f"long long {label}_switches[{count}]", map(str, plan.switches)))
            level = f"place_of({label}_switches, {count}, tick)"
        offset = "" if level == "0" else f" + {robots * width} * {level}"
        yield f"memcpy(amount, {label}_levels{offset}, sizeof amount);"
        for robot, purpose, place in plan.normal:
            row, column = divmod(place, width)
            yield f"amount[{row}][{column}] *= stream_normal(&memory->streams[{self._stream(robot, purpose)}]);"
        for robot, purpose, probability, places, start, stop in plan.losses:
            drawn = f"stream_part(&memory->streams[{self._stream(robot, purpose)}]) < {number(probability)}"
            begin = max(start, 1)  # the first measurement is never lost
            yield f"if ({drawn} && tick >= {begin}LL && tick < {min(stop, 2**62)}LL) {{"
            for place in places:
                row, column = divmod(place, width)
                yield f"    amount[{row}][{column}] = 1.0;"
            yield "}"

    def _stream(self, robot: str, purpose: str) -> int:
        self.streams.append((robot, purpose))
        return self._first_stream + len(self.streams) - 1


def stream_names(streams: list[tuple[str, str]]) -> str:
    """Return the table of the words that stand for the names of streams."""
    rows = []
    for robot, purpose in streams:
        words = ", ".join(f"0x{word:08x}u" for word in words_of_names(robot, purpose).tolist())
        rows += [f"    /* {robot}, {purpose} */", f"    {{{words}}},"]
    return "\n".join([f"static const uint32_t stream_names[{len(streams)}][8] = {{", *rows, "};"])
