"""Numbers, names and assignments as C."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.translation.names import identifier

_WIDTH = 118


def number(value: float) -> str:
    """Return a number as C that has its very bits."""
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return repr(float(value))


def assignments(place: str, value: Any) -> Iterator[str]:
    """Yield the statements that write numbers, arrays, records or named tuples where all bytes are zero."""
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        for name, part in zip(value._fields, value, strict=True):
            yield from assignments(f"{place}.{identifier(name)}", part)
    elif isinstance(value, np.ndarray) and value.dtype.names is not None:
        for index in np.ndindex(value.shape):
            at = place + "".join(f"[{i}]" for i in index)
            for name in value.dtype.names:
                yield from assignments(f"{at}.{identifier(name)}", np.asarray(value[index][name]))
    elif isinstance(value, np.ndarray):
        for index in np.ndindex(value.shape):
            yield from assignments(place + "".join(f"[{i}]" for i in index), value[index].item())
    elif isinstance(value, bool | int):
        if value:
            yield f"{place} = {int(value)};"
    elif value != 0.0 or math.copysign(1.0, value) < 0.0:
        yield f"{place} = {number(value)};"


def member(at: str) -> str:
    """Return a name with places behind it, such as ``K[0]``, as a member of a struct."""
    name, bracket, rest = at.partition("[")
    return identifier(name) + bracket + rest


def table(declaration: str, values: Iterable[str]) -> str:
    """Return the definition of a constant array, several entries a line."""
    lines, line = [], "   "
    for value in values:
        if len(line) + len(value) + 2 > _WIDTH:
            lines.append(line)
            line = "   "
        line += f" {value},"
    return "\n".join([f"static const {declaration} = {{", *lines, line.rstrip(","), "};"])


def numbers(declaration: str, values: NDArray[Any] | Sequence[float]) -> str:
    """Return the definition of a constant array of doubles."""
    return table(declaration, map(number, np.asarray(values, dtype=float).reshape(-1).tolist()))


def block(lines: Iterable[str], indent: int = 1) -> str:
    """Return statements with an indentation."""
    return "".join("    " * indent + line + "\n" if line else "\n" for line in lines)
