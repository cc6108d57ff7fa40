"""All plants of a run, exchanged and stepped together: one kind of plant, whatever their FMUs are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cosim.compiled import entry_of
from cosim.errors import SimulationError
from cosim.frames import Bound
from cosim.plant.activity import Activity
from cosim.plant.activity import activity as new_activity
from cosim.plant.constant_step import misfit
from cosim.plant.elsewhere import Elsewhere
from cosim.plant.failures import COMPLETE, FAILURES, PlantError
from cosim.plant.fleet_step import (
    LINK,
    NO_FLEET,
    CompiledFleet,
    Found,
    fleet_arrays,
    give_inputs,
    load_step,
    run_fleet,
    step_fleet,
    take_outputs,
)
from cosim.plant.local import LocalPlants, NotStarted
from cosim.plant.log import Log
from cosim.plant.member import Link, Member
from cosim.plant.message import Message, RobotMessage
from cosim.plant.saved import FleetState
from cosim.plant.spec import Value
from cosim.plant.start_check import SHOWN_LATE, check_pose, moved_too_far, not_started
from cosim.plant.working_folder import returning
from cosim.undisturbed import Ending

T = TypeVar("T")

HARNESS = "the harness"
"""The process of plants that run where the harness does."""

KEPT_MESSAGES = 20
"""Number of messages of a plant that are kept, the first ones."""


class Fleet:
    """Plants that are stepped together.

    Legal call order: `restore` before the first step, if at all; `step`, `run`, `change` and `saved` in any number, at
    successive ticks; `restart` for another run, also after a failure; `close` at the end. After a SimulationError only
    these two.

    Parameters
    ----------
    members
        The plants; they are started here, those in processes of their own side by side.
    state
        Gets pose and pseudo-velocities (plants, entries) of every plant in its roles' units at the last communication
        point, from the start on. Its rows are contiguous.
    activity
        Shows what the fleet is about.
    often
        Whether it will be restarted.

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

    def __init__(
        self,
        members: Sequence[Member],
        state: NDArray[np.float64],
        activity: Activity | None = None,
        often: bool = False,
    ) -> None:
        load_step()
        self.process = HARNESS
        self._activity = activity or new_activity()
        self._clock, self._found = self._activity.clock, np.zeros(2, dtype=np.int64)
        self._wired: list[object] = []  # what the arrays are made of, which they keep
        self._bound: Bound | None = None
        self._compiled = NO_FLEET
        with Ending() as cleanup:
            self._local = LocalPlants(self._activity)
            cleanup.callback(self._local.close)
            self._elsewhere = Elsewhere(often)
            cleanup.callback(self._elsewhere.close)
            self._start(members, state)
            self._cleanup = cleanup.pop_all()

    def restart(self, members: Sequence[Member], state: NDArray[np.float64]) -> None:
        """Put all plants at the start of another run, with other values; nothing is left of the run before.

        FMUs are reset, also those in other processes. An FMU that cannot be is started anew.

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
        with returning():
            try:
                self._elsewhere.start(members)
                here = [index for index, member in enumerate(members) if not member.isolated]
                self._local.start([member.spec for member in members], here)
            except NotStarted as error:
                raise not_started(self.members, error.index, error.error) from None
            links = [(member.inputs, member.outputs, member.columns) for member in members]
            wired = [self._local.rows, *map(_memory, (state, Log.pending)), *links]
            if wired != self._wired or len(here) < len(members):
                self._wire(state)
                self._wired = wired
            self._one_by_one = bool(self._local.stepwise) or not self._elsewhere.can_ring
            found = self._step(self._nothing, 0.0, 0.0)  # reads the outputs
            for index, failure in self._local.failures().items() if found == Found.FAILED else ():
                raise not_started(self.members, index, PlantError(f"it {failure}"))
            self._check(0.0, found, {}, 0.0)
            for member, found_there in zip(self.members, self._state, strict=True):
                check_pose(member, found_there)
            self._late = [index for index, member in enumerate(self.members) if member.spec.late_outputs]

    def _wire(self, state: NDArray[np.float64]) -> None:
        """Make the arrays for compiled code, which are good for as long as plants and state are where they are."""
        members, rows = self.members, self._local.rows
        inputs = [range(len(member.inputs)) for member in members]
        self._columns = [list(member.columns or range(len(member.outputs))) for member in members]
        self._arrays = fleet_arrays(
            rows,
            _links([member.inputs for member in members], rows.first_input, inputs),
            _links([member.outputs for member in members], rows.first_output, self._columns),
            state,
            self._activity.current,
            Log.pending,
            self._elsewhere.bells(rows),
        )
        self._nothing = np.zeros(len(self._arrays.in_links))
        self._call = entry_of(step_fleet, self._arrays, self._nothing, self._clock, self._found)
        self._bound = None

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
        if self._one_by_one:
            give_inputs(self._arrays, given)
            self._elsewhere.begin(time, step)
            self._check(time, *self._outcome(self._local.advance(self._arrays, time, step)), after)
        else:
            self.settle(tick, step, self._step(given, time, step))
        if self._late:
            self._check_first_step(after)

    @property
    def companions(self) -> tuple[int, ...]:
        """The numbers of the processes that step plants besides this one."""
        return self._elsewhere.companions

    def compiled(self, given: NDArray[np.float64]) -> CompiledFleet | None:
        """Return what compiled code needs in place of `step`; None if plants must be stepped from Python.

        It is good for as long as the fleet is not closed, and reads the inputs from an array.
        """
        if self._one_by_one or self._late:
            return None
        if self._bound is None or self._bound.arguments[1] is not given:
            self._bound = Bound(step_fleet, self._arrays, given, self._clock, self._found)
            numbers = np.array(self._bound.numbers, dtype=np.int64)
            self._compiled = CompiledFleet(numbers, self._clock, self._found[:1], self._found[1:])
        return self._compiled

    def _step(self, given: NDArray[np.float64], time: float, step: float) -> int:
        """Give inputs, take a step and read the outputs; if it has no length, read them only."""
        self._clock[:] = time, step
        given = np.ascontiguousarray(given, dtype=np.float64)
        self._call(self._arrays, given, self._clock, self._found)
        return int(self._found[0])

    def settle(self, tick: int, step: float, found: int) -> None:
        """Keep the messages of a step of `compiled` code from a tick, and raise its failures as `step` does.

        If plants in another process take long, they are waited for here.
        """
        failures: dict[int, str] = {}
        if found == Found.FAILED:
            found, failures = self._outcome(self._local.failures())
        self._check(tick * step, found, failures, (tick + 1) * step)

    def _outcome(self, failures: dict[int, str]) -> tuple[int, dict[int, str]]:
        """Wait for plants elsewhere, and return what a step has come to, with all failures; those here are given."""
        self._elsewhere.finish()
        failures = failures | self._elsewhere.failures()
        return (Found.FAILED if failures else take_outputs(self._arrays)), failures

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
        done = 0
        while done < len(given):
            if self._one_by_one or self._late:
                self.step(first + done, step, given[done])
            else:
                tick, found = run_fleet(self._arrays, given[done:], first + done, step, out[done:])
                done = tick - first
                self.settle(tick, step, found)
            out[done] = self._state
            done += 1

    def change(self, index: int, values: Sequence[Value], tick: int, step: float) -> None:
        """Give parameters of a plant other values at a communication point, which is recorded.

        Raises
        ------
        SimulationError
            The FMU refuses a value: its own messages.
        """
        self._clock[:] = tick * step, step  # for whoever looks on
        try:
            if self.members[index].isolated:
                self._elsewhere.change(index, values)
            else:
                self._local.change(index, values)
        except PlantError as error:
            raise SimulationError(*self._failures({index: str(error)}, tick * step)) from None

    def saved(self, time: float) -> FleetState:
        """Return the state of all plants at a communication point [s], with what they have logged so far.

        What FMUs log of being saved is dropped: the run goes on as if nobody had asked.

        Raises
        ------
        SimulationError
            An FMU does not return its state.
        """
        states = [self._called(index, time, self._from(index).saved) for index in range(len(self.members))]
        self._drop_messages()
        return FleetState(tuple(states), tuple(self.messages), tuple(self.logged), tuple(self._kept))

    def restore(self, state: FleetState, tick: int, step: float) -> None:
        """Let plants that have just been started go on from a state that was saved after a step.

        Parameters
        ----------
        state
            That of the same FMUs.
        tick, step
            It was saved at the communication point ``tick * step`` [s].

        Raises
        ------
        SimulationError
            An FMU refuses its state.
        """
        for index, own in enumerate(state.plants):
            self._called(index, tick * step, self._from(index).restore, own)
        self._drop_messages()
        take_outputs(self._arrays)
        self._late = []
        self._clock[:] = (tick - 1) * step, step  # of the last step, for whoever looks on
        self.messages, self.logged, self._kept = list(state.messages), list(state.logged), list(state.kept)

    def _from(self, index: int) -> LocalPlants | Elsewhere:
        return self._elsewhere if self.members[index].isolated else self._local

    def _called(self, index: int, time: float, function: Callable[..., T], *arguments: object) -> T:
        """Call a function for a plant; SimulationError if the FMU refuses."""
        try:
            return function(index, *arguments)
        except PlantError as error:
            raise SimulationError(*self._failures({index: str(error)}, time)) from None

    def _drop_messages(self) -> None:
        for source in (self._local, self._elsewhere):
            for _ in source.messages():
                pass

    def close(self) -> None:
        """End all plants."""
        self._cleanup.close()

    def _check_first_step(self, time: float) -> None:
        """Refuse a plant whose outputs, which show its pose from now on, show another one than its initial pose."""
        late, self._late = self._late, []
        failures = {
            index: said for index in late if (said := moved_too_far(self.members[index], time, self._state[index]))
        }
        if failures:
            raise SimulationError(*self._failures(failures, time))

    # Outcome of a step ----------------------------------------------------------------------------------

    def _check(self, time: float, found: int, failures: dict[int, str], after: float) -> None:
        """Keep the messages, and raise the failures at a communication point or after the step from there."""
        if found == Found.FAILED:
            last = max(failures)  # the remedy is named once
            failures[last] = self._with_doubt(last, failures[last], after - time)
        elif found == Found.DIVERGED:
            time, failures = after, self._diverged()
            if after == 0.0:
                failures = {index: f"{said}; {SHOWN_LATE}" for index, said in failures.items()}
        for index, said, data in self._local.messages() if Log.pending[0] else ():
            self._keep(index, said, data, time)
        for index, said, data in self._elsewhere.messages():
            self._keep(index, said, data, time)
        if failures:
            variable = self._diverging(min(failures))[0][0].name if found == Found.DIVERGED else ""
            raise SimulationError(*self._failures(failures, time), variable)

    def _with_doubt(self, index: int, said: str, step: float) -> str:
        """Return the failure of a plant, with a possible cause if it has not completed a step of this length."""
        doubt = misfit(self.members[index].usual_step, step) if said.startswith(FAILURES[COMPLETE]) else ""
        return f"{said}; it {doubt}" if doubt else said

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
        self.messages.append(f"{robot}, t = {time:.12g} s: {said}")


def _memory(array: NDArray[Any]) -> tuple[object, ...]:
    """Return where an array is and how its numbers lie there."""
    return array.ctypes.data, array.shape, array.strides


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
