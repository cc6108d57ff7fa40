"""The ticks of a run in compiled code: sense, control, actuate, record and step, segment by segment.

`advance` runs a segment of ticks in one call. Its parts are called one by one where Python has a share in a tick: a law
in plain Python, a plant in a process of its own, commands by hand. The numbers are the same bit for bit.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numba import literal_unroll
from numpy.typing import NDArray

from cosim.compiled import call, compiled
from cosim.plant.fleet import CompiledFleet
from cosim.signals.chain import ChainArrays, apply

Floats: TypeAlias = NDArray[np.float64]
Places: TypeAlias = NDArray[np.int64]


class Ended(IntEnum):
    """Why a segment has ended: it is complete; the plants; a law's inputs, its function, its commands."""

    COMPLETE, PLANTS, INPUTS, RAISED, COMMANDS = range(5)


_COMPLETE, _PLANTS, _INPUTS, _RAISED, _COMMANDS = map(int, Ended)


class Sensing(NamedTuple):
    """From true to measured poses (robots, entries); `state` has pose and pseudo-velocities."""

    state: Floats
    measured: Floats
    chain: ChainArrays


class Taking(NamedTuple):
    """From a tick's numbers to the inputs of the laws, all in one flat array that the laws' inputs are parts of.

    Each pair says where in `taken` a number goes, and where in another flat array it comes from; `q`, `q_dot`, `q_ddot`
    and the leader's `acceleration` have a row a tick.
    """

    taken: Floats
    measured: Floats
    to_measured: Places
    from_measured: Places
    state: Floats
    to_state: Places
    from_state: Places
    q: Floats
    q_dot: Floats
    q_ddot: Floats
    to_q: Places
    to_q_dot: Places
    to_q_ddot: Places
    from_q: Places
    acceleration: Floats
    to_acceleration: Places
    from_acceleration: Places


class LawCall(NamedTuple):
    """A law with one team: the address of its tick and the arguments; its signals as numbers, and their records."""

    address: int
    arguments: tuple[Any, Any, Floats]
    signals: Floats
    records: Floats


class Commanding(NamedTuple):
    """From the commands of the laws, one team after the other, to those of the followers, both flat."""

    given: Floats
    command: Floats
    places: Places


class Acting(NamedTuple):
    """From the followers' commands to what acts on all robots.

    Attributes
    ----------
    command, acting : ndarray
        (followers, entries): commands, and what comes out of the actuators, a part of `torque`.
    torque, external : ndarray
        (robots, entries) what acts, and (ticks, robots, entries) what acts besides the followers' commands.
    disturbed : bool
        Whether anything acts on followers besides their commands.
    """

    command: Floats
    acting: Floats
    torque: Floats
    external: Floats
    disturbed: bool
    chain: ChainArrays


class Recording(NamedTuple):
    """Arrays, and their records (ticks, ...)."""

    state: Floats
    measured: Floats
    torque: Floats
    states: Floats
    measurements: Floats
    torques: Floats


class Driving(NamedTuple):
    """What the plants are given, `given`: numbers of `torque`, flat, or of `samples` (ticks, inputs).

    A number comes from ``torque[place]``, where its place is negative from ``samples[tick, -1 - place]``.
    """

    given: Floats
    torque: Floats
    samples: Floats
    places: Places


class Path(NamedTuple):
    """Where a leader is whose motion is given: its state (ticks, entries), and the columns of `state` where it goes."""

    state: Floats
    columns: Places


class Loop(NamedTuple):
    """Everything that the ticks of a run need, but for the laws."""

    step: float
    ticks: int
    period: int
    sensing: Sensing
    taking: Taking
    commanding: Commanding
    acting: Acting
    recording: Recording
    driving: Driving
    path: Path
    fleet: CompiledFleet


@compiled
def sense(sensing: Sensing, tick: int) -> None:
    """Measure the poses."""
    state, measured = sensing.state, sensing.measured
    for i in range(measured.shape[0]):
        for j in range(measured.shape[1]):
            measured[i, j] = state[i, j]
    apply(sensing.chain, tick, measured)


@compiled
def _take(taking: Taking, tick: int) -> bool:
    """Gather the inputs of the laws; return whether they are finite."""
    taken = taking.taken
    for m in range(len(taking.to_measured)):
        taken[taking.to_measured[m]] = taking.measured[taking.from_measured[m]]
    for m in range(len(taking.to_state)):
        taken[taking.to_state[m]] = taking.state[taking.from_state[m]]
    for m in range(len(taking.from_q)):
        place = taking.from_q[m]
        taken[taking.to_q[m]] = taking.q[tick, place]
        taken[taking.to_q_dot[m]] = taking.q_dot[tick, place]
        taken[taking.to_q_ddot[m]] = taking.q_ddot[tick, place]
    for m in range(len(taking.to_acceleration)):
        taken[taking.to_acceleration[m]] = taking.acceleration[tick, taking.from_acceleration[m]]
    return _finite(taken)


@compiled
def _finite(numbers: Floats) -> bool:
    for number in numbers:  # noqa: SIM110 (compiled code)
        if not math.isfinite(number):
            return False
    return True


@compiled
def _control(laws: tuple[LawCall, ...]) -> bool:
    """Let each law fill its commands; return whether all have."""
    fine = True
    for law in literal_unroll(laws):
        if fine and call(law.address, law.arguments) != 0:
            fine = False
    return fine


@compiled
def _command(commanding: Commanding) -> bool:
    """Hand on the commands of the laws; return whether they are finite."""
    for m in range(len(commanding.places)):
        commanding.command[commanding.places[m]] = commanding.given[m]
    return _finite(commanding.given)


@compiled
def act(acting: Acting, tick: int) -> None:
    """Let the actuators follow the commands; what acts besides is added."""
    torque, external, moved = acting.torque, acting.external, acting.acting
    for j in range(torque.shape[1]):
        torque[0, j] = external[tick, 0, j]
    for i in range(moved.shape[0]):
        for j in range(moved.shape[1]):
            moved[i, j] = acting.command[i, j]
    apply(acting.chain, tick, moved)
    if acting.disturbed:
        for i in range(moved.shape[0]):
            for j in range(moved.shape[1]):
                moved[i, j] += external[tick, 1 + i, j]


@compiled
def record(recording: Recording, tick: int) -> None:
    """Record poses, velocities, measurements and torques."""
    _copy(recording.state, recording.states, tick)
    _copy(recording.measured, recording.measurements, tick)
    _copy(recording.torque, recording.torques, tick)


@compiled
def _copy(values: Floats, records: Floats, tick: int) -> None:
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            records[tick, i, j] = values[i, j]


@compiled
def _record_signals(laws: tuple[LawCall, ...], tick: int) -> None:
    for law in literal_unroll(laws):
        for m in range(len(law.signals)):
            law.records[tick, m] = law.signals[m]


@compiled
def give(driving: Driving, tick: int) -> None:
    """Fill in what the plants are given until the next tick."""
    for m in range(len(driving.places)):
        place = driving.places[m]
        driving.given[m] = driving.torque[place] if place >= 0 else driving.samples[tick, -1 - place]


@compiled
def lead(path: Path, state: Floats, tick: int) -> None:
    """Put a leader whose motion is given where it is at a tick."""
    for m in range(len(path.columns)):
        state[0, path.columns[m]] = path.state[tick, m]


@compiled
def advance(loop: Loop, laws: tuple[LawCall, ...], first: int, last: int) -> tuple[int, int]:
    """Run ticks until one of them, or until an FMU says something.

    Returns
    -------
    tuple of int
        The next tick, or the one in which the segment has ended; and why, of `Ended`.
    """
    fleet = loop.fleet
    for tick in range(first, last):
        sense(loop.sensing, tick)
        if tick % loop.period == 0:
            if not _take(loop.taking, tick):
                return tick, _INPUTS
            if not _control(laws):
                return tick, _RAISED
            if not _command(loop.commanding):
                return tick, _COMMANDS
        act(loop.acting, tick)
        record(loop.recording, tick)
        _record_signals(laws, tick)
        if tick == loop.ticks:
            return tick + 1, _COMPLETE
        give(loop.driving, tick)
        call(fleet.address, (fleet.arrays, loop.driving.given, tick * loop.step, loop.step, fleet.found))
        if fleet.found[0] != 0:
            return tick, _PLANTS
        lead(loop.path, loop.sensing.state, tick + 1)
        if fleet.said[0] != 0:
            return tick + 1, _COMPLETE
    return last, _COMPLETE
