"""What a varied value may be: a list, a grid, whole numbers, a random value, or one of several cases.

Each kind is chosen either by its index or, if it is random, by a number between 0 and 1. Values are texts, as the
scenario holds them. Random ones have ten digits, so that they are the same texts on every machine, whose libraries may
differ in the last bit.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from cosim.errors import shown
from cosim.quantity import quantity, spelled, split
from cosim.scenario.written_element import Written
from cosim.studies.sizes import MOST_RUNS, too_many
from plants import UnitError, units

NEXT_TO_0, NEXT_TO_1 = 2.0**-54, 1.0 - 2.0**-53
"""The ends of what a random value is drawn by: its quantiles there are finite."""


@dataclass(frozen=True)
class Finite:
    """One of several values.

    Attributes
    ----------
    texts : sequence of str
        The values.
    """

    texts: Sequence[str]

    def __len__(self) -> int:
        return len(self.texts)

    def at(self, fraction: float) -> int:
        """Return the index of the value that a number between 0 and 1 draws; all are equally likely."""
        return min(int(fraction * len(self.texts)), len(self.texts) - 1)


@dataclass(frozen=True)
class Random:
    """A random value.

    Attributes
    ----------
    quantile : callable
        Returns the number at a probability.
    unit : str
        The unit of that number; "1" for none.
    least, greatest : float
        No value is outside.
    """

    quantile: Callable[[float], float]
    unit: str
    least: float = -math.inf
    greatest: float = math.inf

    def at(self, fraction: float) -> str:
        """Return the value that a number between 0 and 1 draws."""
        number = float(f"{self.quantile(fraction):.10g}")
        return spelled(min(max(number, self.least), self.greatest), self.unit)


@dataclass(frozen=True)
class Count:
    """A whole number that grows by one from draw to draw."""

    first: int

    def at(self, draw: int) -> str:
        """Return the value of a draw, counted from 0."""
        return str(self.first + draw)


Values = Finite | Random | Count


def has_spread(values: Values) -> bool:
    """Return whether draws of it differ: not those of a range without width, or of one value in several writings."""
    if isinstance(values, Random):
        return values.at(NEXT_TO_0) != values.at(NEXT_TO_1)
    return isinstance(values, Count) or any(not _same(values.texts[0], text) for text in values.texts)


def _same(one: str, other: str) -> bool:
    """Return whether two texts are equal, or equal quantities."""
    if one == other:
        return True
    try:
        number, unit = split(one)
        return math.isclose(number, quantity(other, unit), rel_tol=1e-10)
    except (ValueError, UnitError):  # several numbers, a file
        return False


def _meant(text: str) -> object:
    """Return a whole number, or a number with a unit in SI units with its dimension; any other text as it is."""
    if re.fullmatch(r"[+-]?[0-9]{1,30}", text):
        return int(text)
    try:
        number, unit = split(text)
        parsed = units.parse(unit)
        return (float(f"{number * parsed.factor:.15g}"), parsed.exponents) if unit.strip("0123456789. ") else text
    except (ValueError, UnitError):
        return text


# Reading -----------------------------------------------------------------------------------------------------


def values_of(element: Written) -> Values:
    """Return the values that an element of a study describes.

    Raises
    ------
    InputError
        They make no sense; with their place.
    """
    return _KINDS[element.kind](element)


def _list(element: Written) -> Finite:
    texts = [text.strip() for text in element.get("values").split(",")]
    if "" in texts:
        raise element.error(f'values="{shown(element.get("values"))}" of <list> has an empty value')
    found: dict[object, str] = {}
    for text in texts:
        if (before := found.setdefault(_meant(text), text)) != text:
            raise element.error(f"{shown(before)!r} and {shown(text)!r} are the same value")
    if len(found) < len(texts):
        twice = next(text for text, times in Counter(texts).items() if times > 1)
        raise element.error(f"the value {shown(twice)!r} is given twice")
    return Finite(texts)


def _grid(element: Written) -> Finite:
    least, greatest, unit = _ends(element)
    points = int(element.get("points"))
    if points > MOST_RUNS:
        raise element.error(f"the <grid> has {points:,} points, {too_many(points)}")
    if points == 1 and least != greatest:
        raise element.error("one point cannot be both the least and the greatest value: ask for 2 points or more")
    fractions = np.linspace(0.0, 1.0, points)
    if "scale" in element:
        _check_positive(element, least)
        numbers = least * (greatest / least) ** fractions
    else:
        numbers = least + (greatest - least) * fractions
    texts = [spelled(float(f"{number:.10g}"), unit) for number in numbers.tolist()]
    if points > 1:
        texts[0], texts[-1] = spelled(least, unit), spelled(greatest, unit)
    return Finite(texts)


def _range(element: Written) -> Finite:
    first, last = int(element.get("from")), int(element.get("to"))
    if first > last:
        raise element.error(f"the range begins with {first}, after its end {last}: exchange from and to")
    if last - first >= MOST_RUNS:
        raise element.error(f"the <range> has {last - first + 1:,} numbers, {too_many(last - first + 1)}")
    return Finite(_Numbers(first, last))


class _Numbers(Sequence[str]):
    """The whole numbers of a range, as texts that are made when they are needed."""

    def __init__(self, first: int, last: int) -> None:
        self._range = range(first, last + 1)

    def __len__(self) -> int:
        return len(self._range)

    def __getitem__(self, index: int) -> str:  # type: ignore[override]
        return str(self._range[index])


def _count(element: Written) -> Count:
    return Count(int(element.get("from")))


def _uniform(element: Written) -> Random:
    least, greatest, unit = _ends(element)
    return Random(lambda at: least + (greatest - least) * at, unit, least, greatest)


def _log_uniform(element: Written) -> Random:
    least, greatest, unit = _ends(element)
    _check_positive(element, least)
    return Random(lambda at: least * (greatest / least) ** at, unit, least, greatest)


def _normal(element: Written) -> Random:
    mean, unit = number_of(element, "mean")
    deviation = element.quantity("deviation", unit)
    least = element.quantity("from", unit) if "from" in element else -math.inf
    greatest = element.quantity("to", unit) if "to" in element else math.inf
    if deviation <= 0.0:
        raise element.error(f'deviation="{element.get("deviation")}" of <normal> must be greater than zero')
    if least >= greatest:
        raise element.error("nothing is between from and to of <normal>")
    below, above = (float(ndtr((end - mean) / deviation)) for end in (least, greatest))
    if above - below < 1e-6:
        raise element.error("the part of <normal> between from and to has a probability of less than one in a million")
    return Random(lambda at: mean + deviation * float(ndtri(below + (above - below) * at)), unit, least, greatest)


_KINDS: Mapping[str, Callable[[Written], Values]] = {
    "list": _list,
    "grid": _grid,
    "range": _range,
    "count": _count,
    "uniform": _uniform,
    "log_uniform": _log_uniform,
    "normal": _normal,
}


def _ends(element: Written) -> tuple[float, float, str]:
    """Return the least and the greatest value, in the unit of the least one, and that unit."""
    least, unit = number_of(element, "from")
    greatest = element.quantity("to", unit)
    if least > greatest:
        raise element.error(
            f'from="{element.get("from")}" of <{element.kind}> is greater than to="{element.get("to")}"'
        )
    return least, greatest, unit


def number_of(element: Written, name: str) -> tuple[float, str]:
    """Return an attribute that is a quantity as its number and its unit; raises InputError with its place."""
    try:
        _, unit = split(element.get(name))
        return quantity(element.get(name), unit), unit
    except ValueError as error:
        raise element.error(f'{name}="{shown(element.get(name))}" of <{element.kind}>: {error}') from None


def _check_positive(element: Written, least: float) -> None:
    if least <= 0.0:
        raise element.error(f'from="{element.get("from")}" of <{element.kind}> has no logarithm')
