"""What the code of a compiled function depends on, described from the function as it is in memory.

Numba freezes into the code what the function refers to: constants, arrays, other functions. It finds kept code by the
function's own text and the time of its file, so that a change anywhere else goes unseen.
"""

from __future__ import annotations

import builtins
import dis
import enum
import hashlib
import os
import sys
import sysconfig
from collections import ChainMap
from collections.abc import Iterable, Mapping
from functools import cache, cached_property
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any
from weakref import WeakKeyDictionary

import numba
import numpy as np
from numba.core import caching, compiler, dispatcher, types
from numba.core.extending import _Intrinsic
from numba.core.typing import templates

_LIBRARIES = tuple(os.path.join(package.__path__[0], "") for package in (np, numba))
_STANDARD = tuple({os.path.join(sysconfig.get_path(name), "") for name in ("stdlib", "platstdlib")})

_PLAIN = (type(None), type(...), bool, int, str, bytes)
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
"""All that makes the text of a function, but for where it stands."""


class Unknown(Exception):
    """A function depends on something whose changes cannot be recognised, so that its code must not be kept."""


def of_function(function: Any, own: frozenset[str]) -> str:
    """Return a checksum of what the code of a function depends on, but for the types of its arguments.

    That is its text, its options, and all that the text refers to, one through the other. Functions of Python, NumPy
    and Numba are known by their names, and so are the texts of own files: the caller adds versions. What an own text
    refers to is described as that of any other, as a program may put something else in its place.

    Parameters
    ----------
    function
        The function, by ``numba.njit``.
    own
        Paths of sources of which the caller has a checksum.

    Raises
    ------
    Unknown
        It refers to something else than numbers, texts, arrays, tuples, enumerations, exceptions and functions, or to
        what an extension of Numba compiles.
    """
    return checksum(_described(function, own).pieces)


def of_types(arguments: tuple[Any, ...], own: frozenset[str]) -> str:
    """Return a checksum of Numba's types of arguments, with the fields of tuples; raises as `of_function`."""
    description = _Description(own)
    description.each(arguments)
    return checksum(description.pieces)


def steady(function: Any, own: frozenset[str]) -> bool:
    """Return whether all that a function calls is as it was when it was compiled, if that was before.

    Numba compiles a function once in a process, and calls that code also if a constant has changed since. Of a callee
    that was compiled without `remember`, nobody knows from what. Arguments and errors are those of `of_function`.
    """
    description = _described(function, own)
    # Of a function that Numba has registered nobody knows whether it is compiled already.
    compiled = [each for each in description.functions() if isinstance(each, FunctionType) or each.overloads]
    known = [
        (isinstance(each, FunctionType) or each in _states) and remember(each, own)
        for each in compiled
        if each is not function
    ]
    return all(known)


def remember(function: Any, own: frozenset[str]) -> bool:
    """Return whether a function is as it has always been; call this each time before it is compiled or loaded."""
    now = checksum(_described(function, own, shallow=True).pieces)
    if _states.setdefault(function, now) == now:
        return True
    _states[function] = "changed"
    return False


_states: WeakKeyDictionary[Any, str] = WeakKeyDictionary()
"""What each function was: which functions it calls counts, what they are does not."""


def checksum(pieces: Iterable[str]) -> str:
    """Return a checksum of texts, each of which has one line."""
    return hashlib.sha256("\n".join(pieces).encode("utf-8", "surrogatepass")).hexdigest()


class _Description:
    """Describes values piece by piece; a piece says what it is and how many belong to it.

    A `shallow` description of a function only says which functions it calls, as this process knows them.
    """

    def __init__(self, own: frozenset[str], shallow: bool = False) -> None:
        self.pieces: list[str] = []
        self._own, self._shallow = own, shallow
        self._seen: dict[int, tuple[int, Any]] = {}
        self._within: list[int] = []

    @cached_property
    def _extended(self) -> frozenset[str]:
        return _extended(self._own)

    def functions(self) -> list[Any]:
        """Return the functions that were described."""
        return [value for _, value in self._seen.values() if isinstance(value, (dispatcher.Dispatcher, FunctionType))]

    def each(self, values: Iterable[Any]) -> None:
        values = list(values)
        self.pieces.append(f"{len(values)} of")
        for value in values:
            self.value(value)

    def value(self, value: Any) -> None:
        kind = type(value)
        if kind in _PLAIN:
            self.pieces.append(f"{kind.__name__} {value!r}")
        elif kind in (float, complex):
            self.pieces.append(f"{kind.__name__} {np.array(value).tobytes().hex()}")
        elif isinstance(value, types.Type):
            self._type(value)
        elif isinstance(value, np.generic):
            self.pieces.append(f"{kind.__name__} {value.dtype!r} {value.tobytes().hex()}")
        elif isinstance(value, np.dtype):
            self.pieces.append(f"dtype {value!r}")
        elif kind is np.ndarray and not value.dtype.hasobject:
            content = hashlib.sha256(value.tobytes("A")).hexdigest()
            self.pieces.append(f"array {value.dtype!r} {value.shape} {value.strides} {content}")
        elif kind is CodeType:
            self.pieces.append(_text(value))
        elif kind is dict:
            self.pieces.append("dict")
            self.each(sorted(value.items(), key=repr))
        elif kind in (set, frozenset):
            self.pieces.append("set")
            self.each(sorted(value, key=repr))
        elif isinstance(value, tuple):
            self.pieces.append("tuple")
            if kind is not tuple:
                self.value(kind)
            self.each(value)
        elif kind is slice:
            self.pieces.append("slice")
            self.each([value.start, value.stop, value.step])
        elif library := _library_of(value):
            self._refuse_extended(value.__name__)
            self.pieces.append(f"library {library} {value.__name__}")
        elif isinstance(value, enum.Enum):
            self.pieces.append(f"member {value.name}")
            self.each([kind, value.value])
        else:
            self._once(value)

    def _once(self, value: Any) -> None:
        """Describe what may refer to itself."""
        if id(value) in self._seen:
            if id(value) in self._within[:-1]:
                raise Unknown("functions that call each other in a circle, which Numba cannot load")
            self.pieces.append(f"as number {self._seen[id(value)][0]}")
            return
        if self._shallow and self._seen and isinstance(value, dispatcher.Dispatcher):
            self.pieces.append(f"function {id(value)}")
            return
        self._seen[id(value)] = len(self._seen), value  # kept alive, so that no other object is given its id
        self._within.append(id(value))
        if isinstance(value, dispatcher.Dispatcher):
            self._dispatcher(value)
        elif isinstance(value, type):
            self._class(value)
        elif isinstance(value, FunctionType) and value.__code__.co_filename in self._own:
            self._function(value)
        elif isinstance(value, _Intrinsic) and value._defn.__code__.co_filename in self._own:
            self.pieces.append(f"intrinsic {_place(value._defn)}")
            cells = [cell.cell_contents for cell in value._defn.__closure__ or ()]
            self.each(content for content in cells if isinstance(content, (types.Type, float, *_PLAIN)))
        else:
            raise Unknown(f"a {type(value).__module__}.{type(value).__qualname__}")
        self._within.pop()

    def _dispatcher(self, function: Any) -> None:
        if not function._can_compile or function._compiler.pipeline_class is not compiler.Compiler:
            raise Unknown("a function for given types alone, or compiled in another way")
        if type(getattr(function._cache, "_cache_file", None)) is caching.IndexDataCacheFile:
            raise Unknown("a function that Numba keeps by the time of its file")
        self.pieces.append("compiled")
        self.each([function.targetoptions, function.locals])
        self._function(function.py_func)

    def _function(self, python: FunctionType) -> None:
        """Describe a text, its defaults, and all that it refers to."""
        text = python.__code__
        self.each([python.__defaults__, python.__kwdefaults__])
        cells = zip(text.co_freevars, python.__closure__ or (), strict=True)
        meanings: ChainMap[str, Any] = ChainMap({name: cell.cell_contents for name, cell in cells}, python.__globals__)
        if text.co_filename in self._own:
            self.pieces.append(f"own {_place(python)}")
            self._named(meanings, _globals(text), _names(text))
            return
        self._refuse_extended("operator", *_names(text))
        self.value(text)
        meanings.maps.append(vars(builtins))
        for name, *attributes in _references(text):
            if name in meanings:
                self._reference(meanings[name], name, attributes)

    def _named(self, meanings: Mapping[str, Any], names: Iterable[str], attributes: tuple[str, ...]) -> None:
        """Describe what names of an own text mean; of a module, all attributes of names in the text."""
        for name in names:
            if name not in meanings:
                continue
            value = meanings[name]
            self.pieces.append(name)
            if not isinstance(value, ModuleType):
                self.value(value)
            elif not _library(value):
                others = (name for name in attributes if not isinstance(vars(value).get(name), ModuleType))
                self._named(vars(value), others, ())

    def _reference(self, value: Any, name: str, attributes: list[str]) -> None:
        """Describe what a text means by a name and the attributes that it takes of that, such as np.linalg.norm."""
        self.pieces.append(f"{name} {attributes}")
        for attribute in attributes:
            if not isinstance(value, ModuleType):
                break
            module, value = value, getattr(value, attribute)
            if _library(module) and callable(value) and not isinstance(value, dispatcher.Dispatcher):
                # also methods of an object, such as np.random.normal, which do not know this name
                self._refuse_extended(getattr(value, "__name__", attribute))
                self.pieces.append(f"library {module.__name__}")
                return
        if isinstance(value, ModuleType):
            raise Unknown(f"all of the module {value.__name__}")
        try:
            self.value(value)
        except Unknown as error:
            raise Unknown(f"{'.'.join([name, *attributes])}: {error}") from None

    def _refuse_extended(self, *names: str) -> None:
        for name in self._extended.intersection(names):
            raise Unknown(f"{name}, in the place of which an extension of Numba may compile something else")

    def _class(self, kind: type) -> None:
        self.pieces.append(f"class {kind.__module__} {kind.__qualname__}")
        self.each(base.__qualname__ for base in kind.__mro__)
        if issubclass(kind, tuple) and hasattr(kind, "_fields"):
            self.value(kind._fields)
        elif issubclass(kind, enum.Enum):
            self.each((name, member.value) for name, member in kind.__members__.items())
        elif not issubclass(kind, BaseException):
            raise Unknown(f"the class {kind.__qualname__}")

    def _type(self, kind: Any) -> None:
        self.pieces.append(f"type {type(kind).__name__}")
        if isinstance(kind, types.BaseTuple):
            self.each([getattr(kind, "instance_class", None), *kind.types])  # type: ignore[attr-defined]
        elif isinstance(kind, types.Literal):
            self.value(kind.literal_value)
        elif isinstance(kind, types.Omitted):
            self.value(kind.value)
        elif isinstance(kind, types.EnumMember):
            self.each([kind.instance_class, kind.dtype])
        elif type(kind) is types.Optional:
            self.value(kind.type)
        elif type(kind) is types.Array:
            self.pieces.append(str(kind))
            self.value(kind.dtype)
        elif getattr(sys.modules.get(type(kind).__module__), "__file__", None) in self._own:
            self.pieces.append(str(kind))
            self.each(part for part in vars(kind).values() if isinstance(part, types.Type))
        elif isinstance(kind, _PLAIN_TYPES):
            self.pieces.append(str(kind))
        else:
            raise Unknown(f"the type {kind}")


def _described(function: Any, own: frozenset[str], shallow: bool = False) -> _Description:
    description = _Description(own, shallow)
    description.value(function)
    return description


@cache
def _text(code: CodeType) -> str:
    """Return a checksum of a function's text."""
    return of_types(tuple(getattr(code, name, None) for name in _TEXT), frozenset())


def _place(function: FunctionType) -> str:
    """Return which function of a known file one is."""
    return f"{function.__module__} {function.__qualname__} {function.__code__.co_firstlineno}"


@cache
def _names(code: CodeType) -> tuple[str, ...]:
    """Return all names in a text and in those within it, in order: globals and attributes."""
    within = (_names(one) for one in code.co_consts if isinstance(one, CodeType))
    return tuple(sorted(set(code.co_names).union(*within)))


@cache
def _globals(code: CodeType) -> tuple[str, ...]:
    """Return the names that a text, or one within it, takes from elsewhere: of `_references` the first, much sooner."""
    found, more = set(code.co_freevars), 0
    for operation, argument in zip(code.co_code[::2], code.co_code[1::2], strict=True):
        if operation == _LOAD_GLOBAL:
            found.add(code.co_names[(more | argument) >> 1])
        more = (more | argument) << 8 if operation == dis.EXTENDED_ARG else 0
    within = (_globals(one) for one in code.co_consts if isinstance(one, CodeType))
    return tuple(sorted(found.union(*within)))


_LOAD_GLOBAL = dis.opmap["LOAD_GLOBAL"]


@cache
def _references(code: CodeType, local: frozenset[str] = frozenset()) -> tuple[tuple[str, ...], ...]:
    """Return the names that a text, or one within it, takes from elsewhere, each with the attributes it takes of it.

    Local names of the text around it are from nowhere else.
    """
    local = local.union(code.co_cellvars)
    found = dict[tuple[str, ...], None]()
    chain: list[str] = []
    for instruction in dis.get_instructions(code):
        name = instruction.opname
        if name == "EXTENDED_ARG":
            continue
        if chain and name in ("LOAD_ATTR", "LOAD_METHOD"):
            chain.append(instruction.argval)
            continue
        if chain:
            found[tuple(chain)] = None
        starts = name in ("LOAD_GLOBAL", "LOAD_NAME") or (name == "LOAD_DEREF" and instruction.argval not in local)
        chain = [instruction.argval] if starts else []
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            found.update(dict.fromkeys(_references(constant, local)))
    return tuple(found)


def _library_of(value: Any) -> str | None:
    """Return the name of the library's module that calls a function or a class by its name, if there is one."""
    # Older versions of NumPy do not say of their functions where they belong.
    module = sys.modules.get(getattr(value, "__module__", None) or ("numpy" if isinstance(value, np.ufunc) else ""))
    name = getattr(value, "__name__", None)
    if module is None or not isinstance(name, str) or not _library(module) or getattr(module, name, None) is not value:
        return None
    return module.__name__


def _library(module: ModuleType) -> bool:
    """Return whether a module belongs to Python, NumPy or Numba."""
    file = getattr(module, "__file__", None)
    if file is None:
        return module.__name__ in sys.builtin_module_names and sys.modules.get(module.__name__) is module
    return _file_of_library(file)


@cache
def _file_of_library(file: str) -> bool:
    installed = any(part in ("site-packages", "dist-packages") for part in Path(file).parts)
    return file.startswith(_LIBRARIES) or (file.startswith(_STANDARD) and not installed)


def _extended(own: frozenset[str]) -> frozenset[str]:
    """Return the names of functions and attributes for which others state what is compiled (``overload``)."""
    found = set[str]()
    registry = templates.builtin_registry
    for template in (*registry.functions, *registry.attributes):
        function = getattr(template, "_overload_func", None)
        file = None if function is None else function.__code__.co_filename
        if file is None or file in own or _file_of_library(file):
            continue
        key = template.key
        found.add(getattr(template, "_attr", getattr(key, "__name__", "")))
        if getattr(key, "__module__", None) in ("_operator", "operator"):
            found.add("operator")
    return frozenset(found)
