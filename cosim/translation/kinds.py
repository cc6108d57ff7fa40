"""Kinds of values, which in C are types: all are known before a function is translated."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any, TypeAlias


class Scalar(Enum):
    """A number or truth value, by its type in C."""

    FLOAT = "double"
    INT = "int64_t"
    BOOL = "bool"

    @property
    def words(self) -> str:
        """The kind in words."""
        return {"double": "a float", "int64_t": "a whole number", "bool": "a truth value"}[self.value]


FLOAT, INT, BOOL = Scalar.FLOAT, Scalar.INT, Scalar.BOOL


@dataclass(frozen=True)
class Array:
    """An array of numbers.

    Attributes
    ----------
    item : Scalar
        Its numbers.
    shape : tuple
        Its sizes, None where one is known only when the code runs.
    steps : tuple or None
        Numbers from one entry to the next in each dimension, None where one is known only when the code runs; None as a
        whole for an array without gaps.
    const : bool
        Whether nothing may be written into it; of arrays of several dimensions only, where C asks for it.
    """

    item: Scalar
    shape: tuple[int | None, ...]
    steps: tuple[int | None, ...] | None = None
    const: bool = False


@dataclass(frozen=True)
class Layout:
    """Records as NumPy lays them out: a struct.

    Attributes
    ----------
    name : str
        The struct.
    fields : tuple
        For each field its name in Python, its name in C, and its kind.
    """

    name: str
    fields: tuple[tuple[str, str, Scalar | Array], ...]
    size: int

    def field(self, name: str) -> tuple[str, Scalar | Array] | None:
        """Return name in C and kind of a field."""
        return next(((c, kind) for own, c, kind in self.fields if own == name), None)


@dataclass(frozen=True)
class Record:
    """One record."""

    layout: Layout


@dataclass(frozen=True)
class Records:
    """An array of records."""

    layout: Layout
    size: int


@dataclass(frozen=True)
class Struct:
    """A named tuple.

    Attributes
    ----------
    name : str
        The struct.
    python : type
        The named tuple's class.
    fields : tuple
        For each field its name in Python, its name in C, and its kind.
    """

    name: str
    python: Any
    fields: tuple[tuple[str, str, Kind], ...]

    def field(self, name: str) -> tuple[str, Kind] | None:
        """Return name in C and kind of a field."""
        return next(((c, kind) for own, c, kind in self.fields if own == name), None)

    @property
    def has_memory(self) -> bool:
        """Whether arrays or records are among its fields: such a struct is passed by its address."""
        return any(
            isinstance(kind, Array | Records) or (isinstance(kind, Struct) and kind.has_memory)
            for _, _, kind in self.fields
        )


@dataclass(frozen=True)
class Several:
    """What a function returns that returns a tuple."""

    name: str
    items: tuple[Kind, ...]


Kind: TypeAlias = Scalar | Array | Record | Records | Struct | Several
