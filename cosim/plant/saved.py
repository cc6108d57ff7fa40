"""The saved state of a plant: what its FMU has serialised, and what the harness keeps of it from step to step."""

from __future__ import annotations

import base64
import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

from cosim.plant.failures import PlantError
from cosim.plant.message import RobotMessage

MOST = 32 * 1024**2
"""Bytes of a serialised state; an FMU that reports more is taken to be broken."""


@dataclass(frozen=True)
class PlantState:
    """The state of a plant at a communication point.

    Attributes
    ----------
    fmu : bytes
        Serialised by the FMU (FMI 2.0, section 2.1.8; FMI 3.0, section 2.2.8).
    inputs, outputs : tuple of float
        The numbers that were exchanged last, in the FMU's own units.
    given : tuple of float
        Of a plant that is stepped one call at a time: the inputs of its last event; NaN before the first one.
    next_event : float
        Of Model Exchange: time [s] of the next time event.
    changed : bool
        Whether inputs differ from those of the last step.
    """

    fmu: bytes
    inputs: tuple[float, ...]
    outputs: tuple[float, ...]
    given: tuple[float, ...] = ()
    next_event: float = float("inf")
    changed: bool = True

    def to_json(self) -> dict[str, Any]:
        """Return the state for a pipe; numbers as they are, to the bit."""
        numbers = {name: [x.hex() for x in getattr(self, name)] for name in ("inputs", "outputs", "given")}
        rest = {"next_event": self.next_event.hex(), "changed": self.changed}
        return {"fmu": base64.b64encode(self.fmu).decode(), **numbers, **rest}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """Return the state that `to_json` has written; ValueError, TypeError or KeyError if it is none."""
        inputs, outputs, given = (_numbers(data[name]) for name in ("inputs", "outputs", "given"))
        fmu = base64.b64decode(data["fmu"], validate=True)
        return cls(fmu, inputs, outputs, given, float.fromhex(data["next_event"]), bool(data["changed"]))


@dataclass(frozen=True)
class FleetState:
    """The state of all plants of a run at a communication point.

    Attributes
    ----------
    plants : tuple of PlantState
        That of each plant.
    messages, logged, kept
        What the FMUs have logged by then, and how many texts of each; see `cosim.plant.fleet.Fleet`.
    """

    plants: tuple[PlantState, ...]
    messages: tuple[str, ...]
    logged: tuple[RobotMessage, ...]
    kept: tuple[int, ...]


def _numbers(texts: Sequence[str]) -> tuple[float, ...]:
    return tuple(map(float.fromhex, texts))


def serialised(fmu: Any) -> bytes:
    """Return the state of FMPy's object of an instance, serialised.

    Raises
    ------
    PlantError
        The FMU does not return it; the FMU is the subject of the text.
    """
    try:
        state = fmu.getFMUState()
        try:
            size = ctypes.c_size_t()
            ask = getattr(fmu, "fmi2SerializedFMUstateSize", None) or fmu.fmi3SerializedFMUStateSize
            ask(fmu.component, state, ctypes.byref(size))
            if size.value > MOST:
                raise PlantError(f"cannot save its state, which has {size.value} bytes; at most {MOST} are kept")
            return bytes(fmu.serializeFMUState(state))
        finally:
            fmu.freeFMUState(state)
    except PlantError:
        raise
    except Exception as error:  # FMPy's, also of a function that is missing
        raise PlantError(f"cannot save its state{_why(error)}") from None


def restore(fmu: Any, data: bytes) -> None:
    """Put FMPy's object of an instance into a state that was serialised.

    Raises
    ------
    PlantError
        The FMU refuses it; the FMU is the subject of the text.
    """
    try:
        state = fmu.deserializeFMUState(data)
        try:
            fmu.setFMUState(state)
        finally:
            fmu.freeFMUState(state)
    except Exception as error:
        raise PlantError(f"does not take up the state that it has saved{_why(error)}") from None


def _why(error: Exception) -> str:
    """Return the words of an error: FMPy's of a call, which has a status, or another one."""
    return f": {error}" if hasattr(error, "status") else f" ({type(error).__name__}: {error})"
