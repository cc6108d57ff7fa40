"""Parts of a scenario in words, as an overview and a report show them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from cosim.scenario.scenario import Event, Setting
from cosim.vehicle.kinds import unit_of_entry


def settings(given: Iterable[Setting]) -> Iterator[str]:
    """Yield each setting."""
    return (f"{setting.name} = {setting.value}" for setting in given)


def commands(values: Iterable[tuple[str, float]]) -> str:
    """Return commands [SI] by their names."""
    return ", ".join(f"{name} {value:g} {unit_of_entry(name, 'command')}" for name, value in values)


def event(happening: Event) -> str:
    """Return what changes in an event."""
    parts = [*settings(happening.parameters), *(f"input {text}" for text in settings(happening.inputs))]
    if happening.torque is not None:
        parts.append(commands(happening.torque.values.items()))
    if happening.stops:
        parts.append("stops")
    return ", ".join(parts)
