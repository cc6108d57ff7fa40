"""Plants that exchange other numbers than doubles: Float32, and whole numbers. They are stepped one call at a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.plant.failures import FINE, PlantError
from cosim.plant.instance import Instance
from cosim.plant.message import Message
from cosim.plant.saved import PlantState
from cosim.plant.spec import CO_SIMULATION, PlantSpec, Value
from cosim.plant.stepping import Rows, advance


class TypedPlant:
    """A plant that exchanges numbers of any type; Model Exchange is integrated with a fixed step.

    Legal call order: see `cosim.plant.stepwise.StepwisePlant`.

    Raises
    ------
    PlantError
        See `cosim.plant.instance.Instance`.
    """

    def __init__(self, spec: PlantSpec) -> None:
        self._instance = Instance(spec)
        self._given = np.full(len(spec.inputs.start), np.nan)
        try:
            self._rows = Rows([self._instance], [(0, 0)])  # inputs and outputs are exchanged here
            self.first_outputs = list(spec.outputs.start) if spec.late_outputs else self._instance.take()
        except PlantError as error:
            self.close()
            raise PlantError(f"it {error}") from None
        except BaseException:
            self.close()
            raise

    def step(self, time: float, step: float, inputs: NDArray[np.float64], outputs: NDArray[np.float64]) -> None:
        """Give the inputs, take the step and write the outputs.

        Raises
        ------
        PlantError
            The FMU failed, or the type of an input cannot represent its value.
        """
        instance, rows = self._instance, self._rows
        if instance.spec.interface == CO_SIMULATION:
            instance.give(inputs.tolist())
        elif not np.array_equal(inputs, self._given):  # inputs jump, which is an event
            self._given = inputs.copy()
            instance.handle_event(lambda: instance.give(self._given.tolist()))
            rows.rows["next_event"] = instance.next_event
        what, status = advance(rows.rows[0], rows.scratch[0], rows.work, time, step)
        if what != FINE:
            raise PlantError(instance.failure(what, status))
        outputs[:] = instance.take()

    def change(self, values: Sequence[Value]) -> None:
        """See `Instance.change`."""
        self._instance.change(values)
        self._rows.rows["next_event"] = self._instance.next_event

    def saved(self, inputs: NDArray[np.float64], outputs: NDArray[np.float64]) -> PlantState:
        """Return the state after the last step."""
        numbers = tuple(inputs.tolist()), tuple(outputs.tolist()), tuple(self._given.tolist())
        return PlantState(self._instance.saved(), *numbers, float(self._rows.rows["next_event"][0]))

    def restore(self, state: PlantState) -> list[float]:
        """Go on from a saved state, and return the outputs there."""
        self._instance.restore(state.fmu)
        self._rows.rows["next_event"] = self._instance.next_event = state.next_event
        self._given = np.array(state.given)
        return self._instance.take()

    def take_messages(self) -> str:
        """Return the FMU's messages since the last call."""
        return self._instance.log.take()

    def take_data(self) -> list[Message]:
        """See `Log.take_data`."""
        return self._instance.log.take_data()

    def close(self) -> None:
        """End the plant."""
        self._instance.close()
