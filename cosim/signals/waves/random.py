"""White Gaussian noise through a Butterworth low-pass of second order."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from cosim.scenario.scenario import WaveSource
from cosim.signals.waves.wave import Sampling, Wave
from plants.elementary import tan

MIN_CUTOFF = 1e-6
"""Smallest cutoff, as part of the communication points' frequency: below it, rounding moves the filter's poles, which
come near to one."""


class Random(Wave):
    """``<random>``, whose value is its standard deviation."""

    element = "random"

    def __init__(self, written: WaveSource) -> None:
        super().__init__(written)
        self.cutoff = written.positive("cutoff", "Hz")
        self._state: tuple[float, float] | None = None

    def samples(self, sampling: Sampling) -> NDArray[np.float64]:
        """Return the values.

        The filter's state before the first sample is drawn from its stationary distribution, so there is nothing to
        settle. The factor is the one with which the standard deviation is exactly the value.
        """
        low_pass = _low_pass(self._part(sampling.step))
        if self._state is None:
            self._state = low_pass.start(*sampling.stream.standard_normal(2).tolist())
        values = sampling.stream.standard_normal(len(sampling.times)).tolist()
        course, self._state = low_pass.filtered(self._state, values)
        return np.where(self.acting(sampling.times), self.amount(sampling) / low_pass.deviation * course, 0.0)

    def _part(self, step: float) -> float:
        """Return the cutoff as part of the communication points' frequency."""
        if self.cutoff >= 0.5 / step:
            raise self.written.error(
                f"the cutoff {self.cutoff:g} Hz is not below half of the ticks' frequency, {0.5 / step:g} Hz"
            )
        part = self.cutoff * step
        if not MIN_CUTOFF <= part <= 0.5 - MIN_CUTOFF:
            raise self.written.error(
                f"the cutoff {self.cutoff:g} Hz of a random signal is not from {MIN_CUTOFF / step:g} Hz to "
                f"{(0.5 - MIN_CUTOFF) / step:g} Hz, as communication steps of {step:g} s need"
            )
        return part


@dataclass(frozen=True)
class _LowPass:
    """A Butterworth low-pass of second order for white noise of variance 1.

    Attributes
    ----------
    b, a : tuple
        Coefficients of its numerator and, but the first, which is 1, of its denominator.
    spread : tuple
        Entries 11, 21 and 22 of the Cholesky factor of its state's stationary covariance.
    deviation : float
        The standard deviation of its output.
    """

    b: tuple[float, float, float]
    a: tuple[float, float]
    spread: tuple[float, float, float]
    deviation: float

    def start(self, first: float, second: float) -> tuple[float, float]:
        """Return the state before the first value, which two numbers of variance 1 choose."""
        l_11, l_21, l_22 = self.spread
        return l_11 * first, l_21 * first + l_22 * second

    def filtered(
        self, state: tuple[float, float], values: list[float]
    ) -> tuple[NDArray[np.float64], tuple[float, float]]:
        """Return the output from a state on, and the state after it."""
        (b_0, b_1, b_2), (a_1, a_2) = self.b, self.a
        z_1, z_2 = state
        course = []
        for u in values:
            y = b_0 * u + z_1
            z_1, z_2 = b_1 * u - a_1 * y + z_2, b_2 * u - a_2 * y
            course.append(y)
        return np.array(course), (z_1, z_2)


@cache
def _low_pass(cutoff: float) -> _LowPass:
    """Return the low-pass with a cutoff as part of the sampling frequency.

    It is the bilinear transform of 1/(s^2 + sqrt(2) s + 1).
    """
    k = tan(math.pi * cutoff)
    damped, square = math.sqrt(2) * k, k * k
    scale = 1 / (1 + damped + square)
    b_0, b_1, b_2 = square * scale, 2 * square * scale, square * scale
    a_1, a_2 = 2 * (square - 1) * scale, (1 - damped + square) * scale
    # Its state z, with z_1' = -a_1 z_1 + z_2 + c_1 u, z_2' = -a_2 z_1 + c_2 u and y = z_1 + b_0 u, has the covariance
    # p = A p A' + c c'. In this form, hardly a digit is lost where the poles are near to one.
    c_1, c_2 = b_1 - a_1 * b_0, b_2 - a_2 * b_0
    p_11 = ((1 + a_2) * (c_1 * c_1 + c_2 * c_2) - 2 * a_1 * c_1 * c_2) / ((1 - a_2) * (1 + a_1 + a_2) * (1 + a_2 - a_1))
    p_12 = (a_1 * a_2 * p_11 + c_1 * c_2) / (1 + a_2)
    p_22 = a_2 * a_2 * p_11 + c_2 * c_2
    l_11, l_21 = math.sqrt(p_11), p_12 / math.sqrt(p_11)
    spread = l_11, l_21, math.sqrt(max(p_22 - l_21 * l_21, 0.0))
    return _LowPass((b_0, b_1, b_2), (a_1, a_2), spread, math.sqrt(p_11 + b_0 * b_0))
