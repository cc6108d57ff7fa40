"""C functions by their address, callable from code that Numba compiles, and from the same code as plain Python."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from cosim.compiled import COMPILED

_CTYPES = {
    "pointer": ctypes.c_void_p,
    "size": ctypes.c_size_t,
    "double": ctypes.c_double,
    "int": ctypes.c_int,
}


def c_function(*kinds: str, unsigned: bool = False) -> Callable[[int, tuple[Any, ...]], int]:
    """Return a function ``call(address, arguments)`` that calls a C function which returns an int.

    Addresses are passed as 64-bit integers, as all platforms that FMPy supports pass them like pointers, and a C bool
    as an int.

    Parameters
    ----------
    kinds
        The kinds of its arguments: ``pointer``, ``size``, ``double`` or ``int``; values of just these types are passed.
    unsigned
        Whether the int is taken without a sign: of FMI's statuses, one below zero is then none of success.
    """
    if not COMPILED:
        prototype = ctypes.CFUNCTYPE(ctypes.c_uint if unsigned else ctypes.c_int, *(_CTYPES[kind] for kind in kinds))

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

        return (types.uint32 if unsigned else types.int32)(types.int64, arguments), generate

    return call  # type: ignore[return-value]
