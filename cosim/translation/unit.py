"""A header and a source file in C, made of Python functions with example arguments."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.translation import meanings
from cosim.translation.constants import definitions_in_c
from cosim.translation.function import translated
from cosim.translation.kinds import Array, Kind, Layout, Record, Records, Scalar, Several, Struct
from cosim.translation.layout import comment, wrapped
from cosim.translation.names import RESERVED
from cosim.translation.python_function import plain, python_function
from cosim.translation.shared import Shared
from cosim.translation.translated import Translated


@dataclass(frozen=True)
class Entry:
    """A function that others call.

    Attributes
    ----------
    name : str
        Its name in C, with the unit's name before it: ``tick`` becomes ``observer_pid_tick``.
    function : callable
        The Python function, plain or compiled by Numba.
    arguments : tuple
        Arguments as it is called with them: numbers, arrays of floats or of whole numbers, structured arrays and named
        tuples of these. Kinds and shapes count, not the numbers.
    """

    name: str
    function: Callable[..., Any]
    arguments: tuple[Any, ...]


@dataclass(frozen=True)
class CSource:
    """Two files in C11.

    Attributes
    ----------
    header, source : str
        Their text. The header declares the entries and the structs that they take.
    header_name, source_name : str
        The names of the files.
    structs : mapping
        The structs of named tuples and records that entries take, as data types of NumPy, by their names in C.
    prototypes : mapping
        The declaration of each entry in C, by the entry's name.
    """

    header: str
    source: str
    header_name: str
    source_name: str
    structs: Mapping[str, np.dtype[Any]]
    prototypes: Mapping[str, str]


def translate(
    name: str, entries: Sequence[Entry], *, about: str = "", primitives: Iterable[Callable[..., Any]] = ()
) -> CSource:
    """Translate functions, and all that they call, to C11.

    Types flow from the example arguments. An array argument becomes a pointer to its numbers, a structured array one to
    structs with NumPy's layout; a named tuple with arrays in it becomes a struct that holds these, and a pointer to it
    is passed. The arrays of one call do not overlap. There is no memory but that of the arguments and of the call: no
    allocation and no variable outside of functions.

    The C code has to be compiled without contraction of operations and without unsafe optimisation
    (``-ffp-contract=off``, no ``-ffast-math``). Its numbers are then those of the compiled Python functions, bit for
    bit. What raises an exception in Python does not here: an index out of range is an error of the program, a division
    by zero gives infinity or NaN.

    Parameters
    ----------
    name
        The name of the files, and what the names of entries and structs begin with.
    entries
        The functions to call.
    about
        A sentence about the code, for the head of both files.
    primitives
        Functions that have a meaning in C by their names, see `meanings.PRIMITIVES`, such as ``to_bits``: the smallest
        parts of a package's own elementary functions.

    Raises
    ------
    Untranslatable
        A function is outside of the subset, with its place, the text of the line and what would be right.
    """
    reserved: frozenset[str] = RESERVED
    while True:
        unit = Shared(name, primitives, reserved, translated)
        heads = [unit.entry(entry.name, entry.function, entry.arguments) for entry in entries]
        clashes = unit.local_names & unit.global_names
        if not clashes:
            break
        reserved |= clashes
    return _written(unit, about, entries, heads)


# The files -------------------------------------------------------------------------------------------------


_FLAGS = """\
Every operation must be rounded by itself: compile with -ffp-contract=off, which is what MSVC does with /fp:precise, and
never with -ffast-math."""

_GUARDS = """\
#if defined(__FAST_MATH__) || (defined(FLT_EVAL_METHOD) && FLT_EVAL_METHOD != 0)
#error "the arithmetic of doubles has to be that of IEEE 754, without shortcuts and without excess precision"
#endif
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(_MSC_VER)
#pragma fp_contract(off)
#endif"""


def _written(unit: Shared, about: str, entries: Sequence[Entry], heads: Sequence[Translated]) -> CSource:
    header_name, source_name = f"{unit.name}.h", f"{unit.name}.c"
    guard = f"{unit.name.upper()}_H"
    prototypes = {entry.name: own.head for entry, own in zip(entries, heads, strict=True)}
    origin = ", ".join(dict.fromkeys(plain(entry.function).__module__ for entry in entries))
    told = f"{about} " if about else ""
    lines = [
        comment(f"{told}Translated from the Python of {origin}; do not edit.", 0),
        f"#ifndef {guard}",
        f"#define {guard}",
        "",
        "#include <stdbool.h>",
        "#include <stdint.h>",
        "",
        "#ifdef __cplusplus",
        'extern "C" {',
        "#endif",
        "",
        *(line for own in unit.public for line in (*_struct(own), "")),
    ]
    for entry, own in zip(entries, heads, strict=True):
        docs = python_function(plain(entry.function)).docstring
        lines += [*([comment(docs, 0)] if docs else []), *wrapped(f"{own.head};", 0), ""]
    lines += ["#ifdef __cplusplus", "}", "#endif", "", "#endif"]
    body = [
        comment(f"{told}Translated from the Python of {origin}; do not edit.\n\n{_FLAGS}", 0),
        f'#include "{header_name}"',
        "",
        "#include <float.h>",
        "#include <math.h>",
        "#include <string.h>",
        "",
        _GUARDS,
        "",
    ]
    checks = [
        f'_Static_assert(sizeof({own.name}) == {unit.dtypes[own.name].itemsize}, "{own.name} has no gaps");'
        for own in unit.public
        if isinstance(own, Layout)
    ]
    body += [line for check in checks for line in wrapped(check, 0)]
    body += [""] if checks else []
    body += definitions_in_c(unit.constants)
    body += [line for own in unit.private for line in (*_struct(own), "")]
    functions = [own.text for own in unit.functions]
    called = set(re.findall(r"\w+", "\n".join(functions)))  # a size that nobody looks at needs no helper
    body += [line for name in unit.helpers if name in called for line in (meanings.HELPERS[name], "")]
    body += functions
    return CSource(
        "\n".join(lines) + "\n",
        "\n".join(body).rstrip("\n") + "\n",
        header_name,
        source_name,
        {own.name: unit.dtypes[own.name] for own in unit.public if own.name in unit.dtypes},
        prototypes,
    )


def _struct(own: Struct | Layout | Several) -> Iterable[str]:
    yield "typedef struct {"
    if isinstance(own, Several):
        for place, kind in enumerate(own.items):
            yield f"    {_member(kind, f'item_{place}')};"
    else:
        for _, c, kind in own.fields:
            if _has_size(kind):
                yield f"    {_member(kind, c)};"
    yield f"}} {own.name};"


def _has_size(kind: Kind) -> bool:
    if isinstance(kind, Array):
        return 0 not in kind.shape
    return not (isinstance(kind, Records) and not (kind.size and kind.layout.size))


def _member(kind: Kind, name: str) -> str:
    match kind:
        case Scalar():
            return f"{kind.value} {name}"
        case Array(item, shape):
            return f"{item.value} {name}" + "".join(f"[{n}]" for n in shape)
        case Records(layout, size):
            return f"{layout.name} {name}[{size}]"
        case Record(layout):
            return f"{layout.name} {name}"
        case Struct() | Several():
            return f"{kind.name} {name}"
    raise AssertionError(kind)
