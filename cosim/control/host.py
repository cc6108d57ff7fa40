"""The host of the control laws of another Python environment: one file, which that environment's interpreter runs.

It needs the standard library, NumPy and `formation_controllers` of that environment, any release that speaks version 1
of the controllers' interface; the package that this file belongs to is out of its sight, but for two files:
`cosim.plant.intrinsics`, to compile what shares memory, and `cosim.undisturbed`. The harness imports the same functions
for laws of its own: `described`, `checked_gains`, `said` and the layout of the shared memory.

Requests come through standard input and replies go through standard output, both moved out of the laws' reach first.
A frame is a kind (one byte), a length (four bytes, the least significant first) and that many bytes of JSON. The
numbers of a tick lie in memory that both sides share; whoever waits looks at a number there before it sleeps, as in
`cosim.plant.bells`. Numba, which the laws need anyway, makes the exchange of that number atomic; without it both sides
ring through the pipes alone.

An FMU is a harness of its own kind. It has no Python and shares no memory: see `_Alone`.
"""

from __future__ import annotations

import base64
import ctypes
import hashlib
import inspect
import json
import mmap
import os
import runpy
import struct
import sys
import threading
import time
import traceback
from collections import namedtuple
from contextlib import suppress
from functools import cache
from importlib.util import find_spec

TYPE_CHECKING = False
if TYPE_CHECKING:  # a host starts without
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
    from typing import Any

HEADER = struct.Struct("<BI")
_TICK = struct.Struct("=qq")
SPOKEN = "1"
"""First number of the versions of the controllers' interface that a host speaks."""
PUBLIC = "formation_controllers"

DESCRIBE, STEP, GAINS, TEAMS, FAILURE, NOT_FINITE, RESET, STATE, GO_ON, LIST = range(10)
"""Requests.

Describe a law; run a tick; check gains; make the teams of a run; tell why a tick has failed, or why commands are not
finite; lead a team back to before its start; tell the state of a team as bytes, or let it go on from some; list
the laws that are installed.
"""
DONE, FAILED = range(2)
"""Replies."""
AS_COMPILED, FIRST, STEP_BY_STEP = range(3)
"""How a tick is run: by the law's compiled tick where it has one; after its start; by its Python methods."""

AWAKE, ASLEEP, BY_PIPE = range(3)
"""What whoever waits says beside the number at which it looks, see `cosim.plant.bells`."""
SAYS = 8

_PATIENCE = 50e-6
"""Time [s] to look before going to sleep."""
_MOST = 2**16
"""Most ticks in a row without looks: after each look in vain they are twice as many and one more, after a tick half."""
_ROUNDS = 30_000
"""Looks between two of the clock, which take some microseconds."""
_PACKAGE = os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir)
_INTRINSICS = os.path.join(_PACKAGE, "plant", "intrinsics.py")
"""What compiled code needs for shared memory, which an FMU does without."""
_UNDISTURBED = os.path.join(_PACKAGE, "undisturbed.py")
"""What the harness's processes do about signals; an FMU's does nothing."""
_ORPHAN_CHECK = 1.0
_PR_SET_PDEATHSIG, _SIGKILL = 1, 9
_LINE = 64
"""Bytes of a cache line, at which arrays begin."""
_WORDS = 3

_OLDEST = (3, 11)
_NOT_RUN = ("__pycache__", "tests")
_EXAMPLES = os.path.join("cosim", "scenarios")
"""Folders of a package on which no run depends, and the one with the examples of a wheel of Formation."""


# Words about laws, for laws of this process and of a host alike -----------------------------------------------------


def described(law: Any) -> dict[str, Any]:
    """Return what a law states about itself, as JSON can hold it.

    That is its interface version, vehicles, needs, signals, and gains with their defaults and facts.
    """
    from dataclasses import asdict, fields

    return {
        "interface": law.interface,
        "vehicles": list(law.vehicles),
        "needs": list(getattr(law, "needs", ())),
        "signals": [asdict(signal) for signal in law.signals],
        "gain_facts": {
            field.name: {"default": field.default, **asdict(field.metadata["gain"])} for field in fields(law.gains_type)
        },
    }


def content_of(*modules: str) -> str:
    """Return a checksum of all files of the packages that modules belong to.

    They count as they were when they were first asked for, as Python imports them once. Tests, compiled Python, hidden
    files, and the scenarios that a wheel of Formation brings as examples do not count.
    """
    digest = hashlib.sha256()
    for package in sorted(set(map(_package, modules))):
        with suppress(ImportError, ValueError):  # it is gone, or was no file ever
            spec = find_spec(package)
            for root in () if spec is None else spec.submodule_search_locations or [spec.origin or ""]:
                digest.update(_content(root))
    return digest.hexdigest()


@cache
def _content(root: str) -> bytes:
    digest = hashlib.sha256()
    for file in [root] if os.path.isfile(root) else sorted(_files_in(root)):
        name = os.path.relpath(file, os.path.dirname(root)).replace(os.sep, "/")
        with suppress(OSError), open(file, "rb") as opened:  # an editor may have links to nowhere beside them
            its = hashlib.file_digest(opened, "sha256").hexdigest()
            digest.update(f"{name}\0{its}\0".encode("utf-8", "surrogateescape"))
    return digest.digest()


def _files_in(root: str) -> Iterator[str]:
    for folder, inside, files in os.walk(root):
        inside[:] = [
            name
            for name in inside
            if not (name in _NOT_RUN or name.startswith(".") or os.path.join(folder, name).endswith(_EXAMPLES))
        ]
        paths = (os.path.join(folder, name) for name in files if not name.startswith("."))
        yield from filter(os.path.isfile, paths)


class GainFault(Exception):
    """A gain is wrong: a sentence, and the place of its setting; -1 if none is at fault."""

    def __init__(self, sentence: str, place: int = -1) -> None:
        super().__init__(sentence, place)  # so that it pickles
        self.place = place

    def __str__(self) -> str:
        return str(self.args[0])


def checked_gains(law: Any, settings: Sequence[tuple[str, float | tuple[float, ...]]]) -> Any:
    """Return the gains of a law with some of them set.

    Raises
    ------
    GainFault
        One of them is wrong; they are set one by one, to tell which.
    """
    from formation_controllers.errors import GainError

    values: dict[str, Any] = {}
    try:
        if not settings:
            return law.gains_type()
        for name, value in settings:
            values[name] = value
            gains = law.gains_type.from_mapping(values)
        return gains
    except GainError as error:
        raise GainFault(str(error), len(values) - 1) from None
    except (Exception, SystemExit) as error:  # gains are other people's code, too
        raise GainFault(told(error, law), len(values) - 1) from None


def said(error: BaseException, law: type) -> str:
    """Return an exception of a law in words: of one that the package raises on purpose, its message."""
    from formation_controllers.errors import ControllerError

    return error.message if isinstance(error, ControllerError | NotFinite) else told(error, law)


def told(error: BaseException, law: type) -> str:
    """Return an exception of a control law in words: its type, its message, and the line of the law.

    Parameters
    ----------
    error
        The exception, with its traceback.
    law
        The class of the controller.
    """
    packages = {_package(base.__module__) for base in law.__mro__} - {PUBLIC, "abc", "builtins", "typing"}
    place = innermost(error, packages or {PUBLIC}) or _definition(law)
    return f"{type(error).__name__}: {error}" + (f", at {place}" if place else "")


def innermost(error: BaseException, packages: Collection[str]) -> str:
    """Return ``FILE:LINE`` of the innermost call within some packages that an exception went through; empty if none."""
    if isinstance(error, SyntaxError) and error.filename:
        return f"{error.filename}:{error.lineno}"
    place = ""
    for frame, line in traceback.walk_tb(error.__traceback__):
        file = frame.f_code.co_filename
        if _package(str(frame.f_globals.get("__name__") or _module_of(file))) in packages:
            place = f"{file}:{line}"
    return place


def _module_of(file: str) -> str:
    """Return the module of a file: frames of what Numba has compiled know their file alone."""
    modules = list(sys.modules.items())
    return next((name for name, module in modules if getattr(module, "__dict__", {}).get("__file__") == file), "")


def not_imported(error: BaseException, module: str) -> str:
    """Return why a law of a module could not be loaded; where that module failed, with the line."""
    place = innermost(error.__cause__, {_package(module)}) if error.__cause__ is not None else ""
    return f"{error}, at {place}" if place else str(error)


def _definition(law: type) -> str:
    with suppress(OSError, TypeError):  # the source is not at hand
        return f"{inspect.getsourcefile(law)}:{inspect.getsourcelines(law)[1]}"
    return ""


def _package(module: str) -> str:
    return module.partition(".")[0]


# A step of a law, for laws of this process and of a host alike ------------------------------------------------------


class NotFinite(ValueError):
    """Commands that a law has returned are not finite; the row of the first such follower."""

    def __init__(self, sentence: str, robot: int = 0) -> None:
        super().__init__(sentence, robot)  # so that it pickles
        self.message, self.robot = sentence, robot

    def __str__(self) -> str:
        return str(self.args[0])


def checked_commands(commands: Any, expected: tuple[int, ...]) -> Any:
    """Return the commands of a law as an array of finite numbers.

    Raises
    ------
    ValueError
        They have another shape than the one expected, or are not finite (`NotFinite`).
    """
    import numpy as np

    array = np.asarray(commands, dtype=float)
    if array.shape != expected:
        raise ValueError(f"it returned torques of shape {array.shape}, not {expected}")
    if not np.isfinite(array).all():
        raise not_finite(array)
    return array


def not_finite(commands: Any) -> NotFinite:
    """Return the error of commands of which some are not finite."""
    import numpy as np

    row = int(np.argmin(np.isfinite(commands).all(axis=1)))
    return NotFinite(f"the torque is {commands[row].tolist()}: it must be finite", row)


def telemetry_type(signals: Sequence[Any]) -> Any:
    """Return the type of a record of the signals that a law states."""
    import numpy as np

    return np.dtype([(s.name, np.float64, (len(s.components),) if s.components else ()) for s in signals])


def is_stated(record: Any, stated: Any, robots: int) -> bool:
    """Return whether telemetry is what its law states: a record a robot."""
    return bool(record.dtype == stated and record.shape == (robots,))


def numbers_of(record: Any) -> Any:
    """Return the numbers of telemetry, one record after the other; a view, where its memory is in one piece."""
    import numpy as np

    return np.ascontiguousarray(record).view(np.float64)


def row_of(error: BaseException) -> int | None:
    """Return the row of the follower that an error of a law is about; None if it is about no single one."""
    row = getattr(error, "robot", None)
    return row if isinstance(row, int) else None


# Vehicles as data ---------------------------------------------------------------------------------------------------


def stated(vehicle: Any) -> dict[str, Any]:
    """Return the facts of a vehicle, as JSON can hold them."""
    formation, torques = getattr(vehicle, "formation", None), getattr(vehicle, "torques", None)
    return {
        "kind": vehicle.kind,
        **{fact: [list(entry) for entry in getattr(vehicle, fact)] for fact in ("pose", "velocity", "command")},
        "geometry": [[*entry, getattr(vehicle, entry[0])] for entry in vehicle.geometry],
        "formation": None if formation is None else [formation.steering, formation.length],
        "torques": None if torques is None else [torques.form, torques.wheel_radius, torques.half_track],
    }


def _vehicle(facts: Mapping[str, Any]) -> Any:
    """Return a vehicle of such facts: of a class of `formation_controllers`, if that knows the kind."""
    from formation_controllers import vehicles

    geometry = {name: value for name, _, value in facts["geometry"]}
    for known in vars(vehicles).values():
        if isinstance(known, type) and getattr(known, "kind", None) == facts["kind"]:
            return known(**geometry)
    entries = {
        fact: tuple(vehicles.Entry(*entry[:2]) for entry in facts[fact])
        for fact in ("pose", "velocity", "command", "geometry")
    }
    others = {
        "formation": facts["formation"] and vehicles.FormationGeometry(*facts["formation"]),
        "torques": facts["torques"] and vehicles.TorqueMap(*facts["torques"]),
    }
    values = {"kind": facts["kind"], **entries, **others, **geometry}
    return namedtuple("Vehicle", values)(**values)


# Shared memory ------------------------------------------------------------------------------------------------------


class Board:
    """What the harness and a host share, as arrays on some memory.

    Attributes
    ----------
    current : ndarray of int
        The team whose law is called at the moment; -1 for none.
    told : ndarray
        How the tick is run, a number without use, and as an integer the core on which the harness works.
    tells : ndarray of int
        One more than the place of the team that has failed, 0 without one; 0; the core on which the host works.
    asked, answered : ndarray of int
        As in `cosim.plant.bells`.
    numbers : ndarray
        The inputs and outputs of all teams, one after the other.
    """

    def __init__(self, memory: Any, numbers: int) -> None:
        import numpy as np

        self._used = 0

        def take(size: int, kind: Any) -> Any:
            array = np.frombuffer(memory, kind, size, self._used)
            self._used += -(-size * 8 // _LINE) * _LINE
            return array

        self.current = take(1, np.int64)
        self.told = take(_WORDS, np.float64)
        self.tells = take(_WORDS, np.int64)
        self.asked, self.answered = take(2, np.int64), take(2, np.int64)
        self.numbers = take(numbers, np.float64)


def board_size(numbers: int) -> int:
    """Return the bytes of the memory of a board with so many numbers."""
    return 5 * _LINE + -(-max(numbers, 1) * 8 // _LINE) * _LINE


def lines_of(parts: Iterable[tuple[int, int]]) -> Any:
    """Return the addresses of the cache lines of some memory, parts of which have an address and a number of bytes."""
    import numpy as np

    lines = {line for at, size in parts for line in range(at - at % _LINE, at + size, _LINE)}
    return np.array(sorted(lines), dtype=np.int64)


INPUTS = ("pose", "velocity", "leader_pose", "leader_velocity", "leader_acceleration", "q_d", "q_d_dot", "q_d_ddot")
"""The inputs of a team, as in `formation_controllers.interface.TickInputs`."""


def shapes_of(size: int, poses: int, velocities: int, commands: int, telemetry: int) -> list[tuple[int, ...]]:
    """Return the shapes of a team's inputs, commands and telemetry, given its size and how many entries each has."""
    return [
        (size, poses),
        (size, velocities),
        (poses,),
        (velocities,),
        (velocities,),
        *[(size, 2)] * 3,
        (size, commands),
        (size, telemetry),
    ]


def parts_of(numbers: Any, shapes: Sequence[Sequence[tuple[int, ...]]]) -> Iterator[list[Any]]:
    """Return the arrays of each team, given the shapes of each: parts of the numbers of a board."""
    import math

    first = 0
    for own in shapes:
        arrays = []
        for shape in own:
            arrays.append(numbers[first : first + math.prod(shape)].reshape(shape))
            first += math.prod(shape)
        yield arrays


# Teams --------------------------------------------------------------------------------------------------------------


class _Team:
    """A law with its followers, whose inputs and outputs lie in shared memory."""

    def __init__(self, law: Any, about: Mapping[str, Any], arrays: list[Any]) -> None:
        from formation_controllers.interface import Desired, Leader, Team

        self.law = law
        gains = [checked_gains(law, [(name, _gain(value)) for name, value in own]) for own in about["gains"]]
        team = Team(_vehicle(about["vehicle"]), about["size"], about["period"])
        self.controller = law(team, gains[0] if about["shared"] else tuple(gains))
        *self._inputs, self._commands, self._telemetry = arrays
        pose, self._velocity, leader_pose, leader_velocity, acceleration, *desired = self._inputs
        self._given = pose, Leader(leader_pose, leader_velocity, acceleration if about["accelerates"] else None)
        self._desired = Desired(*desired)
        self._measured = "velocity" in getattr(law, "needs", ())
        self._dtype = telemetry_type(law.signals)
        self._call: Callable[[], None] | None = None
        self.compiled: tuple[Any, ...] | None = None
        """The call of its tick, and where its telemetry goes, for `_Compiled`; None if Python must call it."""
        self._prepare()

    @property
    def can_restart(self) -> bool:
        """Whether all numbers of the law are in its records, so that a reset makes it as good as new."""
        return self._call is not None

    def restart(self) -> bool:
        """Lead the law back to before its start, if it `can_restart`."""
        if not self.can_restart:
            return False
        self.controller.reset()
        return True

    def tick(self, how: float) -> None:
        """Fill commands and telemetry."""
        if how == AS_COMPILED and self._call is not None:
            self._call()
            return
        # A law may keep or change what it is given: it gets arrays of its own.
        pose, leader = self._given[0].copy(), type(self._given[1])(*(_copy(part) for part in self._given[1]))
        desired = type(self._desired)(*(part.copy() for part in self._desired))
        if how == FIRST:
            self.controller.start(pose, leader, desired)
        measured = {"velocity": self._velocity.copy()} if self._measured else {}
        command = self.controller.step(pose, leader, desired, **measured)
        self._commands[:] = checked_commands(command, self._commands.shape)
        record = self._record()
        if not is_stated(record, self._dtype, len(self._commands)):
            raise ValueError(f"its telemetry is {record.dtype.names}, not the signals that it states")
        self._telemetry[:] = numbers_of(record).reshape(self._telemetry.shape)

    def _record(self) -> Any:
        """Return the telemetry, one record a robot, also of a law whose interface has no such thing."""
        import numpy as np

        if hasattr(self.controller, "telemetry_record"):
            return self.controller.telemetry_record
        record = np.zeros(len(self._commands), self._dtype)
        for name, values in self.controller.telemetry().items():
            record[name] = values
        return record

    def not_finite(self) -> BaseException:
        """Return the error of commands that are not finite."""
        if hasattr(self.controller, "not_finite"):
            error: BaseException = self.controller.not_finite(self._commands.copy())
            return error
        return not_finite(self._commands)

    def state(self) -> bytes:
        """Return the state of the law as bytes."""
        state: bytes = self.controller.to_bytes()
        return state

    def go_on(self, state: bytes) -> None:
        """Go on from a state."""
        self.controller.from_bytes(state)

    def _prepare(self) -> None:
        """Compile the law's tick for just these arrays, if it states one."""
        try:
            tick, record = self.controller.compiled_tick(), self.controller.telemetry_record
            contiguous = is_stated(record, self._dtype, len(self._commands)) and record.flags.c_contiguous
        except Exception:  # an older interface; or it fails again when it is stepped, and is reported there
            return
        if tick is None or not contiguous:
            return
        from formation_controllers.interface import TickInputs

        inputs, own, commands, telemetry = TickInputs(*self._inputs), tick.own, self._commands, self._telemetry
        signals = numbers_of(record).reshape(telemetry.shape)
        function = tick.function
        with suppress(ImportError):
            from formation_controllers.compiled import compiled_for

            function = compiled_for(function, inputs, own, commands)

        def call() -> None:
            function(inputs, own, commands)
            telemetry[:] = signals

        self._call = call
        if (address := _address_of(tick.function, (inputs, own, commands))) is not None:
            copied = int(telemetry.ctypes.data), int(signals.ctypes.data), telemetry.nbytes
            self.compiled = address, *copied, inputs, own, commands


def _gain(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _copy(part: Any) -> Any:
    return None if part is None else part.copy()


# The bell -----------------------------------------------------------------------------------------------------------


class _Bell:
    """How a host waits for requests, and answers a tick.

    Parameters
    ----------
    requests, replies
        The pipes.
    failed
        Called with the exception of a law in a tick that compiled code has run, before that is answered.
    """

    def __init__(self, requests: int, replies: int, failed: Callable[[BaseException], None]) -> None:
        self._requests, self._replies = requests, replies
        self._failed = failed
        self._board: Board | None = None
        self._hears = self._asks = 0
        self._seen: Any = None
        self._slept = True  # the harness still rings through the pipe alone
        self._rest = self._pause = 0
        self._core = _core()
        self._compiled: _Compiled | None = None
        self._serve: Callable[[int], int] | None = None

    def use(self, board: Board, work: tuple[Any, ...]) -> None:
        """Look at the numbers of a board from now on, and run this work at a tick, if that is compiled."""
        self._board = board
        self._hears, self._asks = int(board.asked.ctypes.data), int(board.answered.ctypes.data)
        self._rest = self._pause = 0
        self._slept = True
        board.asked[1] = BY_PIPE
        self._compiled = self._compiled or _compile(self._core)
        if self._compiled is not None:
            self._seen = board.asked[:1].copy()
            self._serve = self._compiled.serving(board, self._seen, work)

    def wait(self) -> tuple[int, bytes] | None:
        """Return the next request that compiled code has not answered; None at the end."""
        if not self._slept and self._look():
            return STEP, b""
        header = _exactly(self._requests, HEADER.size)
        if header is None:
            return None
        kind, length = HEADER.unpack(header)
        body = _exactly(self._requests, length)
        if body is None:
            return None
        if self._compiled is not None and self._board is not None:
            self._compiled.swap(self._hears + SAYS, AWAKE if kind == STEP else BY_PIPE)
            self._slept = kind != STEP
            self._seen[0] = self._board.asked[0]
        return kind, body

    def answer(self) -> None:
        """Tell that a tick is done."""
        board = self._board
        if board is None or self._compiled is None:
            send(self._replies, DONE)
            return
        board.tells[2] = -1 if self._core is None else self._core()
        if self._compiled.ring(self._asks):
            send(self._replies, DONE)

    def _look(self) -> bool:
        """Look for new numbers; return whether Python has a tick to run.

        If there is nothing for long, this side says that it sleeps.
        """
        assert self._compiled is not None
        assert self._board is not None
        seen, board, before = self._seen, self._board, int(self._seen[0])
        found, resting, last = self._serves(1), self._rest > 0, -1
        while not found and not resting:
            if seen[0] != last:
                last, until = int(seen[0]), time.perf_counter() + _PATIENCE
            elif time.perf_counter() >= until:
                break
            together = int(board.told.view("int64")[2]) == board.tells[2]
            found = self._serves(1 if together else _ROUNDS)
            if together and not found:
                os.sched_yield()
        served = int(seen[0]) - before
        if resting:
            self._rest = max(self._rest - served - (not found), 0)
        else:
            self._pause >>= served
            self._pause = self._pause if found else min(2 * self._pause + 1, _MOST)
            self._rest = 0 if found else self._pause
        if not found and self._compiled.sleep(self._hears, int(seen[0])):
            self._slept = True
            return False
        seen[0] = board.asked[0]
        return True

    def _serves(self, rounds: int) -> bool:
        """Run ticks as long as each is asked for within so many looks; return whether Python has to run the next."""
        assert self._serve is not None
        try:
            left = self._serve(rounds)
        except (Exception, SystemExit) as error:
            if self._board is None or self._board.current[0] < 0:  # not of a law
                raise
            self._failed(error)
            self.answer()
            return False
        if left == _BY_PIPE:
            send(self._replies, DONE)
        return left == _BY_PYTHON


# Compiled code ------------------------------------------------------------------------------------------------------

_NOTHING, _BY_PYTHON, _BY_PIPE = range(3)
"""What compiled code leaves to do: nothing is asked for; Python has a tick to run, or an answer to write."""


class _Compiled(namedtuple("_Compiled", "serving swap sleep ring")):
    """Functions of addresses that are atomic, and one that makes a function.

    ``swap(address, value)`` exchanges a number, ``sleep(address, seen)`` tells whether this side may sleep, and
    ``ring(address)`` answers, and tells whether the pipe must, too.

    ``serving(board, seen, work)`` returns a function of a number of looks. It runs ticks as long as each is asked for
    within so many, and tells what is left to do. ``seen`` holds the number of the last request. The work is that of
    each team: the address of its tick, where its telemetry goes, where that comes from, how many bytes it has, and the
    arguments of the tick; without work, all ticks are left to Python.
    """


def _core() -> Callable[[], int] | None:
    """Return the system's function that tells the core on which this thread works, if there is one."""
    function = getattr(ctypes.CDLL(None), "sched_getcpu", None) if os.name == "posix" else None
    if function is not None:
        function.argtypes, function.restype = (), ctypes.c_int
    return function


def _address_of(function: Any, arguments: tuple[Any, ...]) -> int | None:
    """Return the address of a function that Numba has compiled for arguments, by Numba's own way to call; else None."""
    try:
        from numba import typeof, types

        overload = function.overloads[tuple(map(typeof, arguments))]
    except (ImportError, AttributeError, KeyError):
        return None
    if overload.signature.return_type != types.none:
        return None
    return int(overload.library.get_pointer_to_function(overload.fndesc.llvm_func_name))


def _compile(core: Callable[[], int] | None) -> _Compiled | None:
    """Compile what a host needs; None where nothing is compiled."""
    try:
        import numba
        from llvmlite import ir
        from numba import types
        from numba.core import cgutils
        from numba.extending import intrinsic
    except ImportError:
        return None
    if numba.config.DISABLE_JIT or os.name != "posix":  # type: ignore[attr-defined]
        return None
    word = ir.IntType(64)

    @intrinsic
    def ticked(_: Any, work: Any, current: Any) -> Any:
        """Run a tick of all teams, each by its address, and say before in memory which one it is."""

        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            convention, place = context.call_conv, builder.inttoptr(values[1], word.as_pointer())
            for number, kind in enumerate(work):
                address, to, of, size, *given = (
                    builder.extract_value(builder.extract_value(values[0], number), i) for i in range(len(kind))
                )
                kinds = tuple(kind)[-len(given) :]
                function = builder.inttoptr(address, convention.get_function_type(types.none, kinds).as_pointer())
                builder.store(ir.Constant(word, number), place)
                status, _result = convention.call_function(builder, function, types.none, kinds, given)
                with cgutils.if_unlikely(builder, status.is_error):  # type: ignore[no-untyped-call]
                    convention.return_status_propagate(builder, status)
                target, source = (builder.inttoptr(at, ir.IntType(8).as_pointer()) for at in (to, of))
                cgutils.raw_memcpy(builder, target, source, size, 1)  # type: ignore[no-untyped-call]
            builder.store(ir.Constant(word, -1), place)
            return context.get_dummy_value()

        return types.none(work, types.int64), generate

    load, exchange, exchange_if, claim = runpy.run_path(_INTRINSICS)["intrinsics"]()
    run: Any = ticked

    def swap(address: int, value: int) -> int:
        before: int = exchange(address, value)
        return before

    def sleep(address: int, seen: int) -> int:
        asleep = ASLEEP + 4 * seen  # as in `cosim.plant.bells.asleep`
        exchange(address + SAYS, asleep)
        return int(load(address) == seen or exchange_if(address + SAYS, asleep, AWAKE) == 0)

    def ring(address: int) -> int:
        before = load(address)
        exchange(address, before + 1)
        return int(load(address + SAYS) == BY_PIPE or exchange_if(address + SAYS, ASLEEP + 4 * before, AWAKE) != 0)

    numbers = types.int64
    jit: Any = numba.njit
    answer: Any = jit(numbers(numbers), nogil=True)(ring)
    here: Any = core or jit(numbers(), nogil=True)(lambda: -1)

    def serve(
        hears: int, asks: int, told: Any, tells: Any, seen: Any, current: int, work: Any, lines: Any, rounds: int
    ) -> int:
        while True:
            asked, looks = load(hears), 1
            while asked == seen[0] and looks < rounds:
                asked, looks = load(hears), looks + 1
            if asked == seen[0]:
                return _NOTHING
            seen[0] = asked
            if told[0] != AS_COMPILED or len(work) == 0:
                return _BY_PYTHON
            for i in range(len(lines)):
                claim(lines[i])
            if tells[0] != 0:  # a line that nobody writes to stays with both sides
                tells[0] = 0
            run(work, current)
            core = here()
            if tells[2] != core:
                tells[2] = core
            if answer(asks):
                return _BY_PIPE

    dispatcher: Any = jit(nogil=True)(serve)

    def serving(board: Board, seen: Any, work: tuple[Any, ...]) -> Callable[[int], int]:
        hears, asks, current = (int(part.ctypes.data) for part in (board.asked, board.answered, board.current))
        written = [(to, size) for _, to, _, size, *_ in work]
        written += [(int(commands.ctypes.data), commands.nbytes) for *_, commands in work]
        given = hears, asks, board.told, board.tells, seen, current, work, lines_of(written)
        entry = dispatcher.compile((*map(numba.typeof, given), numbers))
        return lambda rounds: int(entry(*given, rounds))

    return _Compiled(
        serving,
        jit(numbers(numbers, numbers))(swap),
        jit(numbers(numbers, numbers))(sleep),
        answer,
    )


# The process --------------------------------------------------------------------------------------------------------


class _Host:
    """The laws of this process."""

    def __init__(self, requests: int, replies: int) -> None:
        self._replies = replies
        self._bell = _Bell(requests, replies, self._failed)
        self._laws: dict[str, type] = {}
        self._teams: list[_Team] = []
        self._board: Board | None = None
        self._failure: dict[str, Any] = {}

    def serve(self) -> None:
        """Answer requests until the harness wants no more."""
        while (request := self._bell.wait()) is not None:
            kind, body = request
            if kind == STEP:
                self._tick()
                self._bell.answer()
                continue
            try:
                answer = self._asked(kind, json.loads(body) if body else None)
            except (Exception, SystemExit) as error:
                send(self._replies, FAILED, _refusal(error))
            else:
                send(self._replies, DONE, answer)

    def _asked(self, kind: int, about: Any) -> Any:
        if kind == DESCRIBE:
            return self._described(about)
        if kind == LIST:
            from formation_controllers.registry import installed

            return {name: [found.package, found.version] for name, found in sorted(installed().items())}
        if kind == GAINS:
            name, settings = about
            gains = checked_gains(self._laws[name], [(key, _gain(value)) for key, value in settings])
            return {key: getattr(gains, key) for key in described(self._laws[name])["gain_facts"]}
        if kind == TEAMS:
            return self._make(about)
        if kind == FAILURE:
            return self._failure
        if kind == NOT_FINITE:
            return self._told(about, self._teams[about].not_finite())
        if kind == RESET:
            return self._teams[about].restart()
        if kind == STATE:
            return base64.b64encode(self._teams[about].state()).decode()
        if kind == GO_ON:
            self._teams[about[0]].go_on(base64.b64decode(about[1]))
        return None

    def _described(self, name: str) -> dict[str, Any]:
        from formation_controllers.registry import installed, load

        known = installed()
        if name not in known:
            return {"known": sorted(known)}
        found = known[name]
        about = {"package": found.package, "version": found.version}
        try:
            self._laws[name] = law = load(name)
        except Exception as error:
            return {**about, "fault": not_imported(error, found.entry_point.module)}
        return {**about, "content": content_of(found.entry_point.module, PUBLIC), **described(law)}

    def _make(self, about: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Make the teams of a run; return what is wrong with the first one that cannot be made."""
        size, shapes = about["size"], about["shapes"]
        memory = mmap.mmap(-1, size, about["memory"]) if os.name == "nt" else mmap.mmap(int(about["memory"]), size)
        self._teams = []
        self._board = board = Board(memory, about["numbers"])
        self._how, self._tells, self._current = (part.data for part in (board.told, board.tells, board.current))
        for number, (own, arrays) in enumerate(zip(about["teams"], parts_of(board.numbers, shapes), strict=True)):
            law = self._laws[own["name"]]
            self._current[0] = number
            try:
                self._teams.append(_Team(law, own, arrays))
            except (Exception, SystemExit) as error:
                self._teams = []
                return [{"team": number, "fault": said(error, law)}]
            finally:
                self._current[0] = -1
        work = tuple(team.compiled for team in self._teams if team.compiled is not None)
        self._bell.use(board, work if len(work) == len(self._teams) else ())
        return []

    def _tick(self) -> None:
        how, tells, current = self._how[0], self._tells, self._current
        tells[0] = 0
        try:
            for number, team in enumerate(self._teams):
                current[0] = number
                team.tick(how)
        except (Exception, SystemExit) as error:
            self._failed(error)
        current[0] = -1

    def _failed(self, error: BaseException) -> None:
        """Note the failure of the team that is at work in a tick."""
        number = self._current[0]
        self._failure = self._told(number, error)
        self._tells[0], self._current[0] = number + 1, -1

    def _told(self, number: int, error: BaseException) -> dict[str, Any]:
        return {
            "team": number,
            "row": row_of(error),
            "said": said(error, self._teams[number].law),
            "variable": "torque" if isinstance(error, NotFinite) else "",
        }


class _Alone:
    """The law of an FMU, whose numbers come and go through the pipe, in frames of bytes as this machine has them.

    A request for teams brings the FMU's parameters, and leads the law back to before its start. A request for a step
    brings two integers, team and tick, and the team's inputs; its reply, commands and telemetry. The tick of a team
    that has come last may come again with other inputs: the law is led back to before it.

    Parameters
    ----------
    requests, replies
        The pipes.
    file
        What the FMU says of its law, see `cosim.team_fmu.law_in_host`.
    """

    def __init__(self, requests: int, replies: int, file: str) -> None:
        self._requests, self._replies = requests, replies
        with open(file, encoding="utf-8") as opened:
            self._about = json.load(opened)
        self._law: Any = None
        self._teams: list[_Team] = []
        self._arrays: list[list[Any]] = []
        self._before: list[tuple[int, bytes]] = []
        self._robots: list[str] = []

    def serve(self, fault: str) -> None:
        """Answer requests until the FMU wants no more; say first what is at fault with this environment, if so."""
        self._reply(fault or self._load())
        while (header := _exactly(self._requests, HEADER.size)) is not None:
            kind, length = HEADER.unpack(header)
            body = _exactly(self._requests, length)
            if body is None:
                return
            try:
                answer = self._make(body) if kind == TEAMS else self._step(body)
            except (Exception, SystemExit) as error:
                row, robots = row_of(error), self._robots
                whose = f"{robots[row]}, " if row is not None and 0 <= row < len(robots) else ""
                failed = "" if kind == TEAMS else " failed"
                self._reply(f"{failed}: {whose}{said(error, self._law)}")
            else:
                write_frame(self._replies, DONE, answer)

    def _load(self) -> str:
        """Find the law; return what is at fault with it, in words that follow its name."""
        from formation_controllers.registry import installed, load

        name, wanted = self._about["name"], (self._about["package"], self._about["version"])
        found = installed().get(name)
        if found is None:
            return f" is not installed in the environment of {sys.executable}"
        if (found.package, found.version) != wanted:
            return f" is wanted, and the environment of {sys.executable} has that of {found.package} {found.version}"
        try:
            self._law = load(name)
        except Exception as error:
            return f": {not_imported(error, found.entry_point.module)}"
        return ""

    def _reply(self, fault: str) -> None:
        text = "".join(c if c.isprintable() else " " for c in fault).encode("utf-8", "replace")
        text = text[: self._about["longest"]].decode("utf-8", "ignore").encode()
        write_frame(self._replies, FAILED if text else DONE, text)

    def _make(self, parameters: bytes) -> bytes:
        import numpy as np

        self._values = np.frombuffer(parameters).tolist()
        self._teams, self._arrays, self._before = [], [], []
        for number in range(len(self._about["teams"])):
            self._make_one(number)
        return b""

    def _make_one(self, number: int) -> None:
        """Make a team, in place of one that was there."""
        import math

        import numpy as np

        about = self._about["teams"][number]
        self._robots = about["robots"]
        size = sum(math.prod(shape) for shape in about["shapes"])
        (arrays,) = parts_of(np.zeros(size), [about["shapes"]])
        team = _Team(self._law, {**about, **self._gains(about)}, arrays)
        place = slice(number, number + 1)  # which may be behind the last one
        self._teams[place], self._arrays[place], self._before[place] = [team], [arrays], [(-1, b"")]

    def _gains(self, about: Mapping[str, Any]) -> dict[str, Any]:
        """Return the gains of a team, some of them parameters of the FMU."""

        def value(given: Any, place: Any) -> Any:
            if isinstance(given, list):
                return [value(*own) for own in zip(given, place, strict=True)]
            return given if place is None else self._values[place]

        gains = [[[name, value(given, place)] for name, given, place in own] for own in about["gains"]]
        return {"gains": gains, "shared": about["shared"] and all(own == gains[0] for own in gains)}

    def _step(self, body: bytes) -> bytes:
        import numpy as np

        number, tick = _TICK.unpack_from(body)
        self._robots = self._about["teams"][number]["robots"]
        if tick == 0 and self._before[number][0] >= 0:
            self._make_one(number)
        team = self._teams[number]
        *inputs, commands, telemetry = self._arrays[number]
        if tick > 0 and tick == self._before[number][0]:
            if not self._before[number][1]:
                raise RuntimeError("its inputs have changed after its tick, and it cannot be led back to before it")
            team.go_on(self._before[number][1])
        elif tick > 0:
            self._before[number] = tick, self._state(team)
        else:
            self._before[number] = 0, b""
        given = np.frombuffer(body, offset=_TICK.size)
        (own,) = parts_of(given, [[array.shape for array in inputs]])
        for array, values in zip(inputs, own, strict=True):
            array[:] = values
        team.tick(FIRST if tick == 0 else AS_COMPILED)
        if not np.isfinite(commands).all():
            raise team.not_finite()
        return bytes(commands.tobytes() + telemetry.tobytes())

    def _state(self, team: _Team) -> bytes:
        """Return the state of a team; nothing if it cannot be told."""
        try:
            return team.state()
        except Exception:  # a law that is not asked to go back need not be able to
            return b""


def _refusal(error: BaseException) -> dict[str, Any]:
    place = error.place if isinstance(error, GainFault) else None
    text = str(error) if isinstance(error, GainFault) else f"{type(error).__name__}: {error}"
    return {"said": text, "place": place}


def send(pipe: int, kind: int, about: Any = None) -> None:
    """Write a frame of JSON."""
    write_frame(pipe, kind, b"" if about is None else json.dumps(about).encode())


def write_frame(pipe: int, kind: int, body: bytes) -> None:
    """Write a frame with a body."""
    data = HEADER.pack(kind, len(body)) + body
    while data:
        data = data[os.write(pipe, data) :]


def _exactly(pipe: int, length: int) -> bytes | None:
    data = b""
    while len(data) < length:
        part = os.read(pipe, length - len(data))
        if not part:
            return None
        data += part
    return data


def _greeting() -> dict[str, Any]:
    """Return what this environment is, and its fault if it cannot host laws."""
    version = ".".join(map(str, sys.version_info[:3]))
    about: dict[str, Any] = {"python": version, "implementation": sys.implementation.name, "versions": {}}
    if sys.version_info < _OLDEST:
        return {**about, "fault": f"it has Python {version}, and controllers need 3.11 or newer"}
    from importlib.metadata import PackageNotFoundError
    from importlib.metadata import version as version_of

    for package in ("formation-controllers", "numpy", "numba"):
        with suppress(PackageNotFoundError):
            about["versions"][package] = version_of(package)
    try:
        from formation_controllers.interface import INTERFACE_VERSION
    except ImportError as error:
        if getattr(error, "name", None) == PUBLIC:
            return {**about, "fault": "it lacks formation-controllers, which every controller needs"}
        return {**about, "fault": f"its formation-controllers cannot be imported: {error}"}
    except Exception as error:
        return {**about, "fault": f"its formation-controllers cannot be imported: {type(error).__name__}: {error}"}
    about["interface"] = str(INTERFACE_VERSION)
    if about["interface"].partition(".")[0] != SPOKEN:
        about["fault"] = (
            f"its formation-controllers speak version {INTERFACE_VERSION} of the controllers' interface, and versions "
            f"{SPOKEN}.x are spoken here"
        )
    return about


def _out_of_reach(descriptor: int) -> int:
    """Return another descriptor of a standard stream; the one that laws know leads to standard error, or nowhere."""
    if os.name == "posix":
        import fcntl

        other = fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, 10)
    else:
        import msvcrt

        other = os.dup(descriptor)
        msvcrt.setmode(other, os.O_BINARY)  # type: ignore[attr-defined]
    os.dup2(2 if descriptor == 1 else os.open(os.devnull, os.O_RDWR), descriptor)
    return other


def _leave_terminal() -> None:
    """Let this process have no terminal: what a law wrote there would look like the command's."""
    if os.name != "posix":
        return
    import fcntl
    import termios

    with suppress(OSError):
        fcntl.ioctl(os.open("/dev/tty", os.O_RDWR | os.O_NOCTTY), termios.TIOCNOTTY)


def _end_with(parent: int, main_thread: bool) -> None:
    """End this process when the harness ends, also while a law works."""
    if os.name != "posix":
        return  # its pipe ends
    if main_thread and sys.platform == "linux":  # the system watches a thread, not a process
        with suppress(AttributeError, OSError):
            ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, _SIGKILL)

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_ORPHAN_CHECK)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def main() -> None:
    """Serve the laws of this environment until the harness wants no more, or has ended.

    The arguments are the process of the harness, or of the master of an FMU, whether its main thread has started this
    one, and the text after which the replies begin: until then modules that Python loads at its start may have printed.
    An FMU adds the file that says what its law is.
    """
    parent, main_thread, begins, *law = sys.argv[1:]
    file = law[0] if law else None
    del sys.argv[1:]
    _leave_terminal()
    replies, requests = _out_of_reach(1), _out_of_reach(0)
    streams: list[Any] = [sys.stdout, sys.stderr]
    for stream in streams:
        stream.reconfigure(line_buffering=True, errors="backslashreplace")
    _end_with(int(parent), main_thread == "1")
    status = 0
    try:
        os.write(replies, begins.encode())
        greeting = _greeting()
        if file is not None:
            fault = greeting.get("fault", "")
            _Alone(requests, replies, file).serve(fault and f" cannot run by {sys.executable}: {fault}")
        else:
            send(replies, DONE, greeting)
            if "fault" not in greeting:  # as that of a Python that is too old for that file
                runpy.run_path(_UNDISTURBED)["stay_deaf"]()
                _Host(requests, replies).serve()
    except BaseException:
        traceback.print_exc()
        status = 1
    sys.stdout.flush()
    os._exit(status)


if __name__ == "__main__":
    main()
