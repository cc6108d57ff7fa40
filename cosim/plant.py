"""One instance of a plant FMU, known to the master by its roles.

FMPy loads, instantiates, initialises and terminates. The exchange in the loop calls the FMU's own functions
(FMI 2.0, section 4.2) with arguments prepared once.
"""

from __future__ import annotations

import ctypes
import itertools
from collections import deque
from collections.abc import Iterable
from pathlib import Path
from typing import Any, ClassVar

import fmpy
import numpy as np
from fmpy import fmi2
from fmpy.fmi1 import FMICallException, printLogMessage
from numpy.typing import NDArray

from cosim.contract import BoundRole, unit_of
from cosim.errors import InputError, Location, SimulationError, nearest
from cosim.fmu import Fmu
from cosim.scenario import Setting, quantity

_STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")
_WARNING = 1
_KEPT_MESSAGES = 20


class Plant:
    """A vehicle as an FMI 2.0 Co-Simulation instance, initialised and at rest.

    Legal call order: `read` and `step` in any number, `close` once.

    Parameters
    ----------
    fmu
        The unpacked FMU.
    robot
        The robot that it is; the FMU's instance name.
    parameters
        Values for parameters of the FMU.
    pose
        Initial pose in the contract's units.
    stop_time
        End of the run [s].
    """

    def __init__(
        self, fmu: Fmu, robot: str, parameters: Iterable[Setting], pose: Iterable[float], stop_time: float
    ) -> None:
        self.robot = robot
        self.fmu = fmu
        contract = fmu.binding.contract
        values = [(setting, *_understand(fmu, setting)) for setting in parameters]
        self._log = _Log()
        self._instance = fmi2.FMU2Slave(
            guid=fmu.description.guid,
            unzipDirectory=str(fmu.directory),
            modelIdentifier=fmu.description.coSimulation.modelIdentifier,
            instanceName=robot,
        )
        try:
            self._instance.instantiate(callbacks=self._log.callbacks, loggingOn=False)
            for setting, variable, value in values:
                self._set(variable, value, setting.where)
            for bound, entry in zip(fmu.binding.of(contract.pose), pose, strict=True):
                self._set(bound.variable, entry / bound.scale, None)
            self._instance.setupExperiment(startTime=0.0, stopTime=stop_time)
            self._instance.enterInitializationMode()
            self._instance.exitInitializationMode()
        except FMICallException as error:
            self.close()
            raise InputError(f"the FMU {fmu.path} refuses to start as {robot}: {self._log.text() or error}") from None
        except Exception as error:  # FMPy raises a bare Exception when instantiation fails
            self.close()
            raise InputError(f"the FMU {fmu.path} cannot be started: {self._log.text() or error}") from None
        self._outputs = _Block(self._instance, "fmi2GetReal", fmu.binding.of((*contract.pose, *contract.velocity)))
        self._inputs = _Block(self._instance, "fmi2SetReal", fmu.binding.of(contract.torque))
        self._do_step = self._instance.dll["fmi2DoStep"]
        self._do_step.argtypes = (ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)

    def step(self, time: float, step: float, torque: NDArray[np.float64]) -> None:
        """Hold the torques (2,) [N.m] and advance from a communication point by one communication step [s].

        Raises
        ------
        SimulationError
            The FMU did not accept the torques or did not complete the step: its own messages.
        """
        np.divide(torque, self._inputs.scale, out=self._inputs.values)
        status = self._inputs.call()
        if status > _WARNING:
            raise self._failure("set the torques", status, time)
        status = self._do_step(self._instance.component, time, step, 1)
        if status > _WARNING:
            raise self._failure("complete the step", status, time)

    def read(self, time: float, out: NDArray[np.float64]) -> None:
        """Write pose and pseudo-velocities in the contract's units into `out` (6,).

        Raises
        ------
        SimulationError
            The FMU returns no outputs.
        """
        status = self._outputs.call()
        if status > _WARNING:
            raise self._failure("return its outputs", status, time)
        np.multiply(self._outputs.values, self._outputs.scale, out=out)

    def geometry(self) -> dict[str, Any]:
        """Return the geometry that controllers are told, as the parameters of this instance say."""
        geometry: dict[str, Any] = {}
        for field, role in self.fmu.binding.contract.geometry.items():
            bound = self.fmu.binding.bound[role.name]
            reference = [bound.variable.valueReference]
            if bound.variable.type == "Enumeration":
                geometry[field] = _items(bound.variable)[self._instance.getInteger(reference)[0]]
            else:
                geometry[field] = self._instance.getReal(reference)[0] * bound.scale
        return geometry

    def close(self) -> None:
        """End the instance and release its library."""
        if self._instance.component:
            self._instance.freeInstance()
            self._instance.component = None
        self._log.close()

    def _set(self, variable: Any, value: float | int | bool | str, where: Location | None) -> None:
        setter = {
            "Real": self._instance.setReal,
            "Integer": self._instance.setInteger,
            "Enumeration": self._instance.setInteger,
            "Boolean": self._instance.setBoolean,
            "String": self._instance.setString,
        }[variable.type]
        try:
            setter([variable.valueReference], [value])
        except FMICallException as error:
            raise InputError(
                f"the FMU {self.fmu.path.name} refuses {variable.name} = {value}: {self._log.text() or error}",
                where,
            ) from None

    def _failure(self, what: str, status: int, time: float) -> SimulationError:
        name = _STATUS[status] if status < len(_STATUS) else str(status)
        said = self._log.text()
        return SimulationError(
            self.robot,
            time,
            f"the plant {self.fmu.path.name} did not {what} (status {name})" + (f": {said}" if said else ""),
        )


class _Block:
    """Real variables that are exchanged together: ``fmi2GetReal`` or ``fmi2SetReal`` with prepared arguments."""

    def __init__(self, instance: Any, function: str, bound: tuple[BoundRole, ...]) -> None:
        self.values = np.zeros(len(bound))
        self.scale = np.array([role.scale for role in bound])
        self._references = np.array([role.variable.valueReference for role in bound], dtype=np.uint32)
        self._function = instance.dll[function]
        self._function.argtypes = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p)
        self._arguments = (
            instance.component,
            self._references.ctypes.data,
            len(bound),
            self.values.ctypes.data,
        )

    def call(self) -> int:
        return int(self._function(*self._arguments))


class _Log:
    """The last messages of one instance.

    FMPy's proxy, which formats the variadic arguments of a message, knows a single Python function for the whole
    process; the component environment tells the instances apart.
    """

    _handles = itertools.count(1)
    _open: ClassVar[dict[int, deque[str]]] = {}

    def __init__(self) -> None:
        self._handle = next(self._handles)
        self.messages: deque[str] = deque(maxlen=_KEPT_MESSAGES)
        self._open[self._handle] = self.messages
        self.callbacks = fmi2.fmi2CallbackFunctions()
        self.callbacks.logger = _logger
        self.callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        self.callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
        self.callbacks.componentEnvironment = self._handle
        fmpy.logging.addLoggerProxy(ctypes.byref(self.callbacks))

    @classmethod
    def receive(cls, handle: int | None, instance: bytes, status: int, category: bytes, message: bytes) -> None:
        if handle in cls._open:
            cls._open[handle].append(message.decode("utf-8", "replace"))
        else:  # an instance that something else in this process made through FMPy
            printLogMessage(handle, instance, status, category, message)

    def text(self) -> str:
        return "; ".join(self.messages)

    def close(self) -> None:
        self._open.pop(self._handle, None)


_logger = fmi2.fmi2CallbackLoggerTYPE(_Log.receive)


# Parameters -------------------------------------------------------------------------------------------------


def _understand(fmu: Fmu, setting: Setting) -> tuple[Any, float | int | bool | str]:
    """Return the variable that a setting is for, and the value in the variable's own unit."""
    parameters = {v.name: v for v in fmu.description.modelVariables if v.causality == "parameter"}
    file = Path(fmu.path).name
    if setting.name not in parameters:
        raise InputError(
            f"the FMU {file} has no parameter {setting.name!r}: {nearest(setting.name, list(parameters))}",
            setting.where,
        )
    variable = parameters[setting.name]
    try:
        return variable, _value(fmu, variable, setting.value)
    except ValueError as error:
        raise InputError(f"parameter {setting.name} of {file}: {error}", setting.where) from None


def _value(fmu: Fmu, variable: Any, text: str) -> float | int | bool | str:
    if variable.type == "Real":
        return _in_bounds(variable, _real(fmu, variable, text), text)
    if variable.type == "Integer":
        try:
            return int(_in_bounds(variable, int(text), text))
        except ValueError:
            raise ValueError(f"{text!r} is not a whole number within the bounds") from None
    if variable.type == "Enumeration":
        items = {name: value for value, name in _items(variable).items()}
        if text not in items:
            raise ValueError(f"{text!r} is none of its items: {nearest(text, list(items))}")
        return items[text]
    if variable.type == "Boolean":
        if text not in ("true", "false"):
            raise ValueError(f"{text!r} is neither true nor false")
        return text == "true"
    return text


def _real(fmu: Fmu, variable: Any, text: str) -> float:
    has_unit = variable.unit or (variable.declaredType and variable.declaredType.unit)
    return quantity(text, unit_of(fmu.description, variable) if has_unit else "1")


def _in_bounds(variable: Any, value: float, text: str) -> float:
    for name, violates in (("min", float.__lt__), ("max", float.__gt__)):
        bound = getattr(variable, name) or getattr(variable.declaredType, name, None)
        if bound is not None and violates(float(value), float(bound)):
            word = {"min": "at least", "max": "at most"}[name]
            raise ValueError(f"{text} is out of bounds; it must be {word} {bound} {variable.unit or ''}".rstrip())
    return value


def _items(variable: Any) -> dict[int, str]:
    return {int(item.value): str(item.name) for item in variable.declaredType.items}
