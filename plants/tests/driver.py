"""An FMU's C functions called directly, with no more than the standard library: for any version and interface of FMI.

`python driver.py LIBRARY FMI TOKEN TIME SEED N` calls them N times in random order with random arguments, by each
interface, in a process of its own: for a library that was compiled with sanitizers.
"""

import ctypes
import math
import random
import sys
from collections.abc import Callable, Sequence
from typing import Any

OK, WARNING, DISCARD, ERROR = range(4)
INTERFACES = ("model_exchange", "co_simulation")

_double, _size, _int, _pointer = ctypes.c_double, ctypes.c_size_t, ctypes.c_int, ctypes.c_void_p


class _Callbacks2(ctypes.Structure):
    LOGGER = ctypes.CFUNCTYPE(None, _pointer, ctypes.c_char_p, _int, ctypes.c_char_p, ctypes.c_char_p)
    _fields_ = [("logger", LOGGER)] + [(name, _pointer) for name in ("allocate", "free", "finished", "environment")]


_LOGGER3 = ctypes.CFUNCTYPE(None, _pointer, _int, ctypes.c_char_p, ctypes.c_char_p)


class Library:
    """The functions of an FMU; `time` is the value reference of the time, the last one."""

    def __init__(self, path: str, fmi: str, token: str, time: int) -> None:
        self.path, self.fmi, self.token, self.time = path, fmi, token.encode(), time
        self._dll = ctypes.CDLL(str(path))

    def __call__(self, name: str, *arguments: Any) -> int:
        """Call a function by its name without the prefix; numbers stand for themselves, floats for double."""
        function = self._dll[("fmi2" if self.fmi == "2.0" else "fmi3") + name]
        function.restype = _int
        return int(function(*(_double(a) if isinstance(a, float) else a for a in arguments)))

    def instantiate(
        self,
        interface: str,
        log: Callable[[int, str, str], None] | None,
        name: bytes | None = b"one",
        *,
        event_mode: bool = False,
        intermediate: int = 0,
    ) -> Any:
        """Return an instance's address (or None) and what must be kept as long as it lives."""
        if self.fmi == "2.0":
            callbacks = _Callbacks2()
            if log:
                callbacks.logger = _Callbacks2.LOGGER(lambda e, n, s, c, m: log(s, c.decode(), m.decode()))
            arguments = [name, INTERFACES.index(interface), self.token, None, ctypes.byref(callbacks), 0, 0]
            function, kept = self._dll.fmi2Instantiate, callbacks
        else:
            kept = _LOGGER3(lambda e, s, c, m: log(s, c.decode(), m.decode())) if log else _LOGGER3()
            function = self._dll["fmi3Instantiate" + interface.title().replace("_", "")]
            of_interface = {
                "model_exchange": [None, kept],
                "co_simulation": [event_mode, False, None, _size(intermediate), None, kept, None],
                "scheduled_execution": [None, kept, None, None, None],
            }
            arguments = [name, self.token, None, False, log is not None, *of_interface[interface]]
        function.restype = _pointer
        return function(*arguments), kept

    def free(self, address: Any) -> None:
        self("FreeInstance", address)


class Instance:
    """One instance; methods return values and raise `Refused`, `messages` holds what was logged."""

    def __init__(self, library: Library, interface: str) -> None:
        self.library, self.interface = library, interface
        self.messages: list[tuple[int, str, str]] = []
        self.statuses: set[int] = set()
        address, self._kept = library.instantiate(interface, lambda *message: self.messages.append(message))
        self.address = _pointer(address)

    def call(self, name: str, *arguments: Any) -> int:
        """Call a function, and return its status unless that is an error."""
        status = self.library(name, self.address, *arguments)
        self.statuses.add(status)
        if status > WARNING:
            raise Refused(name, status, self.messages[-1][2] if self.messages else "")
        return status

    def free(self) -> None:
        self.library.free(self.address)

    @property
    def is_2(self) -> bool:
        return self.library.fmi == "2.0"

    def _values(self, verb: str, kind: str, references: Sequence[int], values: Any) -> Any:
        n = len(references)
        counts = () if self.is_2 else (_size(n),)
        self.call(f"{verb}{kind}", (ctypes.c_uint * n)(*references), _size(n), values, *counts)
        return values

    def get(self, *references: int) -> list[float]:
        kind = "Real" if self.is_2 else "Float64"
        return list(self._values("Get", kind, references, (_double * len(references))()))

    def set(self, values: dict[int, float]) -> None:
        kind = "Real" if self.is_2 else "Float64"
        self._values("Set", kind, list(values), (_double * len(values))(*values.values()))

    def set_enumeration(self, reference: int, value: int) -> None:
        kind, number = ("Integer", _int) if self.is_2 else ("Int64", ctypes.c_int64)
        self._values("Set", kind, [reference], (number * 1)(value))

    def initialize(self, time: float = 0.0) -> None:
        if self.is_2:
            self.call("SetupExperiment", 0, 0.0, time, 0, 0.0)
            self.call("EnterInitializationMode")
        else:
            self.call("EnterInitializationMode", False, 0.0, time, False, 0.0)

    def start(self, time: float = 0.0) -> "Instance":
        self.initialize(time)
        self.call("ExitInitializationMode")
        return self

    def step(self, time: float, step: float) -> int:
        if self.is_2:
            return self.call("DoStep", time, step, 1)
        flags, last = [ctypes.c_bool(True) for _ in range(3)], _double(math.nan)
        try:
            return self.call("DoStep", time, step, True, *map(ctypes.byref, flags), ctypes.byref(last))
        finally:
            self.last_successful_time = last.value
            self.flags = [flag.value for flag in flags]

    def reset(self) -> None:
        self.call("Reset")

    def save(self) -> Any:
        state = _pointer()
        self.call("GetFMUstate" if self.is_2 else "GetFMUState", ctypes.byref(state))
        return state

    def restore(self, state: Any) -> None:
        self.call("SetFMUstate" if self.is_2 else "SetFMUState", state)

    def forget(self, state: Any) -> None:
        self.call("FreeFMUstate" if self.is_2 else "FreeFMUState", ctypes.byref(state))

    def serialize(self, state: Any) -> bytes:
        size, word = _size(), "state" if self.is_2 else "State"
        self.call(f"SerializedFMU{word}Size", state, ctypes.byref(size))
        buffer = ctypes.create_string_buffer(size.value)
        self.call(f"SerializeFMU{word}", state, buffer, size)
        return buffer.raw

    def deserialize(self, data: bytes) -> Any:
        state = _pointer()
        name = "DeSerializeFMUstate" if self.is_2 else "DeserializeFMUState"
        self.call(name, data, _size(len(data)), ctypes.byref(state))
        return state

    def differentiate(
        self, unknowns: Sequence[int], knowns: Sequence[int], seed: Sequence[float], *, adjoint: bool = False
    ) -> list[float]:
        n, m, k = len(unknowns), len(knowns), len(knowns if adjoint else unknowns)
        result = (_double * k)()
        lists = ((ctypes.c_uint * n)(*unknowns), _size(n), (ctypes.c_uint * m)(*knowns), _size(m))
        seeds, sizes = (_double * len(seed))(*seed), (_size(len(seed)), _size(k))
        name = "GetAdjointDerivative" if adjoint else "GetDirectionalDerivative"
        self.call(name, *lists, seeds, *((result,) if self.is_2 else (sizes[0], result, sizes[1])))
        return list(result)

    # ---- Model Exchange ----

    def enter_continuous_time(self) -> None:
        if self.is_2:
            self.call("NewDiscreteStates", (_double * 8)())  # more than large enough for a fmi2EventInfo
        else:
            flags = [ctypes.c_bool(True) for _ in range(5)]
            self.call("UpdateDiscreteStates", *map(ctypes.byref, flags), ctypes.byref(_double()))
            assert not any(flag.value for flag in flags)
        self.call("EnterContinuousTimeMode")

    def place(self, time: float, states: Sequence[float]) -> None:
        self.call("SetTime", time)
        self.call("SetContinuousStates", (_double * len(states))(*states), _size(len(states)))

    def derivatives(self, n: int) -> list[float]:
        values = (_double * n)()
        self.call("GetDerivatives" if self.is_2 else "GetContinuousStateDerivatives", values, _size(n))
        return list(values)

    def complete_step(self) -> int:
        flags = [_int(1), _int(1)] if self.is_2 else [ctypes.c_bool(True), ctypes.c_bool(True)]
        status = self.call("CompletedIntegratorStep", 1, *map(ctypes.byref, flags))
        assert not any(flag.value for flag in flags)
        return status


class Refused(Exception):
    """A function returned a status worse than a warning."""

    def __init__(self, name: str, status: int, message: str) -> None:
        super().__init__(f"{name}: status {status}: {message}")
        self.status = status


def call_at_random(library: Library, interface: str, seed: int, n: int) -> dict[str, int]:
    """Call functions in random order with random arguments; return how often each status came.

    Pointers are valid or null and buffers have the stated size, as in any C interface; all other values are arbitrary.
    """
    rng = random.Random(seed)
    is_2 = library.fmi == "2.0"
    size_limit = 6
    numbers = [0.0, 0.02, 0.5, 1.5, -1.0, 3.2, 1e-300, 1e300, math.nan, math.inf, -math.inf]
    fmu = Instance(library, interface)
    states: list[Any] = []
    counted = {"accepted": 0, "refused": 0, "steps": 0, "wrong status": 0}

    def number() -> float:
        return rng.choice(numbers) if rng.random() < 0.3 else rng.uniform(-2.0, 2.0)

    def rarely_null(value: Any) -> Any:
        return None if rng.random() < 0.03 else value

    def size() -> int:
        return rng.randrange(size_limit + 1)

    def references(k: int) -> Any:
        pool = [rng.randrange(library.time + 3) for _ in range(k)]
        if rng.random() < 0.05 and k:
            pool[0] = rng.choice([2**31, 2**32 - 1, 1000])
        return rarely_null((ctypes.c_uint * size_limit)(*pool))

    def reals(k: int = size_limit) -> Any:
        return rarely_null((_double * 64)(*(number() for _ in range(k))))

    def counts(k: int) -> tuple[Any, ...]:
        return () if is_2 else (_size(k if rng.random() < 0.95 else k + 1),)

    def values(verb: str, kind: str) -> None:
        k = size()
        numbers_ = {"Integer": _int, "Int64": ctypes.c_int64}.get(kind)
        held = (numbers_ * 64)(*(rng.choice([1, 2, 3, -1, 9]) for _ in range(k))) if numbers_ else reals(k)
        fmu.call(f"{verb}{kind}", references(k), _size(k), rarely_null(held), *counts(k))

    def differentiate(name: str) -> None:
        k, m = size(), size()
        seeds = reals()
        if is_2:
            fmu.call(name, references(k), _size(k), references(m), _size(m), seeds, reals())
        else:
            pair = (m, k) if "Directional" in name else (k, m)
            fmu.call(
                name, references(k), _size(k), references(m), _size(m), seeds, _size(pair[0]), reals(), _size(pair[1])
            )

    def arrays(name: str) -> None:
        fmu.call(name, reals(), _size(rng.choice([0, 6, 6, 6, 5])))

    def save() -> None:
        states.append(fmu.save())

    def any_state() -> Any:
        return rng.choice([*states, _pointer()])

    def deserialize() -> None:
        state = fmu.save()
        try:
            data = bytearray(fmu.serialize(state))
        finally:
            fmu.forget(state)
        for _ in range(rng.randrange(4)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        if rng.random() < 0.1:
            data = data[: rng.randrange(len(data))]
        states.append(fmu.deserialize(bytes(data)))

    def forget() -> None:
        if states:
            fmu.forget(states.pop(rng.randrange(len(states))))

    def experiment() -> None:
        name = "SetupExperiment" if is_2 else "EnterInitializationMode"
        fmu.call(name, rng.random() < 0.5, number(), number(), rng.random() < 0.2, number())

    def step() -> None:
        time = fmu.get(library.time)[0]
        fmu.step(rng.choice([time, time, number()]), rng.choice([0.02, 0.02, 0.1, number()]))
        counted["steps"] += 1

    real, whole = ("Real", "Integer") if is_2 else ("Float64", "Int64")
    calls: list[Callable[[], Any]] = [
        *[lambda: fmu.start(rng.choice([0.0, 1.0]))] * 8,
        *[step] * 12,
        *[lambda: values("Set", real), lambda: values("Get", real)] * 3,
        *[lambda: values("Set", whole), lambda: values("Get", whole)] * 2,
        *[lambda kind=kind, verb=verb: values(verb, kind) for kind in ("Boolean", "String") for verb in ("Get", "Set")],
        experiment,
        *[fmu.reset] * 3,
        save,
        forget,
        deserialize,
        lambda: fmu.restore(any_state()),
        lambda: differentiate("GetDirectionalDerivative"),
        lambda: fmu.enter_continuous_time(),
        lambda: fmu.place(number(), [number() for _ in range(6)]),
        lambda: fmu.complete_step(),
        *[
            lambda name=name: arrays(name)
            for name in ("SetContinuousStates", "GetContinuousStates", "GetNominalsOfContinuousStates")
        ],
        lambda: arrays("GetDerivatives" if is_2 else "GetContinuousStateDerivatives"),
        lambda: fmu.call("GetEventIndicators", reals(), _size(rng.randrange(2))),
        *[lambda name=name: fmu.call(name) for name in ("ExitInitializationMode", "Terminate", "EnterEventMode")],
        lambda: fmu.call("SetTime", number()),
        lambda: fmu.call("SetDebugLogging", rng.random() < 0.9, _size(0), None),
        lambda: fmu.call("SetDebugLogging", 1, _size(1), (ctypes.c_char_p * 1)(rng.choice([b"logAll", b"x", None]))),
    ]
    if is_2:
        orders = (_int * size_limit)(1, 1, 1, 1, 1, 2)
        kinds = ("Real", "Integer", "Boolean", "String", "")
        calls += [
            lambda: fmu.call(
                "SetRealInputDerivatives", references(k := size()), _size(k), rarely_null(orders), reals()
            ),
            lambda: fmu.call("GetRealOutputDerivatives", references(1), _size(1), orders, reals()),
            lambda: fmu.call("EnterInitializationMode"),
            lambda: fmu.call("CancelStep"),
            lambda: fmu.call(f"Get{rng.choice(kinds)}Status", rng.randrange(-1, 5), reals()),
        ]
    else:
        count = _size()
        typeless = ("Float32", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "UInt64")
        unsupported = ("EnterStepMode", "EnterConfigurationMode", "ExitConfigurationMode", "EvaluateDiscreteStates")
        calls += [
            lambda: differentiate("GetAdjointDerivative"),
            lambda: values(rng.choice(["Get", "Set"]), rng.choice(typeless)),
            lambda: fmu.call(rng.choice(unsupported)),
            lambda: fmu.call("GetNumberOfContinuousStates", rarely_null(ctypes.byref(count))),
            lambda: fmu.call("GetNumberOfEventIndicators", rarely_null(ctypes.byref(count))),
            lambda: fmu.call("GetNumberOfVariableDependencies", rng.randrange(99), ctypes.byref(count)),
            lambda: fmu.call("GetClock", references(k := size()), _size(k), reals()),
            lambda: fmu.call("GetBinary", references(k := size()), _size(k), reals(), reals(), _size(k)),
            lambda: fmu.call("GetOutputDerivatives", references(1), _size(1), reals(), reals(), _size(1)),
            lambda: fmu.call("ActivateModelPartition", 1, number()),
            lambda: fmu.call("GetIntervalDecimal", references(1), _size(1), reals(), reals()),
        ]

    for _ in range(n):
        try:
            rng.choice(calls)()
            counted["accepted"] += 1
        except Refused as refusal:
            counted["refused" if refusal.status in (DISCARD, ERROR) else "wrong status"] += 1
    while states:
        fmu.forget(states.pop())
    fmu.free()
    return counted


if __name__ == "__main__":
    path, fmi, token, time, seed, n = sys.argv[1:]
    for interface in INTERFACES:
        print(call_at_random(Library(path, fmi, token, int(time)), interface, int(seed), int(n)))
