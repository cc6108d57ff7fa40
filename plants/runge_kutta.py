"""One step of the classical Runge-Kutta method of order 4, for numbers of Python as for arrays of NumPy."""

from collections.abc import Callable, Sequence
from typing import Protocol, Self, TypeVar


class _State(Protocol):
    """What can be multiplied with a number, and added: a number, or an array."""

    def __add__(self, other: Self, /) -> Self: ...

    def __rmul__(self, factor: float, /) -> Self: ...


T = TypeVar("T", bound=_State)


def runge_kutta_4(f: Callable[[float, list[T]], Sequence[T]], t: float, x: Sequence[T], h: float) -> list[T]:
    """Return the states at t + h.

    Parameters
    ----------
    f
        Returns der(x), an entry for each entry of x, from the time and the states.
    t
        The time [s].
    x
        The states, numbers or arrays.
    h
        The step [s].
    """

    def along(k: Sequence[T], step: float) -> list[T]:
        return [a + step * slope for a, slope in zip(x, k, strict=True)]

    k1 = f(t, list(x))
    k2 = f(t + h / 2, along(k1, h / 2))
    k3 = f(t + h / 2, along(k2, h / 2))
    k4 = f(t + h, along(k3, h))
    return along([p + 2 * q + 2 * r + s for p, q, r, s in zip(k1, k2, k3, k4, strict=True)], h / 6)
