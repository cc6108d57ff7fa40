"""The NumPy functions of a model: batches of any shape, and exact Jacobians."""

import math

import numpy as np
import pytest
import sympy
from sympy.codegen.cfunctions import exp2, fma

import plants
from plants import ModelError, elementary, numeric
from plants.factory.experiment import _Equations
from plants.numeric import NumericModel
from plants.ode import Input, OdeModel, Output, Parameter, State, Term

from .test_models import spring
from .test_vehicles import LARGEST, NUMPY, VEHICLES, angle_of, draw


def central_differences(function, x: np.ndarray, step: float) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Derivatives along each entry of x with an error of fourth order, (results, entries)."""

    def slope(h: float) -> np.ndarray:
        return np.stack([(function(x + h * e) - function(x - h * e)) / (2 * h) for e in np.eye(len(x))], axis=-1)

    return (4 * slope(step / 2) - slope(step)) / 3


def assert_jacobians(functions: NumericModel, x: np.ndarray, u: np.ndarray, p: np.ndarray, t: float = 0.0) -> None:
    """Compare with central differences, relative to the largest entry of the row."""
    jacobians = functions.jacobians(t, x, u, p)
    for matrix, function, at in (
        (jacobians.A, lambda x: functions.rhs(t, x, u, p), x),
        (jacobians.B, lambda u: functions.rhs(t, x, u, p), u),
        (jacobians.C, lambda x: functions.outputs(t, x, u, p), x),
        (jacobians.D, lambda u: functions.outputs(t, x, u, p), u),
    ):
        expected = central_differences(function, at, 1e-3)
        scale = np.maximum(1.0, np.abs(expected).max(axis=1, keepdims=True, initial=0.0))
        assert matrix.shape == expected.shape
        assert np.all(np.abs(matrix - expected) <= 1e-7 * scale)


@pytest.mark.parametrize("name", NUMPY)
def test_jacobians_of_vehicles(name: str) -> None:
    functions, rng = NUMPY[name], np.random.default_rng(1)
    for _ in range(100):
        x, u, values = draw(rng, functions.model, effects=False)
        if name in LARGEST:  # well within 90 degrees, where differences are accurate enough to compare with
            x[3] -= 0.5 * angle_of(VEHICLES[name], x)
        values |= {"F_c_v": 5.0, "F_v_v": 2.0, "v_s": 0.3, "F_c_omega": 2.0, "omega_s": 0.3}
        assert_jacobians(functions, x, u, functions.parameters(**values))


@pytest.mark.parametrize("name", LARGEST)
@pytest.mark.parametrize("angle", [0.9, -0.9, 0.7])
@pytest.mark.parametrize("rate", [0.5, -0.5, -3.0])
def test_jacobians_beyond_the_stop(name: str, angle: float, rate: float) -> None:
    """On either side of the stop, going in and coming out, and beyond the rate at which the stop lets go."""
    functions = NUMPY[name]
    p = functions.parameters(**{"k_stop": 2e3, LARGEST[name]: 0.8})
    rng = np.random.default_rng(2)
    x = np.array([0.3, -0.2, 0.0, angle, 0.2, rate])
    assert_jacobians(functions, x, rng.uniform(-5, 5, 6), p)


def test_jacobians_of_terms_time_and_variants() -> None:
    functions = numeric.compile(spring())
    for variant in ("linear", "hardening"):
        p = functions.parameters(spring=variant)
        assert_jacobians(functions, np.array([0.7, -0.3]), np.array([2.0]), p, t=0.4)


def test_jacobians_of_nested_terms() -> None:
    """A term of a term, and a derivative that depends on it both directly and through the other."""
    x, u, k, inner, outer = sympy.symbols("x u k inner outer")
    model = OdeModel(
        "nested",
        "",
        (State(x, "1", ""),),
        (outer * inner + x,),
        inputs=(Input(u, "1", ""),),
        parameters=(Parameter(k, "1", "", start=2.0),),
        terms=(Term(inner, sympy.sin(k * x)), Term(outer, inner**2 + u * x)),
        outputs=(Output(sympy.Symbol("y"), outer + u, "1", ""),),
    )
    functions = numeric.compile(model)
    jacobians = functions.jacobians(0.0, [0.3], [1.5], functions.parameters())
    s, c = np.sin(0.6), np.cos(0.6)
    expected = {
        "A": (2 * s * 2 * c + 1.5) * s + (s**2 + 0.45) * 2 * c + 1,
        "B": 0.3 * s,
        "C": 2 * s * 2 * c + 1.5,
        "D": 0.3 + 1,
    }
    for letter, value in expected.items():
        np.testing.assert_allclose(getattr(jacobians, letter), [[value]], rtol=1e-14)


@pytest.mark.parametrize("name", NUMPY)
def test_batches_broadcast(name: str) -> None:
    """States (5, 1, n), inputs (7, m) and parameters (5, 7, p) give (5, 7, ...), equal to one by one."""
    functions, rng = NUMPY[name], np.random.default_rng(3)
    drawn = [draw(rng, functions.model, effects=True) for _ in range(35)]
    x = np.stack([x for x, _, _ in drawn[:5]])[:, None]
    u = np.stack([u for _, u, _ in drawn[:7]])
    p = np.stack([functions.parameters(**values) for *_, values in drawn]).reshape(5, 7, -1)
    for method in (functions.rhs, functions.outputs, *(partial(functions, letter) for letter in "ABCD")):
        batch = method(0.0, x, u, p)
        assert batch.shape[:2] == (5, 7)
        for i, j in np.ndindex(5, 7):
            np.testing.assert_allclose(batch[i, j], method(0.0, x[i, 0], u[j], p[i, j]), rtol=1e-13, atol=1e-13)


def partial(functions: NumericModel, letter: str):  # type: ignore[no-untyped-def]
    return lambda t, x, u, p: getattr(functions.jacobians(t, x, u, p), letter)


def test_parameters_and_states_by_name_may_be_batches() -> None:
    functions = NUMPY["car_like"]
    p = functions.parameters(m_c=np.linspace(10, 50, 9))
    x = functions.start(v=1.0, gamma=np.linspace(-0.5, 0.5, 3)[:, None])
    assert p.shape == (9, len(functions.model.parameters))
    assert functions.rhs(0.0, x, functions.inputs(), p).shape == (3, 9, 6)
    with pytest.raises(ModelError, match="there is no state 'speed'; there are x, y, psi, gamma, v, omega"):
        functions.start(speed=1.0)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"drive": 0}, r"drive has no variant 0; it has 1 \(as_printed\), 2 \(front_wheel\), 3 \(rear_wheel\)"),
        ({"drive": np.array([1, 2, 7])}, r"drive has no variant \[1 2 7\]"),
        ({"drive": 2.5}, "drive has no variant 2.5"),
        ({"drive": np.nan}, "drive has no variant nan"),
        ({"drive": True}, "drive has no variant True"),
        ({"m_c": np.array(["20"])}, "parameter 'm_c' is"),
        ({"m_c": "20"}, "parameter 'm_c' is '20', it must be a number"),
    ],
)
def test_values_that_are_none_are_refused(values: dict[str, object], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        numeric.compile(plants.load("car_like")).parameters(**values)


def test_a_sweep_is_one_call() -> None:
    """A sweep over 1,000 masses in one call: heavier robots accelerate less."""
    functions = numeric.compile(plants.load("car_like"))
    p = functions.parameters(m_c=np.linspace(10, 100, 1000))
    acceleration = functions.rhs(0.0, functions.start(), functions.inputs(tau_drive=10.0), p)[:, 4]
    assert np.all(np.diff(acceleration) < 0)


a, s = sympy.symbols("a s", real=True)
A, S = 0.75, 0.5
"""Values of `a` and `s`, the parameter and the state of the models below."""


def of_one_state(derivative: sympy.Expr, terms: tuple[Term, ...] = (), state: sympy.Symbol = s) -> OdeModel:
    symbols = derivative.free_symbols.union(*(term.expression.free_symbols for term in terms))
    own = symbols - {state} - {term.symbol for term in terms}
    parameters = tuple(Parameter(symbol, "1", "", start=A) for symbol in sorted(own, key=str))
    return OdeModel("named", "", (State(state, "1", "", start=S),), (derivative,), (), parameters, terms=terms)


def rates(model: OdeModel) -> list[float]:
    """Return der(x) at the start, for NumPy's numbers, for a batch of them, and for Python's as an experiment has."""
    f = numeric.compile(model)
    state, p = f.start(), f.parameters()
    batch = f.rhs(0.0, np.stack([state, state]), f.inputs(), p)[:, 0]
    return [*f.rhs(0.0, state, f.inputs(), p), *batch, *_Equations(model).derivatives([], 0.0, list(state))]


def real(name: str) -> sympy.Symbol:
    return sympy.Symbol(name, real=True)


@pytest.mark.parametrize(
    ("derivative", "terms", "expected"),
    [
        (real("pi") * s / sympy.pi, (), A * S / math.pi),
        (real("e") * s * sympy.E, (Term(real("e"), 2 * a),), 2 * A * S * math.e),
        (real("lambda") - real("lambda_"), (Term(real("lambda"), 2 * s),), 2 * S - A),
        (abs(s) * real("abs"), (), A * S),
        (sympy.sign(-s) * real("sign"), (), -A),
        (sympy.Mod(-s, real("mod")), (), A - S),
        (sympy.Max(-s, real("larger")), (), A),
        (sympy.sin(s) * real("near_sin"), (), A * math.sin(S)),
        (sympy.Piecewise((real("less"), s < real("select")), (-s, True)), (), A),
        (s * real("array") * real("function") * real("print"), (), S * A**3),
    ],
)
def test_no_symbol_is_taken_for_a_function_or_constant(
    derivative: sympy.Expr, terms: tuple[Term, ...], expected: float
) -> None:
    assert rates(of_one_state(derivative, terms)) == pytest.approx([expected] * 4, rel=1e-15)


def test_a_state_may_have_the_name_of_a_function() -> None:
    state = real("abs")
    assert rates(of_one_state(-abs(state), state=state)) == [-S] * 4


def test_numbers_keep_all_of_their_digits() -> None:
    assert rates(of_one_state(math.pi + 0 * s)) == [math.pi] * 4
    assert rates(of_one_state(s * (1 / 3))) == [S * (1 / 3)] * 4
    assert rates(of_one_state(sympy.pi * s)) == [math.pi * S] * 4
    turned = sympy.Mod(s - S + math.pi + math.pi, 2 * math.pi) - math.pi
    assert rates(of_one_state(turned)) == [-math.pi] * 4


@pytest.mark.parametrize(
    ("derivative", "expected"),
    [
        (sympy.Max(s, -1, -2 * s), S),
        (sympy.Min(s, a, sympy.Max(-s, -a, 0)), 0.0),
        (sympy.Max(s, sympy.Min(a, sympy.Max(1, a, 2 * s))), A),
    ],
)
def test_the_largest_of_many_is_that_of_pairs(derivative: sympy.Expr, expected: float) -> None:
    assert rates(of_one_state(derivative)) == [expected] * 4


def test_the_largest_number_is_one_where_another_is_none() -> None:
    f = numeric.compile(of_one_state(sympy.Max(s, sympy.log(-s)) + sympy.Min(-3, sympy.log(-s), s)))
    assert f.rhs(0.0, f.start(), f.inputs(), f.parameters()) == [S - 3]  # fmax and fmin of C


def test_the_largest_of_hundreds_is_computed() -> None:
    f = numeric.compile(of_one_state(sympy.Max(*(sympy.sin(k * s) for k in range(1, 251)), evaluate=False)))
    assert f.rhs(0.0, f.start(), f.inputs(), f.parameters()) == max(elementary.sin(k * S) for k in range(1, 251))


def test_an_expression_that_is_nested_too_deep_is_refused() -> None:
    deep = s
    for _ in range(210):
        deep = sympy.Pow(sympy.Add(1, deep, evaluate=False), 2.5, evaluate=False)
    with pytest.raises(ModelError, match="model 'named': an expression is nested too deep for Python: give parts of"):
        numeric.compile(of_one_state(deep))


def test_the_variable_of_a_sum_is_no_symbol_of_the_model() -> None:
    i = sympy.Symbol("i", integer=True)
    assert rates(of_one_state(a * sympy.Sum(s * i, (i, 1, 3)))) == [A * 6 * S] * 4


@pytest.mark.parametrize(
    ("derivative", "expected"),
    [(sympy.erf(s), math.erf(S)), (sympy.erfc(a * s), math.erfc(A * S)), (exp2(s), math.sqrt(2))],
)
def test_functions_that_numpy_lacks_take_arrays_too(derivative: sympy.Expr, expected: float) -> None:
    assert rates(of_one_state(derivative)) == pytest.approx([expected] * 4, rel=1e-15)


def test_a_function_that_python_lacks_is_refused() -> None:
    with pytest.raises(ModelError, match=r"model 'named': fma\(s, s, a\) cannot be computed in Python: it has no fma"):
        numeric.compile(of_one_state(fma(s, s, a)))
