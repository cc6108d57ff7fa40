"""Failures of a plant: numbers for compiled code, and their words."""

from __future__ import annotations

from enum import IntEnum


class Outcome(IntEnum):
    """The outcome of a call of a plant: success, or the kind of failure."""

    FINE, ACCEPT, COMPLETE, RETURN, END, EARLY, DERIVE, EVENT, ITERATE = range(9)


class Status(IntEnum):
    """The status that an FMI function returns."""

    OK, WARNING, DISCARD, ERROR, FATAL, PENDING = range(6)


FINE, ACCEPT, COMPLETE, RETURN, END, EARLY, DERIVE, EVENT, ITERATE = map(int, Outcome)
"""The outcomes as plain numbers, for compiled code."""

FAILURES: dict[int, str] = {
    Outcome.ACCEPT: "did not accept its inputs",
    Outcome.COMPLETE: "did not complete the step",
    Outcome.RETURN: "did not return its outputs",
    Outcome.END: "asks to end the simulation",
    Outcome.EARLY: "returns early from the step without progress",
    Outcome.DERIVE: "did not return the derivatives of its states",
    Outcome.EVENT: "did not process an event",
    Outcome.ITERATE: "handles events without end",
}
"""The words of each failure; the plant is the subject."""

STATUS = ("OK", *(status.name.capitalize() for status in Status if status > Status.OK))
WARNING, DISCARD, ERROR, FATAL = map(int, (Status.WARNING, Status.DISCARD, Status.ERROR, Status.FATAL))
"""Warning is the largest status with which a run goes on; after Error and Fatal an instance cannot be used any more."""


class PlantError(Exception):
    """A plant failed or refused something; the plant is the subject of the text."""


class NoInstance(PlantError):
    """The FMU could not be instantiated."""


def failure(what: int, status: int, said: str) -> str:
    """Return the words of a failure, with the status of the FMI call and the FMU's messages."""
    name = STATUS[status] if status < len(STATUS) else str(status if status < 1 << 31 else status - (1 << 32))
    text = FAILURES[what] + (f" (status {name})" if status > WARNING else "")
    return f"{text}: {said}" if said else text
