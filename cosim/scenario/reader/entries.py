"""Entries of poses and commands, by the names that kinds of vehicle give them."""

from __future__ import annotations

from collections.abc import Collection

from cosim.errors import nearest
from cosim.scenario.reader.element import Element
from cosim.scenario.scenario import Entries
from cosim.vehicle.kinds import entries_of, faults, unit_of_entry

DRIVING = ("torque", "command")
"""Elements that drive a robot: the first one for torques, the second one for any commands."""


def pose(element: Element) -> Entries:
    """Read the ``<pose>`` within an element, if it is there."""
    child = element.find("pose")
    return Entries({}, element.where) if child is None else _entries(child, "pose")


def driving(element: Element) -> Element | None:
    """Return the ``<torque>`` or the ``<command>`` within an element, if it has any; refuse a second one."""
    found = [child for child in element.inside if child.kind in DRIVING]
    if len(found) > 1:
        raise found[1].error(f"an {element.kind} takes one <{found[0].kind}>: remove this second one")
    return found[0] if found else None


def commands(child: Element) -> Entries:
    """Read a ``<torque>`` or a ``<command>``."""
    found = _entries(child, "command")
    for name in found.values:
        if child.kind == "torque" and unit_of_entry(name, "command") != "N.m":
            raise child.error(f"{name!r} is no torque: write <command {name}=...> in the place of <torque>")
    return found


def check_names(element: Element, group: str, besides: Collection[str] = ()) -> None:
    """Refuse attributes that no kind of vehicle has in its ``pose`` or its ``command``, and that are not other ones."""
    for name in element.attributes:
        if name not in besides:
            _unit(element, name, group, besides)


def _entries(element: Element, group: str) -> Entries:
    units = {name: _unit(element, name, group) for name in element.attributes}
    return Entries({name: element.quantity(name, unit) for name, unit in units.items()}, element.where)


def _unit(element: Element, name: str, group: str, besides: Collection[str] = ()) -> str:
    """Return the unit of an attribute, an entry of a kind of vehicle; refuse any other attribute."""
    if (unit := unit_of_entry(name, group)) is None:
        known = nearest(name, [*entries_of(group), *besides])
        raise element.error(f"<{element.kind}> has no attribute {name!r}: {known}{faults()}")
    return unit
