"""Errors that a user sees; each kind has its exit status of the command line."""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, order=True)
class Location:
    """A place in a file that a person wrote: line from 1, column from 1; 0 where unknown."""

    file: str
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        """Return ``file``, ``file:line`` or ``file:line:column``, as editors and compilers read it."""
        return ":".join([self.file, *(str(n) for n in (self.line, self.column) if n)])

    def seen_from(self, here: Location) -> str:
        """Return where it is, as seen from another place: a line of the same file, or a place in another."""
        return f"in line {self.line}" if here.file == self.file else f"at {self}"


def _restored(kind: type[BaseException], args: tuple[object, ...]) -> BaseException:
    return kind.__new__(kind, *args)


class Picklable(BaseException):
    """An exception that is pickled by its fields, without a call of its constructor."""

    def __reduce__(self) -> tuple[object, ...]:
        """Return the steps to make it again: without its constructor, which takes other arguments than the text."""
        return _restored, (type(self), self.args), self.__dict__


class FormationError(Picklable, Exception):
    """Base of all errors that a user sees: a sentence with the fault and its remedy."""

    exit_status: ClassVar[int] = 2


class InputError(FormationError):
    """Something that the user gave is wrong: a file, an option, a value."""

    def __init__(self, message: str, where: Location | None = None) -> None:
        self.message = brief(message)
        self.where = where
        super().__init__(f"{where}: {self.message}" if where else self.message)


class AfterTheEnd(InputError):
    """Something is about a time that the run does not reach."""

    def advised(self, changes: Iterable[str]) -> AfterTheEnd:
        """Return it with a way out, where it is an option that has made the run shorter than its expectations."""
        if not any(words.startswith("--horizon") for words in changes):
            return self
        return AfterTheEnd(
            f"{self.message}; --no-expectations (from Python, expectations=False) leaves all expectations out",
            self.where,
        )


class OtherStructure(InputError):
    """A scenario that was to be run as a variation of a prepared one has another structure."""


class UnboundVelocities(InputError):
    """A robot's FMU lacks velocities that are needed; no variable is bound to them.

    Attributes
    ----------
    fmu : str
        Its file.
    vehicle : str
        The kind of vehicle that it is bound as.
    roles : tuple of str
        The velocities.
    played : tuple of str
        The names of its numbers that play a role.
    """

    def __init__(
        self,
        message: str,
        where: Location | None,
        fmu: str,
        vehicle: str,
        roles: tuple[str, ...],
        played: tuple[str, ...],
    ) -> None:
        super().__init__(message, where)
        self.fmu = fmu
        self.vehicle = vehicle
        self.roles = roles
        self.played = played


class OutputError(FormationError):
    """A result could not be written."""

    def __init__(self, message: str) -> None:
        super().__init__(brief(message))


@dataclass(frozen=True)
class Failure:
    """Why a run did not reach its end.

    Attributes
    ----------
    robot : str
        The robot that failed; empty if the run was interrupted or left.
    time : float
        Communication point [s] at which the failure was noticed.
    variable : str
        Variable that has diverged or was not finite, such as ``v``; empty if it is not about one variable.
    message : str
        The event, in words.
    """

    robot: str
    time: float
    variable: str
    message: str

    @property
    def interrupted(self) -> bool:
        """Whether the user stopped the run."""
        return not self.robot and not self.left

    @property
    def left(self) -> bool:
        """Whether the run was to go no further."""
        return self == leave(self.time)

    def __str__(self) -> str:
        """Return robot, time and message in a line."""
        if not self.robot:
            return f"{self.message} at t = {self.time:.12g} s"
        return f"{self.robot} at t = {self.time:.12g} s: {self.message}"


class SimulationError(FormationError):
    """A plant or a controller failed in the course of a run, or the motion diverged.

    Attributes
    ----------
    failure : Failure
        Robot, time and message; also as `robot` and `time`.
    recorded : cosim.results.result.Result or None
        Everything recorded up to then; set by the master.
    """

    exit_status = 3

    def __init__(self, robot: str, time: float, message: str, variable: str = "") -> None:
        self.failure = Failure(robot, time, variable, message)
        self.robot = robot
        self.time = time
        self.recorded: Any = None
        super().__init__(str(self.failure))

    @property
    def result(self) -> xr.Dataset | None:
        """Everything recorded up to then, as an xarray dataset; None if nothing was."""
        return None if self.recorded is None else self.recorded.dataset


class RunInterrupted(Picklable, KeyboardInterrupt):
    """The user stopped the run (Ctrl-C) at a time [s]; `recorded` is everything recorded up to then."""

    def __init__(self, time: float, recorded: Any) -> None:
        self.time = time
        self.recorded = recorded
        super().__init__(str(interruption(time)))

    @property
    def result(self) -> xr.Dataset:
        """Everything recorded up to then, as an xarray dataset."""
        dataset: xr.Dataset = self.recorded.dataset
        return dataset


def interruption(time: float) -> Failure:
    """Return the failure of a run that the user has stopped at a time [s]."""
    return Failure(robot="", time=time, variable="", message="interrupted")


def leave(time: float) -> Failure:
    """Return why a run that was to go up to a time [s] only has not reached its end."""
    return Failure(robot="", time=time, variable="", message="left as asked")


def printable(text: str) -> str:
    """Return a text of unknown origin without characters that control a terminal, but for the line's end."""
    return "".join("?" if unicodedata.category(c) in ("Cc", "Cf", "Cs") and c != "\n" else c for c in text)


_LINE = 200
"""Characters of a quoted value that a message shows in full."""
_WORD = 500
"""Characters of a path, or of anything else without a space, that a message shows in full."""
_MESSAGE = 10_000
"""Characters of a message; only the output of a compiler has as many."""


def shown(value: str) -> str:
    """Return at most a line of a value, to be shown without quotes."""
    line = value.partition("\n")[0]
    return value if line == value and len(value) <= _LINE else f"{line[: _LINE - 3]}..."


def brief(message: str) -> str:
    """Return a message in which each quoted value, and each path, is at most about a line long."""
    if len(message) <= _LINE:
        return message
    parts: list[str] = []
    at = 0
    unclosed: set[str] = set()
    while opening := _OPENING.search(message, at):
        quote, begin = opening[0], opening.end()
        parts.append(message[at:begin])
        at = begin
        closing = None if quote in unclosed else _CLOSING[quote].search(message, begin)
        if closing is None:
            unclosed.add(quote)
            continue
        value = message[begin : closing.start()]
        parts += [shown(value), quote]
        at = closing.end()
    parts.append(message[at:])
    text = _LONG_WORD.sub(lambda word: f"{word[0][: _WORD // 2]}...{word[0][-_WORD // 2 :]}", "".join(parts))
    return text if len(text) <= _MESSAGE else f"{text[:_MESSAGE]}..."


_OPENING = re.compile(r"""(?<!\w)["']""")
_CLOSING = {quote: re.compile(rf"{quote}(?!\w)") for quote in ("'", '"')}
_LONG_WORD = re.compile(rf"\S{{{_WORD + 10},}}")


MAX_NAMES = 40
"""How many known names are shown."""


def listed(names: Sequence[str]) -> str:
    """Return names one after another; of many the first ones alone."""
    return ", ".join([*names[:MAX_NAMES], *(["..."] if len(names) > MAX_NAMES else [])])


def nearest(name: str, known: list[str]) -> str:
    """Return a sentence that helps with a mistyped name: the nearest known one, and all of them, or the first ones."""
    close = difflib.get_close_matches(name[:100], known, n=1)
    hint = f"did you mean {close[0]!r}? " if close else ""
    shown = sorted(known)[:MAX_NAMES]
    if len(known) > len(shown):
        shown.append(f"and {len(known) - len(shown)} more")
    return f"{hint}{'K' if hint else 'k'}nown: {', '.join(shown) or 'none'}"
