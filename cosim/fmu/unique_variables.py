"""Variables that the linker of Linux keeps once in a process, even if several libraries define them.

In C++ these are static variables of inline functions and templates. Two FMUs made of one framework would share them,
and no such library is ever unloaded, so that a run would find values of an earlier run.
"""

from __future__ import annotations

import re
import struct
from pathlib import Path

_OF_THE_STANDARD_LIBRARY = re.compile(rb"_Z(GV)?Z?N?K?(S[tabsiod]|9__gnu_cxx)")
"""Symbols of the C++ runtime, which libraries may share without harm."""
_DYNAMIC_SYMBOLS = 11
_UNIQUE = 10
_WRITABLE = 1
_HEADER = struct.Struct("<16sHHIQQQIHHHHHH")
_SECTION = struct.Struct("<IIQQQQIIQQ")
_SYMBOL = struct.Struct("<IBBHQQ")


def unique_variable(library: Path) -> str:
    """Return one such variable that a library defines; empty if there is none, or it is no 64-bit ELF file."""
    data = library.read_bytes()
    if not data.startswith(b"\x7fELF\x02\x01"):
        return ""
    try:
        return _found(data)
    except (struct.error, IndexError, ValueError):  # a file that is cut short: the linker reports it
        return ""


def _found(data: bytes) -> str:
    *_, places, _, _, _, _, size, count, _ = _HEADER.unpack_from(data)
    sections = [_SECTION.unpack_from(data, places + size * number) for number in range(count)]
    for _, kind, _, _, start, length, names, *_ in sections:
        if kind != _DYNAMIC_SYMBOLS:
            continue
        for name, info, _, section, _, _ in _SYMBOL.iter_unpack(data[start : start + length]):
            if info >> 4 == _UNIQUE and 0 < section < count and sections[section][2] & _WRITABLE:
                place = sections[names][4] + name
                text = data[place : data.index(b"\0", place)]
                if not _OF_THE_STANDARD_LIBRARY.match(text):
                    return text.decode("ascii", "replace")
    return ""
