"""Expressions in C with what the translation has to know about them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, TypeAlias

from cosim.translation.kinds import FLOAT, INT, Layout, Scalar, Several, Struct

# How tightly an expression holds together, from C's operators
CHOICE, OR, AND, BIT_OR, BIT_XOR, BIT_AND, EQUAL, LESS, SHIFT, ADD, MULTIPLY, UNARY, ATOM = range(3, 16)

Root: TypeAlias = tuple[str, ...]
"""The path to some memory: a name, and the fields from there on."""
Reads: TypeAlias = frozenset[Root]

NOTHING: Final[Reads] = frozenset()


def overlap(a: Root, b: Root) -> bool:
    """Tell whether two paths may lead to the same memory."""
    size = min(len(a), len(b))
    return a[:size] == b[:size]


@dataclass(frozen=True)
class Number:
    """A number or truth value.

    Attributes
    ----------
    kind : Scalar
        Its kind.
    text : str
        The expression.
    level : int
        How tightly it holds together.
    reads : frozenset
        The memory and the names that it depends on.
    constant : int or float or None
        Its value, if that is known.
    is_natural : bool
        Whether it is known to be a whole number that is not negative.
    root : Root or None
        The path to the memory that it stands in, if it stands somewhere.
    is_narrow : bool
        Whether it is an int in C though no constant: a choice between constants. See `wide`.
    """

    kind: Scalar
    text: str
    level: int = ATOM
    reads: Reads = NOTHING
    constant: float | None = None
    is_natural: bool = False
    root: Root | None = None
    is_narrow: bool = False

    def within(self, level: int) -> str:
        """Return the text, in parentheses where it holds together less tightly than that."""
        return self.text if self.level >= level else f"({self.text})"


@dataclass(frozen=True)
class Axis:
    """A dimension of an array in C: either at a fixed index, or from a start on by a step.

    Attributes
    ----------
    index : Number or None
        The fixed index.
    start, step, size : Number
        Of a free dimension.
    native : int
        The size of the dimension in C; 0 of an array that has no dimensions in C.
    """

    index: Number | None
    start: Number
    step: Number
    size: Number
    native: int


@dataclass(frozen=True)
class ArrayValue:
    """An array, or a view of one.

    Attributes
    ----------
    item : Scalar
        The kind of its numbers.
    base : str
        The array in C.
    root : Root
        The path to its memory.
    axes : tuple of Axis
        The dimensions of the array in C.
    is_flat : bool
        Whether C has but one dimension, over which the indices of all axes add up.
    is_const : bool
        Whether nothing may be written into it.
    """

    item: Scalar
    base: str
    root: Root
    axes: tuple[Axis, ...]
    is_flat: bool = False
    is_const: bool = False

    @property
    def free(self) -> tuple[int, ...]:
        """The places of its own dimensions among the axes."""
        return tuple(place for place, axis in enumerate(self.axes) if axis.index is None)

    @property
    def sizes(self) -> tuple[Number, ...]:
        """Its sizes."""
        return tuple(self.axes[place].size for place in self.free)

    @property
    def reads(self) -> Reads:
        """What its place depends on."""
        parts = [
            number.reads
            for axis in self.axes
            for number in ((axis.index,) if axis.index else (axis.start, axis.step, axis.size))
        ]
        return frozenset().union(*parts)


@dataclass(frozen=True)
class RecordsValue:
    """An array of records."""

    layout: Layout
    text: str
    size: int
    root: Root


@dataclass(frozen=True)
class RecordValue:
    """A record, as an expression that is either the struct or a pointer to it."""

    layout: Layout
    text: str
    is_pointer: bool
    root: Root
    reads: Reads = NOTHING

    @property
    def address(self) -> str:
        """An expression for its address."""
        return self.text if self.is_pointer else f"&{self.text}"

    def member(self, name: str) -> str:
        """Return an expression for a field."""
        return f"{self.text}{'->' if self.is_pointer else '.'}{name}"


@dataclass(frozen=True)
class StructValue:
    """A named tuple, as an expression that is either the struct or a pointer to it."""

    struct: Struct
    text: str
    is_pointer: bool
    root: Root
    reads: Reads = NOTHING
    level: int = ATOM

    @property
    def base(self) -> str:
        """The expression as something to take a member of."""
        return self.text if self.level == ATOM else f"({self.text})"

    def member(self, name: str) -> str:
        """Return an expression for a field."""
        return f"{self.base}{'->' if self.is_pointer else '.'}{name}"


@dataclass(frozen=True)
class SeveralValue:
    """A tuple that a function has returned, as an expression for a struct."""

    kind: Several
    text: str
    reads: Reads = NOTHING


@dataclass(frozen=True)
class TupleValue:
    """A tuple that is written out."""

    items: tuple[Value, ...]


Value: TypeAlias = Number | ArrayValue | RecordsValue | RecordValue | StructValue | SeveralValue | TupleValue


def whole(value: int) -> Number:
    """Return a whole number that is known."""
    if value == -(2**63):
        return Number(INT, "INT64_MIN", ATOM, NOTHING, value)
    if -(2**31) < value < 2**31:
        return Number(INT, str(value), ATOM if value >= 0 else UNARY, NOTHING, value, value >= 0)
    return Number(INT, f"INT64_C({value})", ATOM, NOTHING, value, value >= 0)


def real(value: float) -> Number:
    """Return a float that is known."""
    text = {"inf": "INFINITY", "-inf": "-INFINITY", "nan": "(double)NAN"}.get(repr(value), repr(value))
    return Number(FLOAT, text, UNARY if text.startswith(("-", "(")) else ATOM, NOTHING, value)


def is_narrow(number: Number) -> bool:
    """Tell whether a whole number may be an int in C, whose arithmetic has 32 bits."""
    return number.is_narrow or (number.constant is not None and "INT64" not in number.text)


def wide(number: Number) -> Number:
    """Return a whole number as one of 64 bits in C."""
    text = f"(int64_t){number.within(UNARY)}"
    return Number(INT, text, UNARY, number.reads, number.constant, number.is_natural)


def as_float(number: Number) -> Number:
    """Return a number as a double."""
    if number.kind is FLOAT:
        return number
    if number.kind is INT and number.constant is not None and number.text.lstrip("-").isdigit():
        return replace(number, kind=FLOAT, text=f"{number.text}.0", is_natural=False, root=None)
    return Number(FLOAT, f"(double){number.within(UNARY)}", UNARY, number.reads)


def full(size: int) -> Axis:
    """Return a whole dimension."""
    return Axis(None, whole(0), whole(1), whole(size), size)
