"""What can become of a plant, and how it is told."""

from __future__ import annotations

FINE, ACCEPT, COMPLETE, RETURN, END, EARLY, DERIVE, EVENT, ITERATE = range(9)

FAILURES = {
    ACCEPT: "did not accept its inputs",
    COMPLETE: "did not complete the step",
    RETURN: "did not return its outputs",
    END: "asks to end the simulation",
    EARLY: "returns early from the step and does not get on",
    DERIVE: "did not return the derivatives of its states",
    EVENT: "did not process an event",
    ITERATE: "handles events without end",
}
"""What a plant did, by what failed."""

STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")
WARNING, DISCARD, ERROR, FATAL = range(1, 5)
"""Warning is the largest status with which a run goes on; after Error and Fatal an instance is of no more use."""


class PlantError(Exception):
    """A plant failed or refused something; the text, of which the plant is the subject, says what."""


class NoInstance(PlantError):
    """The FMU gave no instance of itself."""


def failure(what: int, status: int, said: str) -> str:
    """Return what a plant did, with the status of the FMI call and what the FMU has logged."""
    name = STATUS[status] if 0 <= status < len(STATUS) else str(status)
    text = FAILURES[what] + (f" (status {name})" if status > WARNING else "")
    return f"{text}: {said}" if said else text
