"""Errors, each a sentence that a user can act on."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class ControllerError(ValueError):
    """Base of every error that this package raises on purpose.

    Attributes
    ----------
    message : str
        One sentence, without the robot.
    robot : int or None
        Row of the follower that the error is about, if it is about one.
    """

    def __init__(self, message: str, *, robot: int | None = None) -> None:
        super().__init__(message)
        self.message = message
        self.robot = robot

    def __str__(self) -> str:
        return self.message if self.robot is None else f"robot {self.robot}: {self.message}"


class UnknownController(ControllerError):
    """No installed package offers a controller of this name."""


class IncompatibleInterface(ControllerError):
    """The controller was written for another version of the controller interface."""


class GainError(ControllerError):
    """A gain is unknown, malformed or out of its bounds."""


def unknown(what: str, name: object, known: Iterable[str]) -> str:
    """Say that a name is unknown, which one was probably meant and which there are."""
    names = sorted(known)
    nearest = difflib.get_close_matches(name, names, n=1) if isinstance(name, str) else []
    meant = f"; did you mean {nearest[0]!r}?" if nearest else ";"
    return f"unknown {what} {name!r}{meant} known: {', '.join(names) or 'none'}"
