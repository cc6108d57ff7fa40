"""Names in C: made from those of Python, apart from each other and from what C and its headers claim."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from typing import Final

_C_WORDS: Final = """
    auto break case char const continue default do double else enum extern float for goto if inline int long register
    restrict return short signed sizeof static struct switch typedef union unsigned void volatile while
    alignas alignof asm bool constexpr false nullptr static_assert thread_local true typeof
    and and_eq bitand bitor catch class compl concept const_cast decltype delete dynamic_cast explicit export friend
    mutable namespace new noexcept not not_eq operator or or_eq private protected public reinterpret_cast requires
    static_cast template this throw try typeid typename using virtual wchar_t xor xor_eq
"""
_LIBRARY: Final = """
    acos acosh asin asinh atan atan2 atanh cbrt ceil copysign cos cosh div double_t erf erfc exp exp2 expm1 fabs fdim
    float_t floor fma fmax fmin fmod frexp gamma hypot ilogb index isfinite isinf isnan isnormal j0 j1 jn labs ldexp
    lgamma log log10 log1p log2 logb lrint lround memcpy memset modf nan nearbyint pow printf remainder remquo rint
    round scalbn signbit signgam sin sinh sqrt strlen tan tanh tgamma trunc y0 y1 yn
    NAN INFINITY NULL DOMAIN OVERFLOW UNDERFLOW SING PLOSS TLOSS EOF HUGE HUGE_VAL
"""
_MACROS: Final = """
    far near small hyper interface huge pascal cdecl min max linux unix i386 environ errno stdin stdout stderr
    BOOL BYTE CONST DELETE DIFFERENCE ERROR FALSE FAR IN INT NEAR OPAQUE OPTIONAL OUT TRANSPARENT TRUE VOID
    I _Complex_I
"""

RESERVED: Final = frozenset(f"{_C_WORDS} {_LIBRARY} {_MACROS}".split())
"""Keywords of C and C++, functions and macros of the headers that are included, and macros of <windows.h> and the like,
which an includer of the header may have."""


def identifier(name: str) -> str:
    """Return a name as a C identifier: a Greek letter is spelt, and what C claims gets an underscore."""
    text = "".join(_letter(letter) for letter in name).strip("_") or "unnamed"
    text = f"_{text}" if text[0].isdigit() else text
    return f"{text}_" if text in RESERVED else text


def type_name(*words: str) -> str:
    """Return words as the name of a type, such as ``ObserverPidState``."""
    parts = re.split("[^A-Za-z0-9]+", "_".join(identifier(word) for word in words))
    return "".join(part[:1].upper() + part[1:] for part in parts)


def _letter(letter: str) -> str:
    if letter == "_" or (letter.isascii() and letter.isalnum()):
        return letter
    try:
        words = unicodedata.name(letter).split()
    except ValueError:
        return "_"
    return words[-1].lower() if "SMALL" in words else words[-1].capitalize()


class Names:
    """Names that are given once."""

    def __init__(self, taken: Iterable[str] = ()) -> None:
        self._taken = set(taken)

    def copy(self) -> Names:
        """Return the same names, to go on from."""
        return Names(self._taken)

    def __contains__(self, name: str) -> bool:
        return name in self._taken

    def new(self, wanted: str) -> str:
        """Return the wanted name, or with a number if it is taken."""
        name, number = wanted, 1
        while name in self._taken:
            number += 1
            name = f"{wanted}_{number}" if not wanted.endswith("_") else f"{wanted}{number}"
        self._taken.add(name)
        return name
