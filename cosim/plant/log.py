"""Messages of FMUs, instance by instance."""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Callable
from typing import ClassVar

import fmpy
import numpy as np
from fmpy import fmi1, fmi2
from numpy.typing import NDArray

from cosim.errors import printable
from cosim.plant.message import LastMessages, Message


class Log:
    """The last messages of one instance.

    FMPy's proxy, which formats the variadic arguments of a message, knows a single Python function for the whole
    process; the component environment tells instances of FMI 2.0 apart, the instance name those of FMI 1.0.

    Parameters
    ----------
    instance_name
        The name by which the FMU knows itself.
    """

    _handles = itertools.count(1)
    _open: ClassVar[dict[int, Log]] = {}
    pending: ClassVar[NDArray[np.int64]] = np.zeros(1, dtype=np.int64)
    """Number of messages received in this process and not taken as data: an array, for compiled code to look at."""
    listener: ClassVar[Callable[[Message], None] | None] = None
    """Called with every message as it comes."""

    def __init__(self, instance_name: str) -> None:
        self._handle = next(self._handles)
        self._name = instance_name.encode()
        self._messages = LastMessages()  # not reported yet
        self._received = 0
        self._taken = LastMessages()  # reported, but not taken as data
        self._pending = 0
        self._open[self._handle] = self

    @property
    def callbacks_1(self) -> ctypes.Structure:
        """The callback functions of FMI 1.0."""
        callbacks: ctypes.Structure = fmi1.fmi1CallbackFunctions()
        callbacks.logger = _logger_1
        callbacks.allocateMemory = fmi1.fmi1CallbackAllocateMemoryTYPE(fmpy.calloc)
        callbacks.freeMemory = fmi1.fmi1CallbackFreeMemoryTYPE(fmpy.free)
        fmpy.logging.addLoggerProxy(ctypes.byref(callbacks))
        return callbacks

    @property
    def callbacks_2(self) -> ctypes.Structure:
        """The callback functions of FMI 2.0."""
        callbacks: ctypes.Structure = fmi2.fmi2CallbackFunctions()
        callbacks.logger = _logger_2
        callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
        callbacks.componentEnvironment = self._handle
        fmpy.logging.addLoggerProxy(ctypes.byref(callbacks))
        return callbacks

    def log_message(self, _: int | None, status: int, category: bytes, message: bytes) -> None:
        """Take a message of an FMI 3.0 instance."""
        self._keep(Message.of(status, category, message))

    @classmethod
    def receive(cls, handle: int | None, instance: bytes, status: int, category: bytes, message: bytes) -> None:
        """Take a message that has come through FMPy's proxy."""
        log = cls._open.get(handle or 0)
        if log is None:
            log = next((log for log in cls._open.values() if log._name == instance), None)
        if log is not None:
            log._keep(Message.of(status, category, message))
        else:  # an instance that something else in this process made through FMPy
            fmi1.printLogMessage(handle, instance, status, category, message)

    def _keep(self, message: Message) -> None:
        self._received += 1
        self._pending += 1
        Log.pending[0] += 1
        self._messages.add([message])
        if Log.listener is not None:
            Log.listener(message)

    def take(self) -> str:
        """Return the messages since the last time, printable, as one text."""
        if not self._received:
            return ""
        text = printable(" ".join("; ".join(message.text for message in self._messages).split()))
        if len(self._messages) == 1 < self._received:
            text = f"{text} ({self._received} times)"
        elif self._received > len(self._messages):
            text = f"{self._received} messages, the last of them: {text}"
        self._taken.add(self._messages.take())
        self._received = 0
        return text

    def take_data(self) -> list[Message]:
        """Return the messages since the last time that it was called, those that `take` has told as well."""
        self.take()
        Log.pending[0] -= self._pending
        self._pending = 0
        return self._taken.take()

    @classmethod
    def begin_anew(cls) -> None:
        """Forget all instances: those of the process that this one was forked from."""
        cls._open.clear()

    def close(self) -> None:
        """Forget the instance."""
        self.take_data()
        self._open.pop(self._handle, None)


_logger_1 = fmi1.fmi1CallbackLoggerTYPE(Log.receive)
_logger_2 = fmi2.fmi2CallbackLoggerTYPE(Log.receive)
