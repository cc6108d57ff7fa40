"""All plants of a run, exchanged and stepped together: one kind of plant, whatever their FMUs are."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress

import numpy as np
from numpy.typing import NDArray

from cosim.compiled import entry_of
from cosim.errors import InputError, SimulationError
from cosim.frames import Bound
from cosim.plant.activity import Activity
from cosim.plant.activity import activity as new_activity
from cosim.plant.constant_step import misfit
from cosim.plant.failures import COMPLETE, FAILURES, FINE, PlantError
from cosim.plant.fleet_step import (
    LINK,
    CompiledFleet,
    FleetArrays,
    Found,
    advance_all,
    give_inputs,
    load_libraries,
    other_address,
    run_fleet,
    step_fleet,
    take_outputs,
)
from cosim.plant.instance import Instance
from cosim.plant.log import Log
from cosim.plant.member import Link, Member
from cosim.plant.message import Message, RobotMessage
from cosim.plant.process import ProcessPlant, end
from cosim.plant.spec import Value
from cosim.plant.start_check import SHOWN_LATE, check_pose, moved_too_far, not_started
from cosim.plant.stepping import Rows
from cosim.plant.stepwise import StepwisePlant, stepper

HARNESS = "the harness"
"""The process of plants that run where the harness does."""

KEPT_MESSAGES = 20
"""Number of messages of a plant that are kept, the first ones."""


class Fleet:
    """Plants that are stepped together.

    Legal call order: `step`, `run` and `change` in any number, at successive ticks; `restart` for another run, also
    after a failure; `close` at the end. After a SimulationError only these two.

    Parameters
    ----------
    members
        The plants; they are started here, those in processes of their own side by side.
    state
        Gets pose and pseudo-velocities (plants, entries) of every plant in its roles' units at the last communication
        point, from the start on. Its rows are contiguous.
    activity
        Shows what the fleet is about.

    Attributes
    ----------
    messages : list of str
        The FMUs' messages, each with robot and time; the first ones of each plant.
    logged : list of RobotMessage
        The same as data, one by one, with those that tell why a plant failed.

    Raises
    ------
    InputError
        A plant cannot be started, or returns no outputs at the start, with its own messages; or it starts elsewhere
        than at its initial pose.
    SimulationError
        A plant returns outputs at the start that are not finite.
    """

    def __init__(self, members: Sequence[Member], state: NDArray[np.float64], activity: Activity | None = None) -> None:
        load_libraries()
        self.process = HARNESS
        self._activity = activity or new_activity()
        self._clock, self._found = self._activity.clock, np.zeros(1, dtype=np.int64)
        with ExitStack() as cleanup:
            self._external: dict[int, StepwisePlant] = {}
            self._instances: dict[int, Instance] = {}
            cleanup.callback(self._end)
            self._start(members, state)
            self._cleanup = cleanup.pop_all()

    def restart(self, members: Sequence[Member], state: NDArray[np.float64]) -> None:
        """Put all plants at the start of another run, with other values; nothing is left of the run before.

        FMUs are reset. An FMU that cannot be, and one in a process of its own, is started anew.

        Parameters
        ----------
        members
            The same FMUs for the same robots.
        state
            As for a new fleet.

        Raises
        ------
        InputError, SimulationError
            As for a new fleet. The fleet can be restarted all the same.
        """
        self._start(members, state)

    def _start(self, members: Sequence[Member], state: NDArray[np.float64]) -> None:
        self.members = tuple(members)
        self.messages: list[str] = []
        self.logged: list[RobotMessage] = []
        self._state = state
        self._state[:] = np.nan
        self._kept = [0] * len(members)
        sizes = [(len(member.spec.inputs.start), len(member.spec.outputs.start)) for member in members]
        with returning():
            self._end_external()
            self._start_processes()
            self._start_stepwise()
            self._start_instances()
            self._rows = rows = Rows([self._instances.get(index) for index in range(len(members))], sizes)
            inputs = [range(len(member.inputs)) for member in members]
            self._columns = [list(member.columns or range(len(member.outputs))) for member in members]
            self._arrays = FleetArrays(
                rows.rows,
                rows.inputs,
                rows.outputs,
                rows.scratch,
                rows.work,
                _links([member.inputs for member in members], rows.first_input, inputs),
                _links([member.outputs for member in members], rows.first_output, self._columns),
                state,
                self._activity.current,
                other_address(rows),
            )
            for index, plant in self._external.items():
                self._slice(rows.outputs, rows.first_output, index)[:] = plant.first_outputs
            given = np.zeros(len(self._arrays.in_links))
            self._call = entry_of(step_fleet, self._arrays, given, self._clock, self._found)
            found = self._step(given, 0.0, 0.0)  # reads the outputs
            for index, failure in self._failed().items() if found == Found.FAILED else ():
                raise self._not_started(index, PlantError(f"it {failure}"))
            self._check(0.0, found, 0.0)
            for member, found_there in zip(self.members, self._state, strict=True):
                check_pose(member, found_there)
            self._late = [index for index, member in enumerate(self.members) if member.spec.late_outputs]

    def step(self, tick: int, step: float, given: NDArray[np.float64]) -> None:
        """Hold the inputs and advance every plant from a communication point by one communication step [s].

        Parameters
        ----------
        tick, step
            The communication point is ``tick * step`` [s].
        given
            Values of the inputs, one plant after the other, in the roles' units.

        Raises
        ------
        SimulationError
            Plants did not accept their inputs, complete the step or return finite outputs: each of them, with its own
            messages.
        """
        time, after = tick * step, (tick + 1) * step
        if self._external:
            self._step_all(time, step, given, after)
        else:
            self._check(time, self._step(given, time, step), after)
        if self._late:
            self._check_first_step(after)

    def compiled(self, given: NDArray[np.float64]) -> CompiledFleet | None:
        """Return what compiled code needs in place of `step`; None if plants must be stepped from Python.

        It is good for as long as the fleet is not closed, and reads the inputs from an array.
        """
        if self._external or self._late:
            return None
        self._bound = Bound(step_fleet, self._arrays, given, self._clock, self._found)
        return CompiledFleet(np.array(self._bound.numbers, dtype=np.int64), self._clock, self._found, Log.pending)

    def _step(self, given: NDArray[np.float64], time: float, step: float) -> int:
        """Give inputs, take a step and read the outputs; if it has no length, read them only."""
        self._clock[:] = time, step
        given = np.ascontiguousarray(given, dtype=np.float64)
        self._call(self._arrays, given, self._clock, self._found)
        return int(self._found[0])

    def settle(self, tick: int, step: float, found: int) -> None:
        """Keep the messages of a step of `compiled` code from a tick, and raise its failures as `step` does."""
        self._check(tick * step, found, (tick + 1) * step)

    def _step_all(self, time: float, step: float, given: NDArray[np.float64], after: float) -> None:
        """Step the plants here and those that are stepped elsewhere side by side."""
        rows = self._rows
        give_inputs(self._arrays, given)
        self._activity.clock[:] = time, step
        for index, plant in self._external.items():
            plant.begin(time, step, self._slice(rows.inputs, rows.first_input, index))
        failed = advance_all(self._arrays, time, step)
        failures = {}
        for index, plant in self._external.items():
            try:
                with self._activity.of(-1 if isinstance(plant, ProcessPlant) else index):
                    plant.finish(self._slice(rows.outputs, rows.first_output, index))
            except PlantError as error:
                failures[index] = str(error)
        found = Found.FAILED if failed or failures else take_outputs(self._arrays)
        self._check(time, found, after, failures)

    def run(self, first: int, step: float, given: NDArray[np.float64], out: NDArray[np.float64]) -> None:
        """Take many steps in one call, with all inputs given.

        Parameters
        ----------
        first, step
            The steps begin at the communication point ``first * step`` [s].
        given
            Inputs (ticks, ...) of every step, as for `step`.
        out
            Gets the state (ticks, plants, entries) after every step.

        Raises
        ------
        SimulationError
            See `step`; `out` holds the samples up to then.
        """
        one_by_one = len(given) if self._external else min(len(given), 1 if self._late else 0)
        for k in range(one_by_one):
            self.step(first + k, step, given[k])
            out[k] = self._state
        if one_by_one == len(given):
            return
        tick, found = run_fleet(self._arrays, given[one_by_one:], first + one_by_one, step, out[one_by_one:])
        self._check(tick * step, found, (tick + 1) * step)

    def change(self, index: int, values: Sequence[Value], time: float) -> None:
        """Give parameters of a plant other values at a communication point [s].

        Raises
        ------
        SimulationError
            The FMU refuses a value: its own messages.
        """
        plant = self._external.get(index) or self._instances[index]
        try:
            with self._activity.of(-1 if isinstance(plant, ProcessPlant) else index):
                plant.change(values)
        except PlantError as error:
            raise SimulationError(*self._failures({index: str(error)}, time)) from None
        if isinstance(plant, Instance):
            self._rows.rows["next_event"][index] = plant.next_event

    def close(self) -> None:
        """End all plants."""
        self._cleanup.close()

    # Starting ----------------------------------------------------------------------------------------------------

    def _start_processes(self) -> None:
        processes: dict[int, ProcessPlant] = {}
        for index, member in enumerate(self.members):
            if member.isolated:
                try:
                    self._external[index] = processes[index] = ProcessPlant(member.spec)
                except PlantError as error:
                    raise self._not_started(index, error) from None
        for index, process in processes.items():
            try:
                process.wait_until_started()
            except PlantError as error:
                raise self._not_started(index, error) from None

    def _start_stepwise(self) -> None:
        for index, member in enumerate(self.members):
            make = None if member.isolated else stepper(member.spec)
            if make is not None:
                try:
                    with self._activity.of(index):
                        self._external[index] = make(member.spec)
                except PlantError as error:
                    raise self._not_started(index, error) from None

    def _start_instances(self) -> None:
        for index, member in enumerate(self.members):
            if index not in self._external:
                try:
                    with self._activity.of(index):
                        before = self._instances.pop(index, None)  # back once it is restarted
                        if before is None or not before.restart(member.spec):
                            if before is not None:
                                before.close()
                            before = Instance(member.spec)
                        self._instances[index] = before
                except PlantError as error:
                    raise self._not_started(index, error) from None

    def _end(self) -> None:
        with ExitStack() as closing:  # whatever happens to one of them
            closing.callback(self._end_external)
            for index, instance in self._instances.items():
                closing.callback(self._end_one, index, instance)
            self._instances = {}

    def _end_external(self) -> None:
        processes = [plant for plant in self._external.values() if isinstance(plant, ProcessPlant)]
        with ExitStack() as closing:
            closing.callback(end, processes)
            for index, plant in self._external.items():
                if not isinstance(plant, ProcessPlant):
                    closing.callback(self._end_one, index, plant)
            self._external = {}

    def _end_one(self, index: int, plant: Instance | StepwisePlant) -> None:
        with self._activity.of(index):
            plant.close()

    def _not_started(self, index: int, error: PlantError) -> InputError:
        return not_started(self.members, index, error)

    def _check_first_step(self, time: float) -> None:
        """Refuse a plant whose outputs, which show its pose from now on, show another one than its initial pose."""
        late, self._late = self._late, []
        failures = {
            index: said for index in late if (said := moved_too_far(self.members[index], time, self._state[index]))
        }
        if failures:
            raise SimulationError(*self._failures(failures, time))

    # Outcome of a step ----------------------------------------------------------------------------------

    def _check(self, time: float, found: int, after: float, failures: dict[int, str] | None = None) -> None:
        """Keep the messages, and raise the failures at a communication point or after the step from there."""
        failures = dict(failures or {})
        if found == Found.FAILED:
            failures |= self._failed()
            last = max(failures)  # the remedy is named once
            failures[last] = self._with_doubt(last, failures[last], after - time)
        elif found == Found.DIVERGED:
            time, failures = after, self._diverged()
            if after == 0.0:
                failures = {index: f"{said}; {SHOWN_LATE}" for index, said in failures.items()}
        if Log.pending[0]:
            for index, instance in self._instances.items():
                self._keep(index, instance.log.take(), instance.log.take_data(), time)
        for index, plant in self._external.items():
            self._keep(index, plant.take_messages(), plant.take_data(), time)
        if failures:
            variable = self._diverging(min(failures))[0][0].name if found == Found.DIVERGED else ""
            raise SimulationError(*self._failures(failures, time), variable)

    def _with_doubt(self, index: int, said: str, step: float) -> str:
        """Return the failure of a plant, with a possible cause if it has not completed a step of this length."""
        doubt = misfit(self.members[index].usual_step, step) if said.startswith(FAILURES[COMPLETE]) else ""
        return f"{said}; it {doubt}" if doubt else said

    def _failed(self) -> dict[int, str]:
        """Return the failure of each plant that is called here and has failed."""
        failed = np.flatnonzero(self._rows.rows["what"] != FINE).tolist()
        told = {index: (int(self._rows.rows[index]["what"]), int(self._rows.rows[index]["status"])) for index in failed}
        return {index: self._instances[index].failure(*outcome) for index, outcome in told.items()}

    def _diverged(self) -> dict[int, str]:
        """Return how the motion of each plant has diverged whose motion has."""
        diverged: dict[int, str] = {}
        for index in range(len(self.members)):
            for link, value in self._diverging(index)[:1]:
                diverged[index] = f"has diverged: {link.name} = {value:.4g} {link.unit}"
        return diverged

    def _diverging(self, index: int) -> list[tuple[Link, float]]:
        """Return the roles of a plant that are out of bounds, with their values."""
        outputs = zip(self.members[index].outputs, self._state[index, self._columns[index]].tolist(), strict=True)
        return [(link, value) for link, value in outputs if link.place >= 0 and not abs(value) < link.bound]

    def _failures(self, failures: dict[int, str], time: float) -> tuple[str, float, str]:
        """Return the arguments of an error that reports all of them."""
        (first, *rest) = sorted(failures)
        specs = [member.spec for member in self.members]
        text = f"the plant {specs[first].file} {failures[first]}"
        text += "".join(f"; {specs[index].robot}: the plant {specs[index].file} {failures[index]}" for index in rest)
        return specs[first].robot, time, text

    def _keep(self, index: int, said: str, data: list[Message], time: float) -> None:
        robot = self.members[index].spec.robot
        if self._kept[index] < KEPT_MESSAGES or not said:  # of a failure, whatever came before
            self.logged += [RobotMessage(time, robot, message.in_a_line) for message in data]
        if not said:
            return
        self._kept[index] += 1
        if self._kept[index] > KEPT_MESSAGES + 1:
            return
        if self._kept[index] > KEPT_MESSAGES:
            said = "more messages, which are not kept"
        self.messages.append(f"{robot}, t = {time:.6g} s: {said}")

    @staticmethod
    def _slice(values: NDArray[np.float64], first: NDArray[np.int64], index: int) -> NDArray[np.float64]:
        return values[first[index] : first[index + 1]]


@contextmanager
def returning() -> Iterator[None]:
    """Return to the working directory at the end of the block, from where an FMU may have gone."""
    folder = os.getcwd()
    try:
        yield
    finally:
        with suppress(OSError):  # it is gone
            os.chdir(folder)


def _links(
    links: Sequence[Sequence[Link]], first: NDArray[np.int64], columns: Sequence[Sequence[int]]
) -> NDArray[np.void]:
    return np.array(
        [
            (row, at, int(first[row]) + link.place if link.place >= 0 else -1, link.scale, link.offset, link.bound)
            for row, (own, places) in enumerate(zip(links, columns, strict=True))
            for at, link in zip(places, own, strict=True)
        ],
        dtype=LINK,
    )
