"""How the compiled parts are compiled, and called: one way for all of them."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar

import numba
import numpy as np

from formation_controllers import elementary
from formation_controllers.kept import kept, sources

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}
"""Strictly IEEE arithmetic, no fast-math; nobody calls a compiled function from C."""


_OWN = sources(Path(__file__).parent.rglob("*.py"))


def _spare_scipy() -> None:
    """Load the array functions of Numba without the linear algebra of SciPy.

    Numba imports it there, a third of a second, only to find out whether it is installed. Matrix products and the like
    load it when they are compiled or called.
    """
    if "numba.np.arraymath" in sys.modules or find_spec("scipy") is None:
        return
    try:
        from numba.np import linalg

        check, linalg.ensure_blas = linalg.ensure_blas, lambda: None
    except (ImportError, AttributeError):  # a Numba that is built otherwise
        return
    try:
        from numba.np import arraymath

        arraymath.ensure_blas = check  # type: ignore[attr-defined]
    finally:
        linalg.ensure_blas = check


if not numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
    _spare_scipy()


def compiled(function: F) -> F:
    """Compile a function with Numba, strictly (no fast-math), and keep the result on disk where that is possible.

    With ``NUMBA_DISABLE_JIT=1`` the function stays the plain Python it is.
    """
    return _compiled(function)


def borrowing(function: F) -> F:
    """Compile a function as `compiled` does that neither makes an array nor returns one.

    Nobody counts there who refers to its arrays, which takes a law of few robots a tenth of its time.
    """
    return _compiled(function, _nrt=False)


def part(function: F) -> F:
    """Compile a function as `compiled` does; compiled callers have its text in the place of a call.

    A loop over robots can be vectorised only if there is no call in it.
    """
    return _compiled(function, inline="always")


def vectors_of_four() -> None:
    """Keep a compiled function that calls this to vectors of four numbers; called by Python, it does nothing.

    With eight numbers to a vector, and two vectors at a time, a team of four never gets to the vectors.
    """


def _compiled(function: F, **more: Any) -> F:
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        return function
    return kept(function, _OWN, **_OPTIONS, **more)  # type: ignore[no-any-return]


def compiled_for(function: F, *arguments: Any) -> F:
    """Return a compiled function for arguments of just these types, from then on called without looking at their types.

    Numba finds out the type of every argument at every call, which for named tuples takes longer than a law. The caller
    promises that the types, also those within tuples and the layout of arrays, are always those of these arguments.
    Without compilation the function is returned unchanged.
    """
    if not hasattr(function, "compile"):
        return function
    key = function, _form(arguments)
    if key not in _entries:
        types = tuple(numba.typeof(argument) for argument in arguments)  # type: ignore[no-untyped-call]
        with warnings.catch_warnings():  # that records of one law begin as those of another that is compiled
            warnings.simplefilter("ignore", numba.NumbaExperimentalFeatureWarning)
            _entries[key] = function.compile(types)
    return _entries[key]  # type: ignore[return-value]


_entries: dict[tuple[Callable[..., Any], Any], Callable[..., Any]] = {}


def _form(value: Any) -> Any:
    """Return what decides on Numba's type of a value, which Numba takes milliseconds to find for arrays of records."""
    if isinstance(value, tuple):
        return type(value), *map(_form, value)
    if isinstance(value, np.ndarray):
        return value.dtype, value.ndim, value.flags.c_contiguous, value.flags.f_contiguous, value.flags.writeable
    return type(value)


def _teach_vectors() -> None:
    """Let compiled functions call `vectors_of_four`."""
    from numba.extending import intrinsic, overload

    @intrinsic
    def narrow(typing: Any) -> Any:
        def generate(context: Any, builder: Any, *_: Any) -> Any:
            # llvmlite itself adds only attributes that it knows, and this is not one of them
            set.add(builder.function.attributes, '"prefer-vector-width"="256"')
            return context.get_dummy_value()

        return numba.none(), generate

    # Inlined as text: what belongs to a function of its own would not count where that is inlined.
    overload(vectors_of_four, strict=False, inline="always")(lambda: lambda: narrow())  # type: ignore[call-arg]


def _teach_elementary() -> None:
    """Let compiled code call the functions of `elementary`, from the same text that Python runs."""
    from numba.extending import intrinsic, overload, register_jitable

    def reinterpreted(given: Any, taken: Any) -> Any:
        @intrinsic
        def bits(typing: Any, value: Any) -> Any:
            return taken(given), lambda context, builder, _, values: builder.bitcast(
                values[0], context.get_value_type(taken)
            )

        return bits

    to_bits, from_bits = reinterpreted(numba.float64, numba.int64), reinterpreted(numba.int64, numba.float64)
    meanings: dict[Callable[..., Any], Callable[..., Any]] = {
        elementary.to_bits: lambda x: to_bits(x),
        elementary.from_bits: lambda i: from_bits(i),
        elementary.select: lambda condition, a, b: a if condition else b,
        elementary.as_float: lambda i: float(i),
        elementary.sqrt: lambda x: np.sqrt(x),
        elementary.floor: lambda x: np.floor(x),
        elementary.copysign: lambda x, y: np.copysign(x, y),
    }
    for primitive in elementary.PRIMITIVES:
        chosen = meanings[primitive]
        overload(primitive, strict=False, jit_options={"forceinline": True})(lambda *_, chosen=chosen: chosen)
    for name, function in vars(elementary).items():
        if isinstance(function, FunctionType) and function not in elementary.PRIMITIVES:
            # What is rarely called, for angles beyond thousands of turns, would only make every law larger.
            options = {} if name.startswith("far_") else {"forceinline": True}
            register_jitable(**_OPTIONS, **options)(function)


if not numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
    _teach_elementary()
    _teach_vectors()
