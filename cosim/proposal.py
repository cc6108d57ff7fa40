"""Proposals: which variables of an FMU play the roles of a vehicle, where their names and units make it obvious.

Nothing is guessed that only the FMU's author knows: a unit that is not stated, a sign, a length. It stays open: `OPEN`
stands for it in the binding, which is refused until the user has filled it in.
"""

from __future__ import annotations

import re
import textwrap
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

from lxml import etree

from cosim.binding import NUMBER_TYPES, match, may_be_started, shape_of
from cosim.contract import CONTRACTS, Contract, Role
from cosim.errors import Location, printable
from cosim.fmu_units import UnitContradiction, unit_name, unit_of
from cosim.grammar import NAMESPACE
from cosim.naming import NEUTRAL, RECOGNITIONS, SERIES, STARTING, doubtful, without_start, words_of
from cosim.plant.spec import WHOLE
from cosim.scenario import OPEN, BindingSource, RoleSource
from plants import UnitError, units

_HERE = Location("the proposed binding")
_MOST_NAMED = 8
"""How many variables a sentence names."""


@dataclass(frozen=True)
class Suggestion:
    """What plays a role.

    Attributes
    ----------
    role : Role
        The role.
    source : RoleSource or None
        As a binding says it; None of an optional role for which there is nothing.
    open : tuple of str
        What the user must fill in, each a sentence.
    doubts : tuple of str
        What the user should look at, each a sentence.
    """

    role: Role
    source: RoleSource | None = None
    open: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()

    @property
    def needs_no_binding(self) -> bool:
        """Whether a binding need not mention the role."""
        return self.source is None or self.source == _by_name(self.role)


@dataclass(frozen=True)
class Proposal:
    """What plays the roles of a contract, in the order of the contract."""

    contract: Contract
    suggestions: tuple[Suggestion, ...]

    @property
    def open(self) -> tuple[Suggestion, ...]:
        """Those in which something is to be filled in."""
        return tuple(suggestion for suggestion in self.suggestions if suggestion.open)

    @property
    def doubts(self) -> tuple[Suggestion, ...]:
        """Those at which the user should look."""
        return tuple(suggestion for suggestion in self.suggestions if suggestion.doubts)

    @property
    def needs_no_binding(self) -> bool:
        """Whether the FMU can be driven as it is."""
        return not self.open and all(suggestion.needs_no_binding for suggestion in self.suggestions)

    @property
    def missing(self) -> tuple[Role, ...]:
        """The roles of pose and torque for which no variable was found."""
        wanted = (*self.contract.pose, *self.contract.torque)
        nothing = {s.role for s in self.suggestions if s.source is None or s.source.variable == OPEN}
        return tuple(role for role in wanted if role in nothing)

    @property
    def plausible(self) -> bool:
        """Whether the FMU seems to be such a vehicle: at least half of pose and torque are there, of each something."""
        found = [
            [role for role in roles if role not in self.missing] for roles in (self.contract.pose, self.contract.torque)
        ]
        return all(found) and sum(map(len, found)) > len(self.missing)

    @property
    def binding(self) -> BindingSource:
        """The binding, in which `OPEN` stands for what is to be filled in."""
        roles = tuple(s.source for s in self.suggestions if s.source is not None and not s.needs_no_binding)
        return BindingSource(self.contract.vehicle, roles, _HERE)


def proposals(description: Any) -> list[Proposal]:
    """Return a proposal for each contract, the one that lacks least first."""
    numbers = _Numbers(description)
    return sorted(
        (_proposed(description, contract, numbers) for contract in CONTRACTS),
        key=lambda proposal: (len(proposal.missing), len(proposal.open)),
    )


def propose(description: Any, contract: Contract) -> Proposal:
    """Propose what plays the roles of a contract.

    Parameters
    ----------
    description : fmpy.model_description.ModelDescription
        What the FMU says of itself.
    contract
        The contract.
    """
    return _proposed(description, contract, _Numbers(description))


def _proposed(description: Any, contract: Contract, numbers: _Numbers) -> Proposal:
    suggestions = [_suggest(role, description, contract, numbers) for role in contract.roles]
    played = Counter(s.source.variable for s in suggestions if s.source is not None and s.source.variable != OPEN)
    suggestions = [
        _open(s.role, (f"{s.source.variable!r} would play more than one role",))
        if s.source is not None and s.source.variable and played[s.source.variable] > 1
        else s
        for s in suggestions
    ]
    settled = [s.source for s in suggestions if s.source is not None and not s.open]
    _, problems = match(contract, description, settled)
    unfit = {problem.role: problem.sentence() for problem in problems}
    return Proposal(
        contract,
        tuple(
            _open(s.role, (unfit[s.role],)) if not s.open and s.source is not None and s.role in unfit else s
            for s in suggestions
        ),
    )


def binding_xml(proposal: Proposal, file: str) -> str:
    """Return a proposal as the text of a file with a binding, with a comment at each place that is open or in doubt.

    Parameters
    ----------
    proposal
        The proposal.
    file
        The FMU, for people.
    """
    contract = proposal.contract
    root = etree.Element(f"{{{NAMESPACE}}}binding", {"vehicle": contract.vehicle}, {None: NAMESPACE})
    about = (
        f"Which variables of {file} play the roles of a {contract.vehicle} vehicle, proposed by their names and units. "
        "Look through it: names tell no signs. A role that is not mentioned is played by the variable of its name."
    )
    if proposal.open:
        about += f' Where it says "{OPEN}", fill in what the comment asks for.'
    root.addprevious(_comment(textwrap.fill(about, 110, subsequent_indent=" " * 5)))
    for suggestion in proposal.suggestions:
        source = suggestion.source
        if source is None or suggestion.needs_no_binding:
            continue
        for sentence in (*suggestion.open, *suggestion.doubts):
            root.append(_comment(f"{suggestion.role.name}: {sentence}"))
        root.append(etree.Element(f"{{{NAMESPACE}}}role", attributes(source)))
    etree.indent(root)
    text = etree.tostring(root.getroottree(), encoding="unicode", pretty_print=True)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}'


def attributes(source: RoleSource) -> dict[str, str]:
    """Return the attributes of a role as a binding has them."""
    values = {field.name: getattr(source, field.name) for field in fields(source) if field.name != "where"}
    return {name: value for name, value in values.items() if value}


def _comment(text: str) -> etree._Element:
    """Return a comment with a text of unknown origin."""
    return etree.Comment(f" {re.sub('-(?=-)', '- ', printable(text))} ")


# The variables ----------------------------------------------------------------------------------------------


class _Number(NamedTuple):
    """A number of an FMU that could play a role.

    Attributes
    ----------
    name : str
        As a binding writes it.
    words : tuple of str
        Those of its variable's name.
    place : int
        In the array of which it is an element; -1 of a scalar.
    size : int
        Of this array.
    """

    variable: Any
    element: int
    name: str
    words: tuple[str, ...]
    place: int = -1
    size: int = 1


_INDEXED = re.compile(r"(.+)\[([0-9]+)\]")
_LARGEST_ARRAY = 16


def _numbers(description: Any) -> Iterator[_Number]:
    """Return the real numbers that could play a role: all scalars, and the elements of small arrays."""
    wanted = {causality for causalities in _ALLOWED.values() for causality in causalities}
    names = Counter(variable.name for variable in description.modelVariables)
    arrays: dict[str, list[tuple[int, Any]]] = {}  # those whose elements are variables of their own
    for variable in description.modelVariables:
        if variable.type not in NUMBER_TYPES or variable.causality not in wanted or names[variable.name] > 1:
            continue
        if variable.name.startswith(("der(", "__")):
            continue
        try:
            shape = shape_of(description, variable)
        except ValueError:
            continue
        if indexed := _INDEXED.fullmatch(variable.name):
            arrays.setdefault(indexed[1], []).append((int(indexed[2]), variable))
        elif not shape:
            yield _Number(variable, 0, variable.name, words_of(variable.name))
        elif len(shape) == 1 and shape[0] <= _LARGEST_ARRAY:
            words = words_of(variable.name)
            yield from (_Number(variable, i, f"{variable.name}[{i + 1}]", words, i, shape[0]) for i in range(shape[0]))
    for name, elements in arrays.items():
        for place, (_, variable) in enumerate(sorted(elements, key=lambda item: item[0])):
            yield _Number(variable, 0, variable.name, words_of(name), place, len(elements))


class _Numbers:
    """The numbers of an FMU that could play a role, found by their causality and by the words of their names.

    An FMU may have a hundred thousand of them: each role looks only at those whose names have a word that tells of it.
    """

    def __init__(self, description: Any) -> None:
        self._all = list(_numbers(description))
        self._of_word: dict[str, list[int]] = {}
        self._of_causality: dict[str, list[int]] = {}
        for place, number in enumerate(self._all):
            self._of_causality.setdefault(number.variable.causality, []).append(place)
            for word in {*number.words, number.name}:
                self._of_word.setdefault(word, []).append(place)

    def of(self, causality: str) -> list[_Number]:
        """Return those of a causality."""
        return [self._all[place] for place in self._of_causality.get(causality, ())]

    def having(self, words: Iterable[str]) -> list[_Number]:
        """Return those whose names have any of some words."""
        return [self._all[place] for place in sorted(self._places(words))]

    def telling(self, role: Role, contract: Contract) -> list[_Number]:
        """Return those whose names may tell of a role."""
        groups: list[Collection[str]] = [{role.name}, words_of(role.name)[:1]]
        groups += [series.words for series in SERIES[contract.vehicle] if role.name in series.roles]
        recognition = RECOGNITIONS[contract.vehicle].get(role.name)
        for clue in recognition.clues if recognition is not None else ():  # of each of its groups, a word must be there
            groups.append(min(clue.groups, key=lambda group: len(self._places(group))))
        return self.having({word for group in groups for word in group})

    def _places(self, words: Iterable[str]) -> set[int]:
        return {place for word in words for place in self._of_word.get(word, ())}


class _Reading(NamedTuple):
    """How the unit of a number fits a role: what a binding states of it, and what is open."""

    unit: str = ""
    factor: str = ""
    open: str = ""


def _reading(description: Any, variable: Any, role: Role) -> _Reading | None:
    """Return how a variable can be read in the unit of a role; None if it measures something else."""
    name = unit_name(variable)
    wanted = units.parse(role.unit)
    if not name:
        return _Reading(
            unit=OPEN, open=f"the FMU states no unit of {variable.name!r}: state it ({role.unit} or the like)"
        )
    try:
        own = unit_of(description, variable)
    except UnitContradiction as error:
        if error.unit.exponents != wanted.exponents:
            return None
        return _Reading(unit=OPEN, open=f"{error.question}: state {error.choice}")
    except UnitError:
        return _Reading(unit=OPEN, open=f"the unit {name!r} of {variable.name!r} is not known: state it")
    if own.exponents == wanted.exponents:
        return _Reading()
    if (own * units.parse("rad")).exponents == wanted.exponents:  # some tools take radians for pure numbers
        return _Reading(
            factor=OPEN, open=f'{variable.name!r} is in {name}, a pure number: if this is in rad, state factor="1 rad"'
        )
    return None


# The roles --------------------------------------------------------------------------------------------------


_ALLOWED: Mapping[str, tuple[str, ...]] = {
    "input": ("input",),
    "output": ("output", "local"),
    "parameter": ("parameter",),
}
"""Causalities of what can play a role, the better ones first."""


def _suggest(role: Role, description: Any, contract: Contract, numbers: _Numbers) -> Suggestion:
    if not role.unit:
        return _suggest_enumeration(role, description)
    fitting: list[tuple[tuple[int, int, int], _Number, _Reading]] = []
    unfit = []
    for number in numbers.telling(role, contract):
        causality = number.variable.causality
        if causality not in _ALLOWED[role.causality]:
            continue
        rank = _rank(role, contract, number, number.words)
        if rank is None:
            continue
        reading = _reading(description, number.variable, role)
        if reading is None:
            unfit.append(f"{number.name!r} is in {unit_name(number.variable)}")
            continue
        fitting.append(((rank[0], _ALLOWED[role.causality].index(causality), rank[1]), number, reading))
    best = _best([found for found in fitting if found[1].variable.type not in WHOLE] or fitting)
    if len(best) == 1:
        return _played(role, description, contract, best[0][1], best[0][2], numbers)
    reasons = []
    if best:
        reasons.append(f"could be played by {_listed(repr(number.name) for _, number, _ in best)}")
    elif unfit:
        reasons.append(f"needs a unit that fits {role.unit}: {_listed(unfit)}")
    if role.optional:
        return Suggestion(role)
    if role.causality == "parameter" and not best:
        return Suggestion(
            role,
            RoleSource(name=role.name, value=OPEN, where=_HERE),
            (f"no parameter is obviously {role.meaning}: state its value, or name the variable", *reasons),
        )
    return _open(role, (*reasons, *([] if best else [_nothing_found(role, description, numbers)])))


def _suggest_enumeration(role: Role, description: Any) -> Suggestion:
    for variable in description.modelVariables:
        if variable.name == role.name and variable.causality == role.causality and variable.type == "Enumeration":
            return Suggestion(role, _by_name(role))
    source = RoleSource(name=role.name, value=OPEN, where=_HERE)
    return Suggestion(role, source, (f"state {role.meaning}; nothing in the FMU says it",))


def _rank(role: Role, contract: Contract, number: _Number, words: tuple[str, ...]) -> tuple[int, int] | None:
    """Return how well a name fits a role, the smaller the better; None if it does not."""
    if number.name == role.name:
        return -2, 0
    if number.size > 1:
        found = (series.role(words, number.size, number.place) for series in SERIES[contract.vehicle])
        return (0, 0) if role.name in found else None
    if tuple(word for word in words if word not in NEUTRAL) == words_of(role.name):
        return -1, 0
    recognition = RECOGNITIONS[contract.vehicle].get(role.name)
    if recognition is None:
        return None
    rank = recognition.rank(words, has_unit=bool(unit_name(number.variable)))
    return None if rank is None else (rank[0] + 1, rank[1])


def _best(
    found: list[tuple[tuple[int, int, int], _Number, _Reading]],
) -> list[tuple[tuple[int, int, int], _Number, _Reading]]:
    """Return those that fit best, one of each number: variables with the same value reference are the same number."""
    least = min((rank for rank, _, _ in found), default=None)
    best = {(f[1].variable.valueReference, f[1].element): f for f in reversed(found) if f[0] == least}
    return list(reversed(best.values()))


def _played(
    role: Role,
    description: Any,
    contract: Contract,
    number: _Number,
    reading: _Reading,
    numbers: _Numbers,
) -> Suggestion:
    source = RoleSource(name=role.name, variable=number.name, unit=reading.unit, factor=reading.factor, where=_HERE)
    text = printable(" ".join((number.variable.description or "").split()))[:200]
    says = f". The FMU describes it as {text!r}" if text else ""
    open_ = [reading.open + says] if reading.open else []
    doubts = []
    if number.name != role.name and text and doubtful(role.name, text):
        doubts.append(f"here it is {role.meaning}; the FMU describes {number.name!r} as {text!r}")
    if role in contract.pose and not may_be_started(description, number.variable):
        initial = _initial(role, description, contract, number, numbers)
        source = replace(source, initial=initial or OPEN)
        if not initial:
            open_.append(
                f"{number.name!r} has no start value that can be set: name the parameter that gives the initial value"
            )
    return Suggestion(role, source, tuple(open_), tuple(doubts))


def _initial(role: Role, description: Any, contract: Contract, played_by: _Number, numbers: _Numbers) -> str | None:
    """Return the parameter that obviously gives the initial value of what plays a role."""
    fitting = []
    own = [word for word in played_by.words if word not in NEUTRAL]
    for number in numbers.having({*STARTING, "0"}):
        rest = without_start(number.words)
        if number.variable.causality != "parameter" or rest is None or number.size != played_by.size:
            continue
        if (reading := _reading(description, number.variable, role)) is None:
            continue
        if [word for word in rest if word not in NEUTRAL] == own and number.place == played_by.place:
            fitting.append(((-3, 0, 0), number, reading))
        elif (rank := _rank(role, contract, number, rest)) is not None:
            fitting.append(((rank[0], 0, rank[1]), number, reading))
    best = _best(fitting)
    return best[0][1].name if len(best) == 1 else None


def _by_name(role: Role) -> RoleSource:
    return RoleSource(name=role.name, variable=role.name, where=_HERE)


def _open(role: Role, sentences: tuple[str, ...]) -> Suggestion:
    """Return a role of which the user must say what plays it."""
    if role.optional:
        return Suggestion(role)
    return Suggestion(role, RoleSource(name=role.name, variable=OPEN, where=_HERE), sentences)


def _nothing_found(role: Role, description: Any, numbers: _Numbers) -> str:
    fitting = [
        repr(number.name)
        for number in numbers.of(role.causality)
        if _reading(description, number.variable, role) is not None
    ]
    return (
        f"no {role.causality} is obviously {role.meaning}; "
        f"{role.causality}s that could be: {_listed(fitting) if fitting else 'none'}"
    )


def _listed(names: Iterable[str]) -> str:
    names = list(names)
    more = len(names) - _MOST_NAMED
    return ", ".join(names[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
