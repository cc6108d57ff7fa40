"""C functions by their address, callable from code that Numba compiles, and from the same code as plain Python."""

from __future__ import annotations

import ctypes
import hashlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

PLAIN = "FORMATION_PLAIN_STEPPING"
"""The environment variable that makes this room alone do without Numba: an FMU may be made of Python and Numba."""

COMPILED = os.environ.get("NUMBA_DISABLE_JIT", "0") in ("", "0") and PLAIN not in os.environ
"""Whether Numba is used; without it, it is not even imported."""

_CTYPES = {
    "pointer": ctypes.c_void_p,
    "size": ctypes.c_size_t,
    "double": ctypes.c_double,
    "int": ctypes.c_int,
}

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile a function, and keep the result on disk where there is a place for it.

    Python's lock is released while it runs: an FMU may log from a thread of its own, for which a step waits.
    """
    if not COMPILED:
        return function
    import numba

    options: dict[str, Any] = {"error_model": "numpy", "nogil": True}
    try:
        dispatcher: Any = numba.njit(cache=True, **options)(function)
        file = dispatcher._cache._cache_file
        fresh = hasattr(file, "_source_stamp")
    except (RuntimeError, AttributeError):  # nowhere to write a cache, or a Numba with another kind of cache
        fresh = False
    if not fresh:
        dispatcher = numba.njit(**options)(function)
        return dispatcher  # type: ignore[no-any-return]
    # Numba renews a cached function only when its own file changes, not one from which another function was inlined.
    file._source_stamp = _sources()
    return dispatcher  # type: ignore[no-any-return]


@cache
def _sources() -> str:
    """Return a checksum of all sources of this package."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"\0".join(file.read_bytes() for file in files)).hexdigest()


def c_function(*kinds: str) -> Callable[[int, tuple[Any, ...]], int]:
    """Return a function ``call(address, arguments)`` that calls a C function which returns an int.

    Addresses are passed as 64-bit integers, as all platforms that FMPy supports pass them like pointers, and a C bool
    as an int.

    Parameters
    ----------
    kinds
        The kinds of its arguments: ``pointer``, ``size``, ``double`` or ``int``; values of just these types are passed.
    """
    if not COMPILED:
        prototype = ctypes.CFUNCTYPE(ctypes.c_int, *(_CTYPES[kind] for kind in kinds))

        @cache
        def function(address: int) -> Callable[..., int]:
            return prototype(address)

        return lambda address, arguments: function(int(address))(*(np.asarray(a).item() for a in arguments))

    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    llvm = {"pointer": ir.IntType(64), "size": ir.IntType(64), "double": ir.DoubleType(), "int": ir.IntType(32)}

    @intrinsic
    def call(_: Any, address: Any, arguments: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            function = ir.FunctionType(ir.IntType(32), [llvm[kind] for kind in kinds])
            pointer = builder.inttoptr(values[0], function.as_pointer())
            return builder.call(pointer, [builder.extract_value(values[1], i) for i in range(len(kinds))])

        return types.int32(types.int64, arguments), generate

    return call  # type: ignore[return-value]
