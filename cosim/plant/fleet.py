"""All plants of a run, exchanged and stepped together: one kind of plant, whatever their FMUs are."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError, Location, SimulationError
from cosim.plant.calls import compiled
from cosim.plant.instance import Instance
from cosim.plant.log import Log
from cosim.plant.outcome import FINE, PlantError
from cosim.plant.process import ProcessPlant, end
from cosim.plant.spec import PlantSpec, Value
from cosim.plant.stepping import EXTERNAL, Rows, advance, read_outputs

if TYPE_CHECKING:
    from cosim.plant.cvode import CvodePlant

STATE = 6
"""Pose entries and pseudo-velocities of a plant."""

KEPT_MESSAGES = 20
"""How many of a plant's messages are kept, the first ones."""

START_TOLERANCE = 1e-6
"""How far [m, rad], and relative to what was asked for, a plant may be from its initial pose at the start."""

_LINK = np.dtype(
    [("row", np.int64), ("place", np.int64), ("scale", np.float64), ("offset", np.float64), ("bound", np.float64)]
)


@dataclass(frozen=True)
class Link:
    """A role that a number of an FMU plays.

    Attributes
    ----------
    name, unit : str
        The role and its unit.
    place : int
        Which number of the block of inputs or outputs it is; -1 if nothing plays the role, which is then not a number.
    scale, offset : float
        ``value in the role's unit = scale * number + offset``.
    bound : float
        Magnitude in the role's unit beyond which the motion has diverged.
    """

    name: str
    unit: str
    place: int
    scale: float
    offset: float
    bound: float = np.inf


@dataclass(frozen=True)
class Member:
    """A plant of a fleet.

    Attributes
    ----------
    spec : PlantSpec
        What to start.
    inputs, outputs : tuple of Link
        Its roles.
    pose : tuple of float
        The initial pose, as the first of the outputs must be at the start; empty if it does not matter.
    isolated : bool
        Whether it runs in a process of its own.
    needs_tool : bool
        Whether it says that it needs another program.
    where : Location or None
        Who asks for it.
    """

    spec: PlantSpec
    inputs: tuple[Link, ...]
    outputs: tuple[Link, ...]
    pose: tuple[float, ...] = ()
    isolated: bool = False
    needs_tool: bool = False
    where: Location | None = None


class Fleet:
    """Plants that are stepped together.

    Legal call order: `step`, `run` and `change` in any number, at successive ticks; `close` at the end. After a
    SimulationError only `close`.

    Parameters
    ----------
    members
        The plants; they are started here, those in processes of their own side by side.
    state
        Gets pose and pseudo-velocities (plants, 6) of every plant in its roles' units at the last communication point,
        from the start on. Its rows are contiguous.

    Attributes
    ----------
    messages : list of str
        What the FMUs have logged, each with robot and time; the first ones of each plant.

    Raises
    ------
    InputError
        A plant cannot be started, with its own messages, or starts elsewhere than at its initial pose.
    SimulationError
        A plant returns no outputs at the start, or outputs that are not finite.
    """

    def __init__(self, members: Sequence[Member], state: NDArray[np.float64]) -> None:
        self.members = tuple(members)
        self.messages: list[str] = []
        self._state = state
        self._state[:] = np.nan
        self._kept = [0] * len(members)
        sizes = [(len(member.spec.inputs.start), len(member.spec.outputs.start)) for member in members]
        with ExitStack() as cleanup:
            cleanup.callback(_go_back, os.getcwd())  # from where an FMU may have gone
            self._external = self._start_processes(cleanup)
            self._instances = self._start_instances(cleanup)
            self._rows = Rows([self._instances.get(index) for index in range(len(members))], sizes)
            rows = self._rows
            self._inputs = _links([member.inputs for member in members], rows.first_input)
            self._outputs = _links([member.outputs for member in members], rows.first_output)
            for index, plant in self._external.items():
                self._slice(rows.outputs, rows.first_output, index)[:] = plant.first_outputs
            self._check(0.0, _read(rows.rows, rows.outputs, self._outputs, self._state), 0.0)
            self._check_start()
            self._cleanup = cleanup.pop_all()

    def step(self, tick: int, step: float, given: NDArray[np.float64]) -> None:
        """Hold the inputs and advance every plant from a communication point by one communication step [s].

        Parameters
        ----------
        tick, step
            The communication point is ``tick * step`` [s].
        given
            For one plant after the other what its inputs are given, in the roles' units.

        Raises
        ------
        SimulationError
            Plants did not accept their inputs, complete the step or return finite outputs: each of them, with its own
            messages.
        """
        rows, time = self._rows, tick * step
        links = (self._inputs, self._outputs)
        if not self._external:
            diverged = _tick(
                rows.rows, rows.inputs, rows.outputs, rows.scratch, rows.work, *links, given, self._state, time, step
            )
            self._check(time, diverged, (tick + 1) * step)
            return
        _give(given, self._inputs, rows.rows, rows.inputs)
        for index, plant in self._external.items():
            plant.begin(time, step, self._slice(rows.inputs, rows.first_input, index))
        failed = _advance_all(rows.rows, rows.scratch, rows.work, time, step)
        failures = {}
        for index, plant in self._external.items():
            try:
                plant.finish(self._slice(rows.outputs, rows.first_output, index))
            except PlantError as error:
                failures[index] = str(error)
        found = _FAILED if failed or failures else _take(rows.outputs, self._outputs, self._state)
        self._check(time, found, (tick + 1) * step, failures)

    def run(self, first: int, step: float, given: NDArray[np.float64], out: NDArray[np.float64]) -> None:
        """Take many steps in one call, with all inputs given.

        Parameters
        ----------
        first, step
            The steps begin at the communication point ``first * step`` [s].
        given
            Inputs (ticks, ...) of every step, as for `step`.
        out
            Gets the state (ticks, plants, 6) after every step.

        Raises
        ------
        SimulationError
            See `step`; what was reached is in `out`.
        """
        rows = self._rows
        if self._external:
            for k, now in enumerate(given):
                self.step(first + k, step, now)
                out[k] = self._state
            return
        links = (self._inputs, self._outputs)
        tick, diverged = _run(
            rows.rows, rows.inputs, rows.outputs, rows.scratch, rows.work, *links, given, self._state, first, step, out
        )
        self._check(tick * step, diverged, (tick + 1) * step)

    def change(self, index: int, values: Sequence[Value], time: float) -> None:
        """Give parameters of a plant other values at a communication point [s].

        Raises
        ------
        SimulationError
            The FMU refuses a value: its own messages.
        """
        plant = self._external.get(index) or self._instances[index]
        try:
            plant.change(values)
        except PlantError as error:
            raise SimulationError(*self._failures({index: str(error)}, time)) from None
        if isinstance(plant, Instance):
            self._rows.rows["next_event"][index] = plant.next_event

    def close(self) -> None:
        """End all plants."""
        self._cleanup.close()

    # Starting ----------------------------------------------------------------------------------------------------

    def _start_processes(self, cleanup: ExitStack) -> dict[int, ProcessPlant | CvodePlant]:
        processes: dict[int, ProcessPlant] = {}
        cleanup.callback(end, processes.values())
        for index, member in enumerate(self.members):
            if member.isolated:
                try:
                    processes[index] = ProcessPlant(member.spec)
                except PlantError as error:
                    raise self._not_started(index, error) from None
        for index, process in processes.items():
            try:
                process.wait_until_started()
            except PlantError as error:
                raise self._not_started(index, error) from None
        return dict(processes)

    def _start_instances(self, cleanup: ExitStack) -> dict[int, Instance]:
        instances: dict[int, Instance] = {}
        for index, member in enumerate(self.members):
            if member.isolated:
                continue
            try:
                if member.spec.uses_cvode:
                    from cosim.plant.cvode import CvodePlant  # loads SUNDIALS

                    self._external[index] = CvodePlant(member.spec)
                    cleanup.callback(self._external[index].close)
                else:
                    instances[index] = Instance(member.spec)
                    cleanup.callback(instances[index].close)
            except PlantError as error:
                raise self._not_started(index, error) from None
        return instances

    def _not_started(self, index: int, error: PlantError) -> InputError:
        member = self.members[index]
        tool = "; it says that it needs an execution tool, which must be there" if member.needs_tool else ""
        message = f"the FMU {member.spec.file} cannot be started as {member.spec.robot}: {error}{tool}"
        return InputError(message, member.where)

    def _check_start(self) -> None:
        """Refuse a plant that does not start at its initial pose."""
        for index, member in enumerate(self.members):
            for link, wanted, found in zip(member.outputs, member.pose, self._state[index].tolist(), strict=False):
                apart = math.remainder(found - wanted, math.tau) if link.unit == "rad" else found - wanted
                if abs(apart) > START_TOLERANCE * max(1.0, abs(wanted)):
                    raise InputError(
                        f"the FMU {member.spec.file} does not take the initial pose of {member.spec.robot}: "
                        f"{link.name} is {found:g} {link.unit} at the start, not {wanted:g} {link.unit}",
                        member.where,
                    )

    # What has become of a step ----------------------------------------------------------------------------------

    def _check(self, time: float, diverged: int, after: float, failures: dict[int, str] | None = None) -> None:
        """Raise what has failed at a communication point, or after the step from there; keep what was logged."""
        failures = dict(failures or {})
        if diverged != _FINE or failures:
            for index in np.flatnonzero(self._rows.rows["what"] != FINE).tolist():
                row = self._rows.rows[index]
                failures[index] = self._instances[index].failure(int(row["what"]), int(row["status"]))
            if failures:
                raise SimulationError(*self._failures(failures, time))
            index, column = divmod(diverged, STATE)
            link = self.members[index].outputs[column]
            value = self._state[index, column]
            raise SimulationError(
                self.members[index].spec.robot,
                after,
                f"the motion has diverged: {link.name} = {value:.4g} {link.unit}",
            )
        if Log.pending:
            for index, instance in self._instances.items():
                self._keep(index, instance.log.take(), time)
        for index, plant in self._external.items():
            self._keep(index, plant.take_messages(), time)

    def _failures(self, failures: dict[int, str], time: float) -> tuple[str, float, str]:
        """Return the arguments of an error that reports all of them."""
        (first, *rest) = sorted(failures)
        specs = [member.spec for member in self.members]
        text = f"the plant {specs[first].file} {failures[first]}"
        text += "".join(f"; {specs[index].robot}: the plant {specs[index].file} {failures[index]}" for index in rest)
        return specs[first].robot, time, text

    def _keep(self, index: int, said: str, time: float) -> None:
        if said and self._kept[index] < KEPT_MESSAGES:
            self._kept[index] += 1
            self.messages.append(f"{self.members[index].spec.robot}, t = {time:.6g} s: {said}")

    @staticmethod
    def _slice(values: NDArray[np.float64], first: NDArray[np.int64], index: int) -> NDArray[np.float64]:
        return values[first[index] : first[index + 1]]


def _go_back(folder: str) -> None:
    with suppress(OSError):  # it is gone
        os.chdir(folder)


def _links(links: Sequence[Sequence[Link]], first: NDArray[np.int64]) -> NDArray[np.void]:
    return np.array(
        [
            (row, int(first[row]) + link.place if link.place >= 0 else -1, link.scale, link.offset, link.bound)
            for row, own in enumerate(links)
            for link in own
        ],
        dtype=_LINK,
    )


# Compiled ---------------------------------------------------------------------------------------------------------

_FINE, _FAILED = -1, -2
"""What `_tick` and the like return, if it is not the number of a state that is out of bounds."""


@compiled
def _give(
    given: NDArray[np.float64], links: NDArray[np.void], rows: NDArray[np.void], inputs: NDArray[np.float64]
) -> None:
    for j in range(len(links)):
        link = links[j]
        value = (given[j] - link["offset"]) / link["scale"]
        if inputs[link["place"]] != value:
            rows[link["row"]]["in_changed"] = 1
        inputs[link["place"]] = value


@compiled
def _take(outputs: NDArray[np.float64], links: NDArray[np.void], state: NDArray[np.float64]) -> int:
    """Write the state; return the number of the first entry that is not finite or out of bounds."""
    diverged = _FINE
    for j in range(len(links)):
        link = links[j]
        if link["place"] < 0:
            continue
        value = link["scale"] * outputs[link["place"]] + link["offset"]
        state[j // STATE, j % STATE] = value
        if not abs(value) < link["bound"] and diverged == _FINE:  # not finite is not smaller
            diverged = j
    return diverged


@compiled
def _read(
    rows: NDArray[np.void], outputs: NDArray[np.float64], links: NDArray[np.void], state: NDArray[np.float64]
) -> int:
    failed = False
    for i in range(len(rows)):
        row = rows[i]
        if row["kind"] != EXTERNAL:
            row["what"], row["status"] = read_outputs(row)
            failed = failed or row["what"] != FINE
    return _FAILED if failed else _take(outputs, links, state)


@compiled
def _advance_all(
    rows: NDArray[np.void], scratch: NDArray[np.float64], work: NDArray[np.float64], time: float, step: float
) -> bool:
    failed = False
    for i in range(len(rows)):
        row = rows[i]
        if row["kind"] != EXTERNAL:
            row["what"], row["status"] = advance(row, scratch[i], work, time, step)
            failed = failed or row["what"] != FINE
    return failed


@compiled
def _tick(
    rows: NDArray[np.void],
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
    scratch: NDArray[np.float64],
    work: NDArray[np.float64],
    in_links: NDArray[np.void],
    out_links: NDArray[np.void],
    given: NDArray[np.float64],
    state: NDArray[np.float64],
    time: float,
    step: float,
) -> int:
    _give(given, in_links, rows, inputs)
    if _advance_all(rows, scratch, work, time, step):
        return _FAILED
    return _take(outputs, out_links, state)


@compiled
def _run(
    rows: NDArray[np.void],
    inputs: NDArray[np.float64],
    outputs: NDArray[np.float64],
    scratch: NDArray[np.float64],
    work: NDArray[np.float64],
    in_links: NDArray[np.void],
    out_links: NDArray[np.void],
    given: NDArray[np.float64],
    state: NDArray[np.float64],
    first: int,
    step: float,
    out: NDArray[np.float64],
) -> tuple[int, int]:
    """Return the last tick and what `_tick` returned there."""
    for k in range(len(given)):
        time = (first + k) * step
        found = _tick(rows, inputs, outputs, scratch, work, in_links, out_links, given[k], state, time, step)
        if found != _FINE:
            return first + k, found
        out[k] = state
    return first + len(given) - 1, _FINE
