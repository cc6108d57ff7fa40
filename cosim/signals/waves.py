"""What is added to the inputs of a plant, over time."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.quantity import quantity
from cosim.scenario.scenario import InputSource, Wave
from cosim.scenario.table import read_table
from cosim.signals.sensors import random_stream
from plants import units

MIN_CUTOFF = 1e-6
"""Smallest cutoff of a random signal, as part of the communication points' frequency: below it, rounding moves the
filter's poles, which come near to one."""

TIME_TOLERANCE = 1e-9
"""By how much [s] a computed point in time may differ from the decimal number that is meant."""


def input_samples(
    source: InputSource, unit: units.Unit, times: NDArray[np.float64], step: float, seed: int, robot: str
) -> NDArray[np.float64]:
    """Return the sum of an input's signals at the communication points.

    A signal with a window is zero before its start and from its end on: the start is included, the end excluded.

    Parameters
    ----------
    source
        The input and its signals.
    unit
        The unit in which the result is wanted, that of the plant's input.
    times
        The communication points (T,) [s], from 0 on in steps of `step`.
    step
        Communication step [s].
    seed, robot
        With the input's name and the signal's position in it they name the stream of random numbers: a random signal
        is the same whatever other robots and inputs there are, and however long the run is.

    Returns
    -------
    ndarray
        Shape (T,), in `unit`.

    Raises
    ------
    InputError
        A value's unit does not fit, a table cannot be used, a cutoff is out of range, or the sum is too large a number.
    """
    total = np.zeros(len(times))
    with np.errstate(over="ignore", invalid="ignore"):
        for index, wave in enumerate(source.waves):
            if wave.kind == "random":
                total += _random(wave, unit, times, step, random_stream(seed, robot, f"input.{source.name}.{index}"))
            else:
                total += _wave(wave, unit, times)
    if not np.isfinite(total).all():
        raise InputError(
            f"the signals of the input {source.name!r} add up to more than can be computed with", source.where
        )
    return total


def _wave(wave: Wave, unit: units.Unit, times: NDArray[np.float64]) -> NDArray[np.float64]:
    if wave.kind == "table":
        assert wave.file is not None
        table = read_table(wave.file, wave.where)
        return np.interp(times, table.time, table.column(wave.column, unit, wave.where))
    value = _value(wave, unit)
    if wave.kind == "ramp":
        return value * np.clip((times - wave.start) / (wave.stop - wave.start), 0.0, 1.0)
    course = np.full(len(times), value)
    if wave.kind == "sine":
        course *= np.sin(2 * math.pi / wave.period * (times - wave.start) + wave.phase)
    return np.where(acting(wave, times), course, 0.0)


def _random(
    wave: Wave, unit: units.Unit, times: NDArray[np.float64], step: float, stream: np.random.Generator
) -> NDArray[np.float64]:
    """Return white Gaussian noise through a Butterworth low-pass of second order.

    The filter's state before the first sample is drawn from its stationary distribution, so there is nothing to settle.
    The factor is the one with which the standard deviation is exactly the value.
    """
    from scipy.signal import sosfilt  # slow to import, and few scenarios need it

    part = wave.cutoff * step
    if not MIN_CUTOFF <= part <= 0.5 - MIN_CUTOFF:
        raise InputError(
            f"the cutoff {wave.cutoff:g} Hz of a random signal is not from {MIN_CUTOFF / step:g} Hz to "
            f"{(0.5 - MIN_CUTOFF) / step:g} Hz, as communication steps of {step:g} s need",
            wave.where,
        )
    sos, spread, deviation = _low_pass(part)
    start = spread @ stream.standard_normal(2)
    course, _ = sosfilt(sos, stream.standard_normal(len(times)), zi=start[np.newaxis])
    return np.where(acting(wave, times), _value(wave, unit) / deviation * course, 0.0)


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


def _value(wave: Wave, unit: units.Unit) -> float:
    try:
        return quantity(wave.value, unit)
    except ValueError as error:
        raise InputError(f'value="{wave.value}" of <{wave.kind}>: {error}', wave.where) from None


def acting(wave: Wave, times: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return at which communication points a signal acts: from its start on, until before its end."""
    return (times >= wave.start - TIME_TOLERANCE) & (times < wave.stop - TIME_TOLERANCE)
