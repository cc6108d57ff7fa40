"""Checkpoints that a run writes as it goes on: when, where, and at what cost."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from cosim.errors import InputError, OutputError, SimulationError
from cosim.master.checkpoint import Snapshot
from cosim.master.checkpoint_folder import name_of
from cosim.master.origin import Origin
from cosim.master.recorder import Recorder
from cosim.master.run_state import RunState

SHARE = 0.04
"""Part of a run's time that its checkpoints may take."""
LEAST, MOST = 1.0, 60.0
"""Time [s] from one checkpoint to the next, at least and at most, whatever the share says."""
_PER_BYTE = 1e-9
"""CPU time [s] for which a byte is taken to be written before one was."""
_LARGE = 2**20
"""Bytes of a checkpoint from which on its CPU time says something about a byte."""


@dataclass
class Checkpoints:
    """The checkpoints of a run in a folder, each with what was recorded since the one before.

    A checkpoint is taken between two ticks and written beside the loop, in a thread, which slows the loop all the same
    where both share a core or its memory. One that is due is left out while the one before is still being written, and
    then until a time has passed by the clock of which it is no more than `SHARE`: neither what the one before has
    taken by the clock, from the state to the disk, nor the CPU time that this one is likely to take, which grows with
    the records since then. The time is at least `LEAST` and at most `MOST`. Where there is none before, it runs from
    the start of the loop.

    Legal call order: `try_out`; then `reach` and `next_stop` in turn, `reach` first; `leave` if the run ends before its
    horizon; `finish`.

    Parameters
    ----------
    folder
        The folder; it exists.
    origin
        Where the checkpoints come from.
    every
        How many ticks lie between two; None for none but at the end.
    until
        The tick at which the run is left, after a checkpoint; None for its end.
    first, before
        The first tick that no checkpoint holds yet, and the name of the one that ends there.

    Attributes
    ----------
    written : int or None
        The tick of the last one that was written.
    fault : str
        Why the last attempt failed; empty if it did not.
    """

    folder: Path
    origin: Origin
    every: int | None = None
    until: int | None = None
    first: int = 0
    before: str = ""
    written: int | None = None
    fault: str = ""
    _since: float | None = None
    _taken_in: float = 0.0
    _written_in: float = 0.0
    _per_tick: int = 0
    _per_byte: float = _PER_BYTE
    _refused: bool = False
    _thread: threading.Thread | None = field(default=None, repr=False)

    def try_out(self, take: Callable[[], RunState], recorder: Recorder) -> None:
        """Take a state at the start of a run, which shows whether that is possible, and how long it takes.

        If checkpoints are to be written on its way, and this one is not there already, it is, too. That of a branch is
        always written, because nothing else leads to later moments of it. It has all records before it, so the loop
        does not wait for it either.

        Raises
        ------
        InputError
            An FMU does not save its state.
        """
        try:
            take()  # the first time takes longer
            began = time.perf_counter()
            state = take()
        except SimulationError as error:
            raise InputError(
                f"{error.robot}: {error.failure.message}, so the run cannot be left and taken up again; it can be run "
                "again from the start up to any moment, with the same bits"
            ) from None
        self._taken_in = time.perf_counter() - began
        self._per_tick = sum(numbers.nbytes for numbers in recorder.numbers(0, 1))
        if (self.every is not None or state.tick > 0) and not self.before:
            self._write_beside(Snapshot.of(self.origin, state, recorder, self.first, every=self.every), began)

    def next_stop(self, tick: int, last: int) -> int:
        """Return the tick at which the run is to stop for a moment: the next one that is due, or its end.

        Where the one that is due would be left out, the run does not stop for it: segments that are cut short cost
        more than all else. A segment is much shorter than the time between two checkpoints.
        """
        end = last + 1 if self.until is None else self.until
        if self.every is None or not self._is_cheap(tick):
            return end
        return min((tick // self.every + 1) * self.every, end)

    def reach(self, tick: int, take: Callable[[], RunState], recorder: Recorder) -> bool:
        """Take note of a tick before which the run is; return whether it is to be left there."""
        if tick == self.until:
            return True
        if self._since is None:
            self._since = time.perf_counter()
        if self.every is not None and tick % self.every == 0 and tick > self.first and self._is_cheap(tick):
            began = time.perf_counter()
            snapshot = self._taken(take, recorder)
            self._taken_in = time.perf_counter() - began
            if snapshot is not None:
                self._write_beside(snapshot, began)
        return False

    def leave(self, tick: int, take: Callable[[], RunState], recorder: Recorder) -> None:
        """Write a checkpoint where the run is left, if there is none."""
        self.finish()
        if tick > self.first and not self._refused and (snapshot := self._taken(take, recorder)) is not None:
            self._write(snapshot)

    def finish(self) -> None:
        """Wait until everything is written."""
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _is_cheap(self, tick: int) -> bool:
        """Return whether a checkpoint at a tick is not left out."""
        if self._refused or self._since is None:
            return False
        likely = self._taken_in + (tick - self.first) * self._per_tick * self._per_byte
        wait = max(likely / SHARE, self._written_in / SHARE, LEAST)
        return time.perf_counter() - self._since >= min(wait, MOST)

    def _taken(self, take: Callable[[], RunState], recorder: Recorder) -> Snapshot | None:
        self.finish()  # its thread has nothing more to write
        try:
            return Snapshot.of(self.origin, take(), recorder, self.first, self.before, self.every)
        except SimulationError as error:
            self.fault, self._refused = str(error), True
            return None

    def _write(self, snapshot: Snapshot) -> None:
        name = name_of(snapshot.tick)
        try:
            snapshot.write(self.folder / name)
        except OutputError as error:
            self.fault = str(error)
        else:
            self.first = self.written = snapshot.tick
            self.before, self.fault = name, ""

    def _write_beside(self, snapshot: Snapshot, began: float) -> None:
        self._since = math.inf  # until it is written
        self._thread = threading.Thread(target=self._write_and_tell, args=(snapshot, began))
        self._thread.start()

    def _write_and_tell(self, snapshot: Snapshot, began: float) -> None:
        """Write a checkpoint, and note what it has cost since its state was taken."""
        spent = time.thread_time()
        try:
            self._write(snapshot)
        finally:
            size = sum(array.nbytes for array in snapshot.arrays.values())
            if size >= _LARGE:
                self._per_byte = (time.thread_time() - spent) / size
            self._written_in = time.perf_counter() - began
            self._since = time.perf_counter()  # last: from now on the loop may take one
