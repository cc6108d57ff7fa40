"""One instance of an FMU in this process: FMPy loads, instantiates, initialises and terminates it."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Sequence
from itertools import groupby
from typing import Any, ClassVar, TypeVar

from fmpy import fmi1, fmi2, fmi3
from fmpy.fmi1 import FMICallException

from cosim.plant.arithmetic import kept_arithmetic
from cosim.plant.exchange import give, take
from cosim.plant.failures import (
    ACCEPT,
    COMPLETE,
    DISCARD,
    END,
    ERROR,
    EVENT,
    FATAL,
    RETURN,
    WARNING,
    NoInstance,
    PlantError,
    failure,
)
from cosim.plant.log import Log
from cosim.plant.missing_library import why_not_loaded
from cosim.plant.saved import restore, serialised
from cosim.plant.spec import CO_SIMULATION, PlantSpec, Value
from cosim.plant.unloading import keep, threads, unload
from cosim.plant.working_folder import loading, returning

_MAX_EVENT_ITERATIONS = 100
_MAX_STATES = 1_000_000
"""Upper limit for states and event indicators; an FMU that reports more is taken to be broken."""

_SETTERS = {
    "Real": "setReal",
    "Integer": "setInteger",
    "Float64": "setFloat64",
    "Float32": "setFloat32",
    "Boolean": "setBoolean",
    "String": "setString",
    **{f"{sign}Int{bits}": f"set{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)},
}


T = TypeVar("T")


def _unsigned(status: int, *_: object) -> int:
    """Return a status without a sign: FMPy takes one below zero for a success."""
    return status & 0xFFFFFFFF


class _NotReset(Exception):
    """An instance cannot be put at the start of another run."""


class Instance:
    """An initialised instance at the start of its run; of Model Exchange, in Continuous-Time Mode.

    Legal call order: `change`, `handle_event` and the calls of `cosim.plant.stepping`, in any number, `restart` for
    another run; `close` once.

    Parameters
    ----------
    spec
        The FMU to start, with all values for its start.

    Attributes
    ----------
    next_event : float
        Of Model Exchange: time [s] of the next time event; infinity if there is none.
    status : int
        The worst status so far. After Error the instance is only freed; after Fatal it is not called again.

    Raises
    ------
    PlantError
        The FMU cannot be loaded or refuses to start; the text has its own messages.
    """

    living: ClassVar[list[PlantSpec]] = []
    """Instances that are started in this process and not closed."""

    def __init__(self, spec: PlantSpec) -> None:
        self.spec = spec
        self.log = Log(spec.robot)
        self.status = 0
        self._fmu: Any = None
        self._addresses: dict[str, int] = {}
        self._initialised = False
        self._started(self._begin)
        self.living.append(spec)

    def restart(self, spec: PlantSpec) -> bool:
        """Reset the instance to the start of a run with other values (FMI 2.0, section 2.1.6; FMI 3.0, section 2.3.1).

        Parameters
        ----------
        spec
            The same FMU with its values for this run.

        Returns
        -------
        bool
            Whether that was possible. If not, it is to be closed: the FMU has no such function, refuses to be reset or
            one of the values, or has failed in the last run.

        Raises
        ------
        PlantError
            The FMU refuses to start with these values; the instance is closed.
        """
        if self.status >= ERROR or (self._version == 1 and not self._co_simulation):
            return False
        self.log.take_data()
        try:
            self._started(lambda: self._reset(spec))
        except _NotReset:
            return False
        return True

    def _reset(self, spec: PlantSpec) -> None:
        """Reset the instance, and give it its values for another run."""
        try:
            self._fmu.reset()
            self._set_together(spec.values)
        except Exception as error:  # FMPy's, or that of a value: a new instance says which one it refuses
            self._note(error)
            raise _NotReset from None
        self.living[:] = [spec if one is self.spec else one for one in self.living]
        self.spec, self.status, self._initialised = spec, 0, False

    def _begin(self) -> None:
        """Make the instance, and give it its values for its first run."""
        self._instantiate()
        for value in self.spec.values:
            self._set(value)

    def _started(self, make_ready: Callable[[], None]) -> None:
        """Make the instance ready to be initialised, and do that; close it if that fails."""
        self.next_event = float("inf")
        self._it = "it "  # the subject of messages until the plant is started
        try:
            with kept_arithmetic(), returning():
                make_ready()
                self._initialise()
            self._it = ""
        except _NotReset:
            raise
        except BaseException as error:
            self._note(error)
            said = self._reason(str(error))
            self.close()
            if not isinstance(error, Exception):
                raise
            # FMPy raises a bare Exception if loading or instantiation fails
            raise error if isinstance(error, PlantError) else PlantError(said) from None

    @property
    def component(self) -> int:
        """The address of the instance."""
        return int(self._fmu.component)

    @property
    def fmu(self) -> Any:
        """FMPy's object of the instance."""
        return self._fmu

    def address(self, function: str) -> int:
        """Return the address of a function of the FMU, by its name without a prefix such as ``fmi2``."""
        if function not in self._addresses:
            prefix = f"{self.spec.identifier}_fmi" if self._version == 1 else f"fmi{self._version}"
            self._addresses[function] = int(ctypes.cast(self._fmu.dll[prefix + function], ctypes.c_void_p).value or 0)
        return self._addresses[function]

    @property
    def states(self) -> int:
        """Of Model Exchange: the number of continuous states."""
        return int(self._numbers[0])

    @property
    def event_indicators(self) -> int:
        """Of Model Exchange: the number of event indicators."""
        return int(self._numbers[1])

    def give(self, numbers: Sequence[float]) -> None:
        """Give the inputs, in the FMU's own units.

        Raises
        ------
        PlantError
            The FMU refuses a number, or its type cannot represent it.
        """
        try:
            give(self._fmu, self.spec.inputs, numbers)
        except FMICallException as error:
            raise PlantError(f"{self._it}{self.failure(ACCEPT, error.status)}") from None

    def take(self) -> list[float]:
        """Return the outputs, in the FMU's own units.

        Raises
        ------
        PlantError
            The FMU does not return them.
        """
        try:
            return take(self._fmu, self.spec.outputs)
        except FMICallException as error:
            raise PlantError(f"{self._it}{self.failure(RETURN, error.status)}") from None

    def change(self, values: Iterable[Value]) -> None:
        """Give parameters other values at a communication point.

        Raises
        ------
        PlantError
            The FMU refuses a value, or does not process the event by which Model Exchange takes it.
        """

        def give() -> None:
            for value in values:
                self._set(value)

        if self._co_simulation:
            give()
        else:
            self.handle_event(give)

    def handle_event(self, give: Callable[[], None] | None = None) -> None:
        """Of Model Exchange: go through Event Mode and back, and `give` values there.

        Raises
        ------
        PlantError
            The FMU refuses a value, or does not process the event.
        """
        try:
            if self._version > 1:
                self._fmu.enterEventMode()
            if give is not None:
                give()
            self._update()
            if self._version > 1:
                self._fmu.enterContinuousTimeMode()
        except FMICallException as error:
            raise PlantError(self.failure(EVENT, error.status)) from None

    def saved(self) -> bytes:
        """Return the state of the FMU, serialised.

        Raises
        ------
        PlantError
            The FMU does not return it.
        """
        with kept_arithmetic():
            return self._told(lambda: serialised(self._fmu))

    def restore(self, state: bytes) -> None:
        """Put the FMU into a state that an instance of the same FMU has saved.

        Raises
        ------
        PlantError
            The FMU refuses it.
        """
        with kept_arithmetic():
            self._told(lambda: restore(self._fmu, state))

    def _told(self, function: Callable[[], T]) -> T:
        """Call a function; where it raises a PlantError, add what the FMU has logged."""
        try:
            return function()
        except PlantError as error:
            said = self.log.take()
            raise PlantError(f"{error}: {said}" if said else str(error)) from None

    def failure(self, what: int, status: int) -> str:
        """Return a failure (a number of `cosim.plant.failures`) in words, with the status of the FMI call."""
        self.status = max(self.status, status)
        said = self.log.take()
        if what == COMPLETE and status == DISCARD and self._version == 2 and self._co_simulation:
            try:  # an FMU also discards a step when it has reached its end (FMI 2.0, section 4.2.2)
                what = END if self._fmu.getBooleanStatus(fmi2.fmi2Terminated) else what
            except FMICallException as error:
                self._note(error)
        if not said and status > WARNING:
            said = self._no_reason()
        return failure(what, status, said)

    def close(self) -> None:
        """Terminate the instance, free it and release its library, as far as its status and its threads allow."""
        fmu, self._fmu = self._fmu, None
        self.living[:] = [spec for spec in self.living if spec is not self.spec]
        try:  # an interrupt may come at any moment
            if fmu is not None and fmu.component and self._initialised and self.status < ERROR:
                try:
                    fmu.terminate()
                except FMICallException as error:
                    self._note(error)
        finally:
            try:
                self._release(fmu)
            finally:
                self.log.close()

    def _release(self, fmu: Any) -> None:
        """Free the instance and release its library."""
        if fmu is not None and self.status < FATAL:
            if fmu.component:
                getattr(fmu, self._free)(fmu.component)  # FMPy's freeInstance would unload the library too
            unload((fmu, self.log), fmu.freeLibrary, self._threads)
        elif fmu is not None:
            keep((fmu, self.log))

    @property
    def _version(self) -> int:
        return int(self.spec.fmi[0])

    @property
    def _free(self) -> str:
        kind = "" if self._version > 1 else "Slave" if self._co_simulation else "Model"
        return f"fmi{self._version}Free{kind}Instance"

    @property
    def _co_simulation(self) -> bool:
        return self.spec.interface == CO_SIMULATION

    def _instantiate(self) -> None:
        spec = self.spec
        about = {
            "guid": spec.token,
            "unzipDirectory": spec.directory,
            "modelIdentifier": spec.identifier,
            "instanceName": spec.robot,
        }
        slaves = {1: fmi1.FMU1Slave, 2: fmi2.FMU2Slave, 3: fmi3.FMU3Slave}
        models = {1: fmi1.FMU1Model, 2: fmi2.FMU2Model, 3: fmi3.FMU3Model}
        self._threads = threads()
        try:
            with loading():  # FMPy goes to its folder, and stays there if that fails
                self._fmu = (slaves if self._co_simulation else models)[self._version](**about)
        except Exception as error:
            reason = str(error.__context__ or error)  # FMPy puts a sentence of its own before the system's
            raise PlantError(f"its binary cannot be loaded: {why_not_loaded(reason, spec.directory)}") from None
        for function in self._fmu._functions.values():
            if function.restype == ctypes.c_int:
                function.errcheck = _unsigned
        callbacks: dict[str, object]
        if self._version == 1:
            callbacks = {"functions": self.log.callbacks_1}
        elif self._version == 2:
            callbacks = {"callbacks": self.log.callbacks_2}
        else:
            # Without Event Mode, early return and intermediate update, which an FMU may offer but not demand
            # (FMI 3.0, section 4.2), it handles its events within a step.
            callbacks = {"logMessage": self.log.log_message}
        try:
            self._fmu.instantiate(loggingOn=spec.logging, **callbacks)
        except Exception as error:  # FMPy's bare one, where there is no instance; of FMI 1.0 slaves it overlooks that
            if type(error) is not Exception:
                raise
        if not self._fmu.component:
            raise NoInstance(self._reason("its instantiation failed"))

    def _initialise(self) -> None:
        fmu = self._fmu
        tolerance = self.spec.tolerance if self._co_simulation else None
        stop = self.spec.stop_time * (1.0 + 1e-12)  # the end of the last step is rounded, and some FMUs are strict
        if self._version == 1:
            self._initialise_1(stop)
        else:
            if self._version == 2:
                fmu.setupExperiment(tolerance=tolerance, startTime=0.0, stopTime=stop)
                fmu.enterInitializationMode()
            else:
                fmu.enterInitializationMode(tolerance=tolerance, startTime=0.0, stopTime=stop)
            self._give_inputs()
            fmu.exitInitializationMode()
        self._initialised = True
        self._numbers = (0, 0)
        if not self._co_simulation:
            if self._version > 1:
                self._update()
                fmu.enterContinuousTimeMode()
            self._numbers = self._counted()

    def _give_inputs(self) -> None:
        """Give the inputs their values at the start, which initial equations may use."""
        for value in self.spec.held:
            self._set(value)
        self.give(self.spec.inputs.start)

    def _initialise_1(self, stop: float) -> None:
        """Initialise an FMI 1.0 instance; of Co-Simulation, FMPy takes the status that is returned for a string."""
        if not self._co_simulation:
            self._fmu.setTime(0.0)
            self._give_inputs()
            if not self._heed(*_in_order(self._fmu.initialize())):
                self._update()
            return
        self._give_inputs()
        function = self._fmu.dll[f"{self.spec.identifier}_fmiInitializeSlave"]
        function.argtypes = (ctypes.c_void_p, ctypes.c_double, ctypes.c_char, ctypes.c_double)
        status = function(self.component, 0.0, fmi1.fmi1True, stop)
        if not 0 <= status <= WARNING:
            raise FMICallException("fmiInitializeSlave", _unsigned(status))

    def _update(self) -> None:
        """Iterate over the discrete states in Event Mode until they do not change any more."""
        fmu = self._fmu
        for _ in range(_MAX_EVENT_ITERATIONS):
            if self._version == 1:
                found = _in_order(fmu.eventUpdate())
            else:
                found = fmu.newDiscreteStates() if self._version == 2 else fmu.updateDiscreteStates()
            if self._heed(*found):
                return
        raise PlantError(f"{self._it}does not settle its discrete states in {_MAX_EVENT_ITERATIONS} iterations")

    def _heed(self, more: bool, end: bool, nominals: bool, values: bool, is_next: bool, next_event: float) -> bool:
        """Return whether the discrete states have settled, and keep the next time event."""
        if end:
            said = self.log.take()
            raise PlantError(f"{self._it}asks to end the simulation" + (f": {said}" if said else ""))
        if not more:
            self.next_event = float(next_event) if is_next else float("inf")
        return not more

    def _counted(self) -> tuple[int, int]:
        numbers = (self.spec.states, self.spec.event_indicators)
        if self._version == 3:
            numbers = (self._fmu.getNumberOfContinuousStates(), self._fmu.getNumberOfEventIndicators())
        if min(numbers) < 0 or max(numbers) > _MAX_STATES:
            raise PlantError(f"it reports {numbers[0]} continuous states and {numbers[1]} event indicators")
        return numbers

    def _reason(self, otherwise: str) -> str:
        """Return the FMU's messages; if there are none, another reason with a remedy."""
        return self.log.take() or "; ".join(filter(None, (otherwise, self._no_reason())))

    def _no_reason(self) -> str:
        """Return the remedy for an FMU that has logged nothing."""
        return "" if self.spec.logging else 'the FMU gives no reason; log="on" in its <plant> may show one'

    def _note(self, error: BaseException) -> None:
        if isinstance(error, FMICallException):
            self.status = max(self.status, error.status)

    def _setter(self, value: Value) -> str:
        """Return FMPy's function that sets a value."""
        return _SETTERS[value.type if value.type != "Enumeration" else ("Integer" if self._version < 3 else "Int64")]

    def _set_together(self, values: Iterable[Value]) -> None:
        """Set values in their order, by one call for all that follow each other and have the same type."""
        for setter, group in groupby(values, self._setter):
            same = list(group)
            numbers = [number for value in same for number in value.values]
            getattr(self._fmu, setter)([value.reference for value in same], numbers)

    def _set(self, value: Value) -> None:
        values = list(value.values)
        try:
            getattr(self._fmu, self._setter(value))([value.reference], values)
        except FMICallException as error:
            self._note(error)
            shown = " ".join(str(v) for v in values)
            raise PlantError(f"{self._it}refuses {value.name} = {shown}: {self._reason(str(error))}") from None


def _in_order(info: tuple[bool, bool, bool, bool, bool, float]) -> tuple[bool, bool, bool, bool, bool, float]:
    """Return the event information of FMI 1.0 in the form of FMI 2.0."""
    converged, names_changed, values_changed, end, is_next, next_event = info
    return (not converged, end, names_changed, values_changed, is_next, next_event)
