"""Names that are alike: a hundred thousand variables have few names that differ by more than their numbers."""

from __future__ import annotations

import re
from collections.abc import Iterable

_NUMBER = re.compile("[1-9][0-9]*")


def without_numbers(name: str) -> str:
    """Return a name with a 1 for each number; a 0 stays, as it may tell of a start."""
    return _NUMBER.sub("1", name)


def all_without_numbers(names: Iterable[str]) -> list[str]:
    """Return `without_numbers` of each of many names, faster than one by one."""
    return without_numbers("\0".join(names)).split("\0")
