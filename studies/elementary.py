"""Where the constants of `plants.elementary` come from, and how far its functions are off, in millions of arguments.

    python studies/elementary.py constants            prints the constants, as they stand in the module
    python studies/elementary.py accuracy [thousands] prints the largest error of each function; needs gmpy2, for speed

Polynomials are fitted with mpmath at Chebyshev's points.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator

import numpy as np
from mpmath import atan, atanh, chebyfit, cos, exp, floor, ldexp, log, mp, mpf, pi, sin, sqrt

from plants import arrays

mp.prec = 300
DIGITS = 56


def fitted(function: Callable[[mpf], mpf], start: mpf, end: mpf, count: int) -> list[float]:
    """Return the coefficients, from the constant one on, of a polynomial that is near a function between two ends."""
    return [float(c) for c in reversed(chebyfit(function, [start, end], count))]


def parts(value: mpf, *places: int) -> list[float]:
    """Return a number as a sum of doubles, of which each but the last ends so many binary places behind the point."""
    found = []
    for place in places:
        found.append(float(ldexp(floor(ldexp(value, place) + mpf(0.5)), -place)))
        value -= found[-1]
    return [*found, float(value)]


def constants() -> Iterator[tuple[str, object, str]]:
    """Yield name, value and meaning of each constant."""
    yield "LARGEST", sys.float_info.max, ""
    yield "FAR", 1.0e6, "beyond it, an angle is reduced with whole numbers"
    yield "TINY", 2.0**-27, "below it, the cube of a number does not count"
    yield "TINY_SQUARE", 2.0**-54, "below it, the square of a number does not count"
    yield "MODERATE", 50.0, "up to it, e^x - 1 is computed as such"
    yield "SHIFT", 1.5 * 2.0**52, "added and taken away again, leaves a whole number"
    yield "SHIFT_BITS", 0x4338000000000000, "its bits"
    yield "SHIFT_16", 1.5 * 2.0**36, "the same, leaves a multiple of 2^-16"
    yield "SHIFT_25", 1.5 * 2.0**27, "the same, leaves a multiple of 2^-25"
    yield "HEAD", -(2**27), "mask of all but the last 27 bits"
    yield "ROOT_HALF_BITS", 0x3FE6A09E667F3BCD, "bits of sqrt(1/2)"
    yield from named("HALF_PI", parts(pi / 2, 52))
    yield from named("QUARTER_PI", parts(pi / 4, 53))
    yield from named("ATAN_HALF", parts(atan(mpf(0.5)), 54))
    yield from named("LOG2_E", parts(1 / log(2), 52))
    yield from named("LOG10_E", parts(1 / log(10), 54))
    yield from named("LOG_2", parts(log(2), 42))
    yield "TWO_OVER_PI", float(2 / pi), ""
    for i, part in enumerate(parts(pi / 2, 32, 65, 98), start=1):
        yield f"HALF_PI_{i}", part, "parts of 33 bits, and the rest" if i == 1 else ""
    end = (pi / 4 * (1 + mpf(2) ** -20)) ** 2
    third = fitted(lambda z: (sin(sqrt(z)) / sqrt(z) - 1) / z, mpf(0), end, 6)
    yield "SINE_3", -21 / 128, "sin r = r + SINE_3 r^3 + SINE_3_REST r^3 + SINE_5 r^5 + ..."
    yield "SINE_3_REST", float(mpf(third[0]) + mpf(21) / 128), ""
    yield from ((f"SINE_{2 * i + 3}", c, "") for i, c in enumerate(third) if i)
    fourth = fitted(lambda z: (cos(sqrt(z)) - 1 + z / 2) / z**2, mpf(0), end, 6)
    yield from ((f"COSINE_{2 * i + 4}", c, "") for i, c in enumerate(fourth))
    fit = fitted(lambda z: (atan(sqrt(z)) / sqrt(z) - 1) / z, mpf(0), mpf("0.2362") ** 2, 9)
    yield from ((f"ATAN_{2 * i + 3}", c, "") for i, c in enumerate(fit))
    yield from named("ARTANH_3", parts(mpf(1) / 3, 54))
    end = ((sqrt(2) - 1) / (sqrt(2) + 1)) ** 2
    fit = fitted(lambda z: (atanh(sqrt(z)) / sqrt(z) - 1 - z / 3) / z**2, mpf(0), end, 8)
    yield from ((f"ARTANH_{2 * i + 5}", c, "") for i, c in enumerate(fit))
    end = log(2) / 2 * (1 + mpf(2) ** -20)
    fit = fitted(lambda r: (exp(r) - 1 - r - r * r / 2) / r**3, -end, end, 10)
    yield from ((f"EXP_{i + 3}", c, "") for i, c in enumerate(fit))


def named(name: str, pair: list[float]) -> Iterator[tuple[str, float, str]]:
    """Yield a number that has two parts."""
    yield name, pair[0], ""
    yield f"{name}_LOW", pair[1], ""


def digits() -> str:
    """Return the digits of 2/pi behind the point to the base 2^24, in hexadecimal."""
    mp.prec = 24 * DIGITS + 100
    text = f"{int(floor(ldexp(2 / pi, 24 * DIGITS))):0{6 * DIGITS}x}"
    mp.prec = 300
    return text


def printed() -> str:
    """Return the constants as the module states them."""
    lines = ["INFINITE: Final = math.inf", "NOT_A_NUMBER: Final = math.nan"]
    lines += [
        f"{name}: Final = {value!r}" + (f"  # {meaning}" if meaning else "") for name, value, meaning in constants()
    ]
    text = digits()
    lines += ["_TWO_OVER_PI: Final = (  # behind the point, in hexadecimal"]
    lines += [f'    "{text[i : i + 96]}"' for i in range(0, len(text), 96)]
    return "\n".join([*lines, ")"])


def arguments(count: int) -> dict[str, list[tuple[np.ndarray, ...]]]:
    """Return arguments of each function: every binade, and where it is difficult."""
    random = np.random.default_rng(count)

    def uniform(low: float, high: float) -> np.ndarray:
        return random.uniform(low, high, count)

    def binades(low: int, high: int, signs: tuple[float, ...] = (-1.0, 1.0)) -> np.ndarray:
        return np.ldexp(1.0 + random.random(count), random.integers(low, high, count)) * random.choice(signs, count)

    def ones(values: np.ndarray, *more: np.ndarray) -> list[tuple[np.ndarray, ...]]:
        return [(one,) for one in (values, *more)]

    turns = random.integers(-600_000, 600_000, count) * (np.pi / 4) * (1.0 + random.integers(-3, 4, count) * 2.0**-53)
    near_one = 10.0 ** uniform(-16, -1)
    angles = ones(uniform(-1, 1), uniform(-10, 10), uniform(-1e6, 1e6), uniform(-1e9, 1e9), turns, binades(-1074, 1024))
    part = ones(uniform(-1, 1), 1.0 - near_one, binades(-1074, -1))
    exponents = ones(uniform(-1, 1), uniform(-60, 60), uniform(-745, 709), binades(-1074, 9))
    positive = ones(uniform(0.5, 2), 1.0 + near_one, 1.0 - near_one, binades(-1074, 1024, (1.0,)))
    large, base = binades(-1070, 1020), 1.0 + near_one
    pairs = [
        (uniform(-1, 1), uniform(-1, 1)),
        (binades(-1074, 1024), binades(-1074, 1024)),
        (large, large * uniform(0.2, 5)),
    ]
    return {
        **dict.fromkeys(("sin", "cos", "tan"), angles),
        **dict.fromkeys(("asin", "acos", "atanh"), part),
        **dict.fromkeys(("atan", "asinh", "cbrt"), ones(uniform(-2, 2), uniform(-60, 60), binades(-1074, 1024))),
        **dict.fromkeys(("exp", "expm1", "sinh", "cosh", "tanh"), exponents),
        **dict.fromkeys(("log", "log2", "log10"), positive),
        "log1p": ones(uniform(-0.99, 2), binades(-1074, 1024, (1.0,)), binades(-1074, -1)),
        "acosh": ones(uniform(1, 2), 1.0 + near_one, binades(0, 1024, (1.0,))),
        **dict.fromkeys(("atan2", "hypot"), pairs),
        "pow": [
            (uniform(0, 10), uniform(-50, 50)),
            (np.exp(uniform(-490, 490)), np.full(count, 1.4)),
            (base, uniform(-700, 700) / near_one),
            (10.0 ** uniform(-20, 20), np.full(count, -0.2)),
        ],
    }


def accuracy(count: int) -> None:
    """Print the largest error of each function, in units in the last place."""
    import gmpy2
    from gmpy2 import mpfr

    gmpy2.get_context().precision, gmpy2.get_context().emin, gmpy2.get_context().emax = 160, -9999, 9999
    exact = {"pow": lambda x, y: x**y}
    for name, sets in arguments(count).items():
        function, worst, total = exact.get(name) or getattr(gmpy2, name), 0.0, 0
        for given in sets:
            found = getattr(arrays, name)(*given)
            for own, *values in zip(found.tolist(), *(one.tolist() for one in given), strict=True):
                true = function(*map(mpfr, values))
                nearest = float(true)
                if math.isfinite(nearest):
                    smaller = math.nextafter(nearest, 0.0) if abs(mpfr(nearest)) > abs(true) else nearest
                    worst = max(worst, abs(float((mpfr(own) - true) / mpfr(math.ulp(smaller)))))
                else:
                    assert own == nearest or abs(own) == sys.float_info.max, (name, values, own)
                total += 1
        print(f"{name:6} {worst:.3f} of {total} arguments", flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["accuracy"]:
        accuracy(1000 * int(sys.argv[2] if len(sys.argv) > 2 else 10))
    else:
        print(printed())
