"""Names that are alike: a hundred thousand variables have few names that differ by more than their numbers."""

from __future__ import annotations

from collections.abc import Iterable

_DIGITS = str.maketrans("23456789", "11111111")


def without_digits(name: str) -> str:
    """Return a name with a 1 for each digit; a 0 stays, as it may tell of a start."""
    return name.translate(_DIGITS)


def all_without_digits(names: Iterable[str]) -> list[str]:
    """Return `without_digits` of each of many names, faster than one by one."""
    return without_digits("\0".join(names)).split("\0")
