"""Numbers in memory that processes share, read and exchanged so that all processes see the same order of events."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

from cosim.compiled import COMPILED
from cosim.plant.intrinsics import intrinsics


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


load: Callable[[int], int]
swap: Callable[[int, int], int]
swap_if: Callable[[int, int, int], int]
claim: Callable[[int], None]
load, swap, swap_if, claim = intrinsics() if COMPILED else (_load_plain, _swap_plain, _swap_if_plain, _claim_plain)
"""``load(address)`` returns a 64-bit integer, ``swap(address, value)`` replaces it and returns the one before.

``swap_if(address, expected, value)`` replaces the expected one alone, and returns whether it was there.
Nothing is moved across them, by the compiler or the processor. Without compilation they are not atomic.
``claim(address)`` fetches a cache line that this core will write to, while it does something else."""
