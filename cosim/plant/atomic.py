"""Numbers in memory that processes share, read and exchanged so that all processes see the same order of events."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

from cosim.compiled import COMPILED


def _load_plain(address: int) -> int:
    return ctypes.c_int64.from_address(int(address)).value


def _swap_plain(address: int, value: int) -> int:
    there = ctypes.c_int64.from_address(int(address))
    before, there.value = there.value, int(value)
    return before


def _swap_if_plain(address: int, expected: int, value: int) -> int:
    there = ctypes.c_int64.from_address(int(address))
    if there.value != expected:
        return 0
    there.value = int(value)
    return 1


def _claim_plain(address: int) -> None:
    """Do nothing."""


def _make() -> tuple[Callable[..., Any], ...]:
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    word = ir.IntType(64)

    @intrinsic
    def load(_: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.load_atomic(builder.inttoptr(values[0], word.as_pointer()), "seq_cst", 8)

        return types.int64(types.int64), generate

    @intrinsic
    def swap(_: Any, address: Any, value: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.atomic_rmw("xchg", builder.inttoptr(values[0], word.as_pointer()), values[1], "seq_cst")

        return types.int64(types.int64, types.int64), generate

    @intrinsic
    def swap_if(_: Any, address: Any, expected: Any, value: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            there = builder.inttoptr(values[0], word.as_pointer())
            found = builder.cmpxchg(there, values[1], values[2], "seq_cst", "seq_cst")
            return builder.zext(builder.extract_value(found, 1), word)

        return types.int64(types.int64, types.int64, types.int64), generate

    @intrinsic
    def claim(_: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            number, memory = ir.IntType(32), ir.IntType(8).as_pointer()
            kind = ir.FunctionType(ir.VoidType(), [memory, number, number, number])
            prefetch = builder.module.declare_intrinsic("llvm.prefetch", [memory], kind)
            to_write, near, data = ir.Constant(number, 1), ir.Constant(number, 3), ir.Constant(number, 1)
            builder.call(prefetch, [builder.inttoptr(values[0], memory), to_write, near, data])
            return context.get_dummy_value()

        return types.none(types.int64), generate

    return load, swap, swap_if, claim


load: Callable[[int], int]
swap: Callable[[int, int], int]
swap_if: Callable[[int, int, int], int]
claim: Callable[[int], None]
load, swap, swap_if, claim = _make() if COMPILED else (_load_plain, _swap_plain, _swap_if_plain, _claim_plain)
"""``load(address)`` returns a 64-bit integer, ``swap(address, value)`` replaces it and returns the one before.

``swap_if(address, expected, value)`` replaces the expected one alone, and returns whether it was there.
Nothing is moved across them, by the compiler or the processor. Without compilation they are not atomic.
``claim(address)`` fetches a cache line that this core will write to, while it does something else."""
