"""Entries of poses and commands, by the names that kinds of vehicle give them."""

from __future__ import annotations

from collections.abc import Collection

from cosim.errors import nearest
from cosim.scenario.reader.element import Element
from cosim.scenario.scenario import Entries
from cosim.vehicle.kinds import entries_of, faults, unit_of_entry


def pose(element: Element) -> Entries:
    """Read the ``<pose>`` within an element, if it is there."""
    child = element.find("pose")
    return Entries({}, element.where) if child is None else _entries(child, "pose")


def commands(element: Element) -> Entries | None:
    """Read the ``<torque>`` or the ``<command>`` within an element; None if there is neither."""
    torque, child = element.find("torque"), element.find("torque") or element.find("command")
    if child is None:
        return None
    found = _entries(child, "command")
    for name in found.values:
        if torque is not None and unit_of_entry(name, "command") != "N.m":
            raise child.error(f"{name!r} is no torque: write <command {name}=...> in the place of <torque>")
    return found


def check_names(element: Element, group: str, besides: Collection[str] = ()) -> None:
    """Refuse attributes that no kind of vehicle has in its ``pose`` or its ``command``, and that are not other ones."""
    for name in element.attributes:
        if name not in besides and unit_of_entry(name, group) is None:
            known = nearest(name, [*entries_of(group), *besides])
            raise element.error(f"<{element.kind}> has no attribute {name!r}: {known}{faults()}")


def _entries(element: Element, group: str) -> Entries:
    check_names(element, group)
    values = {name: element.quantity(name, unit_of_entry(name, group) or "") for name in element.attributes}
    return Entries(values, element.where)
