"""One instance of a plant FMU, known to the master by its roles.

FMPy loads, instantiates, initialises and terminates. The exchange in the loop calls the FMU's own functions
(FMI 2.0, section 4.2) with arguments prepared once.
"""

from __future__ import annotations

import ctypes
import itertools
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from typing import Any, ClassVar

import fmpy
import numpy as np
from fmpy import fmi2
from fmpy.fmi1 import FMICallException, printLogMessage
from numpy.typing import NDArray

from cosim.contract import BoundRole
from cosim.errors import InputError, Location, SimulationError, printable
from cosim.fmu import Fmu
from cosim.parameters import ParameterValue

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
    where
        The place in the scenario that asks for it.
    inputs
        Inputs of the FMU that are given besides the torques.

    Attributes
    ----------
    messages : list of str
        What the FMU logged while it ran, with the time; the first ones.

    Raises
    ------
    InputError
        The FMU cannot be loaded, or refuses to start: its own messages.
    """

    def __init__(
        self,
        fmu: Fmu,
        robot: str,
        parameters: Iterable[ParameterValue],
        pose: Iterable[float],
        stop_time: float,
        where: Location | None = None,
        inputs: Iterable[BoundRole] = (),
    ) -> None:
        self.robot = robot
        self.fmu = fmu
        self.messages: list[str] = []
        self._log = _Log()
        self._instance: Any = None
        self._initialised = False
        contract = fmu.binding.contract
        try:
            self._instance = fmi2.FMU2Slave(
                guid=fmu.description.guid,
                unzipDirectory=str(fmu.directory),
                modelIdentifier=fmu.description.coSimulation.modelIdentifier,
                instanceName=robot,
            )
            self._instance.instantiate(callbacks=self._log.callbacks, loggingOn=False)
            for parameter in parameters:
                self._set(parameter)
            for bound, entry in zip(fmu.binding.of(contract.pose), pose, strict=True):
                self._instance.setReal([bound.variable.valueReference], [entry / bound.scale])
            self._instance.setupExperiment(startTime=0.0, stopTime=stop_time)
            self._instance.enterInitializationMode()
            self._instance.exitInitializationMode()
            self._initialised = True
        except InputError:
            self.close()
            raise
        except Exception as error:  # FMPy raises a bare Exception where loading or instantiation fails
            said = self._log.take() or str(error)
            self.close()
            raise InputError(f"the FMU {fmu.path} cannot be started as {robot}: {said}", where) from None
        self._outputs = _Block(self._instance, "fmi2GetReal", fmu.binding.of((*contract.pose, *contract.velocity)))
        self._inputs = _Block(self._instance, "fmi2SetReal", (*fmu.binding.of(contract.torque), *inputs))
        self._do_step = self._instance.dll["fmi2DoStep"]
        self._do_step.argtypes = (ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)

    def step(
        self,
        time: float,
        step: float,
        torque: NDArray[np.float64],
        inputs: NDArray[np.float64] | tuple[()] = (),
        changes: Iterable[ParameterValue] = (),
    ) -> None:
        """Hold the torques (2,) [N.m] and other inputs, and advance from a communication point by one step [s].

        Parameters that change do so before.

        Raises
        ------
        SimulationError
            The FMU did not accept the values or did not complete the step: its own messages.
        """
        for change in changes:
            try:
                self._set(change)
            except InputError as error:
                raise SimulationError(self.robot, time, f"{change.where}: {error.message}") from None
        self._inputs.values[:2] = torque
        self._inputs.values[2:] = inputs
        self._inputs.values /= self._inputs.scale
        self._check(self._inputs.call(), "accept its inputs", time)
        self._check(self._do_step(self._instance.component, time, step, 1), "complete the step", time)

    def read(self, time: float, out: NDArray[np.float64]) -> None:
        """Write pose and pseudo-velocities in the contract's units into `out` (6,).

        Raises
        ------
        SimulationError
            The FMU returns no outputs.
        """
        self._check(self._outputs.call(), "return its outputs", time)
        np.multiply(self._outputs.values, self._outputs.scale, out=out)

    def close(self) -> None:
        """Terminate the instance, free it and release its library."""
        if self._instance is not None and self._instance.component:
            if self._initialised:
                with suppress(FMICallException):  # refused after a failed step
                    self._instance.terminate()
            self._instance.freeInstance()
            self._instance.component = None
        self._log.close()

    def _set(self, parameter: ParameterValue) -> None:
        setter = {
            "Real": self._instance.setReal,
            "Integer": self._instance.setInteger,
            "Enumeration": self._instance.setInteger,
            "Boolean": self._instance.setBoolean,
            "String": self._instance.setString,
        }[parameter.variable.type]
        try:
            setter([parameter.variable.valueReference], [parameter.value])
        except FMICallException as error:
            what = f"{parameter.variable.name} = {parameter.value}"
            said = self._log.take() or error
            raise InputError(f"the FMU {self.fmu.path.name} refuses {what}: {said}", parameter.where) from None

    def _check(self, status: int, what: str, time: float) -> None:
        if status == 0 and not self._log.messages:
            return
        said = self._log.take()
        if status > _WARNING:
            name = _STATUS[status] if status < len(_STATUS) else str(status)
            message = f"the plant {self.fmu.path.name} did not {what} (status {name})"
            raise SimulationError(self.robot, time, f"{message}: {said}" if said else message)
        if said and len(self.messages) < _KEPT_MESSAGES:
            self.messages.append(f"t = {time:.6g} s: {said}")


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

    def take(self) -> str:
        """Return the messages since the last time, printable, as one text."""
        text = printable(" ".join("; ".join(self.messages).split()))
        self.messages.clear()
        return text

    def close(self) -> None:
        self._open.pop(self._handle, None)


_logger = fmi2.fmi2CallbackLoggerTYPE(_Log.receive)
