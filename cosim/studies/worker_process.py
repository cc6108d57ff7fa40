"""Processes that make runs, as the process sees them that has started them: whatever ends one costs it a run at most.

A run that has ended its process is made once more, in a process that is supervised, where its FMU shows.
"""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import TypeVar

from cosim import process_tree
from cosim.errors import InputError
from cosim.plant.interpreter import environment, how_it_ended, kill, launch, wait
from cosim.plant.protocol import HEADER, MOST, exactly
from cosim.studies.kept_run import KeptRun
from cosim.studies.row import Row
from cosim.studies.task import Task, broken_row
from cosim.studies.worker import LENGTH, Told
from cosim.unforeseen import Lack

_LAST_MOMENT = 5.0
"""Time [s] for a process that has closed its pipe to end."""
_FINISH = 1.0
"""Time [s] for a process without tasks to end."""
_STARTS = 3
"""New processes of which none begins a task before that is a fault: someone may have ended one."""
_OFTEN = 3
"""Processes that may end in the middle of a task, besides one in ten runs, before each run is supervised."""
_T = TypeVar("_T")


class Ended(Exception):
    """A process has ended in the middle of a task; says how, in words that follow what it did not do."""


class NotBegun(Exception):
    """A process has ended before it began a task; says how."""


class Closed(Exception):
    """No more runs are made here."""


class WorkerProcess:
    """A process that makes runs, one task at a time."""

    def __init__(self) -> None:
        self.has_begun = False
        self._mark = process_tree.new_mark()
        self._process = launch(
            (sys.executable, "-P", "-m", "cosim.studies.worker"), environment(self._mark, plain=False)
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._tasks, self._answers = self._process.stdin.fileno(), self._process.stdout.fileno()

    def answers(self, task: bytes, read: Callable[[str], _T]) -> Iterator[_T | float]:
        """Return the answers of a task as they come, and in the end the time [s] that it took.

        Raises
        ------
        NotBegun, Ended
            The process has ended before the task, or in it; it remains to be closed. One that was there before the task
            and has other code than it wants counts as ended before: a new one may have that code.
        Lack
            The machine lacks what the task needs.
        InputError
            The machine has other code than the task wants.
        """
        may_be_outdated = self.has_begun
        with suppress(BrokenPipeError):
            data = memoryview(len(task).to_bytes(LENGTH, "little") + task)
            while data:
                data = data[os.write(self._tasks, data) :]
        try:
            first = self._answer()
        except Ended as how:
            raise NotBegun(str(how)) from None
        self.has_begun = True
        if first[0] not in (Told.BEGUN, Told.UNFORESEEN):
            raise Ended(": its process answers before it has begun")
        while True:
            kind, body = self._answer() if first[0] == Told.BEGUN else first
            try:
                if kind == Told.ANSWER:
                    yield read(body.decode())
                    may_be_outdated = False
                elif kind == Told.DONE:
                    yield float(json.loads(body))
                    return
                else:
                    told = json.loads(body)
                    lacks, message, where = bool(told["lacks"]), str(told["message"]), str(told["traceback"])
                    refuses = bool(told["refuses"])
            except (ValueError, TypeError, LookupError, RecursionError):
                raise Ended(": its process answers with bytes that are no reply") from None
            if kind not in (Told.ANSWER, Told.DONE):
                if refuses and may_be_outdated:
                    raise NotBegun(f": {message}")
                if refuses:
                    raise InputError(message)
                kept = "; the runs so far are kept, and the same command goes on"
                error = Lack(message + kept) if lacks else RuntimeError(message)
                error.add_note(where)
                raise error

    def end(self) -> None:
        """End it at once; whoever waits for its rows hears of it, and closes it."""
        self._process.kill()

    def finish(self) -> None:
        """Let it end what it has prepared, as there are no more tasks; `close` waits a moment for that."""
        assert self._process.stdin is not None
        self._process.stdin.close()

    def close(self) -> None:
        """End it with all that it has started, at once unless it finishes."""
        if self._process.stdin is None or self._process.stdin.closed:
            with suppress(subprocess.TimeoutExpired):
                wait(self._process, self._mark, _FINISH)
        kill(self._process, self._mark)

    def _answer(self) -> tuple[int, bytes]:
        if (header := exactly(self._answers, HEADER.size)) is not None:
            kind, length = HEADER.unpack(header)
            body = exactly(self._answers, length) if length <= MOST else b""
            if body is not None:
                return kind, body
        try:
            raise Ended(how_it_ended(wait(self._process, self._mark, _LAST_MOMENT)))
        except subprocess.TimeoutExpired:
            raise Ended(": its process has closed its pipe") from None


def _row(text: str) -> Row:
    return Row.of(json.loads(text))


class Processes:
    """All processes of this one that make runs: a task borrows one, which keeps what it has prepared."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._idle: list[WorkerProcess] = []
        self._lent: set[WorkerProcess] = set()
        self._open = True
        self._ended = self._made = 0

    def make(self, task: Task) -> tuple[list[Row], float]:
        """Return the rows of a task, and the time [s] that it took in its processes.

        Raises
        ------
        Closed
            No more runs are made here.
        """
        rows: list[Row] = []
        seconds = 0.0
        while len(rows) < len(task.runs):
            often = self._ended > _OFTEN + self._made / 10
            rest = replace(task, runs=task.runs[len(rows) :], keys=task.keys[len(rows) :], alone=often)
            try:
                for told in self.answers(rest, _row):
                    if isinstance(told, Row):
                        rows.append(told)
                    else:
                        seconds += told
            except Ended:
                at = slice(len(rows), len(rows) + 1)  # the run after those whose rows have come
                if task.runs[at]:
                    rows.append(self._alone(replace(task, runs=task.runs[at], keys=task.keys[at], alone=True)))
        self._made += len(rows)
        return rows, seconds

    def answers(self, task: Task | KeptRun, read: Callable[[str], _T]) -> Iterator[_T | float]:
        """Return the answers of a task as they come, and in the end the time [s] that it took.

        Raises
        ------
        Ended
            Its process has ended in the middle of it.
        Closed
            No more is made here.
        """
        data = pickle.dumps(task)
        failed = 0
        while True:
            try:
                with self._borrowed() as process:
                    failed += not process.has_begun  # others may have had nothing to do for a while, and have ended
                    yield from process.answers(data, read)
                return
            except NotBegun as how:
                if failed == _STARTS:
                    raise RuntimeError(f"a process that makes runs did not start{how}") from None

    def close(self) -> None:
        """End all processes at once, in the middle of their tasks, which raise `Closed`."""
        with self._lock:
            self._open = False
            idle, self._idle = self._idle, []
            for process in self._lent:
                process.end()
        for process in idle:
            process.finish()
        for process in idle:
            process.close()

    def _alone(self, task: Task) -> Row:
        """Make one run, which may end its process."""
        try:
            (row,) = (told for told in self.answers(task, _row) if isinstance(told, Row))
        except Ended as how:
            return broken_row(task, task.runs[0], task.keys[0], f"it did not end{how}")
        return row

    @contextmanager
    def _borrowed(self) -> Iterator[WorkerProcess]:
        """Lend a process, which is idle afterwards, unless it has failed."""
        with self._lock:
            if not self._open:
                raise Closed
            process = self._idle.pop() if self._idle else WorkerProcess()
            self._lent.add(process)
        idle = False
        try:
            yield process
            idle = True
        except Ended:
            self._ended += 1
            raise
        finally:
            with self._lock:
                self._lent.discard(process)
                if idle and self._open:
                    self._idle.append(process)
                else:
                    process.close()
