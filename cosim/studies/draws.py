"""The runs of a draw: they share its values and its noise, so that in what must hold a draw counts once.

Two laws that are run on the same twenty draws make forty runs, and twenty independent ones. If every value is crossed,
each run counts by itself. Of a grid, the seeds alone are draws: two whose runs are the same are one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from cosim.errors import nearest
from cosim.scenario.written_element import Written
from cosim.studies.bounds import Sequential
from cosim.studies.row import Row
from cosim.studies.study import Study, Vary
from cosim.studies.values import Finite

AT_RANDOM = ("random", "latin_hypercube", "sobol")
"""Methods whose runs show, with a confidence, what others would be like."""

ENUMERATED = ("grid", "one_at_a_time")
"""Methods that take values one by one: a draw that comes again is no other one."""


@dataclass(frozen=True)
class Draws:
    """How runs belong to draws, and which of them count.

    Attributes
    ----------
    given : tuple of int and str
        Values that count alone: the index of each, and its text.
    crossed : tuple of int
        The indices of all other values that every draw is run with.
    size : int
        How many runs of a draw count.
    single : bool
        Whether each run counts by itself, as nothing is drawn.
    once : bool
        Whether draws with the same runs count once. By chance, they may come twice.
    """

    given: tuple[tuple[int, str], ...]
    crossed: tuple[int, ...]
    size: int
    single: bool
    once: bool = False

    def of(self, rows: Sequence[Row]) -> list[list[Row]]:
        """Return the runs that count, those of a draw together."""
        found: dict[int, list[Row]] = {}
        for row in filter(self.counts, rows):
            found.setdefault(self.key(row), []).append(row)
        return self.different(found.values())

    def different(self, draws: Iterable[list[Row]]) -> list[list[Row]]:
        """Return the draws that count: without those whose runs are all the same as those of one before."""
        if not self.once:
            return list(draws)
        found: dict[tuple[str, ...], list[Row]] = {}
        for own in draws:
            found.setdefault(tuple(row.key for row in own), own)
        return list(found.values())

    def key(self, row: Row) -> int:
        """Return a number that the runs of a draw share."""
        return row.number if self.single else row.draw

    def counts(self, row: Row) -> bool:
        """Return whether a run counts."""
        return all(row.values[index] == text for index, text in self.given)

    def told(self, number: int) -> str:
        """Return a number of draws, in words."""
        return f"{number} runs" if self.size == 1 else f"{number} draws of {self.size} runs"


def draws_of(study: Study, given: Sequence[Written]) -> Draws:
    """Return how the runs of a study belong to draws, of which some values count alone.

    Raises
    ------
    InputError
        No such value is varied; with its place.
    """
    fixed = [_fixed(study, one) for one in given]
    crossed = [index for index, vary in enumerate(study.vary) if vary.crossed]
    single = len(crossed) == len(study.vary)
    others = tuple(index for index in crossed if index not in dict(fixed))
    sizes = [len(values) for values in (study.vary[index].values for index in others) if isinstance(values, Finite)]
    once = single or study.sample.method in ENUMERATED
    return Draws(tuple(fixed), others, 1 if single else math.prod(sizes), single, once)


def is_seed(vary: Vary) -> bool:
    """Return whether a value is the seed of the noise alone, each value of which is a draw of its own."""
    return bool(vary.targets) and all(target.select.rpartition("/@")[2] == "seed" for target in vary.targets)


def value_named(study: Study, written: Written, name: str) -> int:
    """Return the index of a varied value; raises InputError with its place if there is none of the name."""
    names = [vary.name for vary in study.vary]
    if name not in names:
        raise written.error(f"nothing varies that is named {name!r}: {nearest(name, names)}")
    return names.index(name)


def check_choice(study: Study, written: Written, index: int, text: str) -> None:
    """Refuse a text that is none of the values of what varies; raises InputError with its place."""
    vary = study.vary[index]
    if not isinstance(vary.values, Finite):
        raise written.error(
            f"{vary.name!r} has another value in each draw: name one with cases, a list, a grid or a range"
        )
    if text not in vary.values.texts:
        raise written.error(f"{vary.name!r} has no value {text!r}: {nearest(text, list(vary.values.texts[:1000]))}")


def check_two_cases(study: Study, written: Written, index: int, case: str, than: str, equal: str) -> None:
    """Refuse two cases that cannot be compared draw by draw, equal ones in words of their own; raises InputError."""
    vary = study.vary[index]
    if not vary.crossed:
        raise written.error(f'{vary.name!r} is not crossed, so no two runs have the same draw: add cross="yes" to it')
    for one in (case, than):
        check_choice(study, written, index, one)
    if case == than:
        raise written.error(f"{equal}: name two cases")


def _fixed(study: Study, written: Written) -> tuple[int, str]:
    index, text = value_named(study, written, written.get("vary")), written.get("is")
    check_choice(study, written, index, text)
    return index, text


class EarlyTest:
    """A sequential test of whether draws pass, which takes the runs in their order.

    Attributes
    ----------
    passed : int
        How many draws have passed, up to the decision.
    """

    def __init__(self, draws: Draws, passes: Callable[[Row], bool], bound: float, confidence: float) -> None:
        self._draws, self._passes = draws, passes
        self._test = Sequential(bound, confidence)
        self._begun: dict[int, list[Row]] = {}
        self._seen: set[tuple[str, ...]] = set()
        self.passed = 0

    @property
    def above(self) -> bool | None:
        """Whether the probability is above the bound; None while that is open."""
        return self._test.above

    @property
    def trials(self) -> int:
        """How many draws count."""
        return self._test.trials

    def add(self, row: Row) -> None:
        """Take one more run; after the decision, none counts any more."""
        if self.above is not None or not self._draws.counts(row):
            return
        begun = self._begun.setdefault(self._draws.key(row), [])
        begun.append(row)
        if len(begun) == self._draws.size:
            del self._begun[self._draws.key(row)]
            if self._draws.once:
                runs = tuple(own.key for own in begun)
                if runs in self._seen:
                    return
                self._seen.add(runs)
            passed = all(map(self._passes, begun))
            self.passed += passed
            self._test.add(passed)
