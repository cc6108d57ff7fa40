"""Proposals: which variables of an FMU play the roles of a vehicle, where their names and units make it obvious.

A proposal does not guess facts that only the FMU's author knows: a unit that is not stated, a sign, a length. `OPEN`
stands for them in the binding, and a binding with `OPEN` is refused until the user has filled it in.
"""

from __future__ import annotations

import re
import textwrap
from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

from lxml import etree

from cosim.errors import Location, printable
from cosim.fmu.binding import match, may_be_started
from cosim.fmu.model_description import ModelDescription
from cosim.fmu.units import unit_name
from cosim.plant.spec import WHOLE
from cosim.scenario.grammar import NAMESPACE
from cosim.scenario.scenario import OPEN, BindingSource, RoleSource
from cosim.swap.array_roles import Told, told
from cosim.swap.candidates import ALLOWED, Alike, Number, Numbers, Reading, reading
from cosim.swap.naming import doubtful, without_start, words_of
from cosim.swap.wrong_kind import no_vehicle, other_kind
from cosim.vehicle.kind import Kind, Role
from cosim.vehicle.kinds import kinds
from cosim.vehicle.words import NEUTRAL, STARTING

_HERE = Location("the proposed binding")
_MOST_NAMED = 8
"""Number of variables that a sentence names."""


@dataclass(frozen=True)
class Suggestion:
    """The proposed player of a role.

    Attributes
    ----------
    role : Role
        The role.
    source : RoleSource or None
        The role in a binding; None for an optional role without a player.
    open : tuple of str
        Open questions for the user, each a sentence.
    doubts : tuple of str
        Doubts that the user should check, each a sentence.
    candidates : tuple of str
        For a role without a player: the numbers that may play it, among which the user must choose.
    """

    role: Role
    source: RoleSource | None = None
    open: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    candidates: tuple[str, ...] = ()

    @property
    def needs_no_binding(self) -> bool:
        """Whether a binding need not mention the role."""
        return not self.doubts and (self.source is None or self.source == _by_name(self.role))


@dataclass(frozen=True)
class Proposal:
    """The proposed players of the roles of a kind of vehicle.

    Attributes
    ----------
    kind : Kind
        The kind of vehicle.
    suggestions : tuple of Suggestion
        One for each role, in the order of the kind.
    refusal : str
        Why the FMU is clearly no such vehicle; empty if it may be one.
    """

    kind: Kind
    suggestions: tuple[Suggestion, ...]
    refusal: str = ""

    @property
    def open(self) -> tuple[Suggestion, ...]:
        """The suggestions in which the user must fill in something."""
        return tuple(suggestion for suggestion in self.suggestions if suggestion.open)

    @property
    def doubts(self) -> tuple[Suggestion, ...]:
        """The suggestions that the user should check."""
        return tuple(suggestion for suggestion in self.suggestions if suggestion.doubts)

    @property
    def needs_no_binding(self) -> bool:
        """Whether the FMU can be driven as it is."""
        return not self.open and all(suggestion.needs_no_binding for suggestion in self.suggestions)

    @property
    def missing(self) -> tuple[Role, ...]:
        """The roles of pose and torque without a player or a candidate."""
        wanted = (*self.kind.pose, *self.kind.command)
        nothing = {
            s.role for s in self.suggestions if not s.candidates and (s.source is None or s.source.variable == OPEN)
        }
        return tuple(role for role in wanted if role in nothing)

    @property
    def plausible(self) -> bool:
        """Whether the FMU seems to be such a vehicle: half of the roles are there, some of pose and some of torque."""
        found = [[role for role in roles if role not in self.missing] for roles in (self.kind.pose, self.kind.command)]
        return not self.refusal and all(found) and sum(map(len, found)) > len(self.missing)

    @property
    def binding(self) -> BindingSource:
        """The binding, in which `OPEN` stands for text to fill in."""
        roles = tuple(s.source for s in self.suggestions if s.source is not None and not s.needs_no_binding)
        return BindingSource(self.kind.name, roles, _HERE)


def proposals(description: ModelDescription) -> list[Proposal]:
    """Return a proposal for each kind that is installed, the likeliest kind of vehicle first."""
    numbers = Numbers(description)
    return sorted(
        (_proposed(description, kind, numbers) for kind in kinds()),
        key=lambda proposal: (bool(proposal.refusal), len(proposal.missing), len(proposal.open)),
    )


def propose(description: ModelDescription, kind: Kind) -> Proposal:
    """Propose players for the roles of a kind of vehicle.

    Parameters
    ----------
    description : ModelDescription
        The FMU's model description.
    kind
        The kind of vehicle.
    """
    return _proposed(description, kind, Numbers(description))


def _proposed(description: ModelDescription, kind: Kind, numbers: Numbers) -> Proposal:
    suggestions = [_suggest(role, description, kind, numbers) for role in kind.roles]
    played = Counter(s.source.variable for s in suggestions if s.source is not None and s.source.variable != OPEN)
    suggestions = [
        _open(s.role, (f"{s.source.variable!r} would play more than one role",))
        if s.source is not None and s.source.variable and played[s.source.variable] > 1
        else s
        for s in suggestions
    ]
    suggestions = [
        _sought(s, description, numbers, played) if s.role in kind.velocity and s.source is None else s
        for s in suggestions
    ]
    settled = [s.source for s in suggestions if s.source is not None and not s.open]
    _, problems = match(kind, description, settled)
    unfit = {problem.role: problem.sentence() for problem in problems}
    proposal = Proposal(
        kind,
        tuple(
            _open(s.role, (unfit[s.role],)) if not s.open and s.source is not None and s.role in unfit else s
            for s in suggestions
        ),
    )
    missing = {role.name for role in proposal.missing}
    said = f"{description.modelName} {description.description or ''}"
    refusal = other_kind(kind, numbers, missing, said) or no_vehicle(kind, description, numbers)
    return replace(proposal, refusal=refusal)


def velocity_hints(
    description: ModelDescription, kind: Kind, roles: Collection[str], played: Collection[str]
) -> list[str]:
    """Return sentences, one for each velocity without a player, on the outputs of an FMU that could play it.

    Parameters
    ----------
    description : ModelDescription
        The FMU's model description.
    kind
        The kind of vehicle.
    roles
        The velocities that are not bound.
    played
        The names of numbers that play a role already.
    """
    numbers = Numbers(description)
    sought = (_sought(Suggestion(role), description, numbers, played) for role in kind.velocity if role.name in roles)
    return [
        f"{_listed(map(repr, s.candidates))} could be {s.role.name}: add to the binding "
        f"{_element(s.role, s.candidates[0], description, numbers)}"
        for s in sought
        if s.candidates
    ]


def binding_xml(proposal: Proposal, file: str) -> str:
    """Return a proposal as the text of a file with a binding, with a comment at each place that is open or in doubt.

    Parameters
    ----------
    proposal
        The proposal.
    file
        The FMU, for people.
    """
    kind = proposal.kind
    root = etree.Element(f"{{{NAMESPACE}}}binding", {"vehicle": kind.name}, {None: NAMESPACE})
    about = (
        f"Which variables of {file} play the roles of a {kind.name} vehicle, proposed by their names and units. "
        "Check it: names do not show signs. A role without an entry is played by the variable of its name."
    )
    if proposal.open:
        about += f' Replace each "{OPEN}" as its comment asks.'
    root.addprevious(_comment(textwrap.fill(about, 110, subsequent_indent=" " * 5)))
    for suggestion in proposal.suggestions:
        for sentence in (*suggestion.open, *suggestion.doubts):
            root.append(_comment(f"{suggestion.role.name}: {sentence}"))
        if (source := suggestion.source) is not None and not suggestion.needs_no_binding:
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


# The roles --------------------------------------------------------------------------------------------------


class _Fit(NamedTuple):
    """Numbers that may play a role: how well, the smaller the better."""

    rank: tuple[int, int, int, int]
    alike: Alike


def _suggest(role: Role, description: ModelDescription, kind: Kind, numbers: Numbers) -> Suggestion:
    if not role.unit:
        return _suggest_enumeration(role, description)
    fitting: list[_Fit] = []
    by_place: list[_Fit] = []
    unfit: list[int] = []
    for alike in numbers.telling(role, kind):
        number = alike.first
        causality = number.variable.causality
        if causality not in ALLOWED[role.causality]:
            continue
        how = _told(role, kind, number, numbers)
        rank = _rank(role, kind, number, number.words) if how is None else (0, 0)
        if rank is None:
            continue
        if not numbers.readable(number, role):
            if how is not Told.BY_PLACE:
                unfit += alike.places
            continue
        preference = ALLOWED[role.causality].index(causality)
        tier = 2 * preference + 1 if how is not None else 2 if preference and rank[1] else 0
        fit = _Fit((tier, rank[0], preference, rank[1]), alike)
        (by_place if how is Told.BY_PLACE else fitting).append(fit)
    best = _best([fit for fit in fitting if fit.alike.first.variable.type not in WHOLE] or fitting, numbers)
    if len(best) == 1:
        number = best[0]
        played = _played(role, description, kind, number, numbers)
        if role in kind.pose[2:] and _told(role, kind, number, numbers):
            place = f"{number.name!r} is taken by its place in {number.array!r}: check that it is {role.meaning}"
            return replace(played, doubts=(*played.doubts, place))
        return played
    reasons = []
    likely = best or _best(by_place, numbers)
    if best:
        reasons.append(f"could be played by {_listed(repr(number.name) for number in best)}")
    elif likely:
        reasons += [_asked(_played(role, description, kind, number, numbers), number) for number in likely]
    elif unfit:
        units = (f"{n.name!r} is in {unit_name(n.variable) or n.hint}" for n in numbers.those_at(unfit))
        reasons.append(f"needs a unit that fits {role.unit}: {_listed(units)}")
    candidates = tuple(n.name for n in likely if best or n.variable.causality == role.causality)
    if role.optional:
        return Suggestion(role, candidates=candidates)
    if role.causality == "parameter" and not best:
        lengths = numbers.could_play(role)
        which = f": {_listed(map(repr, lengths))} could be it" if lengths else ""
        return Suggestion(
            role,
            RoleSource(name=role.name, value=OPEN, where=_HERE),
            (f"no parameter is obviously {role.meaning}: state its value, or name the variable{which}", *reasons),
        )
    return _open(role, (*reasons, *([] if candidates else [_nothing_found(role, numbers)])), candidates)


def _told(role: Role, kind: Kind, number: Number, numbers: Numbers) -> Told | None:
    """Return the evidence that an element of an array plays a role by its place; None for any other number."""
    if number.size == 1 or number.name == role.name:
        return None
    return told(role, kind, number, numbers)


def _asked(suggestion: Suggestion, number: Number) -> str:
    """Return the question whether a number plays a role if its place in an array is the only evidence."""
    assert suggestion.source is not None
    said = attributes(suggestion.source)
    del said["name"]
    state = " ".join(f'{name}="{value}"' for name, value in said.items())
    return (
        f"{number.name!r} could be it by its place in {number.array!r}, which is no proof: "
        f"if it is {suggestion.role.meaning}, state {state}"
    )


def _suggest_enumeration(role: Role, description: ModelDescription) -> Suggestion:
    variable = description.by_name.get(role.name)
    if variable is not None and variable.causality == role.causality and variable.type == "Enumeration":
        return Suggestion(role, _by_name(role))
    source = RoleSource(name=role.name, value=OPEN, where=_HERE)
    return Suggestion(role, source, (f"state {role.meaning}; the FMU does not state it",))


def _rank(role: Role, kind: Kind, number: Number, words: tuple[str, ...]) -> tuple[int, int] | None:
    """Return how well a name fits a role, the smaller the better; None if it does not."""
    if number.name == role.name:
        return -2, 0
    if number.size > 1:
        return None
    if tuple(word for word in words if word not in NEUTRAL) == words_of(role.name):
        return -1, 0
    recognition = kind.recognised.by_role.get(role.name)
    if recognition is None:
        return None
    rank = recognition.rank(words, has_unit=bool(unit_name(number.variable)))
    return None if rank is None else (rank[0] + 1, rank[1])


def _best(found: list[_Fit], numbers: Numbers) -> list[Number]:
    """Return the numbers that fit best, each once: variables with the same value reference are the same number."""
    least = min((fit.rank for fit in found), default=None)
    best = numbers.those_at(at for fit in found if fit.rank == least for at in fit.alike.places)
    return list(reversed({(n.variable.valueReference, n.element): n for n in reversed(best)}.values()))


def _played(role: Role, description: ModelDescription, kind: Kind, number: Number, numbers: Numbers) -> Suggestion:
    read = reading(description, number, role) or Reading()
    source = RoleSource(name=role.name, variable=number.name, unit=read.unit, factor=read.factor, where=_HERE)
    text = printable(" ".join((number.variable.description or "").split()))[:200]
    says = f". The FMU describes it as {text!r}" if text else ""
    open_ = [read.open + says] if read.open else []
    doubts = []
    if text and doubtful(role.name, kind, text):
        doubts.append(f"here it is {role.meaning}; the FMU describes {number.name!r} as {text!r}")
    if role in kind.pose and not may_be_started(description, number.variable):
        initial = _initial(role, description, kind, number, numbers)
        source = replace(source, initial=initial or OPEN)
        if not initial:
            open_.append(
                f"{number.name!r} has no start value that can be set: name the parameter that gives the initial value"
            )
    return Suggestion(role, source, tuple(open_), tuple(doubts))


def _initial(role: Role, description: ModelDescription, kind: Kind, played_by: Number, numbers: Numbers) -> str | None:
    """Return the parameter that obviously gives the initial value of a role's player."""
    fitting: list[_Fit] = []
    own = [word for word in played_by.words if word not in NEUTRAL]
    for number in numbers.having({*STARTING, "0"}):
        rest = without_start(number.words)
        if number.variable.causality != "parameter" or rest is None or number.size != played_by.size:
            continue
        if not numbers.readable(number, role):
            continue
        alike = Alike(number, (number.at,))
        if [word for word in rest if word not in NEUTRAL] == own and number.place == played_by.place:
            fitting.append(_Fit((0, -3, 0, 0), alike))
        elif (rank := _rank(role, kind, number, rest)) is not None:
            fitting.append(_Fit((0, rank[0], 0, rank[1]), alike))
    best = _best(fitting, numbers)
    return best[0].name if len(best) == 1 else None


def _by_name(role: Role) -> RoleSource:
    return RoleSource(name=role.name, variable=role.name, where=_HERE)


def _open(role: Role, sentences: tuple[str, ...], candidates: tuple[str, ...] = ()) -> Suggestion:
    """Return a role whose player the user must name."""
    if role.optional:
        return Suggestion(role)
    return Suggestion(role, RoleSource(name=role.name, variable=OPEN, where=_HERE), sentences, (), candidates)


def _sought(
    suggestion: Suggestion, description: ModelDescription, numbers: Numbers, played: Collection[str]
) -> Suggestion:
    """Return a velocity without a player, with the outputs that could be it, as many tasks need it."""
    role = suggestion.role
    found = suggestion.candidates or tuple(n for n in numbers.could_play(role) if n not in played)
    if not found:
        return suggestion
    doubt = (
        f"no {role.causality} is obviously {role.meaning}, without which the vehicle cannot lead: "
        f"{_listed(map(repr, found))} could be it; if so, add {_element(role, found[0], description, numbers)}"
    )
    return replace(suggestion, candidates=found, doubts=(doubt,))


def _element(role: Role, name: str, description: ModelDescription, numbers: Numbers) -> str:
    """Return the element of a binding in which a number plays a role."""
    read = reading(description, numbers.named(name), role) or Reading()
    source = RoleSource(name=role.name, variable=name, unit=read.unit, factor=read.factor, where=_HERE)
    return "<role " + " ".join(f'{key}="{value}"' for key, value in attributes(source).items()) + "/>"


def _nothing_found(role: Role, numbers: Numbers) -> str:
    found = numbers.could_play(role)
    return (
        f"no {role.causality} is obviously {role.meaning}; "
        f"{role.causality}s that could be: {_listed(map(repr, found)) if found else 'none'}"
    )


def _listed(names: Iterable[str]) -> str:
    names = list(names)
    more = len(names) - _MOST_NAMED
    return ", ".join(names[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
