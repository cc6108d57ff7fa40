"""A run as the viewers of its page get it while it goes on: evenly spaced ticks so far, and the last one."""

from __future__ import annotations

import json
import math
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.errors import FormationError
from cosim.master.records import Records
from cosim.report.columns import Rows
from cosim.report.content import Json, content_of, courses_of, events_told
from cosim.results.result import Result
from cosim.results.summary import Summary

MOST_NUMBERS = 2_000_000
"""Numbers of a run that a page gets while it goes on, eight bytes each."""
_FEWEST = 50
"""Ticks that it gets at least."""
_AT_ONCE = 250_000
"""Numbers of a message."""
_HEADER = struct.Struct("<4I")
"""Of a message with numbers: its first row, rows, whether one beside the spacing follows, ticks so far."""


class Feed:
    """A run for the viewers of its page.

    Legal call order: `look` as often as wanted, `finish` once the run has ended. All but `finish` from one thread.

    Parameters
    ----------
    records
        What is recorded of the run.

    Attributes
    ----------
    head : str
        What the page shows of the run before the first tick, as JSON; empty as long as there is none.
    ticks : int
        How many ticks viewers can get.
    """

    def __init__(self, records: Records) -> None:
        self._records = records
        self._rows: NDArray[np.float64] = np.empty((0, 0), np.float64)
        self._kept = 0
        self._last: NDArray[np.float64] | None = None
        self._before: Result | None = None
        self._every = 1
        self._finished: tuple[Result, Summary] | None = None
        self._end = ""
        self.head = ""
        self.ticks = 0

    def look(self) -> bool:
        """Take what has been recorded since the last look; return whether there is anything."""
        count = self._records.count()
        if count <= self.ticks:
            return False
        if not self.head:
            self._begin()
        rows = -(-count // self._every)
        if rows > self._kept:
            ticks = slice(self._kept * self._every, count, self._every)
            self._rows[self._kept : rows], self._before = self._numbers(ticks)
            self._kept = rows
        beside = (count - 1) % self._every != 0
        self._last = self._numbers(slice(count - 1, count))[0] if beside else None
        self.ticks = count
        return True

    def since(self, rows: int) -> tuple[bytes, int]:
        """Return a message with the ticks after so many that a viewer has, and how many it has then.

        It may be that there are more, which the next message brings.
        """
        stop = min(self._kept, rows + max(_AT_ONCE // self._rows.shape[1], 1))
        numbers, beside = self._rows[rows:stop], self._last is not None and stop == self._kept
        ticks = self.ticks if stop == self._kept else (stop - 1) * self._every + 1
        parts = [_HEADER.pack(rows, stop - rows, beside, ticks), numbers.tobytes()]
        if beside and self._last is not None:
            parts.append(self._last.tobytes())
        return b"".join(parts), stop

    @property
    def rows(self) -> int:
        """How many evenly spaced ticks viewers can get."""
        return self._kept

    def finish(self, result: Result, summary: Summary) -> None:
        """Take the result of the run, which has ended."""
        self._finished = result, summary

    @property
    def has_ended(self) -> bool:
        """Whether the run has ended."""
        return self._finished is not None

    @property
    def end(self) -> str:
        """What the page shows of the run that has ended, as JSON: what the page of a finished run shows."""
        if not self._end and self._finished is not None:
            result, summary = self._finished
            try:
                run: Json | None = content_of(result, summary)
            except FormationError:  # no sample
                run = None
            failure = summary.provenance.failure
            self._end = in_json(kind="end", run=run, why="" if failure is None else str(failure))
        return self._end

    def _begin(self) -> None:
        scenario = self._records.scenario
        first = self._records.part(slice(0, 1), described=True)
        columns = Rows()
        courses = courses_of(first, columns)
        width = columns.numbers().shape[1]
        ticks = scenario.ticks + 1
        self._every = math.ceil(ticks / max(MOST_NUMBERS // width, _FEWEST))
        self._rows = np.empty((-(-ticks // self._every), width), np.float64)
        not_yet: Json = {name: [] for name in ("followers", "distance", "notes", "verdicts")}
        not_yet["events"] = events_told(first, scenario.horizon)
        self.head = in_json(
            kind="begin",
            run={**content_of(first), **courses, **not_yet, "status": "running", "failure": None, "numbers": ""},
            every=self._every,
            rows=len(self._rows) + 1,
            columns=width,
        )

    def _numbers(self, ticks: slice) -> tuple[NDArray[np.float64], Result]:
        part, columns = self._records.part(ticks, self._before), Rows()
        courses_of(part, columns)
        return columns.numbers(), part


def in_json(**content: Any) -> str:
    """Return a message for viewers, as JSON."""
    return json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
