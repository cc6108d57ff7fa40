"""Plants whose FMUs are called in this process: by compiled code, or one call at a time."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.errors import Picklable
from cosim.plant.activity import Activity, Doing
from cosim.plant.failures import FINE, PlantError
from cosim.plant.fleet_step import FleetArrays, advance_all
from cosim.plant.instance import Instance
from cosim.plant.message import Message
from cosim.plant.saved import PlantState
from cosim.plant.spec import PlantSpec, Value
from cosim.plant.stepping import Rows
from cosim.plant.stepwise import StepwisePlant, stepper
from cosim.undisturbed import Ending


class NotStarted(Picklable, PlantError):
    """A plant cannot be started.

    Parameters
    ----------
    index
        Which one.
    error
        Why; the plant is the subject.
    """

    def __init__(self, index: int, error: PlantError) -> None:
        super().__init__(str(error))
        self.index, self.error = index, error


class LocalPlants:
    """The plants of a fleet whose FMUs are called in this process, by their numbers in the fleet.

    Legal call order: `start`, then `advance`, `change`, `saved`, `restore` and `messages` in any number; `start` again
    for another run; `close` at the end.

    Parameters
    ----------
    activity
        Shows what the plants are about.

    Attributes
    ----------
    rows : Rows
        Those of the whole fleet; the same ones if the same instances are restarted.
    stepwise : dict of StepwisePlant
        The plants that compiled code cannot step.
    """

    def __init__(self, activity: Activity) -> None:
        self.rows = Rows([], [])
        self.stepwise: dict[int, StepwisePlant] = {}
        self._instances: dict[int, Instance] = {}
        self._activity = activity

    def start(
        self, specs: Sequence[PlantSpec], here: Iterable[int], outputs: NDArray[np.float64] | None = None
    ) -> None:
        """Start plants, or put those that are there at the start of another run, if their FMUs can be reset.

        Parameters
        ----------
        specs
            All plants of the fleet.
        here
            The numbers of those to start here.
        outputs
            Gets the outputs; see `Rows`.

        Raises
        ------
        NotStarted
            A plant cannot be started.
        """
        self._end_stepwise()
        for index in here:
            try:
                with self._activity.of(index):
                    self._start(index, specs[index])
            except PlantError as error:
                raise NotStarted(index, error) from None
        sizes = [(len(spec.inputs.start), len(spec.outputs.start)) for spec in specs]
        instances = [self._instances.get(index) for index in range(len(specs))]
        if not self.rows.restart(instances, sizes, outputs):
            self.rows = Rows(instances, sizes, outputs)
        for index, spec in enumerate(specs):
            if index not in self._instances:
                self.rows.inputs_of(index)[:] = spec.inputs.start
        for index, plant in self.stepwise.items():
            self.rows.outputs_of(index)[:] = plant.first_outputs

    def advance(self, arrays: FleetArrays, time: float, step: float) -> dict[int, str]:
        """Advance all plants from Python, with their inputs given; return the failure of each plant that has failed."""
        self._activity.clock[:] = time, step
        failures = self.failures() if advance_all(arrays, time, step) else {}
        for index, plant in self.stepwise.items():
            try:
                with self._activity.of(index):
                    plant.step(time, step, self.rows.inputs_of(index), self.rows.outputs_of(index))
            except PlantError as error:
                failures[index] = str(error)
        return failures

    def failures(self) -> dict[int, str]:
        """Return the failure of each plant that compiled code has called and that has failed."""
        rows = self.rows.rows
        failed = np.flatnonzero(rows["what"] != FINE).tolist()
        told = {index: (int(rows[index]["what"]), int(rows[index]["status"])) for index in failed}
        return {index: self._instances[index].failure(*outcome) for index, outcome in told.items()}

    def change(self, index: int, values: Sequence[Value]) -> None:
        """Give parameters of a plant other values at a communication point.

        Raises
        ------
        PlantError
            The FMU refuses a value.
        """
        plant = self.stepwise.get(index) or self._instances[index]
        with self._activity.of(index, Doing.CHANGE):
            plant.change(values)
        if isinstance(plant, Instance):
            self.rows.rows["next_event"][index] = plant.next_event

    def saved(self, index: int) -> PlantState:
        """Return the state of a plant at a communication point.

        Raises
        ------
        PlantError
            The FMU does not return it.
        """
        row, inputs, outputs = self.rows.rows[index], self.rows.inputs_of(index), self.rows.outputs_of(index)
        with self._activity.of(index, Doing.SAVE):
            if (plant := self.stepwise.get(index)) is not None:
                return plant.saved(inputs, outputs)
            fmu = self._instances[index].saved()
        numbers = tuple(inputs.tolist()), tuple(outputs.tolist())
        return PlantState(fmu, *numbers, (), float(row["next_event"]), bool(row["in_changed"]))

    def restore(self, index: int, state: PlantState) -> None:
        """Let a plant that has just been started go on from a saved state.

        Raises
        ------
        PlantError
            The FMU refuses the state, or comes back with other outputs than it had.
        """
        row, outputs = self.rows.rows[index], self.rows.outputs_of(index)
        self.rows.inputs_of(index)[:], outputs[:] = state.inputs, state.outputs
        with self._activity.of(index):
            if (plant := self.stepwise.get(index)) is not None:
                found = plant.restore(state)
            else:
                instance = self._instances[index]
                instance.restore(state.fmu)
                row["in_changed"] = state.changed
                row["next_event"] = instance.next_event = state.next_event
                found = instance.take()
        if not np.array_equal(found, outputs, equal_nan=True):
            raise PlantError("comes back with other outputs than it had when it saved its state")

    def messages(self) -> Iterator[tuple[int, str, list[Message]]]:
        """Take the messages of each plant since the last time: its number, one text, and all that is not taken yet."""
        for index, instance in self._instances.items():
            yield index, instance.log.take(), instance.log.take_data()
        for index, plant in self.stepwise.items():
            yield index, plant.take_messages(), plant.take_data()

    def close(self) -> None:
        """End all plants, whatever happens to one of them."""
        with Ending() as closing:
            closing.callback(self._end_stepwise)
            for index, instance in self._instances.items():
                closing.callback(self._end_one, index, instance)
            self._instances = {}

    def _start(self, index: int, spec: PlantSpec) -> None:
        if (make := stepper(spec)) is not None:
            self.stepwise[index] = make(spec)
            return
        before = self._instances.pop(index, None)  # back once it is restarted
        if before is None or not before.restart(spec):
            if before is not None:
                before.close()
            before = Instance(spec)
        self._instances[index] = before

    def _end_stepwise(self) -> None:
        with Ending() as closing:
            for index, plant in self.stepwise.items():
                closing.callback(self._end_one, index, plant)
            self.stepwise = {}

    def _end_one(self, index: int, plant: Instance | StepwisePlant) -> None:
        with self._activity.of(index):
            plant.close()
