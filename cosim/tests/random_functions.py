"""Random functions of the restricted Python, as text: what the translation to C accepts of them must have its bits."""

from __future__ import annotations

import random

PARAMETERS = "x, y, i, a, m, k"
"""Two floats, a whole number, arrays of 4 and of (2, 3) floats, and one of 3 whole numbers."""
FLOATS = ("x", "y", "u", "v", "w")
INTEGERS = ("i", "n")
HEAD = """\
import math
from typing import NamedTuple

import numpy as np

HALF = 0.5
SHIFT = 3
MANY = 98765
WEIGHTS = np.array([[0.25, -1.5], [3.0, 0.125]])


class Pair(NamedTuple):
    first: float
    second: float


def swapped(p, factor):
    return Pair(p.second * factor, p.first)


def both(p, q):
    if p > q:
        return p - q, 1
    return q, p


def fill(into, value):
    for place in range(len(into)):
        into[place] = value + place


def clear(of, value):
    for one in range(of.shape[0]):
        for other in range(of.shape[1]):
            of[one, other] = value + one - other


def row(of, at):
    return of[at]


def push(into, value):
    into[1] += value
    return into[0]


def push_both(into, at):
    at[0] = (at[0] + 1) % 3
    into[at[0]] = 0.5
    return into[1], into[0]


def nothing():
    pass

"""


class Text:
    """Writes one function."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._lines: list[str] = []
        self._loops: list[str] = []
        self._count = 0

    def function(self, name: str) -> str:
        """Return its text."""
        self._lines = [f"def {name}({PARAMETERS}):"]
        if self._chance(0.95):
            self._lines.append("    u = 0.5 - x")
        if self._chance(0.95):
            self._lines.append("    v, w = y, 0.25")
        if self._chance(0.95):
            self._lines.append("    n = i % 5")
        for _ in range(self._random.randint(2, 5)):
            self._statement(1, 3)
        if self._chance(0.2):
            self._lines.append(f"    {self._random.choice(FLOATS)}, w = both({self._float(1)}, {self._float(1)})")
        self._lines.append(f"    return {self._float(2)}")
        return "\n".join(self._lines) + "\n\n"

    def _chance(self, part: float) -> bool:
        return self._random.random() < part

    def _add(self, depth: int, text: str) -> None:
        self._lines.append("    " * depth + text)

    def _statement(self, depth: int, room: int) -> None:
        choice = self._random.randrange(21)
        if choice <= 2 or room == 0:
            self._add(depth, f"{self._random.choice(FLOATS)} = {self._float(2)}")
        elif choice == 3:
            self._add(
                depth, f"{self._random.choice(FLOATS)} {self._random.choice(('+=', '-=', '*='))} {self._float(2)}"
            )
        elif choice == 4:
            self._add(depth, f"n = {self._integer(2)}")
        elif choice == 5:
            targets = [self._target() for _ in range(self._random.randint(2, 3))]
            self._add(depth, f"{', '.join(targets)} = {', '.join(self._float(1) for _ in targets)}")
        elif choice == 6:
            self._add(depth, f"{self._entry()} {self._random.choice(('=', '+=', '*='))} {self._float(2)}")
        elif choice == 7:
            self._if(depth, room)
        elif choice == 8 and len(self._loops) < 2:
            self._for(depth, room)
        elif choice == 9:
            self._count += 1
            pair = f"p_{self._count}"
            self._add(depth, f"{pair} = swapped(Pair({self._float(1)}, {self._float(1)}), {self._float(1)})")
            self._add(depth, f"{self._random.choice(FLOATS)}, {self._random.choice(FLOATS)} = {pair}")
        elif choice == 10:
            self._add(
                depth, f"fill({self._random.choice(('a', 'm[0]', 'm[:, 1]', 'a[1:3]', 'a[::2]'))}, {self._float(1)})"
            )
        elif choice == 11:
            self._count += 1
            view = f"r_{self._count}"
            views = ("row(m, 1)", "m[:, 2]", "m[n % 2]", "a[1:]", "a[: i % 3 + 2]", "m[1, : i % 2 + 2]")
            self._add(depth, f"{view} = {self._random.choice(views)}")
            self._add(depth, f"{view}[1] = {self._float(1)} + {view}[0]")
        elif choice == 13:
            name = self._random.choice(("far", "ε", "epsilon", "place", "t_1", "t_2", "double"))
            self._add(depth, f"if {self._test(1)}:")
            self._add(depth + 1, f"{name} = {self._float(1)}")
            if self._chance(0.3):
                self._add(depth + 1, f"if {self._test(1)}:")
                self._statement(depth + 2, 0)
            self._add(depth, "else:")
            if self._chance(0.8):
                self._add(depth + 1, f"{name} = {self._float(1)}")
            else:
                self._add(depth + 1, f"{name}, v = push_both(a, k)")
            self._statement(depth, 0)
            self._add(depth, f"{self._random.choice(FLOATS)} = {name} + {self._float(1)}")
        elif choice == 14:
            target = self._random.choice((*FLOATS, "_", "unused", "a[k[0] % 4]", self._entry()))
            self._add(depth, f"{target} = push({self._random.choice(('a', 'm[0]', 'm[:, 2]'))}, {self._float(1)})")
        elif choice == 15:
            targets = [self._random.choice((*FLOATS, "_", "spare", "m[k[0] % 2, 1]", self._entry())) for _ in range(2)]
            self._add(depth, f"{', '.join(targets)} = push_both({self._random.choice(('a', 'm[1]'))}, k)")
        elif choice == 16:
            place = self._random.choice(("m[0]", "m[n % 2]"))
            self._add(depth, f"{place} = {self._random.choice(('m[1]', 'a[1:]', 'y', 'u'))}")
            self._add(depth, "nothing()")
        elif choice == 17:
            self._count += 1
            steps = f"steps_{self._count}"
            self._add(depth, f"{steps} = 0")
            self._add(depth, f"while {steps} < {self._random.randint(1, 4)} and ({self._test(1)}):")
            self._add(depth + 1, f"{steps} += 1")
            self._statement(depth + 1, room - 1)
        elif choice == 18:
            self._count += 1
            view = f"part_{self._count}"
            parts = ("m[:, 1:]", "m[:2, :2]", "m[:, : i % 2 + 1]", "m[:1]", "m[: i % 2 + 1]")
            self._add(depth, f"{view} = {self._random.choice(parts)}")
            self._add(
                depth,
                f"clear({self._random.choice((view, 'm[:, :2]', 'm[1:, : i % 3]', 'm[: i % 3]'))}, {self._float(1)})",
            )
            self._add(depth, f"{view}[0, 0] += {view}[-1, -1]")
        elif choice == 19:
            places = ("a[: i % 4]", "a[: int(a[0]) % 4]", "m[k[0] % 2, :]", "m[int(m[0, 0]) % 2, :]", "k[k[0] % 3 :]")
            place = self._random.choice(places)
            self._add(depth, f"{place} = {'2' if place[0] == 'k' else self._float(1)}")
        elif choice == 20:
            self._add(depth, f"for place in range({self._random.choice(('k[0] % 4', 'int(a[3]) % 4'))}):")
            self._add(depth + 1, f"{self._random.choice(('k[0] += 1', 'a[3] = 1.0', 'k[1] = place'))}")
            self._add(depth + 1, "a[place] = u")
        else:
            self._add(depth, f"k[{self._integer(1)} % 3] = {self._integer(1)} % 100")

    def _if(self, depth: int, room: int) -> None:
        self._add(depth, f"if {self._test(2)}:")
        for _ in range(self._random.randint(1, 2)):
            self._statement(depth + 1, room - 1)
        if self._chance(0.1):
            self._add(depth + 1, f"return {self._float(1)}")
        if self._chance(0.3):
            self._add(depth, f"elif {self._test(1)}:")
            self._statement(depth + 1, room - 1)
        if self._chance(0.5):
            self._add(depth, "else:")
            for _ in range(self._random.randint(1, 2)):
                self._statement(depth + 1, room - 1)

    def _for(self, depth: int, room: int) -> None:
        name = f"j_{len(self._loops) + 1}"
        bounds = self._random.choice(("3", "n", "len(a)", "1, 4", "0, 7, 3", "3, -1, -1", "m.shape[1]", "int(u) % 4"))
        self._add(depth, f"for {name} in range({bounds}):")
        self._loops.append(name)
        for _ in range(self._random.randint(1, 3)):
            self._statement(depth + 1, room - 1)
        if self._chance(0.15):
            self._add(depth + 1, f"if {self._test(1)}:")
            self._add(depth + 2, self._random.choice(("break", "continue")))
        self._loops.pop()

    def _target(self) -> str:
        return self._random.choice((*FLOATS, self._entry(), self._entry()))

    def _entry(self) -> str:
        return self._random.choice(
            ("a[0]", "a[-1]", f"a[{self._integer(1)} % 4]", "m[1, 2]", f"m[{self._integer(1)} % 2, 0]", "m[n % 2][1]")
        )

    def _float(self, depth: int) -> str:
        choice = self._random.randrange(16)
        if depth == 0 or choice <= 3:
            return self._random.choice((*FLOATS, self._entry(), "0.1", "2.0", "HALF", "WEIGHTS[1, 0]", "-3.5"))
        a, b = self._float(depth - 1), self._float(depth - 1)
        if choice <= 7:
            return f"({a} {self._random.choice('+-*')} {b})" if self._chance(0.6) else f"{a} - {b}"
        return {
            8: f"{a} / ({b} * {b} + 1.0)",
            9: f"math.sqrt(abs({a}))",
            10: f"{self._random.choice(('min', 'max'))}({a}, {b})",
            11: f"({a} if {self._test(depth - 1)} else {b})",
            12: f"math.copysign({a}, {b})",
            13: f"{self._integer(depth - 1)} * {a}",
            14: f"swapped(Pair({a}, {b}), 2.0).first",
            15: f"(-{a})",
        }[choice]

    def _integer(self, depth: int) -> str:
        choice = self._random.randrange(11)
        if depth == 0 or choice <= 2:
            return self._random.choice((*INTEGERS, *self._loops, "2", "SHIFT", "k[1]"))
        a, b = self._integer(depth - 1), self._integer(depth - 1)
        test = self._random.choice(("x > y", "i > 2", "y < 0.25"))
        return {
            3: f"({a} + {b}) % 50",
            4: f"({a} - {b}) % 50",
            5: f"({a} * {b}) % 7",
            6: f"({a} // 3)",
            7: f"(({a} & 12) ^ {b}) % 64",
            8: f"({a} << 2) % 30",
            9: f"((MANY if {test} else {self._random.choice(('2', 'MANY', '-SHIFT'))}) * MANY + {a}) % 50",
            10: f"(~MANY * (SHIFT if {test} else MANY) - {a}) // MANY % 50",
        }[choice]

    def _test(self, depth: int) -> str:
        choice = self._random.randrange(7)
        if depth == 0 or choice <= 2:
            return f"{self._float(0)} {self._random.choice(('<', '<=', '>', '>=', '==', '!='))} {self._float(0)}"
        if choice == 3:
            return f"{self._integer(1)} {self._random.choice(('<', '>=', '=='))} {self._integer(0)}"
        if choice == 4:
            return f"not ({self._test(depth - 1)})"
        return f"({self._test(depth - 1)}) {self._random.choice(('and', 'or'))} ({self._test(depth - 1)})"
