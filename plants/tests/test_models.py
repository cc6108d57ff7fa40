"""Models: the general ordinary differential equation, its NumPy functions, and wrong models by name."""

import math
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from typing import Any

import pytest
import sympy

import plants
from plants import ModelError, numeric
from plants.nonholonomic import NonholonomicSystem
from plants.ode import TIME, Enumeration, Input, OdeModel, Output, Parameter, State, Term

s, f, k, c = sympy.symbols("s f k c")
stiff = Enumeration(sympy.Symbol("spring"), {"linear": "force k s", "hardening": "force k s^3"}, "Law of the spring")
rate = sympy.Symbol("rate")


def spring(**changes: Any) -> OdeModel:
    """A mass of 1 kg on a spring: second-order, an enumeration, a term, a computed output and the time."""
    pull = sympy.Symbol("pull")
    stated = {
        "name": "spring_mass",
        "description": "A mass on a spring",
        "states": (State(s, "m", "Deflection", start=0.1), State(rate, "m/s", "Its rate", output=False)),
        "derivatives": (rate, f * sympy.cos(TIME) - pull - c * rate),
        "inputs": (Input(f, "N", "Force"),),
        "parameters": (
            Parameter(k, "N/m", "Stiffness", start=2.0, min=0.0),
            Parameter(c, "N.s/m", "Damping", start=0.1),
            stiff,
        ),
        "outputs": (
            Output(sympy.Symbol("energy"), rate**2 / 2 + sympy.pi * f, "J", "Kinetic energy and some of the input"),
        ),
        "terms": (Term(pull, stiff.select(linear=k * s, hardening=k * s**3), "N"),),
    }
    return OdeModel(**(stated | changes))


def test_numpy_functions() -> None:
    model = numeric.compile(spring())
    p = model.parameters(spring="hardening", k=3.0)
    assert model.rhs(0.5, [2.0, 1.0], [4.0], p).tolist() == pytest.approx([1.0, 4 * math.cos(0.5) - 24.0 - 0.1])
    assert model.outputs(0.0, [2.0, 3.0], [1.0], p).tolist() == pytest.approx([4.5 + math.pi])
    assert model.start().tolist() == [0.1, 0.0]
    assert model.inputs().tolist() == [0.0]
    assert model.start(rate=2.0).tolist() == [0.1, 2.0]
    with pytest.raises(ModelError, match="no parameter 'mass'; there are k, c, spring"):
        model.parameters(mass=1.0)
    with pytest.raises(ModelError, match="spring has no variant 'soft'"):
        model.parameters(spring="soft")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"derivatives": (rate, -k * s - sympy.Symbol("q"))}, "the derivative of 'rate' uses the undefined symbol 'q'"),
        ({"derivatives": (rate, sympy.Function("g")(s))}, "the derivative of 'rate' uses the undefined function g(s)"),
        ({"derivatives": (rate,)}, "2 states, but 1 derivatives"),
        ({"states": (), "derivatives": ()}, "there are no states"),
        ({"name": "spring mass"}, "model name 'spring mass' is not an FMI and C identifier"),
        ({"name": "double"}, "model name 'double' is reserved"),
        ({"inputs": (Input(f, "N", "Force"), Input(k, "N", "Force"))}, "the name 'k' is used twice"),
        ({"inputs": (Input(sympy.Symbol("f", real=True), "N", ""),)}, "'f' that is not the declared one"),
        ({"inputs": (Input(f, "N", ""), Input(sympy.Symbol("sin"), "N", ""))}, "input 'sin' is reserved"),
        (
            {"inputs": (Input(f, "N", ""), Input(sympy.Symbol("1st"), "N", ""))},
            "input '1st' is not an FMI and C identifier",
        ),
        ({"inputs": (Input(f, "N", "Force", start=math.nan),)}, "input 'f': the default nan is not within its bounds"),
        (
            {"parameters": (Parameter(k, "N/m", "Stiffness", start=-2.0, min=0.0), Parameter(c, "1", ""), stiff)},
            "parameter 'k': the default -2 is not within its bounds [0, inf]",
        ),
        ({"inputs": (Input(f, "newton", "Force"),)}, "unit 'newton': write 'N'"),
        (
            {"outputs": (Output(sympy.Symbol("y"), sympy.Symbol("z"), "m", ""),)},
            "output 'y' uses the undefined symbol 'z'",
        ),
        ({"outputs": (Output(s, k, "m", ""),)}, "the name 's' is used twice"),
        (
            {"outputs": (Output(sympy.Symbol("y"), s, "m", "", nominal=-1),)},
            "output 'y': the nominal value must be positive, not -1",
        ),
        (
            {"outputs": (Output(sympy.Symbol("y"), s, "m", "", nominal=math.nan),)},
            "output 'y': the nominal value must be positive, not nan",
        ),
        (
            {"description": "a\x0bb"},
            "model 'spring_mass': description has the character '\\x0b', which no XML file can have",
        ),
        ({"description": None}, "model 'spring_mass': description is None, it must be a text"),
        (
            {"terms": (Term(sympy.Symbol("pull"), sympy.Symbol("later")),)},
            "term 'pull' uses the undefined symbol 'later'",
        ),
    ],
)
def test_wrong_models_are_refused_by_name(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(plants.PlantError) as error:
        spring(**changes)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("state", "message"),
    [
        (lambda: State("x", "m", ""), "state: its symbol is 'x', it must be a Symbol of SymPy"),  # type: ignore[arg-type]
        (lambda: State(sympy.MatrixSymbol("X", 2, 1)[0], "m", ""), "state: its symbol is X[0, 0], it must be a Symbol"),
        (lambda: State(s, None, ""), "state 's': unit is None, it must be a text"),  # type: ignore[arg-type]
        (lambda: State(s, "m", "\udc80"), "state 's': description has the character '\\udc80', which no XML file can"),
        (lambda: Term(s, k, equation="\x00"), "term 's': equation has the character '\\x00'"),
        (lambda: Enumeration(k, {"one": "\x1b"}, ""), "enumeration 'k': item 'one' has the character '\\x1b'"),
    ],
)
def test_wrong_statements_are_refused_by_name(state: Callable[[], object], message: str) -> None:
    with pytest.raises(ModelError) as error:
        state()
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("assumptions", "start", "told"),
    [
        ({"positive": True}, -1.0, "is not negative"),
        ({"positive": True}, 0.0, ""),
        ({"negative": True}, 0.0, ""),
        ({"positive": False, "real": True}, 2.0, "is not positive"),
        ({"positive": False, "real": True}, -2.0, ""),
        ({"nonnegative": True}, -1.0, "is not negative"),
        ({"negative": True}, 1.0, "is not positive"),
        ({"nonnegative": True}, 0.0, ""),
        ({"real": True}, -1.0, ""),
    ],
)
def test_a_default_cannot_contradict_the_assumptions_of_its_symbol(
    assumptions: dict[str, bool], start: float, told: str
) -> None:
    """SymPy takes |x| for x where x is positive."""
    x = sympy.Symbol("x", **assumptions)
    with pytest.raises(ModelError, match=f"contradicts .*, which {told}") if told else nullcontext():
        OdeModel("assumed", "", (State(x, "m", "", start=start),), (-abs(x),))


def test_enumeration_needs_every_variant() -> None:
    with pytest.raises(ModelError, match="one expression for each of linear, hardening"):
        stiff.select(linear=s)


def pendulum_on_wheels() -> NonholonomicSystem:
    """Two coordinates, one velocity: a unicycle that only goes straight, for the shapes."""
    x, y, v, m, tau, d_x, d_y = sympy.symbols("x y v m tau d_x d_y", real=True)
    return NonholonomicSystem(
        name="straight",
        description="A sledge",
        coordinates=(State(x, "m", ""), State(y, "m", "")),
        velocities=(State(v, "m/s", ""),),
        inputs=(Input(tau, "N", ""),),
        disturbances=(Input(d_x, "N", ""), Input(d_y, "N", "")),
        parameters=(Parameter(m, "kg", "", start=1.0),),
        S=sympy.Matrix([1, 0]),
        M1=m * sympy.eye(2),
        D1=sympy.zeros(2),
        B1=sympy.Matrix([1, 0]),
    )


def test_abbreviations_of_a_nonholonomic_system() -> None:
    """A term that M1 uses is written as it is named; one that cancels does not become part of the model."""
    m, load, spare = sympy.symbols("m load spare", real=True)
    stated = replace(
        pendulum_on_wheels(),
        terms=(Term(load, 2 * m, "kg"), Term(spare, 3 * m, "kg")),
        M1=sympy.diag(load, spare),
        A=sympy.Matrix([[0, 1]]),
    ).ode()
    assert [term.symbol.name for term in stated.terms if term.symbol in (load, spare)] == ["load"]
    assert stated.expand(stated.derivatives[2]) == (sympy.Symbol("tau", real=True) - stated.inputs[1].symbol) / (2 * m)


def test_a_matrix_may_be_of_any_kind() -> None:
    stated = pendulum_on_wheels()
    for S in ([[1], [0]], sympy.ImmutableMatrix([1, 0])):
        assert replace(stated, S=S).ode() == stated.ode()


def test_a_parameter_in_another_unit_is_converted_in_a_term() -> None:
    m, load = sympy.symbols("m load", real=True)
    stated = replace(
        pendulum_on_wheels(),
        parameters=(Parameter(m, "g", "", start=1.0),),
        terms=(Term(load, m / 1000, "kg"),),
        M1=load * sympy.eye(2),
    ).ode()
    expected = 1000 * (sympy.Symbol("tau", real=True) - stated.inputs[1].symbol) / m
    assert sympy.simplify(stated.expand(stated.derivatives[2]) - expected) == 0


def test_a_parameter_in_another_unit_may_be_converted_in_a_matrix() -> None:
    m, load, share, slope, per_g = sympy.symbols("m load share slope per_g", real=True)
    given = {m: "g", load: "g", share: "%", slope: "deg", per_g: "kg/g"}
    stated = replace(
        pendulum_on_wheels(),
        parameters=tuple(Parameter(symbol, unit, "", start=1.0) for symbol, unit in given.items()),
        M1=sympy.diag((m + load) / 1000, per_g * load),
        B1=sympy.Matrix([share / 100 * m / (m + load) * sympy.cos(slope * sympy.pi / 180), 0]),
    ).ode()
    numbers = dict.fromkeys(given, 0) | {m: 1000, load: 3000, share: 50, slope: 60}
    tau = sympy.Symbol("tau", real=True)
    assert stated.expand(stated.derivatives[2]).subs({**numbers, tau: 64, stated.inputs[1].symbol: 0}) == 1


def test_terminals_of_a_nonholonomic_system() -> None:
    terminals = {t.name: [s.name for s in t.symbols] for t in pendulum_on_wheels().ode().terminals}
    assert terminals == {"pose": ["x", "y"], "velocity": ["v"], "torque": ["tau"], "disturbance": ["d_x", "d_y"]}


def test_nonholonomic_with_one_velocity() -> None:
    model = pendulum_on_wheels().ode()
    v, m, tau, d_x = sympy.symbols("v m tau d_x", real=True)
    assert [model.expand(e) for e in model.derivatives] == [v, 0, (tau - d_x) / m]
    assert {term.symbol.name: term.unit for term in model.terms}["M2_11"] == "kg"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"S": sympy.eye(2)}, r"S is (2, 2), it must be (2, 1)"),
        ({"B1": sympy.eye(2)}, r"B1 is (2, 2), it must be (2, 1)"),
        ({"M1": sympy.Matrix([[1, 1], [0, 1]])}, "M1 is not symmetric"),
        ({"disturbances": ()}, "0 disturbances, one for each of 2 coordinates"),
        ({"F2": sympy.eye(2)}, "F2 is (2, 2), it must be (1, 1)"),
        ({"A": sympy.Matrix([[1, 0]])}, "A S is not zero: the motion basis breaks the constraints"),
        ({"angles": (Term(sympy.Symbol("q", real=True), c, "rad"),)}, "the angle q is not a difference of coordinates"),
        (
            {"terms": (Term(c, sympy.Symbol("y", real=True), "kg"),), "M1": c * sympy.eye(2)},
            "S or M1 uses the term c, which is not constant",
        ),
        (
            {"terms": (Term(c, sympy.exp(TIME), "kg"),), "M1": c * sympy.eye(2)},
            "S or M1 uses the term c, which is not constant",
        ),
        (
            {"S": sympy.Matrix([sympy.exp(TIME), 0])},
            "S or M1 uses time: they may depend on coordinates, parameters and",
        ),
        ({"M1": (1 + sympy.Symbol("v", real=True) ** 2) * sympy.eye(2)}, "S or M1 uses v: they may depend"),
        ({"M1": sympy.Symbol("tau", real=True) * sympy.eye(2)}, "S or M1 uses tau: they may depend"),
        ({"S": "1, 0"}, "S is '1, 0', it must be a matrix of SymPy"),
        ({"M1": None}, "M1 is None, it must be a matrix of SymPy"),
        (
            {"parameters": (Parameter(sympy.Symbol("m", real=True), "g", "", start=1.0),)},
            "m is in g, but M1 uses it as it stands, and the derivation computes in SI units: state it in kg, or",
        ),
        (
            {
                "parameters": (Parameter(c, "deg", "", start=1.0),),
                "M1": sympy.eye(2),
                "B1": sympy.Matrix([sympy.cos(c), 0]),
            },
            "c is in deg, but B1 uses it as it stands",
        ),
        (
            {"velocities": (State(sympy.Symbol("v", real=True), "km/h", ""),)},
            "v is in km/h, but the derivation computes in SI units: state it in m/s",
        ),
    ],
)
def test_wrong_matrices_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ModelError) as error:
        replace(pendulum_on_wheels(), **changes)
    assert message in str(error.value)
