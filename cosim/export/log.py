"""What happened in a run, as entries of a log: events of its scenario, messages of FMUs, and why it ended early."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from cosim.errors import printable
from cosim.results.events import events_of
from cosim.results.logged import logged_messages
from cosim.results.provenance import Provenance
from cosim.results.result import Result
from cosim.scenario import in_words

INFO, WARNING, ERROR, FATAL = 20, 30, 40, 50
"""Levels of severity, as ROS numbers them."""
_OF_STATUS = {"OK": INFO, "Warning": WARNING, "Discard": WARNING, "Pending": INFO, "Fatal": FATAL}


class Entry(NamedTuple):
    """An entry: time [s], level, the robot that it is about, and its text."""

    time: float
    level: int
    robot: str
    text: str


def log_of(result: Result) -> list[Entry]:
    """Return the entries of a run in the order of time; of many messages the first and the last."""
    end = float(result["time"].values[-1])
    return sorted(entry for entry in _entries(result) if entry.time <= end)


def _entries(result: Result) -> Iterator[Entry]:
    for event in events_of(result):
        yield Entry(event.time, INFO, event.robot, in_words.event(event))
    messages, _ = logged_messages(result)
    for message in messages:
        times = f" ({message.count} times)" if message.count > 1 else ""
        yield Entry(message.time, _OF_STATUS.get(message.status, ERROR), message.robot, printable(message.text) + times)
    if failure := Provenance.of(result.attrs).failure:
        yield Entry(float(result["time"].values[-1]), FATAL, failure.robot, printable(str(failure)))
