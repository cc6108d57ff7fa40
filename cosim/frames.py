"""Compiled functions with their arguments: called by three numbers, whatever the types of the arguments are.

A compiled caller of such functions has one signature for all of them, and is compiled once.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any, TypeAlias
from weakref import WeakValueDictionary

import numpy as np
from numpy.typing import NDArray

from cosim.compiled import COMPILED, address_of, address_of_types, borrowing, call, form_of, part

Address: TypeAlias = int


class Bound:
    """A compiled function that returns nothing, with the arguments that it is always called with.

    Parameters
    ----------
    function
        The function.
    arguments
        Numbers, arrays, and tuples of these.

    Attributes
    ----------
    numbers : tuple of int
        What `call_bound` gets; they are good for as long as this object lives.

    Raises
    ------
    TypeError
        An argument is something else.
    """

    def __init__(self, function: Callable[..., None], *arguments: Any) -> None:
        self.function, self.arguments = function, arguments
        self._frame = _frame(arguments)
        if COMPILED:
            entry = _entry_for(arguments)
            self.numbers = (entry, address_of(function, *arguments), self._frame.ctypes.data)
        else:
            _living[id(self)] = self
            self.numbers = (address_of(_enter_plain, 0, 0), 0, id(self))


@part
def call_bound(entry: int, function: int, frame: int) -> int:
    """Call a function of `Bound` by its numbers; return not zero if it has raised an exception."""
    return call(entry, (function, frame))


_living: WeakValueDictionary[int, Bound] = WeakValueDictionary()


def _enter_plain(_: int, place: int) -> None:
    bound = _living[place]
    bound.function(*bound.arguments)


# Arguments in memory ----------------------------------------------------------------------------------------------


def _frame(arguments: tuple[Any, ...]) -> NDArray[np.uint8]:
    """Return arguments as they lie in memory when a compiled function has them in a tuple."""
    _align, size, pieces = _layout(arguments)
    frame = np.zeros(size + 8, dtype=np.uint8)
    frame = frame[-frame.ctypes.data % 8 :][:size]
    for place, content in pieces:
        frame[place : place + len(content)] = np.frombuffer(content, dtype=np.uint8)
    return frame


def _layout(value: Any) -> tuple[int, int, list[tuple[int, bytes]]]:
    """Return alignment, size and content of a value, piece by piece, each with its place."""
    if isinstance(value, tuple):
        align, size, pieces = 1, 0, []
        for part in value:
            own, length, inner = _layout(part)
            size += -size % own
            pieces += [(size + place, content) for place, content in inner]
            align, size = max(align, own), size + length
        return align, size + -size % align, pieces
    content = _content(value)
    return min(len(content), 8), len(content), [(0, content)]


def _content(value: Any) -> bytes:
    if isinstance(value, np.ndarray):  # no owner, for which references would be counted
        words = (0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides)
        return struct.pack(f"={len(words)}q", *words)
    if isinstance(value, bool | np.bool_):
        return struct.pack("=?", value)
    if isinstance(value, np.generic) and value.dtype.kind in "iuf" and value.dtype.itemsize <= 8:
        return value.tobytes()
    if isinstance(value, int):
        return struct.pack("=q", value)
    if isinstance(value, float):
        return struct.pack("=d", value)
    raise TypeError(f"compiled code is not called with a {type(value).__name__}")


# Calls with arguments in memory ------------------------------------------------------------------------------------


if COMPILED:
    import numba
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic, models, register_model

    class FrameType(types.Type):
        """The address of a tuple of arguments, of these types."""

        def __init__(self, kinds: Any) -> None:
            self.kinds = kinds
            super().__init__(name=f"Frame({kinds})")

    @register_model(FrameType)
    class _FrameModel(models.PrimitiveModel):
        def __init__(self, manager: Any, kind: Any) -> None:
            super().__init__(manager, kind, ir.IntType(64))  # type: ignore[no-untyped-call]

    @intrinsic
    def _call_with(_: Any, function: Any, frame: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            model, convention = context.data_model_manager[frame.kinds], context.call_conv
            place = builder.inttoptr(values[1], model.get_data_type().as_pointer())
            arguments = model.load_from_data_pointer(builder, place)
            kinds = tuple(frame.kinds)
            given = [builder.extract_value(arguments, i) for i in range(len(kinds))]
            callee = builder.inttoptr(values[0], convention.get_function_type(types.none, kinds).as_pointer())
            status, _result = convention.call_function(builder, callee, types.none, kinds, given)
            return builder.zext(status.is_error, context.get_value_type(types.int64))

        return types.int64(function, frame), generate

    @borrowing
    def _enter(function: Address, frame: Any) -> None:
        if _call_with(function, frame) != 0:  # type: ignore[call-arg]
            raise RuntimeError

    def _entry_for(arguments: tuple[Any, ...]) -> Address:
        """Return the address of `_enter` for arguments of just these types."""

        def kinds() -> tuple[Any, ...]:
            return types.int64, FrameType(numba.typeof(arguments))  # type: ignore[no-untyped-call]

        return address_of_types(_enter, form_of(arguments), kinds)
