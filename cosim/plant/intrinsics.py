"""Numbers in memory for compiled code: read, exchanged and fetched, so that all processes see the same order of events.

This file needs Numba and llvmlite alone: the host of another environment reads it where it stands, without the rest.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def intrinsics() -> tuple[Callable[..., Any], ...]:
    """Return `load`, `swap`, `swap_if` and `claim` of `cosim.plant.atomic`, of 64-bit integers at addresses."""
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
