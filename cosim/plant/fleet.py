"""All plants of a run, exchanged and stepped together: one kind of plant, whatever their FMUs are."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError, Location, SimulationError
from cosim.plant.calls import compiled
from cosim.plant.cvode import CvodePlant, uses_cvode
from cosim.plant.instance import Instance
from cosim.plant.log import Log
from cosim.plant.outcome import FINE, PlantError, failure
from cosim.plant.process import ProcessPlant
from cosim.plant.spec import PlantSpec, Value
from cosim.plant.stepping import EXTERNAL, Rows, advance, read_outputs

STATE = 6
"""Pose entries and pseudo-velocities of a plant."""

KEPT_MESSAGES = 20
"""How many of a plant's messages are kept, the first ones."""

_LINK = np.dtype([("place", np.int64), ("scale", np.float64), ("offset", np.float64), ("bound", np.float64)])


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
    """A plant of a fleet: what to start, its roles, whether in a process of its own, and who asks for it."""

    spec: PlantSpec
    inputs: tuple[Link, ...]
    outputs: tuple[Link, ...]
    isolated: bool
    where: Location | None = None


class Fleet:
    """Plants that are stepped together.

    Legal call order: `step` and `change` in any number, or `run` once; `close` at the end. After a SimulationError only
    `close`.

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
        A plant cannot be started: its own messages.
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
            self._external = self._start_processes(cleanup)
            self._instances = self._start_instances(cleanup)
            try:
                self._rows = Rows([self._instances.get(index) for index in range(len(members))], sizes)
            except PlantError as error:
                raise InputError(str(error)) from None
            rows = self._rows
            self._inputs = _links([member.inputs for member in members], rows.first_input)
            self._outputs = _links([member.outputs for member in members], rows.first_output)
            for index, plant in self._external.items():
                self._slice(rows.outputs, rows.first_output, index)[:] = plant.first_outputs
            self._check(0.0, _read(rows.rows, rows.outputs, self._outputs, self._state), 0.0)
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
        _give(given, self._inputs, rows.inputs)
        for index, plant in self._external.items():
            plant.begin(time, step, self._slice(rows.inputs, rows.first_input, index))
        _advance_all(rows.rows, rows.scratch, rows.work, time, step)
        failures = {}
        for index, plant in self._external.items():
            try:
                plant.finish(self._slice(rows.outputs, rows.first_output, index))
            except PlantError as error:
                failures[index] = str(error)
        self._check(time, _take(rows.outputs, self._outputs, self._state), (tick + 1) * step, failures)

    def run(self, step: float, given: NDArray[np.float64], out: NDArray[np.float64]) -> None:
        """Run from the start with all inputs given.

        Parameters
        ----------
        step
            Communication step [s].
        given
            Inputs (ticks, ...) of every communication step, as for `step`.
        out
            Gets the state (ticks + 1, plants, 6) at every communication point.

        Raises
        ------
        SimulationError
            See `step`; what was reached is in `out`.
        """
        rows = self._rows
        if self._external:
            out[0] = self._state
            for tick, now in enumerate(given):
                self.step(tick, step, now)
                out[tick + 1] = self._state
            return
        links = (self._inputs, self._outputs)
        tick, diverged = _run(
            rows.rows, rows.inputs, rows.outputs, rows.scratch, rows.work, *links, given, self._state, step, out
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
        for index, member in enumerate(self.members):
            if member.isolated:
                processes[index] = ProcessPlant(member.spec)
                cleanup.callback(processes[index].close)
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
                if uses_cvode(member.spec):
                    self._external[index] = CvodePlant(member.spec)
                    cleanup.callback(self._external[index].close)
                else:
                    instances[index] = Instance(member.spec)
                    cleanup.callback(instances[index].close)
            except PlantError as error:
                raise self._not_started(index, error) from None
        return instances

    def _not_started(self, index: int, error: PlantError) -> InputError:
        spec = self.members[index].spec
        return InputError(f"the FMU {spec.file} cannot be started as {spec.robot}: {error}", self.members[index].where)

    # What has become of a step ----------------------------------------------------------------------------------

    def _check(self, time: float, diverged: int, after: float, failures: dict[int, str] | None = None) -> None:
        """Raise what has failed at a communication point, or after the step from there; keep what was logged."""
        failures = dict(failures or {})
        if diverged != _FINE or failures:
            for index in np.flatnonzero(self._rows.rows["what"] != FINE).tolist():
                row, instance = self._rows.rows[index], self._instances[index]
                instance.status = int(row["status"])
                failures[index] = failure(int(row["what"]), instance.status, instance.log.take())
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


def _links(links: Sequence[Sequence[Link]], first: NDArray[np.int64]) -> NDArray[np.void]:
    return np.array(
        [
            (int(start) + link.place if link.place >= 0 else -1, link.scale, link.offset, link.bound)
            for start, own in zip(first, links, strict=False)
            for link in own
        ],
        dtype=_LINK,
    )


# Compiled ---------------------------------------------------------------------------------------------------------

_FINE, _FAILED = -1, -2
"""What `_tick` and the like return, if it is not the number of a state that is out of bounds."""


@compiled
def _give(given: NDArray[np.float64], links: NDArray[np.void], inputs: NDArray[np.float64]) -> None:
    for j in range(len(links)):
        inputs[links[j]["place"]] = (given[j] - links[j]["offset"]) / links[j]["scale"]


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
    _give(given, in_links, inputs)
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
    step: float,
    out: NDArray[np.float64],
) -> tuple[int, int]:
    """Return the last tick and what `_tick` returned there."""
    out[0] = state
    for tick in range(len(given)):
        found = _tick(rows, inputs, outputs, scratch, work, in_links, out_links, given[tick], state, tick * step, step)
        if found != _FINE:
            return tick, found
        out[tick + 1] = state
    return len(given), _FINE
