"""The functions of `plants.elementary` for arrays of NumPy: the same bits, entry by entry."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plants import elementary, logarithms

Array: TypeAlias = NDArray[np.float64]


def _arrays(*values: ArrayLike) -> list[Array]:
    return [np.array(value, dtype=float) for value in np.broadcast_arrays(*values)]


def of_angle(near: Callable[[Any], Any], far: Callable[[Any], Any]) -> Callable[[ArrayLike], Array]:
    """Return a function of angles, made of one for those up to `elementary.FAR` and one for a number beyond."""

    def function(x: ArrayLike) -> Array:
        if np.ndim(x) == 0:
            return np.float64(far(float(x)))  # type: ignore[arg-type, return-value]
        (angles,) = _arrays(x)
        beyond = ~(np.abs(angles) <= elementary.FAR)
        result = np.array(near(np.where(beyond, 0.0, angles)))
        result[beyond] = [far(float(angle)) for angle in angles[beyond]]
        return result

    function.__doc__ = far.__doc__
    return function


def of_any(scalar: Callable[..., Any]) -> Callable[..., Array]:
    """Return a function of arrays, which broadcast, made of one that holds for all numbers."""

    def function(*arguments: ArrayLike) -> Array:
        arrays = _arrays(*arguments)
        if arrays[0].ndim == 0:
            return np.float64(scalar(*map(float, arrays)))  # type: ignore[return-value]
        with np.errstate(all="ignore"):
            return np.array(scalar(*arrays))

    function.__doc__ = scalar.__doc__
    return function


sin = of_angle(elementary.near_sin, elementary.sin)
cos = of_angle(elementary.near_cos, elementary.cos)
tan = of_angle(elementary.near_tan, elementary.tan)
asin = of_any(elementary.asin)
acos = of_any(elementary.acos)
atan = of_any(elementary.atan)
atan2 = of_any(elementary.atan2)
hypot = of_any(elementary.hypot)
exp = of_any(elementary.exp)
expm1 = of_any(logarithms.expm1)
log = of_any(logarithms.log)
log1p = of_any(logarithms.log1p)
log2 = of_any(logarithms.log2)
log10 = of_any(logarithms.log10)
pow = of_any(logarithms.pow)
cbrt = of_any(logarithms.cbrt)
sinh = of_any(logarithms.sinh)
cosh = of_any(logarithms.cosh)
tanh = of_any(logarithms.tanh)
asinh = of_any(logarithms.asinh)
acosh = of_any(logarithms.acosh)
atanh = of_any(logarithms.atanh)
larger = of_any(logarithms.larger)
smaller = of_any(logarithms.smaller)
