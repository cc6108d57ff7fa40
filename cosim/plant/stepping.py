"""Giving inputs to a plant, advancing it by one communication step, and reading its outputs.

The functions that FMPy has loaded are called by address with arguments prepared once: FMI 1.0 for Co-Simulation
(section 3.4), FMI 2.0 (section 4.2) and FMI 3.0 (section 4.2). Those of Model Exchange are in `model_exchange`.
Everything a call needs is in one record of `ROW`; what it writes is in arrays that the records point into.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from cosim.compiled import compiled, part
from cosim.plant.calls import c_function
from cosim.plant.failures import ACCEPT, COMPLETE, EARLY, END, EVENT, FINE, RETURN, WARNING
from cosim.plant.instance import Instance
from cosim.plant.model_exchange import FUNCTIONS, SCRATCH, enter_event_mode, integrate, leave_event_mode, work_size
from cosim.plant.spec import CO_SIMULATION, SOLVERS, Block


class Stepped(IntEnum):
    """How a plant is stepped: elsewhere; as Co-Simulation of FMI 1.0 and 2.0; of FMI 3.0; as Model Exchange."""

    EXTERNAL, SLAVE, SLAVE_3, MODEL = range(4)


EXTERNAL, SLAVE, SLAVE_3, MODEL = map(int, Stepped)
"""The same as plain numbers, for compiled code."""

ROW = np.dtype(
    [("next_event", np.float64)]
    + [
        (name, np.int64)
        for name in (
            *("kind", "version", "component", "set", "get", "step"),
            *("in_names", "in_count", "in_values", "in_size", "in_changed"),
            *("out_names", "out_count", "out_values", "out_size", "late"),
            *("scratch", "method", "steps", "states", "indicators", "work", "first", "completes"),
            *FUNCTIONS,
            *("what", "status"),
        )
    ]
)

_exchange = c_function("pointer", "pointer", "size", "pointer", unsigned=True)
_exchange_3 = c_function("pointer", "pointer", "size", "pointer", "size", unsigned=True)
_do_step = c_function("pointer", "double", "double", "int", unsigned=True)
_do_step_3 = c_function("pointer", "double", "double", "int", "pointer", "pointer", "pointer", "pointer", unsigned=True)

_SMALLEST_PART = 1e-9
"""Part of a communication step; a rest below it after an early return counts as done."""
_MAX_PARTS = 100_000
"""Upper limit for the parts into which early returns cut a communication step."""


class Rows:
    """Arguments and results of the FMI calls of several plants.

    Parameters
    ----------
    instances
        The plants; None for one that is stepped elsewhere, such as in another process.
    sizes
        Number of inputs and of outputs of each plant.
    outputs
        Where numbers are returned; an array of its own if left out.

    Attributes
    ----------
    rows : ndarray of ROW
        A record a plant; ``next_event`` is the time [s] of its next time event, ``in_changed`` whether inputs differ
        from those of the last step, ``what`` and ``status`` the outcome of the last call.
    inputs, outputs : ndarray
        Numbers given and returned, one plant after the other, in the FMUs' own units.
    first_input, first_output : ndarray of int
        Where in these each plant begins; the last entry is the end.
    scratch, work
        Space for values that functions return through pointers, and for solvers.
    """

    def __init__(
        self,
        instances: Sequence[Instance | None],
        sizes: Sequence[tuple[int, int]],
        outputs: NDArray[np.float64] | None = None,
    ) -> None:
        n = len(instances)
        self._made_of = _made_of(instances, sizes, outputs)
        self.first_input, self.first_output = (
            np.cumsum([0, *column], dtype=np.int64) for column in (zip(*sizes, strict=True) if n else ((), ()))
        )
        self.inputs = np.zeros(self.first_input[-1])
        self.outputs = np.zeros(self.first_output[-1]) if outputs is None else outputs
        self.rows = np.zeros(n, ROW)
        self.scratch = np.zeros((n, SCRATCH))
        self.work = np.zeros(sum(work_size(i.states, i.event_indicators) for i in instances if i is not None))
        self._names: list[NDArray[np.uint32]] = []  # keeps the strings alive to which the records point
        first = 0
        for index, instance in enumerate(instances):
            if instance is not None:
                self._fill(index, instance, first)
                first += work_size(instance.states, instance.event_indicators)

    def restart(
        self,
        instances: Sequence[Instance | None],
        sizes: Sequence[tuple[int, int]],
        outputs: NDArray[np.float64] | None = None,
    ) -> bool:
        """Go back to the start for instances that have been restarted; return whether they are the ones of before.

        Those of Model Exchange are not: what they need may have changed.
        """
        if _made_of(instances, sizes, outputs) != self._made_of:
            return False
        if any(one is not None and one.spec.interface != CO_SIMULATION for one in instances):
            return False
        for numbers in (self.inputs, self.scratch, *((self.outputs,) if outputs is None else ())):
            numbers[:] = 0.0
        for index, instance in enumerate(instances):
            if instance is not None:
                self.inputs_of(index)[:] = instance.spec.inputs.start
                self.outputs_of(index)[:] = instance.spec.outputs.start
        self.rows["in_changed"], self.rows["what"], self.rows["status"] = True, FINE, 0
        return True

    def inputs_of(self, index: int) -> NDArray[np.float64]:
        """Return the inputs of a plant."""
        return self.inputs[self.first_input[index] : self.first_input[index + 1]]

    def outputs_of(self, index: int) -> NDArray[np.float64]:
        """Return the outputs of a plant."""
        return self.outputs[self.first_output[index] : self.first_output[index + 1]]

    def _fill(self, index: int, instance: Instance, first: int) -> None:
        spec, row = instance.spec, self.rows[index]
        slave = spec.interface == CO_SIMULATION
        row["version"] = int(spec.fmi[0])
        row["kind"] = MODEL if not slave else (SLAVE_3 if row["version"] == 3 else SLAVE)
        row["component"] = instance.component
        real = "Float64" if row["version"] == 3 else "Real"
        row["set"], row["get"] = instance.address(f"Set{real}"), instance.address(f"Get{real}")
        for which, block, values, starts in (
            ("in", spec.inputs, self.inputs, self.first_input),
            ("out", spec.outputs, self.outputs, self.first_output),
        ):
            block = Block((), (), ()) if spec.is_typed else block  # that is exchanged elsewhere
            names = np.array(block.references, dtype=np.uint32)
            self._names.append(names)
            row[f"{which}_names"], row[f"{which}_count"] = names.ctypes.data, len(names)
            row[f"{which}_values"] = values.ctypes.data + 8 * starts[index]
            row[f"{which}_size"] = len(block.start)
            values[starts[index] : starts[index + 1]] = block.start
        row["scratch"], row["in_changed"] = self.scratch[index].ctypes.data, True
        row["late"] = spec.late_outputs
        if slave:
            row["step"] = instance.address("DoStep")
            return
        row["method"], row["steps"] = SOLVERS.index(spec.solver), spec.solver_steps
        row["states"], row["indicators"] = instance.states, instance.event_indicators
        row["first"], row["work"] = first, self.work.ctypes.data + 8 * first
        for field, functions in FUNCTIONS.items():
            name = functions[row["version"] - 1]
            row[field] = instance.address(name) if name else 0
        row["next_event"], row["completes"] = instance.next_event, spec.completed_steps


def _made_of(
    instances: Sequence[Instance | None], sizes: Sequence[tuple[int, int]], outputs: NDArray[np.float64] | None
) -> tuple[object, ...]:
    """Return everything from which the records of instances follow, apart from numbers; to be compared."""
    specs = [
        one and (one, one.spec.inputs.references, one.spec.outputs.references, one.spec.late_outputs)
        for one in instances
    ]
    return specs, list(sizes), id(outputs)


@part
def _give_2(row: np.void) -> int:
    """Give the inputs of FMI 1.0 or 2.0; return the status."""
    return _exchange(row["set"], (row["component"], row["in_names"], row["in_count"], row["in_values"]))


@part
def _read_2(row: np.void) -> tuple[int, int]:
    """Do what `read_outputs` does, for FMI 1.0 and 2.0."""
    if row["out_count"] == 0:
        return FINE, 0
    status = _exchange(row["get"], (row["component"], row["out_names"], row["out_count"], row["out_values"]))
    return (RETURN if status > WARNING else FINE), status


@part
def read_outputs(row: np.void) -> tuple[int, int]:
    """Read the outputs of one plant, if they are read here; return the failure and the status."""
    if row["version"] != 3:
        return _read_2(row)
    if row["out_count"] == 0:
        return FINE, 0
    arguments = (row["component"], row["out_names"], row["out_count"], row["out_values"], row["out_size"])
    status = _exchange_3(row["get"], arguments)
    return (RETURN if status > WARNING else FINE), status


@part
def read_at_start(row: np.void) -> tuple[int, int]:
    """Read the outputs of one plant as `read_outputs` does, unless they show its state only after a step."""
    if row["late"] != 0:
        return FINE, 0
    return read_outputs(row)


@part
def advance_slave(row: np.void, time: float, step: float) -> tuple[int, int]:
    """Advance a Co-Simulation FMU of FMI 1.0 or 2.0: a function of its own takes half the time."""
    if row["in_count"] > 0:
        status = _give_2(row)
        if status > WARNING:
            return ACCEPT, status
    status = _do_step(row["step"], (row["component"], time, step, np.int32(1)))
    if status > WARNING:
        return COMPLETE, status
    return _read_2(row)


@compiled
def advance(
    row: np.void,
    scratch: NDArray[np.float64],
    work: NDArray[np.float64],
    time: float,
    step: float,
) -> tuple[int, int]:
    """Give one plant its inputs, advance it by a communication step and read its outputs.

    Parameters
    ----------
    row
        The plant's record.
    scratch, work
        Those of `Rows`, of the former the plant's own.
    time, step
        The communication point and the step [s].

    Returns
    -------
    tuple of int
        The failure, of `cosim.plant.failures`, and the status of the FMI call.
    """
    if row["kind"] == SLAVE:
        return advance_slave(row, time, step)
    return _advance_other(row, scratch, work, time, step)


@compiled
def advance_at(
    rows: NDArray[np.void],
    index: int,
    scratch: NDArray[np.float64],
    work: NDArray[np.float64],
    time: float,
    step: float,
) -> None:
    """Do what `advance` does for one of many plants, its outcome in its record; without a step, read its outputs."""
    row = rows[index]
    if step > 0.0:
        row["what"], row["status"] = _advance_other(row, scratch[index], work, time, step)
    else:
        row["what"], row["status"] = read_at_start(row)


@part
def _advance_other(
    row: np.void,
    scratch: NDArray[np.float64],
    work: NDArray[np.float64],
    time: float,
    step: float,
) -> tuple[int, int]:
    what, status = FINE, 0
    jump = row["kind"] == MODEL and row["in_count"] > 0 and row["in_changed"] != 0
    if jump:
        status = enter_event_mode(row)
        if status > WARNING:
            return EVENT, status
    if jump or (row["in_count"] > 0 and row["kind"] != MODEL):  # discrete inputs are set in Event Mode alone
        if row["version"] == 3:
            arguments = (row["component"], row["in_names"], row["in_count"], row["in_values"], row["in_size"])
            status = _exchange_3(row["set"], arguments)
        else:
            status = _give_2(row)
        if status > WARNING:
            return ACCEPT, status
    if jump:
        row["in_changed"] = 0
        what, status = leave_event_mode(row, scratch)
        if what != FINE:
            return what, status
    if row["kind"] == SLAVE_3:
        what, status = _step_3(row, scratch, time, step)
    else:
        what, status = integrate(row, scratch, work, time, step)
    if what != FINE:
        return what, status
    return read_outputs(row)


@part
def _step_3(row: np.void, scratch: NDArray[np.float64], time: float, step: float) -> tuple[int, int]:
    """Take a step of FMI 3.0; where the FMU returns early though nobody allowed it, take the rest as well."""
    flags = scratch.view(np.int32)
    start, end, status = time, time + step, 0
    for _ in range(_MAX_PARTS):
        scratch[:] = 0.0
        place = row["scratch"]
        rest = step if start == time else end - start
        arguments = (row["component"], start, rest, np.int32(1), place, place + 8, place + 16, place + 24)
        status = _do_step_3(row["step"], arguments)
        if status > WARNING:
            return COMPLETE, status
        if flags[2] != 0:  # terminateSimulation
            return END, status
        if flags[4] == 0 or end - scratch[3] <= _SMALLEST_PART * step:  # earlyReturn
            return FINE, status
        if not scratch[3] > start:
            break
        start = scratch[3]
    return EARLY, status
