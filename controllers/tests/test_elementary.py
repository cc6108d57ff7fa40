"""Functions of our own, compiled by Numba: the same bits as the text in plain Python; and no library's in the laws."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import formation_controllers
import numba
import numpy as np
import pytest
from formation_controllers import elementary
from formation_controllers.analysis.small_matrices import exponential, held, inverse, product, riccati, solve
from formation_controllers.compiled import compiled

PACKAGE = Path(formation_controllers.__file__).parent
FREE = {"analysis/gain_conditions.py", "analysis/region_of_attraction.py", "testing.py", "elementary.py"}
"""What no recorded number comes from, and the functions' own text."""
LIBRARY = {
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "arcsin", "arccos", "arctan", "arctan2", "hypot"),
    *("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "pow", "power", "sinh", "cosh", "tanh", "cbrt"),
    *("einsum", "dot", "matmul", "inner"),
}
LINEAR_ALGEBRA = {"solve", "inv", "pinv", "lstsq", "eig", "eigvals", "eigh", "svd", "qr", "det", "norm", "cholesky"}


@compiled
def of_all(x, y, out):
    for i in range(len(x)):
        out[i, 0], out[i, 1], out[i, 2] = elementary.sin(x[i]), elementary.cos(x[i]), elementary.tan(x[i])
        out[i, 3], out[i, 4] = elementary.sin_cos(x[i])
        out[i, 5], out[i, 6] = elementary.atan2(y[i], x[i]), elementary.exp(x[i])
        out[i, 7] = elementary.acos(y[i])
        out[i, 8], out[i, 9], out[i, 10] = elementary.sin_cos_tan(x[i])


def test_compiled_functions_give_the_bits_of_plain_python():
    random = np.random.default_rng(3)
    x = np.concatenate(
        [
            random.uniform(-4, 4, 200),
            random.uniform(-1e7, 1e7, 100),
            np.ldexp(random.uniform(-2, 2, 200), random.integers(-1070, 1024, 200)),
            [0.0, -0.0, math.inf, -math.inf, math.nan, 1e6, 5e-324],
        ]
    )
    y = np.clip(random.permutation(x), -1.5, 1.5)
    found, expected = np.empty((2, len(x), 11))
    with np.errstate(all="ignore"):  # of NumPy's numbers, where nothing is compiled
        of_all(x, y, found)
    getattr(of_all, "py_func", of_all)(x.tolist(), y.tolist(), expected)
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(found[:, [0, 1, 3, 4, 2]], found[:, [8, 9, 8, 9, 10]])  # together as one by one
    np.testing.assert_array_equal(np.signbit(found), np.signbit(np.where(np.isnan(expected), found, expected)))


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_compiled_functions_call_no_library_and_contract_nothing():
    fresh = numba.njit(error_model="numpy")(of_all.py_func)  # of kept code Numba shows nothing
    fresh(*np.ones((2, 1)), np.empty((1, 11)))
    (text,) = fresh.inspect_llvm().values()
    assert "of_all" in text
    called = {line.split("@")[1].split("(")[0] for line in text.splitlines() if " call " in line and "@" in line}
    assert not {name for name in called if name.strip('"') in {"sin", "cos", "tan", "atan2", "exp", "acos", "fma"}}
    assert not any(word in text for word in ("llvm.fma", "llvm.fmuladd", " contract ", " fast ", " reassoc "))


def test_laws_call_no_function_whose_bits_depend_on_the_machine():
    for file in sorted(PACKAGE.rglob("*.py")):
        if file.relative_to(PACKAGE).as_posix() in FREE or file.name == "compiled.py":
            continue
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            assert not isinstance(node, ast.MatMult), f"{file.name}: use small_matrices.product, not @"
            if isinstance(node, ast.Attribute):
                name = ast.unparse(node)
                module, _, function = name.partition(".")
                known = module in ("math", "np") and function in LIBRARY
                assert not known, f"{file.name} calls {name}: use formation_controllers.elementary"
                called = name.removeprefix("np.linalg.")
                assert called == name or called not in LINEAR_ALGEBRA, f"{file.name} calls {name}: use small_matrices"


def test_small_matrices_agree_with_numpy():
    random = np.random.default_rng(5)
    for size in (1, 2, 4, 6):
        a, b, vector = random.normal(size=(size, size)), random.normal(size=(size, 3)), random.normal(size=size)
        close = {"rtol": 1e-9, "atol": 1e-12}
        np.testing.assert_allclose(product(a, a, b), a @ a @ b, **close)
        np.testing.assert_allclose(product(a, vector), a @ vector, **close)
        np.testing.assert_allclose(solve(a, b), np.linalg.solve(a, b), **close)
        np.testing.assert_allclose(solve(a, vector), np.linalg.solve(a, vector), **close)
        np.testing.assert_allclose(inverse(a), np.linalg.inv(a), **close)
        values, vectors = np.linalg.eig(3 * a)
        np.testing.assert_allclose(
            exponential(3 * a), (vectors * np.exp(values) @ np.linalg.inv(vectors)).real, rtol=1e-7, atol=1e-7
        )
    np.testing.assert_array_equal(exponential(np.zeros((3, 3))), np.eye(3))
    Phi, Gamma = held(np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [2.0]]), 0.5)
    np.testing.assert_allclose(Phi, [[1.0, 0.5], [0.0, 1.0]], rtol=1e-15)
    np.testing.assert_allclose(Gamma, [[0.25], [1.0]], rtol=1e-15)


def test_a_slow_mode_is_found_beside_a_fast_one():
    """Two integrators, each with a price: x = (q + sqrt(q^2 + 4 q))/2. The cheap one takes 1e15 periods."""
    prices = np.array([1.0, 1e-30])
    found = riccati(np.eye(2), np.eye(2), np.diag(prices), np.eye(2))
    np.testing.assert_allclose(np.diag(found), (prices + np.sqrt(prices**2 + 4 * prices)) / 2, rtol=1e-6)


def test_what_has_no_solution_is_refused():
    for singular in (np.zeros((2, 2)), np.array([[1.0, 2.0], [2.0, 4.0]]), np.full((2, 2), math.nan)):
        with pytest.raises(np.linalg.LinAlgError):
            inverse(singular)
    unreachable = np.diag([2.0, 0.5])  # the first state grows, whatever the input does
    with pytest.raises(np.linalg.LinAlgError):
        riccati(unreachable, np.array([[0.0], [1.0]]), np.eye(2), np.eye(1))
