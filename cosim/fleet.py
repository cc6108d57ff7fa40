"""All plants of a run, exchanged and stepped at once by compiled code.

FMPy loads the FMUs; here their functions (FMI 2.0, section 4.2) are called by address, with arguments prepared once.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.calls import c_function, compiled
from cosim.contract import BoundRole
from cosim.plant import WARNING, Plant

_exchange = c_function("pointer", "pointer", "size", "pointer")
_do_step = c_function("pointer", "double", "double", "int")

_CALLS = np.dtype(
    [
        (name, np.int64)
        for name in ("component", "set", "step", "get", "in_names", "in_values", "in_count", "out_names", "out_values")
    ]
)
_ACCEPT, _COMPLETE, _RETURN = range(3)
_WHAT = ("accept its inputs", "complete the step", "return its outputs")


class Fleet:
    """Instances of plant FMUs that are stepped together.

    Parameters
    ----------
    plants
        The instances, initialised. They must stay open for as long as the fleet is used.
    """

    def __init__(self, plants: Sequence[Plant]) -> None:
        self._plants = tuple(plants)
        inputs = [plant.inputs for plant in plants]
        self._start = np.cumsum([0, *(len(bound) for bound in inputs)])
        self._in_names, self._in_scale = _block([role for bound in inputs for role in bound])
        self._in_values = np.zeros(len(self._in_names))
        self._out_names, self._out_scale = _block([role for plant in plants for role in plant.outputs])
        self._out_values = np.zeros(len(self._out_names))
        self._calls = np.zeros(len(plants), _CALLS)
        for row, plant in enumerate(plants):
            first, width = int(self._start[row]), len(inputs[row])
            self._calls[row] = (
                plant.component,
                _address(plant, "fmi2SetReal"),
                _address(plant, "fmi2DoStep"),
                _address(plant, "fmi2GetReal"),
                self._in_names[first:].ctypes.data,
                self._in_values[first:].ctypes.data,
                width,
                self._out_names[6 * row :].ctypes.data,
                self._out_values[6 * row :].ctypes.data,
            )

    def read(self, time: float, out: NDArray[np.float64]) -> None:
        """Write pose and pseudo-velocities of every plant in its contract's units into `out` (plants, 6).

        Raises
        ------
        SimulationError
            A plant returns no outputs.
        """
        row, status = _read(self._calls, self._out_values, self._out_scale, out)
        self._report(row, _RETURN, status, time)

    def step(self, time: float, step: float, given: NDArray[np.float64]) -> None:
        """Hold the inputs and advance every plant from a communication point by one communication step [s].

        Parameters
        ----------
        time, step
            The communication point and the step [s].
        given
            For one plant after the other its torques [N.m] and other inputs.

        Raises
        ------
        SimulationError
            A plant did not accept its inputs or did not complete the step: its own messages.
        """
        row, what, status = _advance(self._calls, self._start, given, self._in_scale, self._in_values, time, step)
        self._report(row, what, status, time)

    def _report(self, row: int, what: int, status: int, time: float) -> None:
        if status > WARNING:
            self._plants[row].fail(_WHAT[what], status, time)
        if Plant.messages_received():
            for plant in self._plants:
                plant.keep_messages(time)


def _block(roles: Sequence[BoundRole]) -> tuple[NDArray[np.uint32], NDArray[np.float64]]:
    references = np.array([role.variable.valueReference for role in roles], dtype=np.uint32)
    return references, np.array([role.scale for role in roles], dtype=np.float64)


def _address(plant: Plant, function: str) -> int:
    return int(ctypes.cast(plant.library[function], ctypes.c_void_p).value or 0)


@compiled
def _read(
    calls: NDArray[np.void], values: NDArray[np.float64], scale: NDArray[np.float64], out: NDArray[np.float64]
) -> tuple[int, int]:
    for i in range(len(calls)):
        c = calls[i]
        status = _exchange(c["get"], (c["component"], c["out_names"], np.int64(6), c["out_values"]))
        if status > WARNING:
            return i, status
        for j in range(6):
            out[i, j] = values[6 * i + j] * scale[6 * i + j]
    return -1, 0


@compiled
def _advance(
    calls: NDArray[np.void],
    start: NDArray[np.int64],
    given: NDArray[np.float64],
    scale: NDArray[np.float64],
    values: NDArray[np.float64],
    time: float,
    step: float,
) -> tuple[int, int, int]:
    for i in range(len(calls)):
        c = calls[i]
        for j in range(start[i], start[i + 1]):
            values[j] = given[j] / scale[j]
        status = _exchange(c["set"], (c["component"], c["in_names"], c["in_count"], c["in_values"]))
        if status > WARNING:
            return i, _ACCEPT, status
        status = _do_step(c["step"], (c["component"], time, step, np.int32(1)))
        if status > WARNING:
            return i, _COMPLETE, status
    return -1, 0, 0
