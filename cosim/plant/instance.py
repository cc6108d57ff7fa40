"""One instance of an FMU in this process: FMPy loads, instantiates, initialises and terminates it."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

from fmpy import fmi1, fmi2, fmi3
from fmpy.fmi1 import FMICallException

from cosim.plant.log import Log
from cosim.plant.outcome import ERROR, FATAL, WARNING, PlantError
from cosim.plant.spec import CO_SIMULATION, PlantSpec, Value

_MAX_EVENT_ITERATIONS = 100

_SETTERS = {
    "Real": "setReal",
    "Integer": "setInteger",
    "Float64": "setFloat64",
    "Float32": "setFloat32",
    "Boolean": "setBoolean",
    "String": "setString",
    **{f"{sign}Int{bits}": f"set{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)},
}


class Instance:
    """An initialised instance at the start of its run; of Model Exchange, in Continuous-Time Mode.

    Legal call order: `change` and what `cosim.plant.stepping` does, in any number, `close` once.

    Parameters
    ----------
    spec
        What to start.

    Attributes
    ----------
    next_event : float
        Of Model Exchange: time [s] of the next time event; infinity if there is none.
    status : int
        The worst status so far. After Error nothing is called but to free the instance, after Fatal nothing at all.

    Raises
    ------
    PlantError
        The FMU cannot be loaded, or refuses to start: its own messages.
    """

    def __init__(self, spec: PlantSpec) -> None:
        self.spec = spec
        self.log = Log(spec.robot)
        self.next_event = float("inf")
        self.status = 0
        self._fmu: Any = None
        self._initialised = False
        folder = os.getcwd()
        try:
            self._instantiate()
            for value in spec.values:
                self._set(value)
            self._initialise()
        except PlantError:
            self.close()
            raise
        except Exception as error:  # FMPy raises a bare Exception where loading or instantiation fails
            self._note(error)
            said = self.log.take() or str(error)
            self.close()
            raise PlantError(said) from None
        finally:
            os.chdir(folder)  # FMPy leaves it where a library could not be loaded, and an FMU may have its own way

    @property
    def component(self) -> int:
        """The address of the instance."""
        return int(self._fmu.component)

    @property
    def fmu(self) -> Any:
        """The instance as FMPy has it."""
        return self._fmu

    def address(self, function: str) -> int:
        """Return the address of a function of the FMU, by its name without ``fmi2`` or the like.

        Raises
        ------
        PlantError
            The FMU does not have it.
        """
        prefix = f"{self.spec.identifier}_fmi" if self._version == 1 else f"fmi{self._version}"
        try:
            return int(ctypes.cast(self._fmu.dll[prefix + function], ctypes.c_void_p).value or 0)
        except AttributeError:
            raise PlantError(f"its binary lacks the function {prefix}{function}") from None

    @property
    def states(self) -> int:
        """Of Model Exchange: the number of continuous states."""
        return int(self._numbers[0])

    @property
    def event_indicators(self) -> int:
        """Of Model Exchange: the number of event indicators."""
        return int(self._numbers[1])

    def change(self, values: Iterable[Value]) -> None:
        """Give parameters other values at a communication point.

        Raises
        ------
        PlantError
            The FMU refuses a value.
        """
        if not self._co_simulation:
            self.handle_event(values)
            return
        for value in values:
            self._set(value)

    def handle_event(self, values: Iterable[Value] = ()) -> None:
        """Of Model Exchange: go through Event Mode and back, and set values there.

        Raises
        ------
        PlantError
            The FMU refuses a value, or does not process the event.
        """
        try:
            self._fmu.enterEventMode()
            for value in values:
                self._set(value)
            self._update()
            self._fmu.enterContinuousTimeMode()
        except FMICallException as error:
            self._note(error)
            raise PlantError(self.log.take() or str(error)) from None

    def close(self) -> None:
        """Terminate the instance, free it and release its library."""
        if self._fmu is not None and self._fmu.component:
            if self._initialised and self.status < ERROR:
                with suppress(FMICallException):
                    self._fmu.terminate()
            if self.status < FATAL:
                self._fmu.freeInstance()
            self._fmu.component = None
        self.log.close()

    @property
    def _version(self) -> int:
        return int(self.spec.fmi[0])

    @property
    def _co_simulation(self) -> bool:
        return self.spec.interface == CO_SIMULATION

    def _instantiate(self) -> None:
        spec = self.spec
        slave = self._co_simulation
        about = {
            "guid": spec.token,
            "unzipDirectory": spec.directory,
            "modelIdentifier": spec.identifier,
            "instanceName": spec.robot,
        }
        if self._version == 1:
            self._fmu = fmi1.FMU1Slave(**about)
            self._fmu.instantiate(functions=self.log.callbacks_1, loggingOn=False)
        elif self._version == 2:
            self._fmu = (fmi2.FMU2Slave if slave else fmi2.FMU2Model)(**about)
            self._fmu.instantiate(callbacks=self.log.callbacks_2, loggingOn=False)
        else:
            # Without Event Mode, early return and intermediate update, which an FMU may offer but not demand
            # (FMI 3.0, section 4.2), it handles its events within a step.
            self._fmu = (fmi3.FMU3Slave if slave else fmi3.FMU3Model)(**about)
            self._fmu.instantiate(loggingOn=False, logMessage=self.log.log_message)
        if not self._fmu.component:  # FMPy overlooks this in FMI 1.0
            raise PlantError(self.log.take() or "it does not instantiate")

    def _initialise(self) -> None:
        fmu, stop = self._fmu, self.spec.stop_time
        if self._version == 1:
            self._initialise_slave()
        else:
            if self._version == 2:
                fmu.setupExperiment(startTime=0.0, stopTime=stop)
                fmu.enterInitializationMode()
            else:
                fmu.enterInitializationMode(startTime=0.0, stopTime=stop)
            fmu.exitInitializationMode()
        self._initialised = True
        self._numbers = (0, 0)
        if not self._co_simulation:
            self._update()
            fmu.enterContinuousTimeMode()
            self._numbers = self._counted()

    def _initialise_slave(self) -> None:
        """Initialise an FMI 1.0 instance; FMPy takes the status that is returned for a string."""
        function = self._fmu.dll[f"{self.spec.identifier}_fmiInitializeSlave"]
        function.argtypes = (ctypes.c_void_p, ctypes.c_double, ctypes.c_char, ctypes.c_double)
        status = function(self.component, 0.0, fmi1.fmi1True, self.spec.stop_time)
        if status > WARNING:
            raise FMICallException("fmiInitializeSlave", status)

    def _update(self) -> None:
        """Iterate over the discrete states in Event Mode until they do not change any more."""
        update = self._fmu.newDiscreteStates if self._version == 2 else self._fmu.updateDiscreteStates
        for _ in range(_MAX_EVENT_ITERATIONS):
            more, terminate, _, _, next_event_defined, next_event = update()
            if terminate:
                raise PlantError(self.log.take() or "it asks to end the simulation")
            if not more:
                self.next_event = float(next_event) if next_event_defined else float("inf")
                return
        raise PlantError(f"its discrete states do not settle in {_MAX_EVENT_ITERATIONS} iterations")

    def _counted(self) -> tuple[int, int]:
        if self._version == 2:
            return self.spec.states, self.spec.event_indicators
        return self._fmu.getNumberOfContinuousStates(), self._fmu.getNumberOfEventIndicators()

    def _note(self, error: Exception) -> None:
        if isinstance(error, FMICallException):
            self.status = max(self.status, error.status)

    def _set(self, value: Value) -> None:
        name = value.type if value.type != "Enumeration" else ("Integer" if self._version < 3 else "Int64")
        values = list(value.values)
        try:
            getattr(self._fmu, _SETTERS[name])([value.reference], values)
        except FMICallException as error:
            self._note(error)
            shown = " ".join(str(v) for v in values)
            raise PlantError(f"it refuses {value.name} = {shown}: {self.log.take() or error}") from None
