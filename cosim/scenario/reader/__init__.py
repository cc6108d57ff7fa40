"""From a document that satisfies the schema to a scenario; checks beyond the schema."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from operator import attrgetter
from pathlib import Path

from cosim.collection import without_collection
from cosim.errors import AfterTheEnd, InputError, Location, printable
from cosim.known import Known
from cosim.scenario.attribute_edits import AttributeEdits
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

__all__ = ["Variations", "read_binding", "read_expectations", "read_resolved", "read_scenario", "scenario_in"]


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
    return Variations(scenario).edited(changes)


class Variations:
    """A scenario that is changed often: its text is parsed once, and only elements that have changed are read again.

    Parameters
    ----------
    scenario
        The scenario.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._known = Known()

    def edited(self, changes: Iterable[str | Change]) -> Scenario:
        """Return the scenario with changes, as `Scenario.edited` does.

        Raises
        ------
        InputError
            As there.
        """
        made, scenario = as_changes(changes), self._scenario
        if not made or scenario.read_again is not _read_again:
            return scenario.edited(made)
        document, root, edits = self._known.of("", _document, scenario)
        found = edits.made(made)
        if found is not None:
            text, places, root = found[0], edits.places, root.with_attributes(found[1])
        else:
            changed = document.changed(made)
            text, places, root = changed.text, changed.places, Element.root(changed, root)
        return _scenario(
            root,
            scenario.path,
            scenario.folder,
            text,
            places,
            scenario.untrusted,
            (*scenario.changes, *map(in_words, made)),
            self._known,
        )


def _document(scenario: Scenario) -> tuple[Document, Element, AttributeEdits]:
    document = parse_document(scenario.text, scenario.folder / scenario.path.name, scenario.places)
    return document, Element.root(document), AttributeEdits(document)


def scenario_in(document: Document, untrusted: Iterable[str | Path] = (), changes: Iterable[str] = ()) -> Scenario:
    """Return the scenario in a document, which was changed as told; raises as `read_scenario`."""
    return _scenario(
        Element.root(document),
        document.path,
        document.path.parent.absolute(),
        document.text,
        document.places,
        tuple(Path(os.path.realpath(folder)) for folder in untrusted),
        tuple(changes),
        Known(),
    )


def read_resolved(
    text: str,
    path: Path,
    folder: Path,
    places: Sequence[Location] = (),
    untrusted: Sequence[Path] = (),
    changes: Sequence[str] = (),
) -> Scenario:
    """Read a scenario from its resolved text; the parameters are the attributes of the `Scenario` that had it.

    Raises
    ------
    InputError
        The text is no scenario.
    """
    document = parse_document(text, folder / path.name, places)
    root = Element.root(document)
    return _scenario(root, path, folder, text, tuple(places), tuple(untrusted), tuple(changes), Known())


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
    root, followers = _again(text, path)
    return expectations(tuple(root.children("expect")), Times.of(root.child("simulation")), followers)


def read_events(text: str, path: str | Path) -> tuple[Event, ...]:
    """Read the events of a run from the text of its scenario, in the order of their times; see `read_expectations`."""
    root, followers = _again(text, path)
    found = _expanded(root, Times.of(root.child("simulation")), {LEADER: None, **followers})
    return tuple(sorted(found, key=attrgetter("time")))


def _again(text: str, path: str | Path) -> tuple[Element, Mapping[str, object]]:
    """Return the root of a resolved text, and the followers in it."""
    root = Element.root(parse_document(text, Path(path)))
    return root, {element.get("id"): None for element in root.children("follower")}


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


def _ids(ids: tuple[str, ...]) -> Mapping[str, object]:
    """Return ids, to be looked up."""
    return dict.fromkeys(ids)


def _expected(
    root: Element, times: Times, followers: Mapping[str, object], changes: Iterable[str], known: Known
) -> tuple[Expectation, ...]:
    try:
        return known.of("", expectations, tuple(root.children("expect")), times, followers)
    except AfterTheEnd as error:
        raise error.advised(changes) from None


def _scenario(
    root: Element,
    path: Path,
    folder: Path,
    text: str,
    places: tuple[Location, ...],
    untrusted: tuple[Path, ...],
    changes: tuple[str, ...],
    known: Known,
) -> Scenario:
    """Read the elements of a document; what is known of some of them is not read again."""
    times = known.of("", Times.of, root.child("simulation"))
    simulation = root.child("simulation")
    plants = table(root, "plant", lambda e: known.of(e.get("id"), plant, e, times, untrusted))
    controllers = table(root, "controller", lambda e: known.of(e.get("id"), controller, e))
    ids = known.of("plant", _ids, tuple(plants)), known.of("controller", _ids, tuple(controllers))
    leading = known.of("", leader, root.child("leader"), times, ids[0])
    sensor, actuator = (known.of(tag, effects, tuple(root.children(tag)), times) for tag in ("sensor", "actuator"))
    followers = table(root, "follower", lambda e: known.of(e.get("id"), follower, e, times, *ids, sensor, actuator))
    if LEADER in followers:
        raise InputError(f"a follower cannot have the id {LEADER!r}", followers[LEADER].where)
    named = known.of("follower", _ids, tuple(followers))
    happening = _expanded(root, times, {LEADER: None, **followers})
    return Scenario(
        path=path,
        text=text,
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
        inputs=known.of("", inputs, tuple(root.children("input")), times),
        leader=leading,
        followers=tuple(followers.values()),
        events=tuple(sorted(happening, key=lambda event: event.time)),
        expectations=_expected(root, times, named, changes, known),
        where=simulation.where,
        changes=changes,
        untrusted=untrusted,
        places=places,
        folder=folder,
        read_again=_read_again,
    )
