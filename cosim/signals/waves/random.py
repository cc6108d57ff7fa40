"""White Gaussian noise through a Butterworth low-pass of second order."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from cosim.scenario.scenario import WaveSource
from cosim.signals.waves.wave import Sampling, Wave

MIN_CUTOFF = 1e-6
"""Smallest cutoff, as part of the communication points' frequency: below it, rounding moves the filter's poles, which
come near to one."""


class Random(Wave):
    """``<random>``, whose value is its standard deviation."""

    element = "random"

    def __init__(self, written: WaveSource) -> None:
        super().__init__(written)
        self.cutoff = written.positive("cutoff", "Hz")

    def samples(self, sampling: Sampling) -> NDArray[np.float64]:
        """Return the values.

        The filter's state before the first sample is drawn from its stationary distribution, so there is nothing to
        settle. The factor is the one with which the standard deviation is exactly the value.
        """
        from scipy.signal import sosfilt  # slow to import, and few scenarios need it

        sos, spread, deviation = _low_pass(self._part(sampling.step))
        stream = sampling.stream()
        start = spread @ stream.standard_normal(2)
        course, _ = sosfilt(sos, stream.standard_normal(len(sampling.times)), zi=start[np.newaxis])
        return np.where(self.acting(sampling.times), self.amount(sampling) / deviation * course, 0.0)

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


@cache
def _low_pass(cutoff: float) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Return a Butterworth low-pass of second order for white noise of variance 1.

    Returns
    -------
    tuple
        Its coefficients as `scipy.signal.sosfilt` takes them, the Cholesky factor (2, 2) of its state's stationary
        covariance, and the standard deviation of its output.
    """
    from scipy.signal import butter

    sos = butter(2, 2 * cutoff, output="sos")
    b_0, b_1, b_2, _, a_1, a_2 = sos[0].tolist()
    # Its state z, with z_1' = -a_1 z_1 + z_2 + c_1 u, z_2' = -a_2 z_1 + c_2 u and y = z_1 + b_0 u, has the covariance
    # p = A p A' + c c'. In this form, hardly a digit is lost where the poles are near to one.
    c_1, c_2 = b_1 - a_1 * b_0, b_2 - a_2 * b_0
    p_11 = ((1 + a_2) * (c_1**2 + c_2**2) - 2 * a_1 * c_1 * c_2) / ((1 - a_2) * (1 + a_1 + a_2) * (1 + a_2 - a_1))
    p_12 = (a_1 * a_2 * p_11 + c_1 * c_2) / (1 + a_2)
    p_22 = a_2**2 * p_11 + c_2**2
    l_11, l_21 = math.sqrt(p_11), p_12 / math.sqrt(p_11)
    return sos, np.array([[l_11, 0.0], [l_21, math.sqrt(max(p_22 - l_21**2, 0.0))]]), math.sqrt(p_11 + b_0**2)
