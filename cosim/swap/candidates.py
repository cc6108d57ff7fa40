"""The numbers of an FMU that could play a role: by their names and units."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, count
from operator import itemgetter
from typing import NamedTuple

from cosim.fmu.alike import KEPT, without_numbers
from cosim.fmu.binding import NUMBER_TYPES, shape_of
from cosim.fmu.model_description import ModelDescription, SimpleType, Variable
from cosim.fmu.units import UndecidedUnit, unit_name, unit_of
from cosim.scenario.scenario import OPEN
from cosim.swap.naming import in_english, parts_of, without_start, words_of
from cosim.swap.translations import unit_at_the_end
from cosim.vehicle.kind import Kind, Role
from plants import UnitError, units

ALLOWED: Mapping[str, tuple[str, ...]] = {
    "input": ("input",),
    "output": ("output", "local"),
    "parameter": ("parameter",),
}
"""Causalities of variables that can play a role, the better ones first."""


@dataclass(eq=False)
class Number:
    """A number of an FMU that could play a role.

    Attributes
    ----------
    description : ModelDescription
        That of the FMU.
    at : int
        Numbers have the order of this.
    variable : Variable
        The variable that holds it.
    element : int
        Which of its elements it is, from 0; 0 of a scalar.
    name : str
        As a binding writes it.
    stem : str
        The name without its index.
    array : str
        The name of its array; empty for a scalar.
    place : int
        In this array, from 0; -1 of a scalar.
    size : int
        Of this array.
    """

    description: ModelDescription
    at: int
    variable: Variable
    element: int
    name: str
    stem: str
    array: str = ""
    place: int = -1
    size: int = 1

    @property
    def words(self) -> tuple[str, ...]:
        """The words of its variable's name, without a unit at the end."""
        return self._named[0]

    @property
    def hint(self) -> str:
        """The unit at the end of the name; empty if there is none."""
        return self._named[1]

    @cached_property
    def _named(self) -> tuple[tuple[str, ...], str]:
        return _named(self.description, self.variable, self.stem)


class Alike(NamedTuple):
    """Numbers of which all that tells of a role is the same: the first one, and where all of them are."""

    first: Number
    places: Sequence[int]


_INDEXED = re.compile(r"(.+)\[([0-9]+)\]")
_DIGITS = re.compile("[0-9]+")
_LARGEST_ARRAY = 16
_Key = tuple[str, str, str, str | None, SimpleType | None, bool]
"""What variables have in common that are alike: name without numbers, causality, type, unit, whether an array."""


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

    They are the real scalars, and the elements of small arrays. An FMU may have a hundred thousand of them. Those are
    *alike* that have the same unit and causality, and names without an index that differ by numbers only, other than
    those that are kept; of such a group, one name is taken apart. Each role looks only at those whose names have a
    word that tells of it.
    """

    def __init__(self, description: ModelDescription) -> None:
        self._description = description
        self._known: dict[int, Number] = {}  # those that were made; scalars are made when they are asked for
        self._of_name: dict[str, int] = {}
        self._of_array: dict[str, list[Number]] = defaultdict(list)
        self._of_causality: dict[str, list[list[int]]] = defaultdict(list)
        self._of_word: dict[str, list[list[int]]] = defaultdict(list)
        self._of_unit: dict[str, dict[tuple[str, str], list[list[int]]]] = {}  # of those that are no initial values
        self._readable: dict[tuple[str, str, str], bool] = {}
        variables = description.modelVariables
        indexed: list[int] = []
        for (stem, causality, _, _, _, has_dimensions), places in self._groups():
            if _INDEXED.fullmatch(stem):
                indexed += places
            elif has_dimensions:
                self._add_arrays(places)
            else:
                self._of_name |= {variables[at // _LARGEST_ARRAY].name: at for at in places}
                self._add(causality, places)
        self._add_elements(sorted(indexed))

    def _groups(self) -> Iterator[tuple[_Key, list[int]]]:
        """Yield where variables are that could play a role, those that are alike together."""
        variables, known = self._description.modelVariables, self._description.by_name
        stems = self._description.names_without_numbers
        groups: dict[_Key, list[int]] = defaultdict(list)
        for at, v, stem in zip(count(step=_LARGEST_ARRAY), variables, stems, strict=False):
            groups[stem, v.causality, v.type, v.unit, v.declaredType, bool(v.dimensions)].append(at)
        wanted = {causality for causalities in ALLOWED.values() for causality in causalities}
        for key, places in groups.items():
            stem, causality, kind, *_ = key
            if kind not in NUMBER_TYPES or causality not in wanted or stem.startswith(("der(", "__")):
                continue
            if len(known) < len(variables):  # several have one name
                places = [at for at in places if known[self._variable(at).name] is not None]
            if places:
                yield key, places

    def _add_arrays(self, places: Iterable[int]) -> None:
        """Add the elements of arrays that are a variable each, and that are alike."""
        elements: list[Number] = []
        for at in places:
            variable = self._variable(at)
            name, shape = variable.name, _shape(variable) or ()
            size = shape[0] if len(shape) == 1 and shape[0] <= _LARGEST_ARRAY else 0
            for i in range(size):
                elements.append(self._element(at + i, variable, i, f"{name}[{i + 1}]", name, i, size))
        if elements:
            self._add(elements[0].variable.causality, [number.at for number in elements])

    def _add_elements(self, places: Iterable[int]) -> None:
        """Add variables that are elements of arrays, as their names say."""
        arrays: dict[str, list[tuple[int, Variable]]] = {}
        for variable in map(self._variable, places):
            if (indexed := _INDEXED.fullmatch(variable.name)) and _shape(variable) is not None:
                arrays.setdefault(indexed[1], []).append((int(indexed[2]), variable))
        behind = count(_LARGEST_ARRAY * len(self._description.modelVariables))
        groups: dict[tuple[str, str, str], list[int]] = defaultdict(list)
        for name, elements in arrays.items():
            stem = without_numbers(name)
            for place, (_, variable) in enumerate(sorted(elements, key=itemgetter(0))):
                number = self._element(next(behind), variable, 0, variable.name, name, place, len(elements))
                groups[stem, unit_name(variable), variable.causality].append(number.at)
        for (_, _, causality), alike in groups.items():
            self._add(causality, alike)

    def _element(
        self, at: int, variable: Variable, element: int, name: str, array: str, place: int, size: int
    ) -> Number:
        number = self._known[at] = Number(self._description, at, variable, element, name, array, array, place, size)
        self._of_name[name] = at
        self._of_array[array].append(number)
        return number

    def _add(self, causality: str, alike: list[int]) -> None:
        self._of_causality[causality].append(alike)
        for word in set(map(without_numbers, self._number(alike[0]).words)):
            self._of_word[word].append(alike)

    def of(self, causality: str) -> list[Number]:
        """Return the numbers of a causality."""
        return self.those_at(chain.from_iterable(self._of_causality[causality]))

    def named(self, name: str) -> Number:
        """Return the one of a name that is known to be there."""
        return self._number(self._of_name[name])

    def those_at(self, places: Iterable[int]) -> list[Number]:
        """Return the numbers at some places, in their order."""
        return [self._number(at) for at in sorted(places)]

    def having(self, words: Iterable[str]) -> list[Number]:
        """Return those whose names have any of some words, or are one of them."""
        alone, groups = self._having(set(words))
        return self.those_at(alone.union(*groups))

    def readable(self, number: Number, role: Role) -> bool:
        """Return whether a number can be read in the unit of a role; see `reading`."""
        key = (unit_name(number.variable), number.hint, role.unit)
        known = self._readable.get(key)
        if known is None:
            known = self._readable[key] = reading(self._description, number, role) is not None
        return known

    def could_play(self, role: Role) -> list[str]:
        """Return the names of numbers that could play a role by their unit; if none, of numbers without one."""
        found: dict[bool, list[list[int]]] = {True: [], False: []}
        for (unit, hint), groups in self._by_unit(role.causality).items():
            if self.readable(self._number(groups[0][0]), role):
                found[bool(unit or hint)] += groups
        places = sorted(chain.from_iterable(found[True] or found[False]))
        return [self._known[at].name if at in self._known else self._variable(at).name for at in places]

    def _by_unit(self, causality: str) -> dict[tuple[str, str], list[list[int]]]:
        """Return the numbers of a causality that are no initial values, by their unit and the unit in the name."""
        if causality not in self._of_unit:
            known = self._of_unit[causality] = defaultdict(list)
            for alike in self._of_causality[causality]:
                first = self._number(alike[0])
                if without_start(first.words) is None:
                    known[unit_name(first.variable), first.hint].append(alike)
        return self._of_unit[causality]

    def array_of(self, number: Number) -> list[Number]:
        """Return all elements of the array that a number is in, in their order."""
        return self._of_array[number.array]

    def telling(self, role: Role, kind: Kind) -> Iterator[Alike]:
        """Yield the numbers whose names may tell of a role; each element of an array by itself."""
        groups: list[Collection[str]] = [{role.name}, words_of(role.name)[:1]]
        groups += [series.words for series in kind.series if role.name in series.roles]
        recognition = kind.recognised.by_role.get(role.name)
        for clue in recognition.clues if recognition is not None else ():  # of each of its groups, a word must be there
            groups.append(min(clue.groups, key=self._frequency))
        alone, found = self._having({word for group in groups for word in group})
        sizes = {1}.union(*(series.sizes for series in kind.series))
        for alike in found:
            others = [at for at in alike if at not in alone] if alone else alike
            if others and self._number(others[0]).array:
                others = [at for at in others if self._number(at).size in sizes]
                yield from (Alike(self._number(at), (at,)) for at in others)
            elif others:
                yield Alike(self._number(others[0]), others)
        yield from (Alike(self._number(at), (at,)) for at in alone)

    def _having(self, words: Set[str]) -> tuple[set[int], list[list[int]]]:
        """Return where numbers are whose names have any of some words or are one of them: each alone, and groups."""
        alone = {self._of_name[word] for word in words if word in self._of_name}
        groups: dict[int, list[int]] = {}
        for word in words:
            for alike in self._of_word.get(without_numbers(word), ()):
                if word in KEPT or not word.isdigit():
                    groups[id(alike)] = alike
                else:
                    alone.update(at for at in alike if word in _DIGITS.findall(self._number(at).stem))
        return alone, list(groups.values())

    def _variable(self, at: int) -> Variable:
        return self._description.modelVariables[at // _LARGEST_ARRAY]

    def _number(self, at: int) -> Number:
        number = self._known.get(at)
        if number is None:
            variable = self._variable(at)
            number = self._known[at] = Number(self._description, at, variable, 0, variable.name, variable.name)
        return number

    def _frequency(self, words: Iterable[str]) -> int:
        return sum(len(alike) for word in words for alike in self._of_word.get(without_numbers(word), ()))


def _shape(variable: Variable) -> tuple[int, ...] | None:
    """Return the dimensions of a variable; None if one is not known."""
    try:
        return shape_of(variable) if variable.dimensions else ()
    except ValueError:
        return None


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
    except UndecidedUnit as error:
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
