"""From a document that satisfies the schema to a scenario; checks beyond the schema."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from cosim.collection import without_collection
from cosim.errors import InputError, printable
from cosim.scenario.document import Document, parse_document, read_document
from cosim.scenario.edits import Change, as_changes, in_words
from cosim.scenario.reader.effects import effects
from cosim.scenario.reader.element import Element, table
from cosim.scenario.reader.events import events
from cosim.scenario.reader.expectations import expectations
from cosim.scenario.reader.inputs import inputs
from cosim.scenario.reader.plants import controller, plant, read_binding
from cosim.scenario.reader.robots import follower, leader
from cosim.scenario.reader.times import Times
from cosim.scenario.scenario import LEADER, Event, Expectation, Scenario

MAX_EVENTS = 100_000
"""Of all robots together."""

__all__ = ["read_binding", "read_expectations", "read_scenario", "scenario_in"]


@without_collection()
def read_scenario(
    path: str | Path, changes: Iterable[str | Change] = (), untrusted: Iterable[str | Path] = ()
) -> Scenario:
    """Read a scenario file.

    Parameters
    ----------
    path
        The file.
    changes
        Made before the document is checked: ``XPATH=VALUE`` each, as for ``--set``, or one of `cosim.scenario.edits`.
    untrusted
        Folders: each plant whose FMU lies in one of them gets a process of its own, also in scenarios to compare with.

    Raises
    ------
    InputError
        The file is no scenario; with file, line and column.
    """
    made = as_changes(changes)
    return scenario_in(read_document(Path(path), made), untrusted, map(in_words, made))


def _read_again(scenario: Scenario, changes: Sequence[Change]) -> Scenario:
    """Read the text of a scenario with more changes, for `Scenario.edited`."""
    document = parse_document(scenario.text, scenario.folder / scenario.path.name, scenario.places, changes)
    again = _scenario(document, scenario.untrusted, (*scenario.changes, *map(in_words, changes)))
    return replace(again, path=scenario.path)


def scenario_in(document: Document, untrusted: Iterable[str | Path] = (), changes: Iterable[str] = ()) -> Scenario:
    """Return the scenario in a document, which was changed as told; raises as `read_scenario`."""
    return _scenario(document, tuple(Path(os.path.realpath(folder)) for folder in untrusted), changes)


def read_expectations(text: str, path: str | Path) -> tuple[Expectation, ...]:
    """Read the expectations of a run from the text of its scenario; no other file is read.

    Parameters
    ----------
    text
        The resolved text, as a result keeps it.
    path
        The file of the document, to which other files are relative.

    Raises
    ------
    InputError
        The text is not a scenario.
    """
    document = parse_document(text, Path(path))
    root = Element.root(document)
    return expectations(root, Times.of(root), {element.get("id"): None for element in root.children("follower")})


def _expanded(root: Element, times: Times, robots: Mapping[str, object]) -> list[Event]:
    """Return the events of each robot."""
    found: list[Event] = []
    for element in root.children("event"):
        found += events(element, times, robots)
        if len(found) > MAX_EVENTS:
            raise element.error(
                f"up to here there are {len(found)} events, each counted once for each robot that it names; "
                f"at most {MAX_EVENTS} are read"
            )
    return found


def _scenario(document: Document, untrusted: tuple[Path, ...], changes: Iterable[str]) -> Scenario:
    root = Element.root(document)
    times = Times.of(root)
    simulation = root.child("simulation")
    plants = table(root, "plant", lambda element: plant(element, times, untrusted))
    controllers = table(root, "controller", controller)
    leading = leader(root.child("leader"), times, plants)
    sensor, actuator = effects(root, "sensor", times), effects(root, "actuator", times)
    followers = table(root, "follower", lambda e: follower(e, times, plants, controllers, sensor, actuator))
    if LEADER in followers:
        raise InputError(f"a follower cannot have the id {LEADER!r}", followers[LEADER].where)
    happening = _expanded(root, times, {LEADER: None, **followers})
    return Scenario(
        path=document.path,
        text=document.text,
        name=root.get("name"),
        title=printable(root.child("title").text),
        step=times.step,
        ticks=times.ticks,
        period=times.steps(simulation, "period", least=1) if "period" in simulation else 1,
        seed=int(simulation.get("seed", "0")),
        plants=plants,
        controllers=controllers,
        sensor=sensor,
        actuator=actuator,
        inputs=inputs(root, times),
        leader=leading,
        followers=tuple(followers.values()),
        events=tuple(sorted(happening, key=lambda event: event.time)),
        expectations=expectations(root, times, followers),
        changes=tuple(changes),
        untrusted=untrusted,
        places=document.places,
        folder=document.path.parent.absolute(),
        read_again=_read_again,
    )
