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
from typing import Any, ClassVar, NoReturn

import fmpy
from fmpy import fmi2
from fmpy.fmi1 import FMICallException, printLogMessage

from cosim.contract import BoundRole
from cosim.errors import InputError, Location, SimulationError, printable
from cosim.fmu import Fmu
from cosim.parameters import ParameterValue

_STATUS = ("OK", "Warning", "Discard", "Error", "Fatal", "Pending")
WARNING = 1
"""The largest status with which a run goes on."""

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
        self.outputs = fmu.binding.of((*contract.pose, *contract.velocity))
        self.inputs = (*fmu.binding.of(contract.torque), *inputs)

    @property
    def component(self) -> int:
        """The address of the instance."""
        return int(self._instance.component)

    @property
    def library(self) -> Any:
        """The FMU's shared library, as ctypes has loaded it."""
        return self._instance.dll

    def change(self, parameters: Iterable[ParameterValue], time: float) -> None:
        """Give parameters other values at a communication point [s].

        Raises
        ------
        SimulationError
            The FMU refuses a value: its own messages.
        """
        for parameter in parameters:
            try:
                self._set(parameter)
            except InputError as error:
                raise SimulationError(self.robot, time, f"{parameter.where}: {error.message}") from None

    def fail(self, what: str, status: int, time: float) -> NoReturn:
        """Raise the SimulationError of a call that did not succeed, with the FMU's own messages."""
        said = self._log.take()
        name = _STATUS[status] if status < len(_STATUS) else str(status)
        message = f"the plant {self.fmu.path.name} did not {what} (status {name})"
        raise SimulationError(self.robot, time, f"{message}: {said}" if said else message)

    def keep_messages(self, time: float) -> None:
        """Keep what the FMU has logged since the last time, as logged at a communication point [s]."""
        if (said := self._log.take()) and len(self.messages) < _KEPT_MESSAGES:
            self.messages.append(f"t = {time:.6g} s: {said}")

    @staticmethod
    def messages_received() -> bool:
        """Return whether any instance in this process has logged something that was not taken."""
        return any(_Log.open_logs.values())

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


class _Log:
    """The last messages of one instance.

    FMPy's proxy, which formats the variadic arguments of a message, knows a single Python function for the whole
    process; the component environment tells the instances apart.
    """

    _handles = itertools.count(1)
    open_logs: ClassVar[dict[int, deque[str]]] = {}

    def __init__(self) -> None:
        self._handle = next(self._handles)
        self.messages: deque[str] = deque(maxlen=_KEPT_MESSAGES)
        self.open_logs[self._handle] = self.messages
        self.callbacks = fmi2.fmi2CallbackFunctions()
        self.callbacks.logger = _logger
        self.callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        self.callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
        self.callbacks.componentEnvironment = self._handle
        fmpy.logging.addLoggerProxy(ctypes.byref(self.callbacks))

    @classmethod
    def receive(cls, handle: int | None, instance: bytes, status: int, category: bytes, message: bytes) -> None:
        if handle in cls.open_logs:
            cls.open_logs[handle].append(message.decode("utf-8", "replace"))
        else:  # an instance that something else in this process made through FMPy
            printLogMessage(handle, instance, status, category, message)

    def take(self) -> str:
        """Return the messages since the last time, printable, as one text."""
        text = printable(" ".join("; ".join(self.messages).split()))
        self.messages.clear()
        return text

    def close(self) -> None:
        self.open_logs.pop(self._handle, None)


_logger = fmi2.fmi2CallbackLoggerTYPE(_Log.receive)
