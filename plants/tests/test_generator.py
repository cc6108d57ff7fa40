"""The generated C against NumPy, expression by expression; refusals; the description."""

import functools
import itertools
import math
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
import sympy
from lxml import etree

import plants
from plants import ModelError, logarithms, numeric
from plants.factory.document import document
from plants.factory.generate import generate
from plants.factory.table import tabulate
from plants.ode import TIME, Enumeration, Input, Limit, OdeModel, Output, Parameter, State, Term

from .driver import Instance, Library, Refused
from .fmus import VERSIONS, Fmu, many_functions

x, z, u, k, y = sympy.symbols("x z u k y", real=True)
n = Enumeration(sympy.Symbol("n", integer=True), {"one": "", "two": "", "three": ""}, "Number")


def model_of(*expressions: Any, **changes: Any) -> OdeModel:
    """A model with these expressions as outputs y0, y1, ..."""
    stated = {
        "name": "expressions",
        "description": "Expressions",
        "states": (State(x, "1", "", start=0.4), State(z, "1", "", start=-0.7)),
        "derivatives": (-x, x * 0),
        "inputs": (Input(u, "1", ""),),
        "parameters": (Parameter(k, "1", "", start=1.3), n),
        "outputs": tuple(Output(sympy.Symbol(f"y{i}"), e, "1", "") for i, e in enumerate(expressions)),
    }
    return OdeModel(**(stated | changes))


@pytest.fixture
def load(own_caches: None, tmp_path: Path) -> Callable[[OdeModel], Fmu]:
    def make(model: OdeModel) -> Fmu:
        path = plants.build(model)
        fmpy.extract(path, tmp_path)
        description = fmpy.read_model_description(tmp_path)
        references = {v.name: v.valueReference for v in description.modelVariables}
        (binary,) = (tmp_path / "binaries").glob("*/*")
        library = Library(str(binary), "2.0", description.guid, max(references.values()) + 1)
        return Fmu(path, tmp_path, library, references)

    return make


def assert_equal(model: OdeModel, fmu: Fmu, points: list[dict[str, float]]) -> np.ndarray:
    """Compare outputs and derivatives with NumPy's to 1e-12 of their terms' size; return the outputs, row by row."""
    functions = numeric.compile(model)
    names = [o.name for o in model.outputs] + [f"der({s.name})" for s in model.states]
    rows = []
    for point in points:
        instance = Instance(fmu.library, "co_simulation")
        reals = {v.name: point.get(v.name, v.start) for v in (*model.states, *model.inputs, *model.reals)}
        instance.set({fmu[name]: value for name, value in reals.items()})
        for e in model.enumerations:
            instance.set_enumeration(fmu[e.name], int(point.get(e.name, 1)))
        instance.initialize()
        found = np.array(instance.get(*(fmu[name] for name in names)))
        instance.free()
        values = reals | {e.name: point.get(e.name, 1) for e in model.enumerations}
        arguments = [[values[v.name] for v in vs] for vs in (model.states, model.inputs, model.parameters)]
        expected = np.concatenate([functions.outputs(0.0, *arguments), functions.rhs(0.0, *arguments)])
        assert np.all(np.isfinite(expected))
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)
        rows.append(found[: len(model.outputs)])
    return np.array(rows)


def test_arithmetic_with_enumerations_is_real(load: Callable) -> None:
    """No quotient of integers, no abs() of an integer: in C both would round."""
    m = n.symbol
    model = model_of(
        2 / (m + 1), 1 / m, m / (m + 3), sympy.Abs(m - 5) / 2, sympy.sign(m - 2) / (m + 3), sympy.Mod(m, 2) / 3, m**-2
    )
    values = assert_equal(model, load(model), [{"n": i} for i in (1, 2, 3)])
    np.testing.assert_allclose(values[:, 0], [1, 2 / 3, 1 / 2], rtol=1e-15)


def test_mod_has_the_sign_of_the_divisor(load: Callable) -> None:
    wrapped = sympy.Mod(x + sympy.pi, 2 * sympy.pi) - sympy.pi
    model = model_of(wrapped, sympy.Mod(x, -3), sympy.Mod(x * k, 2 + u**2), sympy.Mod(x, 1) ** 2)
    fmu = load(model)
    angles = np.array([-20.0, -7.0, -4.0, -3.0, -0.5, 0.0, 0.5, 4.0, 7.0, 20.0])
    values = assert_equal(model, fmu, [{"x": angle, "u": 0.3} for angle in angles])
    np.testing.assert_allclose(values[:, 0], np.arctan2(np.sin(angles), np.cos(angles)), atol=1e-13)

    instance = Instance(fmu.library, "co_simulation")
    instance.set({fmu["x"]: -4.0, fmu["u"]: 0.3})
    instance.initialize()
    slopes = instance.differentiate([fmu[f"y{i}"] for i in range(4)], [fmu["x"]], [1.0])
    np.testing.assert_allclose(slopes[:3], [1.0, 1.0, 1.3])
    # Mod(x, 1)^2 is x^2 between the integers, shifted: at -4 its slope is 0.
    assert slopes[3] == 0.0
    assert instance.differentiate([fmu["y2"]], [fmu["u"]], [1.0]) == pytest.approx([0.6 * 3])  # -floor(-5.2 / 2.09) = 3
    instance.free()


def test_mod_is_that_of_python_where_a_quotient_is_rounded(load: Callable) -> None:
    """1/0.1 is 10, but 0.1 in binary is more than a tenth, so that the remainder of 1 is nearly 0.1."""
    fmu = load(model_of(sympy.Mod(u, sympy.Float(0.1)), sympy.Mod(u, sympy.Float(-0.1)), sympy.Mod(x, u)))
    points = [0.02 * tick for tick in range(-60, 300)] + [-1e-300, 1e300, 0.0, -0.0]
    instance = Instance(fmu.library, "co_simulation").start()
    for point in points:
        instance.set({fmu["u"]: point})
        found = np.array(instance.get(*(fmu[f"y{i}"] for i in range(3))))
        expected = np.array([point % 0.1, point % -0.1, 0.4 % point if point else math.nan])
        assert found[:2].tobytes() == expected[:2].tobytes()
        np.testing.assert_equal(found, expected)
    instance.free()


def test_the_largest_of_many_has_the_same_bits_in_any_order_of_calls(load: Callable) -> None:
    """Of equal ones it is the last, and a number where another is NaN."""
    inputs = sympy.symbols("a b c d", real=True)
    items = [symbol * sympy.sqrt(symbol + 1) for symbol in inputs]  # NaN below -1
    largest, smallest = sympy.Max(*items), sympy.Min(*items)
    model = model_of(largest, smallest, inputs=tuple(Input(symbol, "1", "") for symbol in inputs))
    fmu, functions = load(model), numeric.compile(model)
    instance = Instance(fmu.library, "co_simulation").start()
    for values in itertools.product((-2.0, 0.0, -0.0, 1.0), repeat=4):
        named = dict(zip("abcd", values, strict=True))
        instance.set({fmu[name]: value for name, value in named.items()})
        found = np.array(instance.get(fmu["y0"], fmu["y1"]))
        with np.errstate(invalid="ignore"):
            computed = functions.outputs(0.0, functions.start(), functions.inputs(**named), functions.parameters())
        expected = []
        for expression, pair in ((largest, logarithms.larger), (smallest, logarithms.smaller)):
            given = [named[str(*item.free_symbols)] for item in expression.args]
            results = [value * math.sqrt(value + 1) if value > -1 else math.nan for value in given]
            expected.append(functools.reduce(pair, results))
        assert np.array_equal(found, expected, equal_nan=True)
        assert np.array_equal(found, computed, equal_nan=True)
        assert (np.signbit(found) == np.signbit(expected))[~np.isnan(found)].all()
    instance.free()


def test_a_state_that_is_no_output_has_its_derivative_by_itself(load: Callable) -> None:
    fmu = load(model_of(x, states=(State(x, "1", "", output=False), State(z, "1", ""))))
    instance = Instance(fmu.library, "co_simulation").start()
    assert instance.differentiate([fmu["x"], fmu["z"], fmu["y0"]], [fmu["x"]], [2.0]) == [2.0, 0.0, 2.0]
    instance.free()


def test_derivatives_at_kinks_are_those_beside_them(load: Callable) -> None:
    """They are numbers, too, where a chain rule that multiplies zero by infinity has none."""
    larger, twice, driven = sympy.symbols("larger twice driven", real=True)
    slopes = [  # expression, and its slope at some x
        (sympy.Abs(x), {-2.0: -1.0, 0.0: 1.0}),
        (sympy.Max(x, -x), {-2.0: -1.0, 0.0: -1.0, 3.0: 1.0}),
        (sympy.Max(1, x, x**2), {-0.5: 0.0, 3.0: 6.0}),
        (sympy.Max(-1, sympy.Min(1, 3 * x)), {-1.0: 0.0, 0.2: 3.0, 0.5: 0.0}),
        (sympy.sqrt(sympy.Max(x, 0)), {-1.0: 0.0, 0.0: math.inf, 4.0: 0.25}),
        (sympy.sqrt(twice) + x, {-1.0: 1.0, 2.0: 1.5}),
        (sympy.log(1 + sympy.sqrt(sympy.Max(0, sympy.Min(x, 4)))), {-1.0: 0.0, 1.0: 0.25, 9.0: 0.0}),
        (1 / sympy.Piecewise((x, x > 1), (5, True)), {0.0: 0.0, 2.0: -0.25}),
        (sympy.cbrt(x), {-8.0: 1 / 12, 8.0: 1 / 12}),
        (sympy.real_root(x, 3), {-8.0: 1 / 12, 8.0: 1 / 12}),
        (sympy.sinc(x), {0.0: 0.0, 1e-200: 0.0, 2.0: (2 * math.cos(2.0) - math.sin(2.0)) / 4}),
        (x * sympy.sign(x), {-1.0: -1.0, 0.0: 1.0}),
        (x * sympy.Heaviside(x), {-1.0: 0.0, 0.0: 1.0}),
        (u * sympy.Heaviside(x) * x**2, {0.0: 0.0, 3.0: 3.0}),
        (x * sympy.ceiling(x), {1.5: 2.0}),
        (sympy.sqrt(sympy.Max(0, u * sympy.Max(x, 0))), {-2.0: 0.0, 2.0: 0.25}),
        (sympy.cbrt(sympy.Max(x, 0) - 2 * sympy.Max(x - 1, 0)), {-2.0: 0.0, 10.0: -1 / 12}),
        (sympy.sqrt(u * sympy.Piecewise((x, x > 0), (0, True))), {-2.0: 0.0, 2.0: 0.25}),
        (sympy.sqrt(driven), {-2.0: 0.0, 2.0: 0.25}),
    ]
    model = model_of(
        *(expression for expression, _ in slopes),
        terms=(
            Term(larger, sympy.Max(x, 0), "1"),
            Term(twice, 2 * larger, "1"),
            Term(driven, u * sympy.Max(x, 0), "1"),
        ),
    )
    fmu, functions = load(model), numeric.compile(model)
    for at in sorted({at for _, wanted in slopes for at in wanted}):
        instance = Instance(fmu.library, "co_simulation")
        instance.set({fmu["x"]: at, fmu["u"]: 0.5})
        instance.initialize()
        names = [o.name for o in model.outputs]
        found = np.array(instance.differentiate([fmu[name] for name in names], [fmu["x"]], [1.0]))
        instance.free()
        in_numpy = functions.jacobians(0.0, functions.start(x=at), functions.inputs(u=0.5), functions.parameters())
        assert not np.any(np.isnan(found))
        np.testing.assert_allclose(in_numpy.C[:, 0], found, rtol=1e-12, atol=1e-13)
        if at == -2.0:
            np.testing.assert_array_equal(in_numpy.D[:, 0], 0.0, "u has no effect there")
        for (expression, wanted), slope in zip(slopes, found, strict=True):
            if at in wanted:
                assert slope == pytest.approx(wanted[at], rel=1e-12), f"{expression} at {at}"


def test_the_inverse_of_a_cube_root_is_real_too(load: Callable) -> None:
    model = model_of(1 / sympy.cbrt(x), u / sympy.cbrt(x))
    fmu, functions = load(model), numeric.compile(model)
    for at, value in ((-8.0, -0.5), (8.0, 0.5)):
        instance = Instance(fmu.library, "co_simulation")
        instance.set({fmu["x"]: at, fmu["u"]: 0.5})
        instance.initialize()
        given = 0.0, functions.start(x=at), functions.inputs(u=0.5), functions.parameters()
        assert instance.get(fmu["y0"], fmu["y1"]) == [value, 0.5 * value] == functions.outputs(*given).tolist()
        slopes = instance.differentiate([fmu["y0"], fmu["y1"]], [fmu["x"]], [1.0])
        assert slopes == pytest.approx([-1 / 48, -1 / 96], rel=1e-14)
        assert slopes == functions.jacobians(*given).C[:, 0].tolist()
        instance.free()


def test_functions_whose_names_would_coincide_are_told_apart(load: Callable) -> None:
    """tanh(x + 1) and tanh(x - 1), each used twice, are not the same intermediate result."""
    more, less = sympy.tanh(x + 1), sympy.tanh(x - 1)
    model = model_of(more * less, 2 * more - 3 * less, more**2)
    assert_equal(model, load(model), [{"x": value} for value in (-1.0, 0.2, 2.0)])


def test_functions_of_an_angle_are_computed_together(load: Callable) -> None:
    """One call for the tangent and the cosine of x; a function in a branch is left there, and one alone is alone."""
    model = model_of(sympy.tan(x) + z, 1 / sympy.cos(x), sympy.Piecewise((sympy.sin(z), x > 0), (sympy.cos(u), True)))
    text = generate(model, "2.0")["sources/model.c"].decode()
    function = text[text.index("void model_get_outputs") :].partition("\n}\n")[0]
    assert function.count("elementary_sin_cos_tan(x)") == 1
    assert "elementary_tan(" not in function
    assert "elementary_cos(x)" not in function
    assert "elementary_sin(z)" in function
    assert "elementary_cos(u)" in function
    assert_equal(model, load(model), [{"x": value, "z": 0.3, "u": 1e7} for value in (-1e9, -1.0, 0.0, 2.0)])


def random_expression(rng: random.Random, depth: int) -> sympy.Expr:
    """Draw an expression that is finite everywhere, and moderate."""
    if depth == 0:
        number = sympy.Rational(rng.randint(-9, 9), rng.randint(1, 4))
        return rng.choice([x, z, u, k, n.symbol, number, sympy.Integer(rng.randint(1, 3)), sympy.pi])
    a, b, c = (random_expression(rng, rng.randint(0, depth - 1)) for _ in range(3))
    return rng.choice(
        [
            lambda: a + b,
            lambda: a - b,
            lambda: a * b,
            lambda: a / (1 + b**2),
            lambda: a / (n.symbol + 1),
            lambda: sympy.sin(a),
            lambda: sympy.cos(a),
            lambda: sympy.tanh(a),
            lambda: sympy.Piecewise((a, b > c), (b, True)),
            lambda: n.select(one=a, two=b, three=c),
            lambda: sympy.Mod(a, sympy.Rational(7, 3)),
            lambda: sympy.Mod(a, 1 + b**2),
            lambda: sympy.floor(a),
            lambda: sympy.Abs(a),
            lambda: sympy.Min(a, b),
            lambda: sympy.Max(a, b, c),
        ]
    )()


def test_random_expressions(load: Callable) -> None:
    rng = random.Random(20)
    expressions: list[sympy.Expr] = []
    while len(expressions) < 30:
        expression = random_expression(rng, 4)
        if len(expression.free_symbols) > 1:
            expressions.append(expression)
    used = {type(e).__name__ for expression in expressions for e in sympy.preorder_traversal(expression)}
    assert used >= {"Add", "Mul", "Pow", "sin", "cos", "tanh", "Piecewise", "Mod", "floor", "Abs", "Min", "Max"}
    model = model_of(*expressions)
    points = [{s.name: rng.uniform(-3, 3) for s in (x, z, u, k)} | {"n": 1 + i % 3} for i in range(12)]
    assert_equal(model, load(model), points)


def dependencies(model: OdeModel) -> dict[str, tuple[dict[str, str], dict[str, str]]]:
    """For each computed variable, its dependencies and their kinds while running and at the start."""
    table = tabulate(model)
    names = {v.reference: v.full_name for v in table.variables}
    result: dict[str, tuple[dict[str, str], dict[str, str]]] = {}
    for i, unknowns in enumerate(((*table.output_unknowns, *table.derivative_unknowns), table.initial_unknowns)):
        for unknown in unknowns:
            kinds = {names[r]: kind for r, kind in zip(unknown.dependencies, unknown.kinds, strict=True)}
            result.setdefault(names[unknown.reference], ({}, {}))[i].update(kinds)
    return result


def test_what_stands_in_a_condition_is_a_dependency() -> None:
    switch = Term(y, sympy.Piecewise((1, u > k), (-1, True)))
    found = dependencies(
        model_of(y, sympy.Piecewise((x, TIME > 1), (0, True)), sympy.floor(x), sympy.Mod(u, 2), x + k, terms=(switch,))
    )
    assert found["y0"] == ({"u": "dependent", "k": "dependent"}, {"u": "dependent", "k": "dependent"})
    assert found["y1"][0] == {"x": "dependent", "time": "dependent"}
    assert found["y2"][0] == {"x": "dependent"}
    assert found["y3"][0] == {"u": "dependent"}
    assert found["y4"] == ({"x": "constant", "k": "constant"}, {"x": "constant", "k": "constant"})


def test_kinds_of_dependencies() -> None:
    """A slope made of parameters alone is `tunable`, or `fixed` if none of them is; at the start, `dependent`."""
    fixed = Parameter(sympy.Symbol("c"), "1", "", start=2.0, tunable=False)
    c = fixed.symbol
    model = model_of(c * x, k * c * x, n.symbol * x, k**2, c * k, parameters=(Parameter(k, "1", ""), fixed, n))
    found = dependencies(model)
    assert found["y0"] == ({"x": "fixed", "c": "dependent"}, {"x": "dependent", "c": "dependent"})
    assert found["y1"][0] == {"x": "tunable", "k": "dependent", "c": "dependent"}
    assert found["y2"][0] == {"x": "fixed", "n": "dependent"}
    assert found["y3"][0] == {"k": "dependent"}
    assert found["y4"][0] == {"k": "fixed", "c": "tunable"}


def test_dependencies_are_in_the_order_of_the_variables() -> None:
    """FMI 2.0, section 2.2.8: in ascending order, the time too, which comes last; parameters only at the start."""
    table = tabulate(many_functions())
    orders = [u.dependencies for u in (*table.output_unknowns, *table.derivative_unknowns, *table.initial_unknowns)]
    assert any(table.time.reference in order for order in orders)
    assert all(order == tuple(sorted(order)) for order in orders)
    parameters = {entry.reference for entry in (*table.parameters, *table.integers)}
    stripped = [set(u.dependencies) for u in table.without_parameters(table.derivative_unknowns)]
    assert stripped == [set(u.dependencies) - parameters for u in table.derivative_unknowns]
    assert any(parameters & set(u.dependencies) for u in table.derivative_unknowns)


@pytest.mark.parametrize("fmi", VERSIONS)
def test_names_with_nan_in_them(fmi: str) -> None:
    resonance, tenant = sympy.symbols("resonance tenant")
    inputs = (Input(u, "1", ""), Input(resonance, "1", ""), Input(tenant, "1", ""))
    code = generate(model_of(resonance * tenant, inputs=inputs), fmi)["sources/model.c"].decode()
    assert "outputs[OUTPUT_y0] = resonance*tenant;" in code


@pytest.mark.parametrize(
    "expression",
    [
        sympy.Sum(x ** sympy.Symbol("i"), (sympy.Symbol("i"), 1, 3)),
        sympy.Product(x + sympy.Symbol("i"), (sympy.Symbol("i"), 1, 3)),
        sympy.Integral(sympy.exp(sympy.sin(u)), (u, 0, x)),
        sympy.Derivative(sympy.sin(x), x),
        sympy.besselj(1, x),
        sympy.factorial(x),
        sympy.zeta(x),
        sympy.DiracDelta(x),
        sympy.Piecewise((1, sympy.Xor(x > 0, u > 0)), (0, True)),
        sympy.I * x,
        sympy.Piecewise((sympy.nan, x > 0), (0, True)),
    ],
    ids=str,
)
def test_what_c_has_not_is_refused(expression: sympy.Expr) -> None:
    with pytest.raises(ModelError, match=r"model 'expressions': .* (cannot be written in C|could be written in C)"):
        generate(model_of(expression), "2.0")


@pytest.mark.parametrize(
    "name",
    [
        "M_PI",
        "FP_NAN",
        "HUGE_VAL",
        "MATH_ERRNO",
        "math_errhandling",
        "DBL_MAX",
        "MODEL_GUID",
        "N_STATES",
        "ROOM",
        "FIRST_STATE",
        "STATE_x",
        "INPUT_u",
        "PARAMETER_k",
        "ENUMERATION_n",
        "SOLVER_EULER",
        "TIME",
        "true",
        "isinf",
        "EOF",
        "errno",
        "SIZE_MAX",
        "UINT_FAST8_MAX",
        "LONG_MIN",
    ],
)
def test_names_that_c_headers_define_are_refused(name: str) -> None:
    with pytest.raises(ModelError, match=f"'{name}' is reserved, it cannot be used in the generated C code"):
        model_of(inputs=(Input(u, "1", ""), Input(sympy.Symbol(name), "1", "")))


def test_an_enumeration_whose_items_make_a_reserved_name() -> None:
    drive = Enumeration(sympy.Symbol("M"), {"PI": ""}, "")
    with pytest.raises(ModelError, match="'M_PI' is reserved"):
        model_of(parameters=(Parameter(k, "1", ""), n, drive))


@pytest.mark.parametrize(("enumeration", "item"), [("LOG", "ALL"), ("OFFERS", "STATES"), ("size", "t"), ("va", "list")])
def test_an_enumeration_whose_items_make_a_name_of_the_runtime(enumeration: str, item: str) -> None:
    made = Enumeration(sympy.Symbol(enumeration), {item: ""}, "")
    with pytest.raises(ModelError, match=f"the generated C code uses the name '{enumeration}_{item}' for something"):
        generate(model_of(parameters=(Parameter(k, "1", ""), n, made)), "3.0")


def test_names_of_locals_members_and_comments_of_the_runtime_are_free(load: Callable) -> None:
    """There: locals `q_low` and `is_left`, an argument `n_knowns`, a member `has_error`, a text "#define and"."""
    words = {"q": ("low", "rest"), "is": ("left",), "n": ("knowns",), "has": ("error",)}
    made = [Enumeration(sympy.Symbol(name), dict.fromkeys(items, ""), "") for name, items in words.items()]
    named = Parameter(sympy.Symbol("and"), "1", "", start=3.0)
    expression = made[0].select(low=named.symbol * x, rest=-x)
    model = model_of(expression, parameters=(Parameter(k, "1", ""), named, *made))
    values = assert_equal(model, load(model), [{"q": 1}, {"q": 2}])
    assert values[:, 0].tolist() == [3 * 0.4, -0.4]
    assert generate(model, "3.0")


@pytest.mark.parametrize(("name", "fmi"), [("INTERFACES", "2.0"), ("VARIABLES_H", "3.0"), ("fmi2True", "2.0")])
def test_macros_of_the_runtime_are_refused(name: str, fmi: str) -> None:
    with pytest.raises(ModelError, match=f"the generated C code uses the name '{name}' for something else"):
        generate(model_of(inputs=(Input(u, "1", ""), Input(sympy.Symbol(name), "1", ""))), fmi)


def test_a_variant_that_is_not_there() -> None:
    with pytest.raises(ModelError, match="output 'y0': n has no variant 4; it has 1 to 3"):
        model_of(sympy.Piecewise((x, sympy.Eq(n.symbol, 4)), (u, True)))


def test_numbers_become_floats() -> None:
    parameter = Parameter(k, "1", "", start=sympy.pi / 2, min=sympy.Rational(1, 3), max=sympy.oo, nominal=np.int64(2))
    numbers = (parameter.start, parameter.min, parameter.max, parameter.nominal)
    assert numbers == (math.pi / 2, 1 / 3, math.inf, 2.0)
    limit, output = Limit(x, min=-sympy.pi, max=3), Output(y, x, "1", "", nominal=sympy.Integer(4))
    numbers += (limit.min, limit.max, output.nominal)
    assert {type(number) for number in numbers} == {float}
    description = generate(model_of(parameters=(parameter, n)), "2.0")["modelDescription.xml"]
    (real,) = etree.fromstring(description).xpath("//ScalarVariable[@name='k']/Real")
    assert float(real.get("start")) == math.pi / 2


@pytest.mark.parametrize("value", ["1", None, u, 1 + 2j, sympy.I, [1.0]], ids=repr)
@pytest.mark.parametrize("attribute", ["start", "min", "max", "nominal"])
def test_what_is_no_number_is_refused(attribute: str, value: Any) -> None:
    with pytest.raises(ModelError, match=rf"parameter 'k': {attribute} is .*, it must be a real number"):
        Parameter(k, "1", "", **{attribute: value})


@pytest.mark.parametrize("fmi", VERSIONS)
def test_type_names_are_unique(fmi: str) -> None:
    drives = [Enumeration(sympy.Symbol(name), {"a": "", "b": ""}, "") for name in ("drive", "Drive", "dri_ve")]
    inputs = (Input(u, "1", ""), Input(sympy.Symbol("DriveVariant"), "1", ""))
    root = etree.fromstring(
        generate(model_of(inputs=inputs, parameters=(Parameter(k, "1", ""), *drives)), fmi)["modelDescription.xml"]
    )
    types = root.xpath("//SimpleType/@name | //EnumerationType/@name")
    names = [*types, *root.xpath("//ModelVariables/*/@name")]
    assert len(types) == len(drives) + 1
    assert len(names) == len(set(names))
    assert sorted(root.xpath("//@declaredType")) == sorted(types)


def test_text_of_all_kinds_reaches_the_messages(load: Callable) -> None:
    """Characters beyond the Basic Multilingual Plane, digits after an escape, trigraphs of C."""
    reason = 'θ\u20091 is \U0001f600\u00e92 "far" \\ what??/ \x7f.'
    model = model_of(x, description=f"{reason} */", limits=(Limit(x, max=2.0, reason=reason),))
    fmu = load(model)
    instance = Instance(fmu.library, "co_simulation")
    instance.set({fmu["x"]: 3.0})
    instance.set_enumeration(fmu["at_singularity"], 2)
    with pytest.raises(Refused) as refused:
        instance.start()
    assert reason in str(refused.value)
    instance.free()


def test_names_on_the_page() -> None:
    """I_theta1 is I with the index θ1, e_dot_stop is e with a dot, also within a derivative."""
    inertia, rate, d_1 = sympy.symbols("I_theta1 e_dot_stop M2_11")
    terms = (Term(inertia, 2 * k), Term(rate, 3 * k), Term(d_1, 4 * k))
    page = document(model_of(terms=terms))
    left = [term.left for term in page.terms]
    assert left == [
        "<msub><mi>I</mi><mrow><mrow><mi>θ</mi><mn>1</mn></mrow></mrow></msub>",
        "<msub><mover><mi>e</mi><mo>˙</mo></mover><mrow><mrow><mi>stop</mi></mrow></mrow></msub>",
        "<msub><mi>M</mi><mrow><mrow><mn>2</mn></mrow><mo>,</mo><mrow><mn>11</mn></mrow></mrow></msub>",
    ]
    assert page.derivatives[0].left == "<mover><mi>x</mi><mo>˙</mo></mover>"
