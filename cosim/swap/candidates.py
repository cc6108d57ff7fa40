"""The numbers of an FMU that could play a role: by their names and units."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from itertools import chain
from typing import NamedTuple

from cosim.fmu.alike import all_without_numbers, without_numbers
from cosim.fmu.binding import NUMBER_TYPES, shape_of
from cosim.fmu.model_description import ModelDescription, Variable
from cosim.fmu.units import UnitContradiction, unit_name, unit_of
from cosim.scenario.scenario import OPEN
from cosim.swap.naming import in_english, parts_of, words_of
from cosim.swap.translations import unit_at_the_end
from cosim.vehicle.kind import Kind, Role
from plants import UnitError, units

ALLOWED: Mapping[str, tuple[str, ...]] = {
    "input": ("input",),
    "output": ("output", "local"),
    "parameter": ("parameter",),
}
"""Causalities of variables that can play a role, the better ones first."""


class Number(NamedTuple):
    """A number of an FMU that could play a role.

    Attributes
    ----------
    variable : Variable
        The variable that holds it.
    element : int
        Which of its elements it is, from 0; 0 of a scalar.
    name : str
        As a binding writes it.
    words : tuple of str
        Those of its variable's name, without a unit at the end.
    hint : str
        This unit; empty if there is none.
    array : str
        The name of its array; empty for a scalar.
    place : int
        In this array, from 0; -1 of a scalar.
    size : int
        Of this array.
    """

    variable: Variable
    element: int
    name: str
    words: tuple[str, ...]
    hint: str = ""
    array: str = ""
    place: int = -1
    size: int = 1


_INDEXED = re.compile(r"(.+)\[([0-9]+)\]")
_DIGITS = re.compile("[0-9]+")
_LARGEST_ARRAY = 16


class _Place(NamedTuple):
    """A number before its name has been looked at: as the attributes of `Number`, and the name without an index."""

    variable: Variable
    element: int
    name: str
    stem: str
    array: str = ""
    place: int = -1
    size: int = 1


def _places(description: ModelDescription) -> Iterator[_Place]:
    """Return the real numbers that could play a role: all scalars, and the elements of small arrays."""
    wanted = {causality for causalities in ALLOWED.values() for causality in causalities}
    types = frozenset(NUMBER_TYPES)
    known = description.by_name
    arrays: dict[str, list[tuple[int, Variable]]] = {}  # those whose elements are variables of their own
    for variable in description.modelVariables:
        name = variable.name
        if variable.type not in types or variable.causality not in wanted or known[name] is None:
            continue
        if name[:1] in "d_" and name.startswith(("der(", "__")):
            continue
        try:
            shape = shape_of(variable) if variable.dimensions else ()
        except ValueError:
            continue
        if name.endswith("]") and (indexed := _INDEXED.fullmatch(name)):
            arrays.setdefault(indexed[1], []).append((int(indexed[2]), variable))
        elif not shape:
            yield _Place(variable, 0, name, name)
        elif len(shape) == 1 and shape[0] <= _LARGEST_ARRAY:
            size = shape[0]
            yield from (_Place(variable, i, f"{name}[{i + 1}]", name, name, i, size) for i in range(size))
    for name, elements in arrays.items():
        for place, (_, variable) in enumerate(sorted(elements, key=lambda item: item[0])):
            yield _Place(variable, 0, variable.name, name, name, place, len(elements))


def _named(description: ModelDescription, variable: Variable, name: str) -> tuple[tuple[str, ...], str]:
    """Return the words of a name, and the unit that it ends with, if the variable is in no other."""
    parts = parts_of(name)
    count, hint = unit_at_the_end(parts)
    if count and unit_name(variable):
        try:
            fits = unit_of(description, variable).exponents == units.parse(hint).exponents
        except UnitError:
            fits = True
        count, hint = (count, hint) if fits else (0, "")
    return in_english(parts[: len(parts) - count]), hint


class Numbers:
    """The numbers of an FMU that could play a role, found by their causality and by the words of their names.

    An FMU may have a hundred thousand of them. Those are *alike* that have the same unit and causality, and names that
    differ by digits other than 0 only; of such a group, one name is taken apart. Each role looks only at those whose
    names have a word that tells of it.
    """

    def __init__(self, description: ModelDescription) -> None:
        self._description = description
        self._places = list(_places(description))
        self._number_at: dict[int, Number] = {}
        self._of_name = {place.name: at for at, place in enumerate(self._places)}
        self._of_array: dict[str, list[int]] = defaultdict(list)
        groups: dict[tuple[str, str, str], list[int]] = defaultdict(list)
        stems = all_without_numbers(place.stem for place in self._places)
        for at, (place, stem) in enumerate(zip(self._places, stems, strict=False)):
            groups[stem, unit_name(place.variable), place.variable.causality].append(at)
            if place.array:
                self._of_array[place.array].append(at)
        self._of_causality: dict[str, list[list[int]]] = defaultdict(list)
        self._of_word: dict[str, list[list[int]]] = defaultdict(list)
        for (_, _, causality), alike in groups.items():
            self._of_causality[causality].append(alike)
            for word in set(map(without_numbers, self._number(alike[0]).words)):
                self._of_word[word].append(alike)

    def of(self, causality: str) -> list[Number]:
        """Return the numbers of a causality."""
        return [self._number(at) for at in sorted(at for alike in self._of_causality[causality] for at in alike)]

    def named(self, name: str) -> Number:
        """Return the one of a name that is known to be there."""
        return self._number(self._of_name[name])

    def having(self, words: Iterable[str]) -> list[Number]:
        """Return those whose names have any of some words, or are one of them."""
        found = {self._of_name[word] for word in words if word in self._of_name}
        for word in words:
            of_all = word == "0" or not word.isdigit()
            for alike in self._of_word.get(without_numbers(word), ()):
                found.update(alike if of_all else (at for at in alike if self._has_number(at, word)))
        return [self._number(at) for at in sorted(found)]

    def names(self, causality: str, chosen: Callable[[Number], bool]) -> list[str]:
        """Return the names of the numbers of a causality that fit by unit and by the words of the name."""
        chosen_ones = (alike for alike in self._of_causality[causality] if chosen(self._number(alike[0])))
        return [self._places[at].name for at in sorted(chain.from_iterable(chosen_ones))]

    def array_of(self, number: Number) -> list[Number]:
        """Return all elements of the array that a number is in, in their order."""
        return [self._number(at) for at in self._of_array[number.array]]

    def telling(self, role: Role, kind: Kind) -> list[Number]:
        """Return the numbers whose names may tell of a role."""
        groups: list[Collection[str]] = [{role.name}, words_of(role.name)[:1]]
        groups += [series.words for series in kind.series if role.name in series.roles]
        recognition = kind.recognised.by_role.get(role.name)
        for clue in recognition.clues if recognition is not None else ():  # of each of its groups, a word must be there
            groups.append(min(clue.groups, key=self._frequency))
        return self.having({word for group in groups for word in group})

    def _number(self, at: int) -> Number:
        number = self._number_at.get(at)
        if number is None:
            variable, element, name, stem, array, place, size = self._places[at]
            words, hint = _named(self._description, variable, stem)
            number = self._number_at[at] = Number(variable, element, name, words, hint, array, place, size)
        return number

    def _has_number(self, at: int, digits: str) -> bool:
        return digits in _DIGITS.findall(self._places[at].stem)

    def _frequency(self, words: Iterable[str]) -> int:
        return sum(len(alike) for word in words for alike in self._of_word.get(without_numbers(word), ()))


class Reading(NamedTuple):
    """How the unit of a number fits a role: statements for a binding, and open questions."""

    unit: str = ""
    factor: str = ""
    open: str = ""


def reading(description: ModelDescription, number: Number, role: Role) -> Reading | None:
    """Return how a number can be read in the unit of a role; None if it measures something else."""
    variable = number.variable
    name = unit_name(variable)
    wanted = units.parse(role.unit)
    if not name:
        if number.hint and units.parse(number.hint).exponents != wanted.exponents:
            return None
        like = f"{role.unit} or the like" if not number.hint else f"{number.hint}, as its name ends, or the like"
        return Reading(unit=OPEN, open=f"the FMU states no unit of {variable.name!r}: state it ({like})")
    try:
        own = unit_of(description, variable)
    except UnitContradiction as error:
        if error.unit.exponents != wanted.exponents:
            return None
        return Reading(unit=OPEN, open=f"{error.question}: state {error.choice}")
    except UnitError:
        return Reading(unit=OPEN, open=f"the unit {name!r} of {variable.name!r} is not known: state it")
    if own.exponents == wanted.exponents:
        return Reading()
    if (own * units.parse("rad")).exponents == wanted.exponents:  # some tools take radians for pure numbers
        return Reading(
            factor=OPEN, open=f'{variable.name!r} is in {name}, a pure number: if this is in rad, state factor="1 rad"'
        )
    return None
