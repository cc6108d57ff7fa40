"""A step of all plants in compiled code: inputs given, each plant advanced, outputs read and checked."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.compiled import address_of, borrowing, call, compiled, part
from cosim.frames import Bound
from cosim.plant.bells import HEARD_DONE, Bells, no_bells
from cosim.plant.failures import FINE
from cosim.plant.stepping import EXTERNAL, SLAVE, Rows, advance_at, advance_slave, read_at_start

LINK = np.dtype(
    [
        ("row", np.int64),
        ("column", np.int64),
        ("place", np.int64),
        ("scale", np.float64),
        ("offset", np.float64),
        ("bound", np.float64),
    ]
)


class Found(IntEnum):
    """What a tick of a fleet has come to: all is well, a call has failed, a state is not within its bounds."""

    FINE, FAILED, DIVERGED = range(3)


_FINE, _FAILED, _DIVERGED = map(int, Found)
"""The same as plain numbers, for compiled code."""


class FleetArrays(NamedTuple):
    """A fleet for compiled code: the arrays of `Rows`, the links of inputs and outputs, and the state.

    ``current`` gets the number of the plant that is called, -1 in between. ``pending`` is how many messages of FMUs
    here wait to be taken. ``other`` is the address of the function for plants that are not Co-Simulation of FMI 1.0 or
    2.0, zero without any: it is a large function, which most runs need not compile. ``elsewhere`` are plants in other
    processes.
    """

    rows: NDArray[np.void]
    inputs: NDArray[np.float64]
    outputs: NDArray[np.float64]
    scratch: NDArray[np.float64]
    work: NDArray[np.float64]
    in_links: NDArray[np.void]
    out_links: NDArray[np.void]
    state: NDArray[np.float64]
    current: NDArray[np.int64]
    pending: NDArray[np.int64]
    other: int
    elsewhere: Bells


class CompiledFleet(NamedTuple):
    """A step of a fleet for compiled code.

    Attributes
    ----------
    call : ndarray of int
        The numbers of `step_fleet` with its arguments, see `cosim.frames.Bound`.
    clock : ndarray
        Takes the communication point and the step [s].
    found : ndarray
        Gets the finding, of `Found`.
    said : ndarray
        How many messages of FMUs wait for `Fleet.settle`.
    """

    call: NDArray[np.int64]
    clock: NDArray[np.float64]
    found: NDArray[np.int64]
    said: NDArray[np.int64]


NO_FLEET = CompiledFleet(
    np.zeros(3, dtype=np.int64), np.zeros(2), np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64)
)
"""For plants that are stepped from Python."""


def fleet_arrays(
    rows: Rows,
    in_links: NDArray[np.void],
    out_links: NDArray[np.void],
    state: NDArray[np.float64],
    current: NDArray[np.int64],
    pending: NDArray[np.int64],
    elsewhere: Bells,
) -> FleetArrays:
    """Return a fleet for compiled code; see `FleetArrays`."""
    other = 0
    if not {EXTERNAL, SLAVE}.issuperset(rows.rows["kind"].tolist()):
        other = address_of(advance_at, rows.rows, 0, rows.scratch, rows.work, 0.0, 0.0)
    own = rows.rows, rows.inputs, rows.outputs, rows.scratch, rows.work
    return FleetArrays(*own, in_links, out_links, state, current, pending, other, elsewhere)


@compiled
def load_libraries() -> None:
    """Do nothing: the first call lets Numba load libraries, whose threads are then not taken for a plant's."""


def load_step(others: bool = False) -> None:
    """Load the compiled step of a fleet, or compile it, before anything is timed.

    Parameters
    ----------
    others
        Whether there are plants that are not Co-Simulation of FMI 1.0 or 2.0.
    """
    load_libraries()
    rows, links, numbers = Rows([], []), np.zeros(0, LINK), np.zeros(2, dtype=np.int64)
    arrays = fleet_arrays(rows, links, links, np.zeros((0, 0)), numbers, numbers, no_bells())
    Bound(step_fleet, arrays, np.zeros(0), np.zeros(2), numbers)
    if others:
        address_of(advance_at, rows.rows, 0, rows.scratch, rows.work, 0.0, 0.0)


@part
def give_inputs(plants: FleetArrays, given: NDArray[np.float64]) -> None:
    """Convert inputs from the roles' units to those of the FMUs."""
    for j in range(len(plants.in_links)):
        link = plants.in_links[j]
        value = (given[j] - link["offset"]) / link["scale"]
        if plants.inputs[link["place"]] != value:
            plants.rows[link["row"]]["in_changed"] = 1
        plants.inputs[link["place"]] = value


@part
def take_outputs(plants: FleetArrays) -> int:
    """Write the state; return whether all of it is finite and within its bounds."""
    found = _FINE
    for j in range(len(plants.out_links)):
        link = plants.out_links[j]
        if link["place"] < 0:
            continue
        value = link["scale"] * plants.outputs[link["place"]] + link["offset"]
        plants.state[link["row"], link["column"]] = value
        if not abs(value) < link["bound"]:  # not finite is not smaller
            found = _DIVERGED
    return found


@part
def advance_all(plants: FleetArrays, time: float, step: float) -> bool:
    """Advance the plants that are called here, with their inputs given; return whether a call has failed.

    A step of no length only reads the outputs.
    """
    failed = False
    for i in range(len(plants.rows)):
        row = plants.rows[i]
        plants.current[0] = i
        if row["kind"] == SLAVE:
            row["what"], row["status"] = advance_slave(row, time, step) if step > 0.0 else read_at_start(row)
        elif row["kind"] != EXTERNAL:
            call(plants.other, (plants.rows, i, plants.scratch, plants.work, time, step))
        else:
            continue
        failed = failed or row["what"] != FINE
    plants.current[0] = -1
    return failed


@part
def _tick(plants: FleetArrays, given: NDArray[np.float64], time: float, step: float) -> tuple[int, int]:
    """Return the finding, and how many messages of FMUs wait to be taken."""
    bells = plants.elsewhere.bells
    rings = step > 0.0 and len(bells) > 0
    if step > 0.0:
        give_inputs(plants, given)
    if rings:
        call(plants.elsewhere.ring, (bells, plants.elsewhere.gives, time, step))
    failed = advance_all(plants, time, step)
    said = plants.pending[0]
    if rings:
        call(plants.elsewhere.listen, (bells, plants.elsewhere.takes))
        for i in range(len(bells)):
            failed = failed or bells[i]["heard"] != HEARD_DONE
            said += bells[i]["pending"]
    return (_FAILED if failed else take_outputs(plants)), said


@borrowing
def step_fleet(
    plants: FleetArrays, given: NDArray[np.float64], clock: NDArray[np.float64], found: NDArray[np.int64]
) -> None:
    """Give all plants their inputs, advance them and take their outputs.

    Parameters
    ----------
    plants, given, clock
        The plants, their inputs, and communication point and step [s]. A step of no length only reads the outputs.
    found
        Gets the finding, of `Found`, and how many messages of FMUs wait to be taken.
    """
    found[0], found[1] = _tick(plants, given, clock[0], clock[1])


@borrowing
def run_fleet(
    plants: FleetArrays, given: NDArray[np.float64], first: int, step: float, out: NDArray[np.float64]
) -> tuple[int, int]:
    """Take steps, with inputs (ticks, ...) for each, until one fails or an FMU says something.

    Returns
    -------
    tuple of int
        The last tick, whose state is not written yet, and the finding there.
    """
    for k in range(len(given)):
        found, said = _tick(plants, given[k], (first + k) * step, step)
        if found != _FINE or said != 0 or k + 1 == len(given):
            return first + k, found
        for i in range(out.shape[1]):  # an assignment of arrays would take longer than the master's own step
            for j in range(out.shape[2]):
                out[k, i, j] = plants.state[i, j]
    return first, _FINE
