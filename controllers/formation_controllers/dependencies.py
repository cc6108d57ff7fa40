"""What the code of a compiled function depends on, told from the function as it is in memory.

Numba freezes into the code what the function refers to: constants, arrays, other functions. It finds kept code by the
function's own text and the time of its file, so that a change anywhere else goes unseen.
"""

from __future__ import annotations

import dis
import enum
import hashlib
import os
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numba
import numpy as np
from numba.core import dispatcher, types
from numba.core.extending import _Intrinsic
from numba.core.typing import templates

_LIBRARIES = tuple(os.path.join(package.__path__[0], "") for package in (np, numba))
_STANDARD = tuple({os.path.join(sysconfig.get_path(name), "") for name in ("stdlib", "platstdlib")})

_PLAIN = (type(None), type(...), bool, int, float, complex, str, bytes)
_PLAIN_TYPES = (
    types.Boolean,
    types.Bytes,
    types.CharSeq,
    types.NoneType,
    types.NPDatetime,
    types.NPTimedelta,
    types.Number,
    types.NumberClass,
    types.RawPointer,
    types.Record,
    types.SliceType,
    types.UnicodeCharSeq,
    types.UnicodeType,
)
"""Types of Numba whose names say all, among them that of a record with its fields."""

_TEXT = (
    "co_code",
    "co_exceptiontable",
    "co_flags",
    "co_argcount",
    "co_posonlyargcount",
    "co_kwonlyargcount",
    "co_names",
    "co_varnames",
    "co_freevars",
    "co_cellvars",
    "co_consts",
)


class Unknown(Exception):
    """A function depends on something that cannot be told from something else, so that its code must not be kept."""


def of_text(function: Any, own: frozenset[str]) -> str:
    """Return a checksum of what the code of a function depends on, but for its closure and the types of its arguments.

    These are its text and all that this refers to, one through the other, and the extensions of Numba that are in use.
    Python, NumPy and Numba are known by names alone, and so is what the own files hold: their versions are the
    caller's to add.

    Parameters
    ----------
    function
        The function, by ``numba.njit``.
    own
        Paths of sources that the caller has a checksum of.

    Raises
    ------
    Unknown
        It refers to something else than numbers, texts, arrays, tuples, enumerations, exceptions and functions.
    """
    if function.py_func.__code__.co_filename in own:
        return ""
    extensions = (_checksum(_Teller(own).value(extension)) for extension in _extensions(own))
    return _checksum([*_Teller(own).compiled(function), *sorted({*extensions})])


def of_closure(function: Any, own: frozenset[str]) -> str:
    """Return a checksum of what a compiled function has from the function that has made it; arguments as `of_text`."""
    return _checksum(_Teller(own).each(_cells(function.py_func)))


def of_types(arguments: tuple[Any, ...], own: frozenset[str]) -> str:
    """Return a checksum of Numba's types of arguments, with the fields of tuples; raises as `of_text`."""
    return _checksum(_Teller(own).each(arguments))


def _checksum(pieces: Iterable[str]) -> str:
    return hashlib.sha256("\n".join(pieces).encode("utf-8", "surrogatepass")).hexdigest()


class _Teller:
    """Tells values piece by piece, of which each says how many belong to it: no two values have the same pieces."""

    def __init__(self, own: frozenset[str]) -> None:
        self._own = own
        self._told: dict[tuple[int, frozenset[str]], tuple[int, Any]] = {}

    def each(self, values: Iterable[Any]) -> Iterator[str]:
        values = list(values)
        yield f"{len(values)} of"
        for value in values:
            yield from self.value(value)

    def value(self, value: Any, names: frozenset[str] = frozenset()) -> Iterator[str]:
        """Tell a value; of a module, what has one of these names."""
        kind = type(value)
        if kind in _PLAIN:
            yield f"{kind.__name__} {value!r}"
        elif isinstance(value, types.Type):
            yield from self._type(value)
        elif isinstance(value, np.generic):
            yield f"{kind.__name__} {value.dtype!r} {value.tobytes().hex()}"
        elif isinstance(value, np.dtype):
            yield f"dtype {value!r}"
        elif kind is np.ndarray and not value.dtype.hasobject:
            content = hashlib.sha256(value.tobytes("A")).hexdigest()
            yield f"array {value.dtype!r} {value.shape} {value.strides} {content}"
        elif kind is CodeType:
            yield _text(value)
        elif kind is dict:
            yield "dict"
            yield from self.each(sorted(value.items(), key=repr))
        elif kind is frozenset:
            yield "frozenset"
            yield from self.each(sorted(value, key=repr))
        elif isinstance(value, tuple):
            yield "tuple"
            yield from self.value(kind) if kind is not tuple else ()
            yield from self.each(value)
        elif _of_library(value):
            yield f"library {value.__module__} {value.__qualname__}"
        elif isinstance(value, enum.Enum):
            yield f"member {value.name}"
            yield from self.value(kind)
        else:
            yield from self._once(value, names)

    def _once(self, value: Any, names: frozenset[str]) -> Iterator[str]:
        """Tell what may refer to itself."""
        known = id(value), names
        if known in self._told:
            yield f"as number {self._told[known][0]}"
            return
        self._told[known] = len(self._told), value  # the value, too, so that none gets its identity
        if isinstance(value, ModuleType):
            yield from self._module(value, names)
        elif isinstance(value, dispatcher.Dispatcher):
            yield from self.compiled(value)
            yield from self.each(_cells(value.py_func))
        elif isinstance(value, FunctionType):
            yield from self._function(value)
            yield from self.each(_cells(value))
        elif isinstance(value, _Intrinsic):
            yield "intrinsic"
            yield from self.value(value._defn)
        elif isinstance(value, type):
            yield from self._class(value)
        else:
            raise Unknown(f"a {type(value).__qualname__}")

    def compiled(self, function: Any) -> Iterator[str]:
        """Tell a compiled function but for its closure."""
        yield "compiled"
        yield from self.value(function.targetoptions)
        yield from self._function(function.py_func)

    def _function(self, function: FunctionType) -> Iterator[str]:
        code = function.__code__
        if code.co_filename in self._own:
            yield f"own {function.__module__} {function.__qualname__}"
            return
        yield "function"
        yield from self.each([code, function.__defaults__, function.__kwdefaults__])
        names, attributes = _names(code)
        for name in sorted(names & function.__globals__.keys()):
            yield f"global {name}"
            yield from self.value(function.__globals__[name], attributes)

    def _module(self, module: ModuleType, names: frozenset[str]) -> Iterator[str]:
        yield f"module {module.__name__}"
        if _library(module.__name__) or getattr(module, "__file__", None) in self._own:
            return
        for name in sorted(names & set(dir(module))):
            yield f"attribute {name}"
            yield from self.value(getattr(module, name), names)

    def _class(self, kind: type) -> Iterator[str]:
        yield f"class {kind.__module__} {kind.__qualname__}"
        if issubclass(kind, tuple) and hasattr(kind, "_fields"):
            yield from self.value(kind._fields)
        elif issubclass(kind, enum.Enum):
            yield from self.each((name, member.value) for name, member in kind.__members__.items())
        elif not issubclass(kind, BaseException):
            raise Unknown(f"the class {kind.__qualname__}")

    def _type(self, kind: Any) -> Iterator[str]:
        yield f"type {type(kind).__name__}"
        if isinstance(kind, types.BaseTuple):
            yield from self.each([getattr(kind, "instance_class", None), *kind.types])  # type: ignore[attr-defined]
        elif isinstance(kind, types.Literal):
            yield from self.value(kind.literal_value)
        elif isinstance(kind, types.Omitted):
            yield from self.value(kind.value)
        elif isinstance(kind, types.EnumMember):
            yield from self.each([kind.instance_class, kind.dtype])
        elif type(kind) is types.Optional:
            yield from self.value(kind.type)
        elif type(kind) is types.Array:
            yield str(kind)
            yield from self.value(kind.dtype)
        elif getattr(sys.modules.get(type(kind).__module__), "__file__", None) in self._own:
            yield str(kind)
            yield from self.each(part for part in vars(kind).values() if isinstance(part, types.Type))
        elif isinstance(kind, _PLAIN_TYPES):
            yield str(kind)
        else:
            raise Unknown(f"the type {kind}")


def _cells(function: FunctionType) -> list[Any]:
    return [cell.cell_contents for cell in function.__closure__ or ()]


@cache
def _text(code: CodeType) -> str:
    """Return a checksum of a function's text: all of it but for where it stands."""
    return _checksum(_Teller(frozenset()).each(getattr(code, name, None) for name in _TEXT))


@cache
def _names(code: CodeType) -> tuple[frozenset[str], frozenset[str]]:
    """Return the names of the globals that a text refers to, and all names that it may take from a module."""
    names, attributes = set[str](), {*code.co_names}
    for instruction in dis.get_instructions(code):
        if instruction.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
            names.add(instruction.argval)
    for constant in code.co_consts:
        if isinstance(constant, str):  # for `getattr`
            attributes.add(constant)
        elif isinstance(constant, CodeType):
            inner_names, inner_attributes = _names(constant)
            names |= inner_names
            attributes |= inner_attributes
    return frozenset(names), frozenset(attributes)


def _of_library(value: Any) -> bool:
    """Return whether a function or a class is what a library calls by its name."""
    module, name = getattr(value, "__module__", None), getattr(value, "__qualname__", None)
    if not isinstance(module, str) or not isinstance(name, str) or not _library(module):
        return False
    return getattr(sys.modules.get(module), name, None) is value


@cache
def _library(module: str) -> bool:
    """Return whether a module belongs to Python, NumPy or Numba."""
    file = getattr(sys.modules.get(module), "__file__", None)
    if file is None:
        return module in sys.builtin_module_names
    installed = any(part in ("site-packages", "dist-packages") for part in Path(file).parts)
    return file.startswith(_LIBRARIES) or (file.startswith(_STANDARD) and not installed)


def _extensions(own: frozenset[str]) -> Iterator[Any]:
    """Yield the functions of others than Numba that say what is compiled in the place of something (``overload``)."""
    registry = templates.builtin_registry
    for template in (*registry.functions, *registry.attributes):
        function = getattr(template, "_overload_func", None)
        if function is not None and not _library(function.__module__) and function.__code__.co_filename not in own:
            yield function
