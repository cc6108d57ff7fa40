"""A Model Exchange FMU integrated with a fixed step: FMI 1.0, FMI 2.0 and 3.0 (section 3.2 of each), by address.

Inputs that change do so in an event, as they jump. Time events are hit exactly. A state event, a change of sign of an
event indicator, is handled at the end of the solver step in which it happens: the error is of the order of that step.
"""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

from cosim.compiled import compiled
from cosim.plant.calls import c_function
from cosim.plant.failures import COMPLETE, DERIVE, END, EVENT, FINE, ITERATE, WARNING

FUNCTIONS = {
    "set_time": ("SetTime", "SetTime", "SetTime"),
    "set_states": ("SetContinuousStates", "SetContinuousStates", "SetContinuousStates"),
    "get_states": ("GetContinuousStates", "GetContinuousStates", "GetContinuousStates"),
    "get_derivatives": ("GetDerivatives", "GetDerivatives", "GetContinuousStateDerivatives"),
    "get_indicators": ("GetEventIndicators", "GetEventIndicators", "GetEventIndicators"),
    "completed": ("CompletedIntegratorStep", "CompletedIntegratorStep", "CompletedIntegratorStep"),
    "enter_event": ("", "EnterEventMode", "EnterEventMode"),
    "update": ("EventUpdate", "NewDiscreteStates", "UpdateDiscreteStates"),
    "enter_continuous": ("", "EnterContinuousTimeMode", "EnterContinuousTimeMode"),
}
"""Functions of Model Exchange, by their names in FMI 1.0 (which has no modes), 2.0 and 3.0."""

SCRATCH = 8
"""Doubles per plant for values that FMI functions return through pointers."""

_EULER, _RUNGE_KUTTA_4 = 0, 1
_MAX_ITERATIONS = 100
_MAX_PARTS = 100_000
"""Upper limit for the parts into which time events cut a step of the solver."""
_SMALLEST_PART, _ROUNDING = 1e-9, 8 * sys.float_info.epsilon
"""Part of a solver step, and of the time; a time event nearer than one of them counts as reached."""

_STAGE_TIME = (0.0, 0.5, 0.5, 1.0)
_STAGE_WEIGHT = (1 / 6, 1 / 3, 1 / 3, 1 / 6)

_plain = c_function("pointer", unsigned=True)
_at_time = c_function("pointer", "double", unsigned=True)
_vector = c_function("pointer", "pointer", "size", unsigned=True)
_completed_1 = c_function("pointer", "pointer", unsigned=True)
_completed = c_function("pointer", "int", "pointer", "pointer", unsigned=True)
_update_3 = c_function("pointer", "pointer", "pointer", "pointer", "pointer", "pointer", "pointer", unsigned=True)
_update_2 = c_function("pointer", "pointer", unsigned=True)
_update_1 = c_function("pointer", "int", "pointer", unsigned=True)


def work_size(states: int, indicators: int) -> int:
    """Return how many doubles of work space a plant needs."""
    return 4 * states + 2 * indicators


@compiled
def integrate(
    row: np.void, scratch: NDArray[np.float64], work: NDArray[np.float64], time: float, step: float
) -> tuple[int, int]:
    """Advance one plant by a communication step; see `cosim.plant.stepping.advance`.

    The work space holds the states, the states of a stage, its derivatives, their weighted sum, and the event
    indicators before and after a solver step.
    """
    nx, nz, place = row["states"], row["indicators"], row["work"]
    status = _vector(row["get_states"], (row["component"], place, nx)) if nx > 0 else 0
    if status > WARNING:
        return DERIVE, status
    if nz > 0:
        status = _vector(row["get_indicators"], (row["component"], place + 8 * 4 * nx, nz))
        if status > WARNING:
            return EVENT, status
    solver_step = step / row["steps"]
    for part in range(row["steps"]):
        now = time + part * solver_step
        end = time + step if part + 1 == row["steps"] else time + (part + 1) * solver_step
        parts = 0
        while now < end:
            parts += 1
            until, close = end, max(_SMALLEST_PART * solver_step, _ROUNDING * end)
            if row["next_event"] < end - close:
                until = max(row["next_event"], now)
            elif row["next_event"] < end + close:  # rounding may have put the end before it
                until = max(row["next_event"], end)
            if until > now:
                status = _solver_step(row, work, now, until)
            else:  # the FMU may be at a time which rounding puts before this one
                status = _at_time(row["set_time"], (row["component"], now))
            if status > WARNING:
                return DERIVE, status
            now = until
            what, status = _after_step(row, scratch, work, now)
            if what != FINE:
                return what, status
            if row["next_event"] <= now or parts > _MAX_PARTS:  # time events that never end
                return ITERATE, status
    return FINE, 0


@compiled
def _solver_step(row: np.void, work: NDArray[np.float64], now: float, end: float) -> int:
    """Take a step of the method and leave the plant at its end, which may be the time of an event: to the bit."""
    step = end - now
    nx, first, place = row["states"], row["first"], row["work"]
    stage, slope, total = first + nx, first + 2 * nx, first + 3 * nx
    stages = 1 if row["method"] == _EULER else 4
    for s in range(stages):
        if s > 0:
            status = _at_time(row["set_time"], (row["component"], end if s == 3 else now + _STAGE_TIME[s] * step))
            if status > WARNING:
                return status
            for i in range(nx):
                work[stage + i] = work[first + i] + _STAGE_TIME[s] * step * work[slope + i]
            status = _vector(row["set_states"], (row["component"], place + 8 * nx, nx)) if nx > 0 else 0
            if status > WARNING:
                return status
        if nx > 0:
            status = _vector(row["get_derivatives"], (row["component"], place + 8 * 2 * nx, nx))
            if status > WARNING:
                return status
        for i in range(nx):
            weighted = work[slope + i] if stages == 1 else _STAGE_WEIGHT[s] * work[slope + i]
            work[total + i] = weighted if s == 0 else work[total + i] + weighted
    for i in range(nx):
        work[first + i] += step * work[total + i]
    status = _at_time(row["set_time"], (row["component"], end))
    if status > WARNING or nx == 0:
        return status
    return _vector(row["set_states"], (row["component"], place, nx))


@compiled
def _after_step(row: np.void, scratch: NDArray[np.float64], work: NDArray[np.float64], now: float) -> tuple[int, int]:
    """Complete a solver step and handle its events."""
    nx, nz = row["states"], row["indicators"]
    before = row["first"] + 4 * nx
    event = now >= row["next_event"]
    status = 0
    if row["completes"] != 0:
        what, status, asked = _complete(row, scratch)
        if what != FINE:
            return what, status
        event = event or asked
    if nz > 0:
        status = _vector(row["get_indicators"], (row["component"], row["work"] + 8 * (4 * nx + nz), nz))
        if status > WARNING:
            return EVENT, status
        for i in range(nz):
            event = event or (work[before + i] > 0) != (work[before + nz + i] > 0)
            work[before + i] = work[before + nz + i]
    if not event:
        return FINE, status
    status = enter_event_mode(row)
    if status > WARNING:
        return EVENT, status
    what, status = leave_event_mode(row, scratch)
    if what != FINE:
        return what, status
    if nx > 0:
        status = _vector(row["get_states"], (row["component"], row["work"], nx))
    if nz > 0 and status <= WARNING:
        status = _vector(row["get_indicators"], (row["component"], row["work"] + 8 * 4 * nx, nz))
    return (EVENT if status > WARNING else FINE), status


@compiled
def _complete(row: np.void, scratch: NDArray[np.float64]) -> tuple[int, int, bool]:
    """Complete a solver step; return the failure, the status, and whether the FMU asks for an event."""
    place = row["scratch"]
    scratch[:] = 0.0
    if row["version"] == 1:
        status = _completed_1(row["completed"], (row["component"], place))
        return (COMPLETE if status > WARNING else FINE), status, scratch.view(np.int8)[0] != 0
    status = _completed(row["completed"], (row["component"], np.int32(1), place, place + 8))
    flags = scratch.view(np.int32)
    if status > WARNING:
        return COMPLETE, status, False
    return (END if flags[2] != 0 else FINE), status, flags[0] != 0


@compiled
def enter_event_mode(row: np.void) -> int:
    """Enter Event Mode; return the status."""
    if row["enter_event"] == 0:
        return 0
    return _plain(row["enter_event"], (row["component"],))


@compiled
def leave_event_mode(row: np.void, scratch: NDArray[np.float64]) -> tuple[int, int]:
    """Iterate over the discrete states, and go back to Continuous-Time Mode."""
    flags, small_flags, place = scratch.view(np.int32), scratch.view(np.int8), row["scratch"]
    status = 0
    for _ in range(_MAX_ITERATIONS):
        scratch[:] = 0.0
        # All versions return five flags and a time; before FMI 3.0 in one structure, in FMI 1.0 with flags of a byte.
        if row["version"] == 3:
            places = (row["component"], place, place + 4, place + 8, place + 12, place + 16, place + 24)
            status = _update_3(row["update"], places)
        elif row["version"] == 2:
            status = _update_2(row["update"], (row["component"], place))
        else:
            status = _update_1(row["update"], (row["component"], np.int32(0), place))
        if row["version"] == 1:
            again, ended, is_next, next_event = (
                small_flags[0] == 0,
                small_flags[3] != 0,
                small_flags[4] != 0,
                scratch[1],
            )
        else:
            again, ended, is_next, next_event = flags[0] != 0, flags[1] != 0, flags[4] != 0, scratch[3]
        if status > WARNING:
            return EVENT, status
        if ended:
            return END, status
        if not again:
            row["next_event"] = next_event if is_next else np.inf
            if row["enter_continuous"] != 0:
                status = _plain(row["enter_continuous"], (row["component"],))
            return (EVENT if status > WARNING else FINE), status
    return ITERATE, status
