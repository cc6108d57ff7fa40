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
        (angles,) = _arrays(x)
        beyond = ~(np.abs(angles) <= elementary.FAR)
        result = np.array(near(np.atleast_1d(np.where(beyond, 0.0, angles)))).reshape(angles.shape)
        result[beyond] = [far(float(angle)) for angle in angles[beyond]]
        return result

    function.__doc__ = far.__doc__
    return function


def of_any(scalar: Callable[..., Any]) -> Callable[..., Array]:
    """Return a function of arrays, which broadcast, made of one that holds for all numbers."""

    def function(*arguments: ArrayLike) -> Array:
        arrays = _arrays(*arguments)
        with np.errstate(all="ignore"):
            return np.array(scalar(*map(np.atleast_1d, arrays))).reshape(arrays[0].shape)

    function.__doc__ = scalar.__doc__
    return function


sin = of_angle(elementary.near_sin, elementary.sin)
cos = of_angle(elementary.near_cos, elementary.cos)
tan = of_angle(elementary.near_tan, elementary.tan)
asin, acos, atan, atan2 = map(of_any, (elementary.asin, elementary.acos, elementary.atan, elementary.atan2))
hypot = of_any(elementary.hypot)
exp, expm1, log, log1p = map(of_any, (elementary.exp, logarithms.expm1, logarithms.log, logarithms.log1p))
log2, log10 = map(of_any, (logarithms.log2, logarithms.log10))
sinh, cosh, tanh = map(of_any, (logarithms.sinh, logarithms.cosh, logarithms.tanh))
asinh, acosh, atanh = map(of_any, (logarithms.asinh, logarithms.acosh, logarithms.atanh))
pow, cbrt = map(of_any, (logarithms.pow, logarithms.cbrt))
