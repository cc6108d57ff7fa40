"""The compiled FMU against the NumPy model, against known solutions, and against misuse."""

import ctypes
import math
from collections.abc import Callable
from pathlib import Path

import fmpy
import fmpy.validation
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from scipy.integrate import solve_ivp

import plants
from plants import numeric
from plants.car_like.reference import REFERENCE

STATES = REFERENCE.states
INPUTS = REFERENCE.inputs
CAR = plants.load("car_like")
NUMPY = numeric.compile(CAR)
REALS = [parameter.name for parameter in CAR.reals]


def draw(rng: np.random.Generator) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
    """Random states, inputs and parameters, by name."""
    x = rng.uniform([-50, -50, -10, -1.4, -3, -3], [50, 50, 10, 1.4, 3, 3])
    u = rng.uniform(-200, 200, len(INPUTS))
    body, damping = ([0.3, 1, 0.5, 0.5], [3, 80, 20, 20]), ([0] * 4, [50] * 4)
    friction, stop = ([-10, 0, 0.01] * 2, [20, 20, 0.5] * 2), ([0.2, -1000, 0], [1, 5000, 1])
    # Negative ones stand for none.
    p = rng.uniform(*np.hstack([body, damping, friction, stop])).clip(min=0)
    return tuple(dict(zip(names, map(float, v), strict=True)) for names, v in ((STATES, x), (INPUTS, u), (REALS, p)))


@pytest.mark.parametrize("drive", [1, 2, 3])
@pytest.mark.parametrize(("solver", "method"), [(1, NUMPY.euler), (2, NUMPY.rk4)])
def test_one_step_equals_the_numpy_model(new_car: Callable, drive: int, solver: int, method: Callable) -> None:
    rng = np.random.default_rng([drive, solver])
    car = new_car()
    for _ in range(100):
        x, u, p = draw(rng)
        step = rng.uniform(0.001, 0.03)
        car.start(**x, **u, **p, drive=drive, solver=solver, solver_step=step)
        p_vector = NUMPY.parameters(**p, drive=drive)
        derivatives = car.get(*(f"der({name})" for name in STATES))
        expected = NUMPY.rhs(0.0, list(x.values()), list(u.values()), p_vector)
        np.testing.assert_array_less(np.abs(derivatives - expected), 1e-12 * np.maximum(1, np.abs(expected)))

        car.step(0.0, step)
        expected = method(0.0, list(x.values()), list(u.values()), p_vector, step)
        np.testing.assert_array_less(np.abs(car.get(*STATES) - expected), 1e-12 * np.maximum(1, np.abs(expected)))
        car.fmu.reset()


def test_reference_result(new_car: Callable) -> None:
    """A run of 6 s against the constrained dynamics; the internal step makes Runge-Kutta's error negligible."""
    table = REFERENCE.read()
    car = new_car().start(**dict(zip(STATES, REFERENCE.start, strict=True)), solver=2, solver_step=0.005)
    for row in table:
        np.testing.assert_allclose(car.get(*STATES), row[1:7], rtol=0, atol=1e-9)
        car.set(**dict(zip(INPUTS, row[7:], strict=True)))
        car.step(row[0], REFERENCE.step)


@pytest.mark.parametrize(("solver", "order", "steps"), [(1, 1, (200, 400, 800)), (2, 4, (10, 20, 40))])
def test_convergence_order(new_car: Callable, solver: int, order: int, steps: tuple[int, ...]) -> None:
    """Against SciPy at tight tolerance, halving the step divides the error by 2 to the order."""
    horizon, u, p = 2.0, NUMPY.inputs(tau_drive=40.0, tau_steer=20.0, tau_d_y=-5.0), NUMPY.parameters()
    start = np.array(REFERENCE.start)
    exact = solve_ivp(lambda t, x: NUMPY.rhs(t, x, u, p), (0, horizon), start, method="DOP853", rtol=1e-13, atol=1e-13)
    errors = []
    for n in steps:
        car = new_car().start(
            **dict(zip(STATES, start, strict=True)),
            **dict(zip(INPUTS, u, strict=True)),
            solver=solver,
            solver_step=horizon / n,
        )
        car.step(0.0, horizon)
        errors.append(np.linalg.norm(car.get(*STATES) - exact.y[:, -1]))
    orders = -np.diff(np.log2(errors))
    np.testing.assert_allclose(orders, order, atol=0.15)


def test_simulate_fmu_agrees_with_stepping(fmu: Path, new_car: Callable) -> None:
    values = {"tau_drive": 8.0, "tau_steer": 1.0, "gamma": 0.1, "drive": 2}
    result = fmpy.simulate_fmu(str(fmu), stop_time=1.0, output_interval=0.02, start_values=values, output=list(STATES))
    car = new_car().start(**values)
    for k, row in enumerate(result):
        assert row["time"] == pytest.approx(k * 0.02)
        np.testing.assert_allclose(car.get(*STATES), list(row)[1:], rtol=1e-12, atol=1e-15)
        car.step(k * 0.02, 0.02)
    assert len(result) == 51


def test_communication_step_is_divided_evenly(new_car: Callable) -> None:
    """50 ms with an internal step of at most 20 ms: three steps of a third; any communication step is possible."""
    start, u, p = np.array(REFERENCE.start), NUMPY.inputs(tau_drive=30.0, tau_steer=-10.0), NUMPY.parameters()
    car = new_car().start(**dict(zip(STATES, start, strict=True)), tau_drive=30.0, tau_steer=-10.0, solver_step=0.02)
    x, t = start, 0.0
    for step, n in ((0.05, 3), (0.02, 1), (0.04, 2), (0.0401, 3), (1e-4, 1), (0.02 * (1 + 1e-9), 1)):
        car.step(t, step)
        for _ in range(n):
            x = NUMPY.euler(0.0, x, u, p, step / n)
        t += step
        np.testing.assert_allclose(car.get(*STATES), x, rtol=1e-13, atol=1e-13)


def test_time_does_not_drift(new_car: Callable) -> None:
    """A master that computes t = k h and one that adds up h are both followed, over many steps."""
    by_count, by_sum, t = new_car().start(), new_car().start(), 0.0
    for k in range(100_000):
        by_count.step(k * 0.02, 0.02)
        by_sum.step(t, 0.02)
        t += 0.02
    assert t != 2000.0  # the sum has drifted
    assert by_count.fmu.getRealStatus(fmpy.fmi2.fmi2LastSuccessfulTime) == pytest.approx(2000.0, rel=1e-15)


def test_reset_starts_afresh(new_car: Callable) -> None:
    def run() -> list[float]:
        car.start(tau_drive=8.0, gamma=0.3)
        for k in range(10):
            car.step(k * 0.02, 0.02)
        return car.get(*STATES)

    car = new_car()
    first = run()
    car.fmu.reset()
    car.fmu.enterInitializationMode()
    assert car.get("x", "gamma", "tau_drive", "m_c") == [0.0, 0.0, 0.0, 30.0]
    car.fmu.reset()
    assert run() == first


def test_instances_are_independent(new_car: Callable) -> None:
    alone = new_car().start(tau_drive=8.0)
    one, other = new_car("one").start(tau_drive=8.0), new_car("other").start(tau_drive=-3.0, m_c=10.0, solver=2)
    for k in range(20):
        alone.step(k * 0.02, 0.02)
    for k in range(20):
        one.step(k * 0.02, 0.02)
        other.step(k * 0.02, 0.02)
    assert one.get(*STATES) == alone.get(*STATES)
    assert other.get("v")[0] < 0 < one.get("v")[0]


def test_saved_state_resumes_bit_for_bit(new_car: Callable) -> None:
    car = new_car().start(tau_drive=20.0, tau_steer=5.0)
    car.step(0.0, 0.5)
    state = car.fmu.getFMUstate()
    stored = car.fmu.serializeFMUstate(state)
    car.step(0.5, 0.5)
    expected = car.get(*STATES)

    car.fmu.setFMUstate(state)
    car.step(0.5, 0.5)
    assert car.get(*STATES) == expected
    car.fmu.freeFMUstate(state)

    other = new_car("other")
    state = other.fmu.deSerializeFMUstate(stored)
    other.fmu.setFMUstate(state)
    other.step(0.5, 0.5)
    assert other.get(*STATES) == expected
    with pytest.raises(FMICallException):
        other.fmu.deSerializeFMUstate(b"x" * len(stored))
    assert "not a state of this FMU" in other.messages[-1]
    other.fmu.freeFMUstate(state)


def test_validation_is_silent(fmu: Path) -> None:
    assert fmpy.validation.validate_fmu(str(fmu)) == []


def test_description_says_what_the_model_says(fmu: Path) -> None:
    description = fmpy.read_model_description(fmu)
    variables = {variable.name: variable for variable in description.modelVariables}
    assert (description.modelName, description.coSimulation.modelIdentifier) == ("car_like", "car_like")
    assert description.generationTool.startswith("Formation")
    assert description.generationDateAndTime is None
    for state in CAR.states:
        variable = variables[state.name]
        assert (variable.causality, variable.initial, variable.unit) == ("output", "exact", state.unit)
        assert variables[f"der({state.name})"].derivative is variable
    for inputs in CAR.inputs:
        assert (variables[inputs.name].causality, variables[inputs.name].unit) == ("input", inputs.unit)
    for parameter in CAR.reals:
        variable = variables[parameter.name]
        assert (variable.causality, variable.variability, variable.unit) == ("parameter", "tunable", parameter.unit)
        assert (float(variable.start), float(variable.min)) == (parameter.start, parameter.min)
    for name in ("solver_step", "tolerance", "solver", "drive", "at_singularity"):
        assert (variables[name].causality, variables[name].variability) == ("parameter", "fixed")
    assert [item.name for item in variables["drive"].declaredType.items] == ["as_printed", "front_wheel", "rear_wheel"]
    assert [item.name for item in variables["solver"].declaredType.items] == [
        "euler",
        "runge_kutta_4",
        "dormand_prince_45",
    ]
    units = {unit.name: unit for unit in description.unitDefinitions}
    assert (units["N.m"].baseUnit.kg, units["N.m"].baseUnit.m, units["N.m"].baseUnit.s) == (1, 2, -2)
    assert units["rad"].displayUnits[0].name == "deg"
    assert units["rad"].displayUnits[0].factor == pytest.approx(180 / math.pi)


def test_structure_is_true(new_car: Callable) -> None:
    """A derivative changes with a state, an input or a parameter if and only if the model structure says so."""
    rng = np.random.default_rng(3)
    car = new_car()
    known = [*STATES, *INPUTS, *REALS]
    unknowns = {unknown.variable.name: unknown for unknown in car.description.initialUnknowns}
    seen = {name: set() for name in unknowns}
    for _ in range(5):
        x, u, p = draw(rng)
        values = {**x, **u, **p}
        car.set(**values)
        car.fmu.setupExperiment()
        car.fmu.enterInitializationMode()
        before = car.get(*unknowns)
        for name in known:
            car.set(**{name: values[name] * 1.1})
            changed = np.array(car.get(*unknowns)) != before
            for unknown, has_changed in zip(unknowns, changed, strict=True):
                if has_changed:
                    seen[unknown].add(name)
            car.set(**{name: values[name]})
        car.fmu.reset()
    for name, unknown in unknowns.items():
        assert {v.name for v in unknown.dependencies} - {"drive"} == seen[name]
    running = {unknown.variable.name: {v.name for v in unknown.dependencies} for unknown in car.description.derivatives}
    assert running == {name: names & {*STATES, *INPUTS} for name, names in seen.items()}


# ---- misuse: an error status and a message that names the cause, never a crash ----


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"m_c": -30.0}, "parameter m_c is -30 kg at time 0 s: must be at least 1e-06 kg"),
        ({"a": 0.0}, "parameter a is 0 m at time 0 s: must be at least"),
        ({"d_psi": -1.0}, "parameter d_psi is -1 N.m.s/rad at time 0 s: must be at least 0"),
        ({"solver_step": 0.0}, "parameter solver_step is 0 s at time 0 s: must be at least"),
        (
            {"drive": 7},
            "parameter drive is 7 at time 0 s: must be one of 1 (as_printed), 2 (front_wheel), 3 (rear_wheel)",
        ),
        ({"solver": 0}, "parameter solver is 0 at time 0 s: must be one of 1 (euler), 2 (runge_kutta_4)"),
    ],
)
def test_bounds_are_checked_at_the_end_of_initialization(new_car: Callable, values: dict, message: str) -> None:
    car = new_car("follower_1")
    with pytest.raises(FMICallException, match="fmi2ExitInitializationMode"):
        car.start(**values)
    assert len(car.messages) == 1
    assert car.messages[0].startswith("follower_1: fmi2ExitInitializationMode: ")
    assert message in car.messages[0]


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_inputs_must_be_finite(new_car: Callable, value: float) -> None:
    car = new_car("follower_1").start(tau_drive=8.0)
    car.step(0.0, 0.5)
    with pytest.raises(FMICallException, match="fmi2SetReal"):
        car.set(tau_drive=value)
    assert f"input tau_drive is set to {value:g} at time 0.5 s: must be a finite number" in car.messages[0]
    assert car.get("tau_drive") == [8.0]


def test_divergence_is_reported_with_variable_and_time(new_car: Callable) -> None:
    car = new_car("follower_1").start(tau_drive=8.0, gamma=0.1)
    car.step(0.0, 0.02)
    good = car.get(*STATES)
    car.set(tau_drive=1e308)
    with pytest.raises(FMICallException, match="fmi2DoStep"):
        car.step(0.02, 0.02)
    assert car.messages == ["follower_1: fmi2DoStep: state v becomes inf after time 0.02 s: the simulation diverges"]
    # It stands at the last good point, and its values can still be read.
    assert car.get(*STATES) == good
    assert car.fmu.getRealStatus(fmpy.fmi2.fmi2LastSuccessfulTime) == 0.02
    with pytest.raises(FMICallException):
        car.step(0.02, 0.02)
    assert "must not be called while the instance is stopped by a failed step" in car.messages[1]
    car.fmu.reset()
    car.start(tau_drive=1.0).step(0.0, 0.02)


@pytest.mark.parametrize(
    ("time", "step", "message"),
    [
        (0.03, 0.02, "wrong communication point: expected 0.02 s, received 0.03 s"),
        (math.nan, 0.02, "wrong communication point"),
        (0.02, 0.0, "communication step at time 0.02 s is 0 s: must be positive"),
        (0.02, -0.02, "must be positive"),
        (0.02, math.nan, "must be positive"),
        (0.02, 1.0, "goes beyond the stop time 1 s"),
    ],
)
def test_wrong_steps_are_refused(new_car: Callable, time: float, step: float, message: str) -> None:
    car = new_car().start(stop_time=1.0)
    car.step(0.0, 0.02)
    with pytest.raises(FMICallException, match="fmi2DoStep"):
        car.step(time, step)
    assert message in car.messages[0]


def test_values_that_cannot_be_set(new_car: Callable) -> None:
    car = new_car()
    with pytest.raises(FMICallException):
        car.set(**{"der(v)": 1.0})
    assert "derivative v is computed: it cannot be set" in car.messages[-1]
    car.start()
    for name in ("solver_step", "x", "drive"):
        with pytest.raises(FMICallException):
            car.set(**{name: 1})
        assert f"{name} is fixed" in car.messages[-1]


def test_unknown_value_references(new_car: Callable) -> None:
    car = new_car().start()
    n = len(car.variables) + 1  # the last one is the time, which FMI 2.0 need not list
    for call in (
        lambda: car.fmu.getReal([n]),
        lambda: car.fmu.getReal([2**32 - 1]),
        lambda: car.fmu.setReal([n], [0.0]),
        lambda: car.fmu.getInteger([0]),
        lambda: car.fmu.getInteger([n]),
        lambda: car.fmu.setInteger([n], [1]),
    ):
        with pytest.raises(FMICallException):
            call()
        assert "value reference" in car.messages[-1]
    for call in (
        lambda: car.fmu.getBoolean([0]),
        lambda: car.fmu.getString([0]),
        lambda: car.fmu.setString([0], ["x"]),
    ):
        with pytest.raises(FMICallException):
            call()
        assert "no variables of this type" in car.messages[-1]


def test_calls_in_wrong_order(new_car: Callable) -> None:
    car = new_car()
    for call in (lambda: car.step(0.0, 0.02), car.fmu.exitInitializationMode, car.fmu.terminate, lambda: car.get("x")):
        with pytest.raises(FMICallException):
            call()
        assert "must not be called while the instance is instantiated" in car.messages[-1]
    car.start()
    for call in (
        car.fmu.enterInitializationMode,
        car.fmu.exitInitializationMode,
        car.fmu.setupExperiment,
        car.fmu.cancelStep,
    ):
        with pytest.raises(FMICallException):
            call()
        assert "must not be called while the instance is running" in car.messages[-1]
    car.fmu.terminate()
    assert car.get("m_c") == [30.0]
    with pytest.raises(FMICallException):
        car.step(0.0, 0.02)
    assert "terminated" in car.messages[-1]


def test_random_calls_never_crash(new_car: Callable) -> None:
    """Thousands of calls in random order with random arguments: each is accepted or refused with an error status."""
    rng = np.random.default_rng(5)
    car = new_car()
    n = len(car.variables)
    numbers = [0.0, 0.02, -1.0, 1e300, math.nan, math.inf]

    def number() -> float:
        return numbers[rng.integers(len(numbers))]

    calls = [
        lambda: car.fmu.setReal([int(rng.integers(n + 3))], [number()]),
        lambda: car.fmu.getReal([int(rng.integers(n + 3))]),
        lambda: car.fmu.setInteger([int(rng.integers(n + 3))], [int(rng.integers(-2, 5))]),
        lambda: car.fmu.getInteger([int(rng.integers(n + 3))]),
        lambda: car.fmu.setupExperiment(startTime=number(), stopTime=number()),
        car.fmu.enterInitializationMode,
        car.fmu.exitInitializationMode,
        lambda: car.step(number(), number() % 1.0),
        car.fmu.terminate,
        car.fmu.reset,
        lambda: car.fmu.freeFMUstate(car.fmu.getFMUstate()),
        lambda: car.fmu.setRealInputDerivatives([12], [1], [0.0]),
        lambda: car.fmu.getDirectionalDerivative([6], [0], [1.0]),
    ]
    accepted = refused = 0
    statuses = set()
    for _ in range(5000):
        try:
            calls[rng.integers(len(calls))]()
            accepted += 1
        except FMICallException as error:
            statuses.add(error.status)
            refused += 1
    assert statuses == {fmpy.fmi2.fmi2Discard, fmpy.fmi2.fmi2Error}  # Discard: a parameter out of its bounds
    assert min(accepted, refused) > 500
    assert len(car.messages) == refused


def test_null_pointers(new_car: Callable) -> None:
    car = new_car().start()
    library, error = car.fmu.dll, fmpy.fmi2.fmi2Error
    component = ctypes.c_void_p(car.fmu.component)
    assert library.fmi2GetReal(component, None, ctypes.c_size_t(1), None) == error
    assert library.fmi2SetReal(component, None, ctypes.c_size_t(1), None) == error
    assert library.fmi2DoStep(None, ctypes.c_double(0), ctypes.c_double(1), 1) == error
    assert library.fmi2GetFMUstate(component, None) == error
    assert library.fmi2SetFMUstate(component, None) == error
    assert library.fmi2GetReal(component, None, ctypes.c_size_t(0), None) == fmpy.fmi2.fmi2OK
    library.fmi2FreeInstance(None)


def test_wrong_guid_is_refused(unzipped: Path, new_car: Callable) -> None:
    with pytest.raises(Exception, match="instantiate"):
        new_car(guid="{wrong}")
