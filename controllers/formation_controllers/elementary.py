"""Sine, exponential and other elementary functions whose results have the same bits on every machine.

A C library's functions differ from one library, and from one processor, to the next: where there are fused
multiply-adds it uses them. These functions are made of what IEEE 754 defines to the last bit: additions,
multiplications, divisions and square roots of doubles, one after the other, and the bits of a double as a whole number.
They err by less than one unit in the last place, for all arguments, and treat infinities, NaN, zeros with a sign and
subnormal numbers as C does.

This one text, functions and constants, is used in three ways: as it stands, for numbers and for arrays of NumPy;
compiled by Numba, in laws; and translated to C, in plants. The distributions of the harness and of the controllers each
hold it, letter by letter the same, as neither knows the other. So it keeps to a small language:

- A function has annotated arguments and results, which are floats, whole numbers of 64 bits, truth values or tuples of
  these; it is a sequence of assignments to new names, and a ``return``. What depends on a condition is a `select`.
- A function that begins with ``if`` serves numbers alone; those with the prefix ``near_`` serve arrays.
- No number is ever divided by zero: Python would raise an exception.
"""

from __future__ import annotations

import math
import re
import struct
from typing import Any, Final

import numpy as np

# Primitives -------------------------------------------------------------------------------------------------


def to_bits(x: float) -> int:
    """Return the bits of a double as a whole number."""
    if isinstance(x, np.ndarray):
        return x.view(np.int64)
    return int(struct.unpack("<q", struct.pack("<d", x))[0])


def from_bits(i: int) -> float:
    """Return the double that has these bits."""
    if isinstance(i, np.ndarray):
        return i.view(np.float64)
    return float(struct.unpack("<d", struct.pack("<Q", int(i) & 0xFFFFFFFFFFFFFFFF))[0])


def select(condition: bool, a: float, b: float) -> float:
    """Return a where the condition holds, else b."""
    if isinstance(condition, np.ndarray):
        return np.where(condition, a, b)
    return a if condition else b


def as_float(i: int) -> float:
    """Return a whole number as a double."""
    return i.astype(np.float64) if isinstance(i, np.ndarray) else float(i)


def sqrt(x: float) -> float:
    """Return the square root, of a negative number NaN."""
    if isinstance(x, np.ndarray):
        return np.sqrt(x)
    return math.sqrt(x) if x >= 0.0 else math.nan


def floor(x: float) -> float:
    """Return the largest whole number that is not above x."""
    return np.floor(x) if isinstance(x, np.ndarray) else float(np.floor(x))


def copysign(x: float, y: float) -> float:
    """Return x with the sign of y."""
    return np.copysign(x, y) if isinstance(y, np.ndarray) else math.copysign(x, y)


PRIMITIVES: Final = (to_bits, from_bits, select, as_float, sqrt, floor, copysign)
"""What every one of the three ways defines in its own way."""

# Constants: see studies/elementary.py -----------------------------------------------------------------------

INFINITE: Final = math.inf
NOT_A_NUMBER: Final = math.nan
LARGEST: Final = 1.7976931348623157e308  # the largest finite number
FAR: Final = 1000000.0  # beyond it, an angle is reduced with whole numbers
TINY: Final = 7.450580596923828e-09  # below it, the cube of a number does not count
SHIFT: Final = 6755399441055744.0  # added and taken away again, leaves a whole number
SHIFT_BITS: Final = 4843621399236968448  # its bits
SHIFT_16: Final = 103079215104.0  # the same, leaves a multiple of 2^-16
SHIFT_25: Final = 201326592.0  # the same, leaves a multiple of 2^-25
HEAD: Final = -134217728  # mask of all but the last 27 bits
HALF_PI: Final = 1.5707963267948966
HALF_PI_LOW: Final = 6.123233995736766e-17  # pi/2 less HALF_PI, and the like below
QUARTER_PI: Final = 0.7853981633974483
QUARTER_PI_LOW: Final = 3.061616997868383e-17
ATAN_HALF: Final = 0.4636476090008061  # atan 1/2
ATAN_HALF_LOW: Final = 2.2698777452961687e-17
LOG2_E: Final = 1.4426950408889634
LOG_2: Final = 0.6931471805598903
LOG_2_LOW: Final = 5.497923018708371e-14
TWO_OVER_PI: Final = 0.6366197723675814
HALF_PI_1: Final = 1.5707963267341256  # parts of 33 bits, and the rest
HALF_PI_2: Final = 6.077100506303966e-11
HALF_PI_3: Final = 2.0222662487111665e-21
HALF_PI_4: Final = 8.4784276603689e-32
SINE_3: Final = -0.1640625  # sin r = r + SINE_3 r^3 + SINE_3_REST r^3 + SINE_5 r^5 + ...
SINE_3_REST: Final = -0.0026041666666666574
SINE_5: Final = 0.008333333333330948
SINE_7: Final = -0.0001984126983675854
SINE_9: Final = 2.7557316102534617e-06
SINE_11: Final = -2.505113184128889e-08
SINE_13: Final = 1.5918129027234826e-10
COSINE_4: Final = 0.041666666666666664  # cos r = 1 - r^2/2 + COSINE_4 r^4 + ...
COSINE_6: Final = -0.0013888888888887398
COSINE_8: Final = 2.4801587298765665e-05
COSINE_10: Final = -2.7557317271718644e-07
COSINE_12: Final = 2.087614626607931e-09
COSINE_14: Final = -1.1382632258093615e-11
ATAN_3: Final = -0.3333333333333333  # atan r = r + ATAN_3 r^3 + ...
ATAN_5: Final = 0.1999999999999956
ATAN_7: Final = -0.14285714285502987
ATAN_9: Final = 0.11111111072109199
ATAN_11: Final = -0.09090905477849787
ATAN_13: Final = 0.07692119151590426
ATAN_15: Final = -0.06660860153672582
ATAN_17: Final = 0.05777172538911189
ATAN_19: Final = -0.042123745554151784
EXP_3: Final = 0.16666666666666669  # exp r = 1 + r + r^2/2 + EXP_3 r^3 + ...
EXP_4: Final = 0.041666666666666664
EXP_5: Final = 0.008333333333330065
EXP_6: Final = 0.0013888888888886554
EXP_7: Final = 0.0001984126986304067
EXP_8: Final = 2.4801587317135252e-05
EXP_9: Final = 2.7557268480116333e-06
EXP_10: Final = 2.7557282983917557e-07
EXP_11: Final = 2.5100375924709717e-08
EXP_12: Final = 2.0911229795563617e-09

_TWO_OVER_PI: Final = (  # behind the point, in hexadecimal
    "a2f9836e4e441529fc2757d1f534ddc0db6295993c439041fe5163abdebbc561b7246e3a424dd2e006492eea09d1921c"
    "fe1deb1cb129a73ee88235f52ebb4484e99c7026b45f7e413991d639835339f49c845f8bbdf9283b1ff897ffde05980f"
    "ef2f118b5a0a6d1f6d367ecf27cb09b74f463f669e5fea2d7527bac7ebe5f17b3d0739f78a5292ea6bfb5fb11f8d5d08"
    "56033046fc7b6babf0cfbc209af4361da9e391615ee61b08"
)
DIGITS: Final[Any] = np.array([0] * 4 + [int(digit, 16) for digit in re.findall(".{6}", _TWO_OVER_PI)], np.int64)
"""Digits of 2/pi to the base 2^24, behind four zeros."""

# Sums, products and quotients of more than double precision ---------------------------------------------------


def exact_sum(a: float, b: float) -> tuple[float, float]:
    """Return the rounded sum, and what was rounded off."""
    s = a + b
    v = s - a
    return s, (a - (s - v)) + (b - v)


def head(x: float) -> float:
    """Return the leading 26 bits of the significand; 27 are left."""
    return from_bits(to_bits(x) & HEAD)


def exact_product(a: float, b: float) -> tuple[float, float]:
    """Return the rounded product, and what was rounded off."""
    a_1 = head(a)
    a_0 = a - a_1
    b_1 = head(b)
    b_0 = b - b_1
    p = a * b
    return p, ((a_1 * b_1 - p) + a_1 * b_0 + a_0 * b_1) + a_0 * b_0


def exact_quotient(n: float, n_low: float, d: float, d_low: float) -> tuple[float, float]:
    """Return (n + n_low)/(d + d_low) as a sum of 26 leading bits and the rest."""
    inverse = 1.0 / d
    q = head(n * inverse)
    d_1 = head(d)
    rest = ((n - q * d_1) - q * (d - d_1)) + (n_low - q * d_low)
    return q, rest * inverse


def times_power(x: float, k: int) -> float:
    """Return x times 2 to the power k, |k| <= 2044: in two factors, as one alone may be beyond the largest double."""
    half = k >> 1
    return x * from_bits((half + 1023) << 52) * from_bits((k - half + 1023) << 52)


# Sine, cosine, tangent --------------------------------------------------------------------------------------


def near_turn(x: float) -> tuple[float, float, int]:
    """Return x less n pi/2 as a sum of two numbers, and n, for |x| <= FAR.

    The parts of pi/2 have 33 bits and n has 20, so that the products are exact.
    """
    t = x * TWO_OVER_PI + SHIFT
    n = t - SHIFT
    a = x - n * HALF_PI_1
    b = n * HALF_PI_2
    c = a - b
    d = n * HALF_PI_3 - ((a - c) - b)
    r = c - d
    return r, ((c - r) - d) - n * HALF_PI_4, to_bits(t)


def row(m_0: int, m_1: int, m_2: int, j: int) -> int:
    """Return one digit, with what it carries, of the product of a significand and 2/pi."""
    row: int = m_0 * DIGITS[j] + m_1 * DIGITS[j + 1] + m_2 * DIGITS[j + 2]
    return row


def far_turn(x: float) -> tuple[float, float, int]:
    """Return |x| less n pi/2 as a sum of two numbers, and n modulo 4, for FAR < |x| < infinity.

    M. H. Payne, R. N. Hanek: Radian reduction for trigonometric functions. ACM SIGNUM Newsletter 18 (1983), 19-24.
    Digits of 24 bits: the significand has three, which begin at a multiple of 24 bits, and of 2/pi those matter that
    its product with them takes to the last two bits of n and to 192 bits behind the point.
    """
    bits = to_bits(abs(x))
    place = (bits >> 52) - 1003
    first = place // 24
    shift = place - 24 * first
    m = (bits & 4503599627370495) | 4503599627370496
    lower = (m & 16777215) << shift
    upper = ((m >> 24) << shift) + (lower >> 24)
    m_0 = lower & 16777215
    m_1 = upper & 16777215
    m_2 = upper >> 24
    p_8 = row(m_0, m_1, m_2, first + 8) + (row(m_0, m_1, m_2, first + 9) >> 24)
    p_7 = row(m_0, m_1, m_2, first + 7) + (p_8 >> 24)
    p_6 = row(m_0, m_1, m_2, first + 6) + (p_7 >> 24)
    p_5 = row(m_0, m_1, m_2, first + 5) + (p_6 >> 24)
    p_4 = row(m_0, m_1, m_2, first + 4) + (p_5 >> 24)
    p_3 = row(m_0, m_1, m_2, first + 3) + (p_4 >> 24)
    p_2 = row(m_0, m_1, m_2, first + 2) + (p_3 >> 24)
    p_1 = row(m_0, m_1, m_2, first + 1) + (p_2 >> 24)
    p_0 = row(m_0, m_1, m_2, first) + (p_1 >> 24)
    # Two digits at a time, the first ones less 1 where n is rounded up
    up = (p_1 >> 23) & 1
    f_1 = as_float((((p_1 & 16777215) << 24) | (p_2 & 16777215)) - (up << 48)) * 3.552713678800501e-15
    f_2 = as_float(((p_3 & 16777215) << 24) | (p_4 & 16777215)) * 1.262177448353619e-29
    f_3 = as_float(((p_5 & 16777215) << 24) | (p_6 & 16777215)) * 4.484155085839415e-44
    f_4 = as_float(((p_7 & 16777215) << 24) | (p_8 & 16777215)) * 1.5930919111324523e-58
    a, a_low = exact_sum(f_1, f_2)
    b, b_low = exact_sum(a, a_low + (f_3 + f_4))
    c, c_low = exact_product(b, HALF_PI)
    low = c_low + (b * HALF_PI_LOW + b_low * HALF_PI)
    r = c + low
    return r, (c - r) + low, p_0 + up


def sum_of_sine(r: float, low: float) -> tuple[float, float]:
    """Return the sine of r + low, |r| <= pi/4 and a little, as a sum; r and a part of r^3 are exact."""
    z = r * r
    w = z * z
    h = (r + SHIFT_16) - SHIFT_16
    cube = SINE_3 * h * h * h
    tail = z * (SINE_5 + z * SINE_7 + w * (SINE_9 + z * SINE_11 + w * SINE_13))
    rest = r * (z * (SINE_3_REST + tail)) + (SINE_3 * ((r - h) * (z + h * (r + h))) + (low - 0.5 * z * low))
    y = r + cube
    return y, ((r - y) + cube) + rest


def sum_of_cosine(r: float, low: float) -> tuple[float, float]:
    """Return the cosine of r + low as a sum; 1 and a part of r^2/2 are exact."""
    z = r * r
    w = z * z
    h = (r + SHIFT_25) - SHIFT_25
    tail = w * (COSINE_4 + z * COSINE_6 + w * (COSINE_8 + z * COSINE_10 + w * (COSINE_12 + z * COSINE_14)))
    return 1.0 - 0.5 * h * h, tail - (0.5 * (r - h) * (r + h) + r * low)


def turned(r: float, low: float, n: int) -> tuple[float, float]:
    """Return the sine and cosine of r + low + n pi/2."""
    s, s_low = sum_of_sine(r, low)
    c, c_low = sum_of_cosine(r, low)
    is_odd = (n & 1) == 1
    sine = select(is_odd, c + c_low, s + s_low)
    cosine = select(is_odd, s + s_low, c + c_low)
    return from_bits(to_bits(sine) ^ ((n & 2) << 62)), from_bits(to_bits(cosine) ^ (((n + 1) & 2) << 62))


def slope(r: float, low: float, n: int) -> float:
    """Return the tangent of r + low + n pi/2."""
    s, s_low = sum_of_sine(r, low)
    c, c_low = sum_of_cosine(r, low)
    y = s + s_low
    x = c + c_low
    y_low = (s - y) + s_low
    x_low = (c - x) + c_low
    is_odd = (n & 1) == 1
    q, rest = exact_quotient(
        select(is_odd, -x, y), select(is_odd, -x_low, y_low), select(is_odd, y, x), select(is_odd, y_low, x_low)
    )
    return q + rest


def near_sin_cos(x: float) -> tuple[float, float]:
    """Return sine and cosine for |x| <= FAR."""
    r, low, n = near_turn(x)
    sine, cosine = turned(r, low, n)
    return select(abs(x) < TINY, x, sine), cosine


def near_sin(x: float) -> float:
    """Return the sine for |x| <= FAR."""
    sine, _ = near_sin_cos(x)
    return sine


def near_cos(x: float) -> float:
    """Return the cosine for |x| <= FAR."""
    _, cosine = near_sin_cos(x)
    return cosine


def near_tan(x: float) -> float:
    """Return the tangent for |x| <= FAR."""
    r, low, n = near_turn(x)
    return select(abs(x) < TINY, x, slope(r, low, n))


def near_sin_cos_tan(x: float) -> tuple[float, float, float]:
    """Return sine, cosine and tangent for |x| <= FAR."""
    r, low, n = near_turn(x)
    sine, cosine = turned(r, low, n)
    is_tiny = abs(x) < TINY
    return select(is_tiny, x, sine), cosine, select(is_tiny, x, slope(r, low, n))


def far_functions(x: float) -> tuple[float, float, float]:
    """Return sine, cosine and tangent for |x| > FAR, NaN for infinity and NaN."""
    if not abs(x) <= LARGEST:
        return x - x, x - x, x - x
    r, low, n = far_turn(x)
    sine, cosine = turned(r, low, n)
    sign = copysign(1.0, x)
    return sign * sine, cosine, sign * slope(r, low, n)


def sin_cos(x: float) -> tuple[float, float]:
    """Return sine and cosine of an angle [rad]: for little more than the price of one."""
    if not abs(x) <= FAR:
        return far_functions(x)[0], far_functions(x)[1]
    return near_sin_cos(x)


def sin_cos_tan(x: float) -> tuple[float, float, float]:
    """Return sine, cosine and tangent of an angle [rad]: for less than the price of two."""
    if not abs(x) <= FAR:
        return far_functions(x)
    return near_sin_cos_tan(x)


def sin(x: float) -> float:
    """Return the sine of an angle [rad]."""
    if not abs(x) <= FAR:
        return far_functions(x)[0]
    return near_sin(x)


def cos(x: float) -> float:
    """Return the cosine of an angle [rad]."""
    if not abs(x) <= FAR:
        return far_functions(x)[1]
    return near_cos(x)


def tan(x: float) -> float:
    """Return the tangent of an angle [rad]."""
    if not abs(x) <= FAR:
        return far_functions(x)[2]
    return near_tan(x)


# Angles of a point ------------------------------------------------------------------------------------------


def sum_of_angle(y: float, x: float) -> tuple[float, float]:
    """Return atan2(|y|, x) as a sum.

    The smaller one over the larger is the tangent t of an angle of at most 45 degrees. With the nearest of three values
    f = 0, 1/2 and 1, atan(t) = atan(f) + atan(q), q = (t - f)/(1 + t f), |q| < 0.24.
    """
    u = abs(x)
    v = abs(y)
    is_steep = v > u
    larger = select(is_steep, v, u)
    smaller = select(is_steep, u, v)
    is_plain = (larger > 0.0) & (larger <= LARGEST)
    large = select(is_plain, larger, 1.0)
    small = select(is_plain, smaller, select(smaller > LARGEST, 1.0, 0.0))
    scale = select(large > 5.260135901548374e210, 4.909093465297727e-91, 2.037035976334486e90)
    s = small * scale
    b = large * scale
    is_high = s > 0.8345 * b
    is_middle = s > 0.2361 * b
    f = select(is_high, 1.0, select(is_middle, 0.5, 0.0))
    base = select(is_high, QUARTER_PI, select(is_middle, ATAN_HALF, 0.0))
    base_low = select(is_high, QUARTER_PI_LOW, select(is_middle, ATAN_HALF_LOW, 0.0))
    n, n_low = exact_sum(s, -(f * b))
    d = b + f * s
    q, q_rest = exact_quotient(n, n_low, d, (b - d) + f * s)
    t = q + q_rest
    t_low = (q - t) + q_rest
    z = t * t
    w = z * z
    series = (ATAN_5 + z * ATAN_7) + w * (
        (ATAN_9 + z * ATAN_11) + w * ((ATAN_13 + z * ATAN_15) + w * (ATAN_17 + z * ATAN_19))
    )
    tail = t * (z * (ATAN_3 + z * series)) + (t_low - z * t_low)
    is_left = to_bits(x) < 0
    whole = select(is_steep, 1.0, select(is_left, 2.0, 0.0))
    sign = select(is_steep == is_left, 1.0, -1.0)
    g = whole * HALF_PI
    h, h_low = exact_sum(g, sign * base)
    a, a_low = exact_sum(h, sign * t)
    return a, a_low + (h_low + (whole * HALF_PI_LOW + sign * base_low) + sign * tail)


def atan2(y: float, x: float) -> float:
    """Return the angle [rad] of the point (x, y) about the origin, from the x axis, between -pi and pi."""
    a, low = sum_of_angle(y, x)
    return select((x != x) | (y != y), x + y, copysign(a + low, y))


def atan(x: float) -> float:
    """Return the angle [rad] between -pi/2 and pi/2 whose tangent this is."""
    return atan2(x, 1.0)


def root_of_sum(w: float, low: float) -> tuple[float, float]:
    """Return the square root of w + low as a sum."""
    y = sqrt(w)
    s, s_low = exact_product(y, y)
    return y, (((w - s) - s_low) + low) / select(y > 0.0, 2.0 * y, 1.0)


def leg(x: float) -> tuple[float, float]:
    """Return the square root of 1 - x^2 as a sum, NaN for |x| > 1."""
    p, low = exact_product(x, x)
    w = 1.0 - p
    return root_of_sum(w, ((1.0 - w) - p) - low)


def acos(x: float) -> float:
    """Return the angle [rad] between 0 and pi whose cosine this is."""
    y, y_low = leg(x)
    a, low = sum_of_angle(y, x)
    return a + (low + x * y_low)


def asin(x: float) -> float:
    """Return the angle [rad] between -pi/2 and pi/2 whose sine this is."""
    y, y_low = leg(x)
    a, low = sum_of_angle(x, y)
    return copysign(a + (low - abs(x) * y_low), x)


def hypot(x: float, y: float) -> float:
    """Return the distance of the point (x, y) from the origin."""
    u = abs(x)
    v = abs(y)
    large = select(v > u, v, u)
    factor = select(large > 3.273390607896142e150, 2.409919865102884e-181, 1.0)
    scale = select(large < 3.054936363499605e-151, 4.149515568880993e180, factor)
    p, p_low = exact_product(u * scale, u * scale)
    q, q_low = exact_product(v * scale, v * scale)
    w, w_low = exact_sum(p, q)
    h, low = root_of_sum(w, w_low + (p_low + q_low))
    return select((u > LARGEST) | (v > LARGEST), INFINITE, (h + low) / scale)


# Exponential functions --------------------------------------------------------------------------------------


def parts_of_exp(x: float, low: float) -> tuple[float, float, float, int]:
    """Return r, r^2/2, what is left of e^r, and k, where x + low = r + k log 2."""
    t = x * LOG2_E + SHIFT
    n = t - SHIFT
    h = x - n * LOG_2
    g = n * LOG_2_LOW - low
    r = h - g
    c = (h - r) - g
    z = r * r
    w = z * z
    p = (EXP_3 + r * EXP_4) + z * (EXP_5 + r * EXP_6)
    q = (EXP_7 + r * EXP_8) + z * (EXP_9 + r * EXP_10) + w * (EXP_11 + r * EXP_12)
    return r, 0.5 * z, (z * r) * (p + w * q) + (c + c * r), to_bits(t) - SHIFT_BITS


def exp_of_sum(x: float, low: float, less: int) -> float:
    """Return e to the power x + low, of which the second counts for little, over 2 to the power `less`."""
    r, square, rest, k = parts_of_exp(select(x > 720.0, 720.0, select(x < -750.0, -750.0, x)), low)
    s = 1.0 + r
    return times_power(s + (((1.0 - s) + r) + (square + rest)), k - less)


def exp(x: float) -> float:
    """Return e to the power x."""
    return exp_of_sum(x, 0.0, 0)
