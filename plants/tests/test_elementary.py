"""Functions of our own: their errors, what they do at the edges, and the same bits in C, for numbers and for arrays."""

import ast
import contextlib
import ctypes
import math
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
import sympy

from plants import arrays, elementary, logarithms
from plants.factory import c_functions
from plants.factory.compile import FLAGS, find_compiler
from plants.printing import OWN_FUNCTIONS, scalar_functions

RANDOM = np.random.default_rng(1)
N = 60
EDGES = np.array(
    [
        *(
            0.0,
            -0.0,
            1.0,
            -1.0,
            0.5,
            -2.0,
            3.0,
            1e-300,
            5e-324,
            -5e-324,
            1e300,
            1.7976931348623157e308,
            math.inf,
            -math.inf,
        ),
        *(math.nan, math.pi / 2, 2.0**53 + 2, -(2.0**53 - 1), 1e6, 1e22, 710.0, -746.0),
    ]
)


def binades(low: int, high: int, both: bool = True) -> np.ndarray:
    """Return numbers of magnitudes from 2^low to 2^high, the first one and every seventh among them."""
    exponents = np.concatenate([np.arange(low, high, 7), RANDOM.integers(low, high, N)])
    sign = RANDOM.choice([-1.0, 1.0], len(exponents)) if both else 1.0
    return np.ldexp(1.0 + RANDOM.random(len(exponents)), exponents) * sign


def uniform(low: float, high: float) -> np.ndarray:
    return RANDOM.uniform(low, high, N)


def near_quarter_turns() -> np.ndarray:
    turns = RANDOM.integers(-600_000, 600_000, N) * (math.pi / 2)
    return turns * (1.0 + RANDOM.integers(-3, 4, N) * 2.0**-53)


ANGLES = (
    np.array([6381956970095103 * 2.0**797]),
    uniform(-1, 1),
    uniform(-10, 10),
    uniform(-1e6, 1e6),
    near_quarter_turns(),
    binades(-1074, 1024),
)
UNIT = (uniform(-1, 1), binades(-1074, 0) * 0.999999, 1.0 - 10.0 ** uniform(-16, -1))
LARGE = (uniform(-1, 1), uniform(-60, 60), uniform(-710, 709), binades(-1074, 9))
POSITIVE = (uniform(0.5, 2), 1.0 + uniform(-1, 1) * 10.0 ** uniform(-16, -1), binades(-1074, 1024, both=False))
ARGUMENTS = {
    **dict.fromkeys(("sin", "cos", "tan"), ANGLES),
    **dict.fromkeys(("asin", "acos", "atanh"), UNIT),
    **dict.fromkeys(("atan", "cbrt"), (uniform(-2, 2), binades(-1074, 1024))),
    "asinh": (np.array([0.5181882247872107, 1.1335371899086035]), uniform(-2, 2), binades(-1074, 1024)),
    **dict.fromkeys(("exp", "expm1", "sinh", "cosh", "tanh"), LARGE),
    **dict.fromkeys(("log", "log2", "log10"), POSITIVE),
    "log1p": (uniform(-0.99, 2), binades(-1074, 1024, both=False), -binades(-1074, 0, both=False) / 2.1),
    "acosh": (uniform(1, 2), 1.0 + 10.0 ** uniform(-16, 1), binades(0, 1024, both=False)),
}
EXACT: dict[str, Callable[..., Any]] = {
    **{name: getattr(mpmath, name) for name in ("sin", "cos", "tan", "asin", "acos", "atan", "exp", "expm1", "log")},
    **{name: getattr(mpmath, name) for name in ("sinh", "cosh", "tanh", "asinh", "acosh", "atanh", "log1p", "log10")},
    "log2": lambda x: mpmath.log(x) / mpmath.log(2),
    "cbrt": lambda x: mpmath.sign(x) * mpmath.cbrt(abs(x)),
    "atan2": mpmath.atan2,
    "hypot": mpmath.hypot,
    "pow": mpmath.power,
}
HUGE = binades(-1074, 1020)
PAIRS = {
    "atan2": ((uniform(-1, 1), uniform(-1, 1)), (binades(-1074, 1024)[:400], binades(-1074, 1024)[:400][::-1])),
    "hypot": ((uniform(-1, 1), uniform(-1, 1)), (HUGE, HUGE * RANDOM.uniform(0.2, 5, len(HUGE)))),
    "pow": (
        (uniform(0, 10), uniform(-50, 50)),
        (np.exp(uniform(-490, 490)), np.full(N, 1.4)),
        (1 + 10 ** uniform(-9, -2), uniform(-1e4, 1e4)),
        (10 ** uniform(-9, 9), np.full(N, -0.2)),
    ),
}


def units_in_the_last_place(found: float, exact: Any) -> float:
    nearest = float(exact)
    if math.isinf(nearest):
        return 0.0 if found == nearest or abs(found) > 1.79e308 else math.inf
    smaller = math.nextafter(nearest, 0.0) if abs(mpmath.mpf(nearest)) > abs(exact) else nearest
    return float(abs(mpmath.mpf(found) - exact) / mpmath.mpf(math.ulp(smaller)))


@pytest.mark.parametrize("name", [*ARGUMENTS, *PAIRS])
def test_a_function_errs_by_less_than_one_unit_in_the_last_place(name: str) -> None:
    function, exact = getattr(arrays, name), EXACT[name]
    with mpmath.workprec(1300 if name in ("sin", "cos", "tan") else 250):  # enough for angles of 2^1024
        for given in PAIRS.get(name) or [(values,) for values in ARGUMENTS[name]]:
            for found, *arguments in zip(
                function(*given).tolist(), *(values.tolist() for values in given), strict=True
            ):
                error = units_in_the_last_place(found, exact(*map(mpmath.mpf, arguments)))
                assert error < 1.0, f"{name}{tuple(arguments)} = {found} is off by {error} units"


def bits(values: Any) -> np.ndarray:
    """Return the bits of an array, those of every NaN the same."""
    array = np.array(values, dtype=float)
    return np.where(np.isnan(array), np.nan, array).view(np.int64)


def library(name: str, *arguments: float) -> float:
    """Return what C's function gives, as NumPy shows it; of powers, Python does, but for those that it refuses."""
    if name == "pow":
        with contextlib.suppress(ValueError, OverflowError):
            return math.pow(*arguments)
    with np.errstate(all="ignore"):
        own = {"asin": "arcsin", "acos": "arccos", "atan": "arctan", "atan2": "arctan2", "pow": "power"}
        own |= {"asinh": "arcsinh", "acosh": "arccosh", "atanh": "arctanh"}
        return float(getattr(np, own.get(name, name))(*arguments))


@pytest.mark.parametrize("name", [*ARGUMENTS, *PAIRS])
def test_at_the_edges_a_function_does_what_that_of_c_does(name: str) -> None:
    own = scalar_functions()[name]
    points = [(x,) for x in EDGES] if name in ARGUMENTS else [(x, y) for x in EDGES for y in EDGES]
    for arguments in points:
        found, expected = own(*map(float, arguments)), library(name, *arguments)
        assert math.isnan(found) == math.isnan(expected), (name, arguments, found, expected)
        if not math.isnan(found):
            assert math.copysign(1.0, found) == math.copysign(1.0, expected), (name, arguments, found, expected)
            assert abs(found - expected) <= 2 * math.ulp(expected) or found == expected


def test_sine_and_cosine_at_once_are_those_alone() -> None:
    for x in [*EDGES.tolist(), *ANGLES[2].tolist(), *ANGLES[5].tolist()]:
        assert bits(elementary.sin_cos(x)).tolist() == bits([elementary.sin(x), elementary.cos(x)]).tolist()


@pytest.fixture(scope="module")
def in_c(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """Compile the header with warnings as errors, and give each function a name that can be called."""
    folder = tmp_path_factory.mktemp("elementary")
    (folder / c_functions.FILE).write_text(c_functions.header())
    text = [f'#include "{c_functions.FILE}"']
    for name in scalar_functions():
        names = ("x", "y") if name in (*PAIRS, "larger", "smaller") else ("x",)
        stated, entries = (", ".join(form.format(n) for n in names) for form in ("const double *{}", "{}[i]"))
        call = f"{c_functions.PREFIX}{name}({entries})"
        text.append(
            f"void {name}_all(long n, double *out, {stated}) {{ for (long i = 0; i < n; i++) out[i] = {call}; }}"
        )
    (folder / "functions.c").write_text("\n".join(text) + "\n")
    flags = [flag for flag in FLAGS if not flag.startswith("-fvisibility")]
    command = [*find_compiler().command, *flags, "-Werror", "-fPIC", "-o", "functions.so", "functions.c", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return ctypes.CDLL(str(folder / "functions.so"))


@pytest.mark.parametrize("name", [*scalar_functions()])
def test_c_numbers_and_arrays_give_the_same_bits(name: str, in_c: ctypes.CDLL) -> None:
    if name in (*PAIRS, "larger", "smaller"):
        edges = np.array([(x, y) for x in EDGES for y in EDGES]).T
        given = [
            np.concatenate([some, edge]) for some, edge in zip(PAIRS.get(name, PAIRS["atan2"])[1], edges, strict=True)
        ]
    else:
        given = [np.concatenate([*ARGUMENTS[name], EDGES])]
    found = np.empty(len(given[0]))
    doubles = np.ctypeslib.ndpointer(float)
    function = in_c[f"{name}_all"]
    function.argtypes = [ctypes.c_long] + [doubles] * (len(given) + 1)
    function(len(found), found, *given)
    own = scalar_functions()[name]
    np.testing.assert_array_equal(bits(getattr(arrays, name)(*given)), bits(found))
    np.testing.assert_array_equal(
        bits([own(*arguments) for arguments in zip(*map(np.ndarray.tolist, given), strict=True)]), bits(found)
    )


def test_the_functions_are_made_of_plain_arithmetic() -> None:
    """A call of a library's function in their text would be another machine's bits."""
    for module in (elementary, logarithms):
        tree = ast.parse(Path(module.__file__).read_text(encoding="utf-8"))
        own = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        primitives = {primitive.__name__ for primitive in elementary.PRIMITIVES}
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and node.name not in primitives:
                called = {ast.unparse(call.func) for call in ast.walk(node) if isinstance(call, ast.Call)}
                assert called <= own | primitives | set(vars(elementary)) | {"abs"}, node.name
                assert not any(isinstance(part, ast.Pow) for part in ast.walk(node)), node.name


def test_text_that_is_no_c_is_refused() -> None:
    for body in ("x += 1.0", "return x ** 2", "return [x]", "return max(x, 1.0)"):
        function = ast.parse(f'def f(x: float) -> float:\n    """Return."""\n    {body}').body[0]
        assert isinstance(function, ast.FunctionDef)
        with pytest.raises((ValueError, KeyError)):
            list(c_functions._Function(function, {"f": ("double",)}).lines())


def test_a_model_calls_no_function_of_the_c_library() -> None:
    from plants.factory.generate import _Printer
    from plants.ode import OdeModel, State

    x = sympy.Symbol("x", real=True)
    printer = _Printer(OdeModel("m", "A model.", (State(x, "1", "A state"),), (-x,)))
    for name in OWN_FUNCTIONS:
        function = getattr(sympy, name, None) or getattr(
            __import__("sympy.codegen.cfunctions").codegen.cfunctions, name
        )
        text = printer.doprint(function(x, 2 * x) if name in ("atan2", "hypot", "Max", "Min") else function(x))
        assert text.startswith(c_functions.PREFIX), text
    powers = {x ** sympy.Rational(1, 3): "cbrt", x**5: "pow", x**-0.2: "pow", 2**x: "pow"}
    for power, name in powers.items():
        assert printer.doprint(power).startswith(f"{c_functions.PREFIX}{name}("), power
