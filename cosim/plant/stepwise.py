"""The interface of plants that are stepped one call at a time, not by compiled code with all others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cosim.plant.message import Message
from cosim.plant.saved import PlantState
from cosim.plant.spec import PlantSpec, Value


class StepwisePlant(Protocol):
    """A plant that is stepped one call at a time.

    Legal call order: `step`, `change`, `take_messages`, `saved` and `restore` in any number, `close` once.
    """

    first_outputs: list[float]

    def step(self, time: float, step: float, inputs: NDArray[np.float64], outputs: NDArray[np.float64]) -> None:
        """Give the inputs, take a communication step and write the outputs, or raise PlantError."""

    def change(self, values: Sequence[Value]) -> None:
        """Change parameters, or raise PlantError."""

    def saved(self, inputs: NDArray[np.float64], outputs: NDArray[np.float64]) -> PlantState:
        """Return the state after the last step, which had these inputs and outputs, or raise PlantError."""

    def restore(self, state: PlantState) -> list[float]:
        """Go on from a saved state, and return the outputs there, or raise PlantError."""

    def take_messages(self) -> str:
        """Return the messages since the last call, as one text."""

    def take_data(self) -> list[Message]:
        """Return the messages since the last call, one by one, with the messages on a failure."""

    def close(self) -> None:
        """End it."""


def stepper(spec: PlantSpec) -> Callable[[PlantSpec], StepwisePlant] | None:
    """Return the constructor of a plant that is stepped one call at a time; None if compiled code can step it."""
    if spec.uses_cvode:
        from cosim.plant.cvode import CvodePlant  # loads SUNDIALS

        return CvodePlant
    if spec.is_typed:
        from cosim.plant.typed import TypedPlant

        return TypedPlant
    return None
