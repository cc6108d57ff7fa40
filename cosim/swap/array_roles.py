"""Arrays that may hold roles one after the other: the role of each element, and whether the FMU states it."""

from __future__ import annotations

from enum import Enum

from cosim.fmu.units import unit_name
from cosim.swap.candidates import Number, Numbers
from cosim.swap.naming import words_of
from cosim.vehicle.kind import Kind, Role


class Told(Enum):
    """The evidence that an element of an array plays a role."""

    BY_THE_FMU = "by the FMU"
    """The name of the array and all units up to the element fit, or a description gives the order."""
    BY_PLACE = "by place"
    """Only its place in the array is evidence, so the user is asked."""


def told(role: Role, kind: Kind, number: Number, numbers: Numbers) -> Told | None:
    """Return the evidence that an element of an array plays a role; None if there is none."""
    found = next((s for s in kind.series if s.role(number.words, number.size, number.place)), None)
    if found is None or role.name not in found.roles:
        return None
    if (described := _described(kind, number)) is not None:
        return Told.BY_THE_FMU if described == role.name else None
    if found.role(number.words, number.size, number.place) != role.name:
        return None
    if not found.telling:
        return Told.BY_PLACE
    roles = {role.name: role for role in kind.roles}
    before = numbers.array_of(number)[: number.place + 1]
    for name, element in zip(found.roles, before, strict=False):
        if not unit_name(element.variable) or not numbers.readable(element, roles[name]):
            return Told.BY_PLACE
    return Told.BY_THE_FMU


def _described(kind: Kind, number: Number) -> str | None:
    """Return the role of an element by its description, or by the order in which the array's description names them."""
    words = words_of(number.variable.description or "")
    order = kind.recognised.order
    places = {
        role: min(place for place, word in enumerate(words) if word in own)
        for role, own in order.items()
        if own & set(words)
    }
    named = sorted(places, key=lambda role: places[role])
    if number.name == number.variable.name:  # an element with a description of its own
        return named[0] if len(named) == 1 else None
    return named[number.place] if len(named) == len(order) == number.size else None
