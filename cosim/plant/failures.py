"""Failures of a plant: numbers for compiled code, and their words."""

from __future__ import annotations

FINE, ACCEPT, COMPLETE, RETURN, END, EARLY, DERIVE, EVENT, ITERATE = range(9)

FAILURES = {
    ACCEPT: "did not accept its inputs",
    COMPLETE: "did not complete the step",
    RETURN: "did not return its outputs",
    END: "asks to end the simulation",
    EARLY: "returns early from the step without progress",
    DERIVE: "did not return the derivatives of its states",
    EVENT: "did not process an event",
    ITERATE: "handles events without end",
}
"""The words of each failure; the plant is the subject."""

STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")
WARNING, DISCARD, ERROR, FATAL = range(1, 5)
"""Warning is the largest status with which a run goes on; after Error and Fatal an instance is of no more use."""


class PlantError(Exception):
    """A plant failed or refused something; the plant is the subject of the text."""


class NoInstance(PlantError):
    """The FMU could not be instantiated."""


def failure(what: int, status: int, said: str) -> str:
    """Return the words of a failure, with the status of the FMI call and the FMU's messages."""
    name = STATUS[status] if 0 <= status < len(STATUS) else str(status)
    text = FAILURES[what] + (f" (status {name})" if status > WARNING else "")
    return f"{text}: {said}" if said else text
