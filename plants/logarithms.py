"""Logarithms, powers, hyperbolic functions and others that a model may use, in the way of `plants.elementary`."""

from __future__ import annotations

from typing import Final

from plants.elementary import (
    INFINITE,
    LARGEST,
    LOG2_E,
    LOG_2,
    LOG_2_LOW,
    NOT_A_NUMBER,
    TINY,
    as_float,
    copysign,
    exact_product,
    exact_quotient,
    exact_sum,
    exp,
    exp_of_sum,
    floor,
    from_bits,
    parts_of_exp,
    root_of_sum,
    select,
    to_bits,
)

# Constants: see studies/elementary.py -----------------------------------------------------------------------

TINY_SQUARE: Final = 5.551115123125783e-17  # below it, the square of a number does not count
MODERATE: Final = 50.0  # up to it, e^x - 1 is computed as such
ROOT_HALF_BITS: Final = 4604544271217802189  # bits of sqrt(1/2)
LOG2_E_LOW: Final = 2.0355273740931033e-17
LOG10_E: Final = 0.4342944819032518
LOG10_E_LOW: Final = 1.098319650216765e-17
ARTANH_3: Final = 0.3333333333333333
ARTANH_3_LOW: Final = 1.850371707708594e-17
ARTANH_5: Final = 0.2
ARTANH_7: Final = 0.14285714285714682
ARTANH_9: Final = 0.11111111110828116
ARTANH_11: Final = 0.09090909167657202
ARTANH_13: Final = 0.07692297485447729
ARTANH_15: Final = 0.06667402119112673
ARTANH_17: Final = 0.05853124270461193
ARTANH_19: Final = 0.058615255140488765

# Logarithms and powers --------------------------------------------------------------------------------------


def log_of_sum(x: float, low: float) -> tuple[float, float]:
    """Return the natural logarithm of x + low > 0 as a sum; where x is not near 1, `low` counts for little.

    log(2^k m) = k log 2 + 2 artanh(s) with s = (m - 1)/(m + 1), |s| < 0.172.
    """
    is_subnormal = x < 2.2250738585072014e-308
    v = select(is_subnormal, x * 18014398509481984.0, x)
    bits = to_bits(v)
    k = (bits - ROOT_HALF_BITS) >> 52
    m_low = low * from_bits((1024 - k) << 52) * 0.5
    f, f_low = exact_sum(from_bits(bits - (k << 52)) - 1.0, m_low)
    d = 2.0 + f
    q, rest = exact_quotient(f, f_low, d, ((2.0 - d) + f) + f_low)
    s = q + rest
    s_low = (q - s) + rest
    z, z_low = exact_product(s, s)
    w = z * z
    series = w * (
        (ARTANH_5 + z * ARTANH_7)
        + w * ((ARTANH_9 + z * ARTANH_11) + w * ((ARTANH_13 + z * ARTANH_15) + w * (ARTANH_17 + z * ARTANH_19)))
    )
    third, third_low = exact_product(z, ARTANH_3)
    u, u_low = exact_sum(third, series)
    p, p_low = exact_product(2.0 * s, u)
    more = 2.0 * s * (u_low + (third_low + (z * ARTANH_3_LOW + z_low * ARTANH_3)))
    n = as_float(k) - select(is_subnormal, 54.0, 0.0)
    a, a_low = exact_sum(n * LOG_2, 2.0 * s)
    b, b_low = exact_sum(a, p)
    c = a_low + (b_low + (p_low + (more + (2.0 * s_low * (1.0 + (z + w)) + n * LOG_2_LOW))))
    h = b + c
    return h, (b - h) + c


def sum_of_log(x: float) -> tuple[float, float]:
    """Return the natural logarithm of a number, and what was rounded off."""
    is_plain = (x > 0.0) & (x <= LARGEST)
    h, low = log_of_sum(select(is_plain, x, 1.0), 0.0)
    other = select(x == 0.0, -INFINITE, select(x > 0.0, x, NOT_A_NUMBER))
    return select(is_plain, h, other), select(is_plain, low, 0.0)


def log(x: float) -> float:
    """Return the natural logarithm."""
    h, _ = sum_of_log(x)
    return h


def log2(x: float) -> float:
    """Return the logarithm to the base 2."""
    h, low = sum_of_log(x)
    p, p_low = exact_product(h, LOG2_E)
    inside = p + (p_low + (h * LOG2_E_LOW + low * LOG2_E))
    return select(abs(h) <= LARGEST, inside, h)


def log10(x: float) -> float:
    """Return the logarithm to the base 10."""
    h, low = sum_of_log(x)
    p, p_low = exact_product(h, LOG10_E)
    inside = p + (p_low + (h * LOG10_E_LOW + low * LOG10_E))
    return select(abs(h) <= LARGEST, inside, h)


def log_of_1_plus(x: float, low: float) -> tuple[float, float]:
    """Return the natural logarithm of 1 + x + low as a sum, x > -1."""
    h, h_low = exact_sum(1.0, x)
    return log_of_sum(h, h_low + low)


def log1p(x: float) -> float:
    """Return the natural logarithm of 1 + x."""
    is_near = (x > -1.0) & (x < 9007199254740992.0)
    h, low = log_of_1_plus(select(is_near, x, 0.0), 0.0)
    return select(abs(x) < TINY_SQUARE, x, select(is_near, h + low, log(1.0 + x)))


def power_of_size(x: float, y: float, y_low: float) -> float:
    """Return |x| to the power y + y_low."""
    h, low = sum_of_log(abs(x))
    p, p_low = exact_product(y, h)
    rest = p_low + (y * low + y_low * h)
    return exp_of_sum(p, select(abs(p) < 1000.0, rest, 0.0), 0)


def pow(x: float, y: float) -> float:
    """Return x to the power y."""
    size = select((y == 0.0) | (x == 1.0) | ((abs(x) == 1.0) & (abs(y) > LARGEST)), 1.0, power_of_size(x, y, 0.0))
    half = 0.5 * y
    is_whole = floor(y) == y
    is_odd = is_whole & (floor(half) != half) & (abs(y) < 9007199254740992.0)
    is_defined = is_whole | (x >= 0.0) | (abs(x) > LARGEST) | (y != y)
    value = select(is_odd, copysign(size, x), size)
    return select(is_defined | (x == 0.0), value, NOT_A_NUMBER)


def cbrt(x: float) -> float:
    """Return the cube root, which has the sign of x."""
    return copysign(power_of_size(x, ARTANH_3, ARTANH_3_LOW), x)


# Exponential and hyperbolic functions ----------------------------------------------------------------------


def sum_of_exp_less_1(x: float) -> tuple[float, float]:
    """Return e^x - 1 as a sum, as if x were zero for |x| > MODERATE."""
    r, square, rest, k = parts_of_exp(select(abs(x) <= MODERATE, x, 0.0), 0.0)
    power = from_bits((k + 1023) << 52)
    p, p_low = exact_sum(power, -1.0)
    a, a_low = exact_sum(p, power * r)
    b, b_low = exact_sum(a, power * square)
    c = b_low + (a_low + (p_low + power * rest))
    h = b + c
    return h, (b - h) + c


def expm1(x: float) -> float:
    """Return e to the power x, less 1."""
    h, low = sum_of_exp_less_1(x)
    inside = select(abs(x) < TINY_SQUARE, x, h + low)
    return select(abs(x) <= MODERATE, inside, select(x < 0.0, -1.0, exp(x)))


def sinh(x: float) -> float:
    """Return the hyperbolic sine."""
    u = abs(x)
    h, low = sum_of_exp_less_1(u)
    d, d_low = exact_sum(1.0, h)
    q, rest = exact_quotient(h, low, d, d_low + low)
    s, s_low = exact_sum(h, q)
    inside = select(u < TINY, u, 0.5 * (s + (s_low + (low + rest))))
    return copysign(select(u <= MODERATE, inside, exp_of_sum(u, 0.0, 1)), x)


def cosh(x: float) -> float:
    """Return the hyperbolic cosine."""
    u = abs(x)
    h, low = sum_of_exp_less_1(u)
    d, d_low = exact_sum(1.0, h)
    return select(u <= MODERATE, 0.5 * (d + ((d_low + low) + 1.0 / d)), exp_of_sum(u, 0.0, 1))


def tanh(x: float) -> float:
    """Return the hyperbolic tangent."""
    u = abs(x)
    h, low = sum_of_exp_less_1(2.0 * u)
    d, d_low = exact_sum(2.0, h)
    q, rest = exact_quotient(h, low, d, d_low + low)
    inside = select(u < TINY, u, q + rest)
    return copysign(select(2.0 * u <= MODERATE, inside, select(u != u, u, 1.0)), x)


def asinh(x: float) -> float:
    """Return the number whose hyperbolic sine this is."""
    u = abs(x)
    is_near = u < 134217728.0
    v = select(is_near, u, 0.0)
    p, p_low = exact_product(v, v)
    w, w_low = exact_sum(1.0, p)
    y, y_low = root_of_sum(w, w_low + p_low)
    d, d_low = exact_sum(1.0, y)
    q, rest = exact_quotient(p, p_low, d, d_low + y_low)
    s, s_low = exact_sum(v, q)
    h, low = log_of_1_plus(s, s_low + rest)
    beyond, beyond_low = sum_of_log(u)
    inside = select(u < TINY, u, h + low)
    return copysign(select(is_near, inside, beyond + (LOG_2 + (LOG_2_LOW + beyond_low))), x)


def acosh(x: float) -> float:
    """Return the number of at least zero whose hyperbolic cosine this is; NaN for x < 1."""
    is_near = (x >= 1.0) & (x < 134217728.0)
    v = select(is_near, x - 1.0, 0.0)
    p, p_low = exact_product(v, v)
    w, w_low = exact_sum(2.0 * v, p)
    y, y_low = root_of_sum(w, w_low + p_low)
    s, s_low = exact_sum(y, v)
    h, low = log_of_1_plus(s, s_low + y_low)
    beyond, beyond_low = sum_of_log(x)
    return select(is_near, h + low, select(x < 1.0, NOT_A_NUMBER, beyond + (LOG_2 + (LOG_2_LOW + beyond_low))))


def atanh(x: float) -> float:
    """Return the number whose hyperbolic tangent this is; NaN for |x| > 1."""
    u = abs(x)
    v = select(u < 1.0, u, 0.0)
    d, d_low = exact_sum(1.0, -v)
    q, rest = exact_quotient(2.0 * v, 0.0, d, d_low)
    s, s_low = exact_sum(q, rest)
    h, low = log_of_1_plus(s, s_low)
    beyond = select(u == 1.0, INFINITE, NOT_A_NUMBER)
    return copysign(select(u < 1.0, select(u < TINY, u, 0.5 * (h + low)), beyond), x)


# The larger and the smaller of two numbers ------------------------------------------------------------


def larger(x: float, y: float) -> float:
    """Return the larger of two numbers, the other one if one is NaN."""
    return select((x > y) | (y != y), x, y)


def smaller(x: float, y: float) -> float:
    """Return the smaller of two numbers, the other one if one is NaN."""
    return select((x < y) | (y != y), x, y)
