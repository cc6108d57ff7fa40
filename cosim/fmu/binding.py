"""Bindings: the variables of an FMU that play the roles of a kind of vehicle, with unit, factor and offset."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from cosim.errors import InputError, Location, nearest
from cosim.fmu.model_description import NEGATED, ModelDescription, Variable
from cosim.fmu.units import UnitContradiction, stated, unit_of
from cosim.plant.spec import FLOAT_TYPES, REAL_TYPES, WHOLE
from cosim.quantity import quantity, split
from cosim.scenario.scenario import BindingSource, RoleSource
from cosim.vehicle.kind import Kind, Role
from cosim.vehicle.kinds import faults, kind_named, kinds
from plants import UnitError, units

NUMBER_TYPES = (*FLOAT_TYPES, *WHOLE)
"""Types of variables that can play a role with a unit."""
_ELEMENT = re.compile(r"(.+)\[([0-9]{1,9}(?:, ?[0-9]{1,9})*)\]")
MAX_ELEMENTS = 1_000_000
"""Upper limit for an array that is exchanged as a whole for one of its elements."""


@dataclass(frozen=True)
class BoundVariable:
    """A number of an FMU: ``value in the role's unit = scale * number + offset``.

    Attributes
    ----------
    variable : Variable
        The variable that holds it.
    element : int
        Index of its element, from 0 in row-major order; 0 for a scalar.
    unit : plants.units.Unit
        The unit of the number, as the binding or the FMU states it; that of a pure number for an enumeration.
    """

    variable: Variable
    element: int
    scale: float
    offset: float
    unit: units.Unit = field(default_factory=units.Unit)


@dataclass(frozen=True)
class BoundRole:
    """A role and its player.

    Attributes
    ----------
    role : Role
        The role.
    played_by : BoundVariable or None
        The number; None of a role that has a constant value.
    initial : BoundVariable or None
        Of a pose entry: the number that takes its initial value.
    constant : float, str or None
        The constant value in the role's unit, or an item.
    """

    role: Role
    played_by: BoundVariable | None
    initial: BoundVariable | None = None
    constant: float | str | None = None


@dataclass(frozen=True)
class Binding:
    """The kind of vehicle that an FMU is, with the player of each role, by the role's name."""

    kind: Kind
    bound: dict[str, BoundRole]

    def of(self, roles: Iterable[Role]) -> tuple[BoundRole | None, ...]:
        """Return the bound roles in the order given; None for an optional role without a player."""
        return tuple(self.bound.get(role.name) for role in roles)

    def role_of(self, variable: Variable, roles: Iterable[Role]) -> Role | None:
        """Return which of some roles a variable plays, by whatever of its names; None if it plays none of them."""
        for bound in self.of(roles):
            player = None if bound is None else bound.played_by
            if bound is not None and player is not None and player.variable.identity == variable.identity:
                return bound.role
        return None

    def described(self) -> dict[str, str]:
        """Return the player of each role, in words."""
        return {name: _described(bound) for name, bound in self.bound.items()}


def bind(
    description: ModelDescription, file: str, declared: BindingSource | None = None, where: Location | None = None
) -> Binding:
    """Find the kind of vehicle that an FMU is.

    A role that the binding does not mention is played by the variable of its name.

    Parameters
    ----------
    description : ModelDescription
        The FMU's model description.
    file, where
        The FMU and the place in the scenario that asks for it, for the message.
    declared
        The binding that a scenario or a file states.

    Raises
    ------
    InputError
        The FMU is no vehicle of any kind, or the binding does not fit it; the message names roles and reasons.
    """
    if declared is not None:
        kind = kind_named(declared.vehicle)
        known = [role.name for role in kind.roles]
        for source in declared.roles:
            if source.name not in known:
                raise InputError(
                    f"a {kind.name} vehicle has no role {source.name!r}: {nearest(source.name, known)}",
                    source.where,
                )
        bound, problems = match(kind, description, declared.roles)
        if problems:
            places = [problem.where or declared.where for problem in problems]
            sentences = [problem.sentence(f"the FMU {file}") for problem in problems]
            others = (f"\n  {place}: {text}" for place, text in zip(places[1:], sentences[1:], strict=True))
            raise InputError(sentences[0] + "".join(others), places[0])
        return Binding(kind, bound)
    reasons = []
    for kind in kinds():
        bound, problems = match(kind, description)
        if not problems:
            return Binding(kind, bound)
        reasons.append(f"as a {kind.name} vehicle it {'; it '.join(problem.text for problem in problems)}")
    raise InputError(
        f"the FMU {file} is no vehicle that can be driven as it is: {'. '.join(reasons)}. A <binding> assigns "
        f'variables to these roles; "formation swap" writes one to complete{faults()}',
        where,
    )


class _BindingError(ValueError):
    """A statement of a binding that is wrong for every FMU."""


@dataclass(frozen=True)
class Problem:
    """Why a role is not played; the FMU is the subject of the text, unless that is about the binding alone."""

    role: Role
    text: str
    where: Location | None = None
    about_binding: bool = False

    def sentence(self, fmu: str = "the FMU") -> str:
        """Return the text with its subject."""
        return self.text if self.about_binding else f"{fmu} {self.text}"


def match(
    kind: Kind, description: ModelDescription, declared: Iterable[RoleSource] = ()
) -> tuple[dict[str, BoundRole], list[Problem]]:
    """Return the roles of a kind of vehicle that are played, by name, and why each other role is not.

    The FMU is such a vehicle if there are no problems: an optional role may be left out.
    """
    sources = {source.name: source for source in declared}
    bound, problems = {}, []
    for role in kind.roles:
        source = sources.get(role.name)
        if source is None:
            if role.optional and not _plays_by_name(role, description):
                continue
            source = RoleSource(name=role.name, variable=role.name)
        try:
            bound[role.name] = _bound(kind, role, description, source)
        except (ValueError, UnitError) as error:
            if source.where is not None or not role.optional or isinstance(error, UnitContradiction):
                problems.append(Problem(role, str(error), source.where, isinstance(error, _BindingError)))
    return bound, problems + list(_shared(bound, sources))


def _shared(bound: dict[str, BoundRole], sources: dict[str, RoleSource]) -> Iterator[Problem]:
    """Return why roles cannot be played together: a number is set once. Two lengths may be the same parameter."""
    first: dict[tuple[tuple[str, int], int], Role] = {}
    for name, one in bound.items():
        number = one.initial if one.role.causality == "output" else one.played_by
        if number is None:
            continue
        place = (number.variable.identity, number.element)
        before = first.setdefault(place, one.role)
        if before is not one.role and not before.causality == one.role.causality == "parameter":
            text = f"cannot be given {before.name!r} and {name!r} through the same number, {number_name(number)!r}"
            at = sources.get(name) or sources.get(before.name)
            yield Problem(one.role, text, at.where if at is not None else None)


def _plays_by_name(role: Role, description: ModelDescription) -> bool:
    variable = description.by_name.get(role.name)
    return variable is not None and variable.causality == role.causality


def _bound(kind: Kind, role: Role, description: ModelDescription, source: RoleSource) -> BoundRole:
    if source.initial:
        with _about(source, "initial"):
            if role not in kind.pose:
                raise ValueError("only a pose entry has an initial value")
    if source.value:
        with _about(source, "value"):
            return BoundRole(role, None, constant=_constant(role, source.value))
    variable, element = _found(role, description, source.variable, source)
    if role.causality == "parameter" and variable.initial in ("approx", "calculated"):
        raise ValueError(
            f"computes the value of {variable.name!r} itself, so that it is not known before the run: state the "
            f'value of the role {role.name!r}, value="..."'
        )
    if not role.unit:
        if variable.type != "Enumeration":
            raise ValueError(f"has {variable.name!r} as {variable.type}, not as Enumeration")
        if source.unit or source.factor or source.offset:
            raise ValueError(f"has the enumeration {variable.name!r}, which takes no unit, factor or offset")
        return BoundRole(role, BoundVariable(variable, 0, 1.0, 0.0))
    played_by = _read_as(role, description, variable, element, source)
    if role not in kind.pose:
        return BoundRole(role, played_by)
    if source.initial:
        variable, element = _found(role, description, source.initial, source, parameter=True)
        return BoundRole(role, played_by, _read_as(role, description, variable, element, source))
    if not may_be_started(description, variable):
        raise ValueError(
            f"has no start value of {variable.name!r} that can be set; if a parameter gives the initial value of "
            f'{role.name!r}, name it in a binding: initial="..."'
        )
    return BoundRole(role, played_by, played_by)


@contextmanager
def _about(source: RoleSource, attribute: str) -> Iterator[None]:
    """Add the attribute and the role to an error."""
    try:
        yield
    except (ValueError, UnitError) as error:
        said = getattr(source, attribute)
        raise _BindingError(f'{attribute}="{said}" of the role {source.name!r}: {error}') from None


def _constant(role: Role, text: str) -> float | str:
    if role.causality != "parameter":
        raise ValueError(f"only a parameter has a constant value, and this is an {role.causality}")
    if not role.unit:
        if text not in role.items:
            raise ValueError(f"{text!r} is none of its items: {nearest(text, list(role.items))}")
        return text
    value = quantity(text, role.unit)
    if value <= 0:
        raise ValueError(f"{text!r} is no length; expected a length greater than zero")
    return value


def _found(
    role: Role,
    description: ModelDescription,
    name: str,
    source: RoleSource,
    parameter: bool = False,
) -> tuple[Variable, int]:
    """Return the variable of a name, which may end in the indices of an element, and the element."""
    causality = "parameter" if parameter else role.causality
    variable, element = _only(description, name), 0
    if variable is None and (indexed := _ELEMENT.fullmatch(name)) and (array := _only(description, indexed[1])):
        variable = array
        element = _element(variable, name, [int(index) for index in indexed[2].split(",")])
    elif variable is not None and variable.dimensions:
        raise ValueError(f"has {name!r} as an array: name one of its elements, such as '{name}[1]'")
    if variable is None and source.where is not None:
        raise ValueError(f"has no variable {name!r}: {nearest(name, sorted(description.by_name))}")
    if variable is not None and variable.causality == NEGATED:
        raise ValueError(
            f"has {name!r} as a negated alias, whose sign would be lost: bind the variable whose alias it is, "
            'with factor="-1"'
        )
    if variable is None or (source.where is None and variable.causality not in _ALLOWED[causality]):
        raise ValueError(f"lacks the {causality} {name!r}" + (f" [{role.unit}]" if role.unit else ""))
    if variable.causality not in _ALLOWED[causality]:
        cannot = "cannot give the initial value of" if parameter else f"cannot play the {role.causality}"
        raise ValueError(f"has {name!r} as {variable.causality}, which {cannot} {role.name!r}")
    if source.where is None and variable.causality != causality:
        raise ValueError(f"has {name!r} as {variable.causality}, not as {causality}")
    if role.unit and variable.type not in NUMBER_TYPES:
        raise ValueError(f"has {name!r} as {variable.type}, not as {REAL_TYPES[description.fmiVersion[0] == '3']}")
    if role.unit:
        start_of(variable)  # its causality and variability must allow the exchange
    return variable, element


def _only(description: ModelDescription, name: str) -> Variable | None:
    """Return the variable of a name, None if there is none."""
    variable = description.by_name.get(name)
    if variable is None and name in description.by_name:
        raise ValueError(f"has more than one variable {name!r}")
    return variable


_ALLOWED = {
    "input": ("input",),
    "output": ("output", "local", "internal"),
    "parameter": ("parameter", "local", "internal", "input"),
}
"""Causalities that a declared role may have; FMI 1.0 has no parameters but internal variables with a start value."""


def _element(variable: Variable, name: str, indices: list[int]) -> int:
    shape = shape_of(variable)
    if not shape:
        raise ValueError(f"has {variable.name!r} as a scalar, so there is no {name!r}")
    if len(indices) != len(shape) or not all(1 <= i <= n for i, n in zip(indices, shape, strict=True)):
        raise ValueError(
            f"has {variable.name!r} with the dimensions {shape}, so that there is no {name!r}; the first index is 1"
        )
    element = 0
    for index, n in zip(indices, shape, strict=True):
        element = element * n + index - 1
    return element


def _read_as(
    role: Role, description: ModelDescription, variable: Variable, element: int, source: RoleSource
) -> BoundVariable:
    wanted = units.parse(role.unit)
    if source.unit:
        with _about(source, "unit"):
            units.parse(source.unit)
        own = stated(description, variable, source.unit, has_offset=bool(source.offset))
    else:
        own = unit_of(description, variable)
    number, factor, offset = 1.0, units.parse("1"), 0.0
    if source.factor:
        with _about(source, "factor"):
            number, name = split(source.factor)
            factor = units.parse(name)
            if number == 0 or not math.isfinite(number):
                raise ValueError("it must be finite and not zero")
    if source.offset:
        with _about(source, "offset"):
            if (
                source.unit
                and split(source.offset)[1] == "1"
                and units.parse(source.unit).exponents == wanted.exponents
            ):
                raise ValueError(f"the unit is missing: write '{source.offset} {source.unit}'")
            offset = quantity(source.offset, role.unit)
    read = own * factor
    if read.exponents != wanted.exponents:
        times = f" times {source.factor}" if source.factor else ""
        raise UnitError(f"offers a unit that does not fit: {variable.name!r} is in {own}{times}, not in {wanted}")
    scale = number * read.factor / wanted.factor
    return BoundVariable(variable, element, scale, offset, own)


def may_be_started(description: ModelDescription, variable: Variable) -> bool:
    """Return whether a variable has a start value that can be set."""
    if description.fmiVersion == "1.0":
        return variable.start is not None
    return variable.initial in ("exact", "approx")


def shape_of(variable: Variable) -> tuple[int, ...]:
    """Return the dimensions of a variable; none of a scalar.

    Raises
    ------
    ValueError
        A dimension is not known.
    """
    shape = variable.shape
    if not all(1 <= size <= MAX_ELEMENTS for size in shape):
        raise ValueError(f"has {variable.name!r} with an unknown dimension")
    if math.prod(shape) > MAX_ELEMENTS:
        raise ValueError(f"has {variable.name!r} with {math.prod(shape)} elements; at most are {MAX_ELEMENTS}")
    return shape


def start_of(variable: Variable) -> tuple[float, ...]:
    """Return the start value of every element of a real variable; zero where the FMU states none."""
    size = math.prod(shape_of(variable))
    text = variable.start if isinstance(variable.start, str) else " ".join(map(str, variable.start or ()))
    try:
        numbers = tuple(float(number) for number in text.split())
    except ValueError:
        raise ValueError(f"has the start value {text[:40]!r} of {variable.name!r}, which is no number") from None
    if len(numbers) not in (0, 1, size):
        raise ValueError(f"has {len(numbers)} start values of {variable.name!r}, which has {size} elements")
    return numbers if len(numbers) == size else (numbers or (0.0,)) * size


def _described(bound: BoundRole) -> str:
    if bound.played_by is None:
        return f"{bound.constant} {bound.role.unit}".rstrip()
    text = "".join(_parts(bound.role, bound.played_by))
    if bound.initial is not None and bound.initial != bound.played_by:
        text += f", started by {number_name(bound.initial)}"
    return text


def _parts(role: Role, bound: BoundVariable) -> Iterator[str]:
    if bound.scale != 1:
        yield f"{bound.scale:.6g} * "
    yield number_name(bound)
    if bound.offset != 0:
        yield f" {bound.offset:+.6g} {role.unit}"


def number_name(bound: BoundVariable) -> str:
    """Return the name of a number: its variable's name, with the indices of an array's element, counted from 1."""
    indices: list[str] = []
    rest = bound.element
    for n in reversed(bound.variable.shape):
        rest, index = divmod(rest, n)
        indices.insert(0, str(index + 1))
    return f"{bound.variable.name}[{','.join(indices)}]" if indices else str(bound.variable.name)
