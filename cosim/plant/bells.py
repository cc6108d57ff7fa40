"""A step of plants in other processes, from compiled code: numbers go through shared memory, a bell through a pipe.

The harness writes inputs into memory that it shares with a process, and increases a number there to ask for a step. The
process steps its plants, writes outputs into the memory, and answers in the same way. Whoever waits looks at the number
for a while, since to sleep and to wake up takes longer than most steps. On one core it gives the core to the other side
between two looks. Then it says that it sleeps, and waits for a few bytes in a pipe. Where looking has not helped, as
the step is long or others want the core, it does not look in the next steps.

The functions of the C library are called by addresses that come as data: compiled code is kept on disk.
"""

from __future__ import annotations

import ctypes
import os
import select
import sys
import time
from collections.abc import Sequence
from enum import IntEnum
from functools import cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.compiled import address_of, compiled, part
from cosim.plant.activity import Activity, activity
from cosim.plant.atomic import load, swap, swap_if
from cosim.plant.calls import c_function
from cosim.plant.protocol import HEADER, Reply, Request
from cosim.shared_memory import MappedMemory

PATIENCE = 50_000
"""Time [ns] to look before going to sleep: about what it takes to wake up on another core."""
_FEWEST, _MOST = 64, 2**16
"""Steps without looks after one in which looking has not helped: twice as many as the last time, within bounds."""

AWAKE, ASLEEP, BY_PIPE = range(3)
"""What whoever waits for a number says in memory: it looks there; it is `asleep`; it never looks, or not now."""


class Heard(IntEnum):
    """What is heard of a process: its step is done, with plants that have failed or without; nothing in good time.

    Or the process is gone, or has closed its pipe; or it has answered something that is no reply.
    """

    DONE, FAILED, NOTHING, GONE, NONSENSE = range(5)


HEARD_DONE, _FAILED, _NOTHING, _GONE, _NONSENSE = map(int, Heard)
"""The same as plain numbers, for compiled code."""

_FUNCTIONS = {
    "write": "write",
    "read": "read",
    "poll": "poll",
    "core_now": "sched_getcpu",
    "copy": "memcpy",
    "give_way": "sched_yield",
    "clock": "clock_gettime",
}
"""Functions of the C library, by the fields of `BELL` for their addresses."""

BELL = np.dtype(
    [
        *(("time", np.float64), ("step", np.float64), ("core", np.int64)),  # `Board.told`
        *((name, np.int64) for name in ("failed", "pending", "other_core")),  # `Board.tells`
        *((name, np.int64) for name in ("heard", "requests", "replies", "patience")),
        *(
            (name, np.int64)
            for name in ("asks_at", "hears_at", "seen", "slept", "rest", "pause", "seconds", "nanoseconds", "now_at")
        ),
        *((name, np.int64) for name in ("frame", "answer", "watched", "ending", "timer")),
        *((name, np.int64) for name in ("frame_at", "answer_at", "watched_at", *_FUNCTIONS)),
    ]
)
"""A process for compiled code: what it is told and tells, its pipes, and addresses in this record and of functions.

``asks_at`` and ``hears_at`` are the addresses of `Board.asked` and `Board.answered`, or the other way round in the
process. ``seen`` is the number that was there last, and ``slept`` whether this side has said since that it sleeps.
``rest`` is how many steps go without looks, and ``pause`` how many that were the last time.
``heard`` is of `Heard`. ``watched``, ``ending`` and ``timer`` are each a ``struct pollfd``: the replies, the end of the
process, and a timer, as far as the system has them. ``patience`` is how long [ms] compiled code waits; -1 with a timer.
"""

_WORDS = 3
"""Numbers of ``told``, and of ``tells``."""
_ROOM = 1 << 17
"""Bytes of a board without inputs and outputs, and more."""

SIZE = HEADER.size
SAYS = 8
"""Place [bytes] of what is said in `Board.asked` and `Board.answered`."""
_MONOTONIC = getattr(time, "CLOCK_MONOTONIC", 0)
_WATCHED = 3
"""Number of ``struct pollfd``."""
STEP, DONE = (int.from_bytes(HEADER.pack(kind, 0), "little") for kind in (Request.STEP, Reply.DONE))

_copy = c_function("pointer", "pointer", "size")
exchange = c_function("int", "pointer", "size")
_poll = c_function("pointer", "size", "int")
core_of = c_function("int")
_call = c_function("int")
_clock = c_function("int", "pointer")

Copies: TypeAlias = NDArray[np.int64]
"""Rows of three: an address, the address from which its bytes come, and how many."""


class Board(NamedTuple):
    """What the harness and a process share.

    Attributes
    ----------
    activity : Activity
        What the process is about.
    told : ndarray
        Communication point and step [s], and as an integer the core on which the harness works.
    tells : ndarray of int
        How many plants have failed, how many messages wait to be taken, the core on which the process works.
    asked, answered : ndarray of int
        A number that is increased for each step that is asked for, or answered, without the pipe or with it; and what
        the side says that waits for it: `AWAKE`, `BY_PIPE` or that it is `asleep`.
    inputs, outputs : ndarray
        Of all its plants, one after the other, in the FMUs' own units.
    """

    activity: Activity
    told: NDArray[np.float64]
    tells: NDArray[np.int64]
    asked: NDArray[np.int64]
    answered: NDArray[np.int64]
    inputs: NDArray[np.float64]
    outputs: NDArray[np.float64]


class Bells(NamedTuple):
    """Processes for compiled code: a record each, what is copied before a step and after it, and two functions."""

    bells: NDArray[np.void]
    gives: Copies
    takes: Copies
    ring: int
    listen: int


def board_size(inputs: int, outputs: int) -> int:
    """Return how many bytes suffice for a board with so many numbers given and returned."""
    return _ROOM + 8 * (inputs + outputs)


def board(memory: MappedMemory, inputs: int, outputs: int) -> Board:
    """Return the board that is in some memory."""
    return Board(
        activity(memory.take),
        memory.take((_WORDS,), np.float64),
        memory.take((_WORDS,), np.int64),
        memory.take((2,), np.int64),
        memory.take((2,), np.int64),
        memory.take((inputs,), np.float64),
        memory.take((outputs,), np.float64),
    )


def core_now() -> int:
    """Return the core on which this thread works; -1 if the system does not tell."""
    function = _function("sched_getcpu")
    return -1 if function is None else int(function())


def can_ring() -> bool:
    """Return whether compiled code can ring, and not Python alone."""
    return all(_function(name) is not None for name in _FUNCTIONS.values() if name != "sched_getcpu")


def fill(
    bell: NDArray[np.void],
    pipes: tuple[int, int],
    numbers: tuple[NDArray[np.int64], NDArray[np.int64]],
    rings: int,
) -> None:
    """Fill the record of a process, the only one of an array.

    Parameters
    ----------
    bell
        The array.
    pipes
        The one to be written, and the one to be read.
    numbers
        `Board.asked` and `Board.answered`, or the other way round in the process.
    rings
        What is written to ring.
    """
    bell["requests"], bell["replies"] = pipes
    bell["asks_at"], bell["hears_at"] = map(_at, numbers)
    bell["frame"] = rings
    replies = pipes[1]
    for name, descriptor in (("watched", replies), ("ending", -1), ("timer", -1)):
        bell[name] = _watched(descriptor)
    for name in ("frame", "answer", "watched"):
        bell[f"{name}_at"] = _at(bell[name])
    bell["now_at"] = _at(bell["seconds"])
    for field, name in _FUNCTIONS.items():
        function = _function(name)
        bell[field] = 0 if function is None else ctypes.cast(function, ctypes.c_void_p).value


def watch(bell: NDArray[np.void], ending: int, patience: float) -> int:
    """Let compiled code notice the end of a process, and return after some time for Python to have a look.

    Parameters
    ----------
    bell
        The array with its record.
    ending
        A descriptor that can be read once it has ended; -1 without one.
    patience
        The time [s].

    Returns
    -------
    int
        A descriptor to be closed in the end; -1 for none.
    """
    bell["ending"] = _watched(ending)
    timer = _timer(patience)
    bell["timer"] = _watched(timer)
    bell["patience"] = -1 if timer >= 0 else round(1000 * patience)
    return timer


def _timer(interval: float) -> int:
    """Return a descriptor that can be read after each interval [s], as setting a time for each step costs more."""
    create, start = _function("timerfd_create"), _function("timerfd_settime")
    if create is None or start is None:
        return -1
    descriptor = int(create(time.CLOCK_MONOTONIC, os.O_NONBLOCK | os.O_CLOEXEC))
    if descriptor >= 0:
        seconds, rest = divmod(round(interval * 1e9), 10**9)
        start(descriptor, 0, (ctypes.c_long * 4)(seconds, rest, seconds, rest), None)
    return descriptor


def bells_of(
    bells: NDArray[np.void],
    boards: Sequence[Board],
    places: Sequence[tuple[NDArray[np.int64], NDArray[np.int64]]],
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
) -> Bells:
    """Return processes for compiled code.

    Parameters
    ----------
    bells, boards
        The record of each, filled, and its board.
    places
        Where the inputs of each are in those of the fleet, and the outputs.
    inputs, outputs
        Those of the fleet.
    """
    gives: list[tuple[int, int, int]] = []
    takes: list[tuple[int, int, int]] = []
    for index, (own, (given, returned)) in enumerate(zip(boards, places, strict=True)):
        bell = bells[index : index + 1]
        gives.append((_at(own.told), _at(bell["time"]), 8 * _WORDS))
        takes.append((_at(bell["failed"]), _at(own.tells), 8 * _WORDS))
        gives += [(_at(own.inputs) + 8 * there, _at(inputs) + 8 * here, 8 * n) for here, there, n in _runs(given)]
        takes += [(_at(outputs) + 8 * here, _at(own.outputs) + 8 * there, 8 * n) for here, there, n in _runs(returned)]
    to, back = (np.array(copies, dtype=np.int64).reshape(-1, 3) for copies in (gives, takes))
    return Bells(bells, to, back, address_of(ring, bells, to, 0.0, 0.0), address_of(listen, bells, back))


def no_bells() -> Bells:
    """Return no processes."""
    copies = np.zeros((0, 3), dtype=np.int64)
    return Bells(np.zeros(0, BELL), copies, copies, 0, 0)


@compiled
def ring(bells: NDArray[np.void], gives: Copies, time: float, step: float) -> None:
    """Give all processes their inputs, and let them take a step from a time."""
    for i in range(len(bells)):
        bells[i]["time"], bells[i]["step"] = time, step
        bells[i]["core"] = core_of(bells[i]["core_now"], (np.int32(0),)) if bells[i]["core_now"] != 0 else -1
    for j in range(len(gives)):
        _copy(bells[0]["copy"], (gives[j, 0], gives[j, 1], gives[j, 2]))
    for i in range(len(bells)):
        bell = bells[i]
        bell["heard"], bell["seen"], bell["slept"] = _NOTHING, load(bell["hears_at"]), 0
        if load(bell["hears_at"] + SAYS) != AWAKE:  # to write there takes the memory from the other core
            swap(bell["hears_at"] + SAYS, AWAKE)
        ring_there(bell)


@compiled
def listen(bells: NDArray[np.void], takes: Copies) -> None:
    """Wait until all processes have completed their steps, or something else is to be heard; take their outputs."""
    for i in range(len(bells)):
        _hear(bells[i])
    for j in range(len(takes)):
        _copy(bells[0]["copy"], (takes[j, 0], takes[j, 1], takes[j, 2]))
    for i in range(len(bells)):
        if bells[i]["heard"] == HEARD_DONE and bells[i]["failed"] != 0:
            bells[i]["heard"] = _FAILED


@part
def _hear(bell: np.void) -> None:
    bell["answer"] = 0
    if look_for_it(bell):
        bell["heard"] = HEARD_DONE
        return
    if _poll(bell["poll"], (bell["watched_at"], _WATCHED, np.int32(bell["patience"]))) <= 0:
        return  # nothing in good time, or a signal that Python must see
    if bell["watched"] >> 48 != 0:  # an event
        read = exchange(bell["read"], (np.int32(bell["replies"]), bell["answer_at"], SIZE))
        if read > 0:
            bell["heard"] = HEARD_DONE if read == SIZE and bell["answer"] == DONE else _NONSENSE
            return
        bell["heard"] = _GONE
    elif bell["ending"] >> 48 != 0:
        bell["heard"] = _GONE
    else:
        exchange(bell["read"], (np.int32(bell["timer"] & 0xFFFFFFFF), bell["answer_at"], 8))  # until the next time


@part
def asleep(seen: int) -> int:
    """Return what a side says that sleeps after it has seen a number.

    The other side may have increased the number and then lost its core. Before it looks whether this side sleeps, this
    one may have found the number, and sleep again: it waits for the next one then, and must not be woken for the last.
    """
    return ASLEEP + 4 * seen


def sleep_until(number: NDArray[np.int64]) -> None:
    """Say from Python that this side is `asleep` until `Board.answered` is another one: the answer is in the pipe."""
    number[1] = ASLEEP + 4 * number[0]


@part
def ring_there(bell: np.void) -> None:
    """Increase the number for the other side, and wake it up by its pipe if it sleeps."""
    there = bell["asks_at"]
    before = load(there)
    swap(there, before + 1)
    if load(there + SAYS) == BY_PIPE or swap_if(there + SAYS, asleep(before), AWAKE) != 0:
        exchange(bell["write"], (np.int32(bell["requests"]), bell["frame_at"], SIZE))


@part
def look_for_it(bell: np.void) -> bool:
    """Look for a new number of the other side; return False, and say that this side sleeps, if there is none for long.

    Then something will be in the pipe. Of both sides, one alone makes this side `AWAKE` again: if it is the other one,
    it writes into the pipe.
    """
    if bell["slept"] != 0:
        return False
    here, seen = bell["hears_at"], bell["seen"]
    found = load(here) != seen
    if bell["rest"] > 0:
        bell["rest"] -= 1
    elif not found:
        together, now = bell["other_core"] == bell["core"], 0
        begun = _nanoseconds(bell)
        while not found and now - begun < PATIENCE:
            if together:
                _call(bell["give_way"], (np.int32(0),))
            found, now = load(here) != seen, _nanoseconds(bell)
        bell["pause"] = min(max(2 * bell["pause"], _FEWEST), _MOST) if now - begun >= PATIENCE else bell["pause"] // 2
        bell["rest"] = bell["pause"] if now - begun >= PATIENCE else 0
    if not found:
        swap(here + SAYS, asleep(seen))
        if load(here) == seen or swap_if(here + SAYS, asleep(seen), AWAKE) == 0:  # it has just rung, or is about to
            bell["slept"] = 1
            return False
    return True


@part
def _nanoseconds(bell: np.void) -> int:
    _clock(bell["clock"], (np.int32(_MONOTONIC), bell["now_at"]))
    now: int = 1_000_000_000 * bell["seconds"] + bell["nanoseconds"]
    return now


def _watched(descriptor: int) -> int:
    """Return a ``struct pollfd`` as a number; of the descriptor -1, nothing is watched."""
    return descriptor & 0xFFFFFFFF | getattr(select, "POLLIN", 0) << 32


def _at(array: NDArray[Any]) -> int:
    return int(array.ctypes.data)


def _runs(places: NDArray[np.int64]) -> list[tuple[int, int, int]]:
    """Return the runs of successive places: the first place, its number, and how many."""
    if not len(places):
        return []
    firsts = np.flatnonzero(np.diff(places, prepend=places[0] - 2) != 1)
    counts = np.diff(firsts, append=len(places))
    return list(zip(places[firsts].tolist(), firsts.tolist(), counts.tolist(), strict=True))


@cache
def _function(name: str) -> Any:
    if sys.platform == "win32":
        return None
    return getattr(ctypes.CDLL(None), name, None)
