"""One run of a study as a row of its table."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

from cosim.errors import Location

PASSED, FAILED, BROKEN = "passed", "failed", "broken"
"""How a run ends: all expectations hold; one does not; or it did not reach its end, or could not begin."""


@dataclass(frozen=True)
class Row:
    """How one run went.

    Attributes
    ----------
    key : str
        What determines the run, as a checksum; see `cosim.studies.keys`.
    number, draw : int
        Of the run and its draw, from 1.
    values : tuple of str or None
        Of each varied value, as the scenario had it; None where it had its own.
    status : str
        ``passed``, ``failed`` or ``broken``.
    measures : tuple of float
        In the units of the study; NaN of a broken run, infinite where there is no figure.
    margins : tuple of float
        Of each expectation, the least over the robots, in the unit of its bound; NaN where there is none.
    message : str
        Why it is broken: robot, time and reason; or which expectation failed.
    least : float
        The least of the margins, each over the magnitude of its bound: below zero if an expectation fails, minus
        infinite if one has no figure, infinite if nothing is expected.
    courses : tuple of str
        Of each envelope, see `cosim.studies.courses`; none of a broken run, and none in memory once the row is kept.
    where : str
        The place in a file that the message begins with; empty if it begins with none of an element.
    element : int
        The number of that element in the text of the scenario.
    """

    key: str
    number: int
    draw: int
    values: tuple[str | None, ...]
    status: str
    measures: tuple[float, ...]
    margins: tuple[float, ...]
    message: str
    least: float = math.inf
    courses: tuple[str, ...] = ()
    where: str = ""
    element: int = 0

    def placed(self, places: Sequence[Location]) -> Row:
        """Return it with a message that begins with the place as it is now, by the places of all elements."""
        if not self.where or not 0 <= self.element < len(places):  # the file may be damaged
            return self
        where = str(places[self.element])
        return replace(self, where=where, message=where + self.message.removeprefix(self.where))

    def to_json(self) -> str:
        """Return it in a line."""
        data = {**vars(self), "least": _told(self.least)}
        data |= {name: list(map(_told, data[name])) for name in ("measures", "margins")}
        if not self.courses:
            del data["courses"]
        if not self.where:
            del data["where"], data["element"]
        return json.dumps(data, allow_nan=False)

    @classmethod
    def of(cls, data: Mapping[str, Any]) -> Self:
        """Return the row that was written as data; raises TypeError, ValueError or KeyError if it was not."""
        if data["status"] not in (PASSED, FAILED, BROKEN):
            raise ValueError(f"no status: {data['status']!r}")
        return cls(
            key=str(data["key"]),
            number=int(data["number"]),
            draw=int(data["draw"]),
            values=tuple(None if value is None else str(value) for value in data["values"]),
            status=data["status"],
            measures=tuple(map(float, data["measures"])),
            margins=tuple(map(float, data["margins"])),
            message=str(data["message"]),
            least=float(data["least"]),
            courses=tuple(map(str, data.get("courses", ()))),
            where=str(data.get("where", "")),
            element=int(data.get("element", 0)),
        )


def _told(number: float) -> float | str:
    """Return a number as JSON can hold it; `float` reads it again."""
    return number if math.isfinite(number) else str(number)
