"""How functions of the harness are compiled with Numba, and called by their addresses: one way for all of them."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from cosim.compiling import watch_numba

if TYPE_CHECKING:
    from formation_controllers.kept import Sources

PLAIN = "FORMATION_PLAIN_STEPPING"
"""The environment variable that makes the harness alone do without Numba: an FMU may be made of Python and Numba."""

COMPILED = os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0") and PLAIN not in os.environ
"""Whether Numba is used; without it, it is not even imported."""

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile a function, and keep the result on disk where there is a place for it.

    Python's lock is released while it runs: an FMU may log from a thread of its own, for which a step waits.
    """
    return _compiled(function)


def borrowing(function: F) -> F:
    """Compile a function as `compiled` does that neither makes an array, of whatever use, nor returns one.

    Nobody counts there who refers to its arrays, which takes a short function longer than its work.
    """
    return _compiled(function, _nrt=False)


def part(function: F) -> F:
    """Compile a function as `compiled` does; compiled callers have its text in the place of a call.

    Of its own it is compiled only when Python calls it, which spares a newcomer's first run a third of a second for
    each such function.
    """
    return _compiled(function, inline="always")


def _compiled(function: F, **more: Any) -> F:
    if not COMPILED:
        return function
    from formation_controllers.kept import kept

    watch_numba()
    return kept(function, _own(), error_model="numpy", nogil=True, no_cfunc_wrapper=True, **more)  # type: ignore[no-any-return]


@cache
def _own() -> Sources:
    """Read the sources of all rooms that have compiled code."""
    from formation_controllers.kept import sources

    here = Path(__file__).parent
    rooms = ("control", "master", "plant", "signals")
    return sources(
        [Path(__file__), here / "frames.py", *(file for room in rooms for file in (here / room).rglob("*.py"))]
    )


# Compiled functions by their addresses -----------------------------------------------------------------------------

_functions: list[Callable[..., Any]] = []
"""Those that have an address without compilation: their places here."""


def address_of(function: Callable[..., Any], *arguments: Any) -> int:
    """Return the address of a compiled function that returns nothing, for arguments of just these types.

    A compiled caller that takes the address instead of the function has a signature of plain numbers and arrays:
    Numba keeps it on disk, and it need not be compiled anew for each function.
    """
    if not COMPILED:
        if function not in _functions:
            _functions.append(function)
        return _functions.index(function)
    return _compiled_for(function, arguments)[1]


def address_of_types(function: Callable[..., Any], form: Any, types: Callable[[], tuple[Any, ...]]) -> int:
    """Return the address of a compiled function for Numba's types, which are asked for once for each form."""
    return _compiled_as(function, form, types)[1]


def entry_of(function: F, *arguments: Any) -> F:
    """Return a compiled function for arguments of just these types, from then on called without looking at their types.

    Without compilation the function is returned unchanged.
    """
    if not hasattr(function, "compile"):
        return function
    return _compiled_for(function, arguments)[0]  # type: ignore[return-value]


_known: dict[tuple[Callable[..., Any], Any], tuple[Callable[..., Any], int]] = {}


def _compiled_for(function: Any, arguments: tuple[Any, ...]) -> tuple[Callable[..., Any], int]:
    """Compile a function for the types of arguments; return what Python calls, and the address for compiled code."""

    def types() -> tuple[Any, ...]:
        import numba

        return tuple(numba.typeof(argument) for argument in arguments)  # type: ignore[no-untyped-call]

    return _compiled_as(function, form_of(arguments), types)


def _compiled_as(function: Any, form: Any, types: Callable[[], tuple[Any, ...]]) -> tuple[Callable[..., Any], int]:
    if (function, form) not in _known:
        import numba

        signature = types()
        with warnings.catch_warnings():  # that records of one law begin as those of another that is compiled
            warnings.simplefilter("ignore", numba.NumbaExperimentalFeatureWarning)
            entry = function.compile(signature)
        overload = function.overloads[signature]
        address = int(overload.library.get_pointer_to_function(overload.fndesc.llvm_func_name))
        _known[function, form] = entry, address
    return _known[function, form]


def form_of(value: Any) -> Any:
    """Return what decides on Numba's type of a value, which Numba takes milliseconds to find for arrays of records."""
    if isinstance(value, tuple):
        return type(value), *map(form_of, value)
    if isinstance(value, np.ndarray):
        return value.dtype, value.ndim, value.flags.c_contiguous, value.flags.f_contiguous, value.flags.writeable
    return type(value)


def _call_plain(address: int, arguments: tuple[Any, ...]) -> int:
    _functions[address](*arguments)
    return 0


def _make_call() -> Callable[[int, tuple[Any, ...]], int]:
    from numba import types
    from numba.extending import intrinsic

    @intrinsic
    def call(_: Any, address: Any, arguments: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            kinds = tuple(arguments)
            convention = context.call_conv
            callee = builder.inttoptr(values[0], convention.get_function_type(types.none, kinds).as_pointer())
            given = [builder.extract_value(values[1], place) for place in range(len(kinds))]
            status, _result = convention.call_function(builder, callee, types.none, kinds, given)
            return builder.zext(status.is_error, context.get_value_type(types.int64))

        return types.int64(types.int64, arguments), generate

    return call  # type: ignore[return-value]


call: Callable[[int, tuple[Any, ...]], int] = _make_call() if COMPILED else _call_plain
"""``call(address, arguments)`` calls a function by its address; not zero if it has raised an exception.

By Numba's own calling convention, so the arguments must have just the types that `address_of` was given. Without
compilation an exception is raised."""
