"""Trajectories: versions and interfaces agree, solvers keep their promises."""

import math
import zipfile
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import fmpy
import fmpy.validation
import numpy as np
import pytest
import sympy
from scipy.integrate import solve_ivp

import plants
from plants import numeric
from plants.ode import OdeModel, State

from . import driver
from .driver import Instance, Library, Refused
from .fmus import MODELS, VERSIONS, Fmu

EULER, RUNGE_KUTTA_4, DORMAND_PRINCE_45 = 1, 2, 3


@pytest.mark.parametrize("name", plants.models())
def test_versions_and_interfaces_agree(fmus: Callable, name: str) -> None:
    """FMPy's own master and Euler solver: four trajectories are one."""
    model = MODELS[name]
    first, second = (v.name for v in model.inputs[:2])
    results = [
        fmpy.simulate_fmu(
            str(fmus(name, fmi).folder),
            fmi_type=interface,
            solver="Euler",
            step_size=0.02,
            output_interval=0.02,
            stop_time=2.0,
            start_values={first: 8.0, second: 1.0},
            output=[s.name for s in model.states],
        )
        for fmi in VERSIONS
        for interface in ("CoSimulation", "ModelExchange")
    ]
    assert np.abs(results[0]["x"][-1]) > 0.1
    for result in results[1:]:
        for column in result.dtype.names:
            np.testing.assert_allclose(result[column], results[0][column], rtol=0, atol=1e-12)


def test_every_function_is_what_numpy_computes(fmus: Callable, fmi: str) -> None:
    fmu, model = fmus("many_functions", fmi), MODELS["many_functions"]
    functions, rng = numeric.compile(model), np.random.default_rng(8)
    instance = Instance(fmu.library, "model_exchange")
    for law in (1, 2, 3):
        instance.set_enumeration(fmu["law"], law)
        instance.start(0.7)
        instance.enter_continuous_time()
        for _ in range(50):
            t, x, u = rng.uniform(-2, 2), rng.uniform(-1.5, 1.5, 2), rng.uniform(0.1, 2, 2)
            instance.place(t, x)
            instance.set({fmu["u"]: u[0], fmu["w"]: u[1]})
            expected = functions.rhs(t, x, u, functions.parameters(law=law))
            np.testing.assert_allclose(instance.derivatives(2), expected, rtol=1e-12, atol=1e-12)
            expected = functions.outputs(t, x, u, functions.parameters(law=law))
            np.testing.assert_allclose(instance.get(fmu["energy"]), expected, rtol=1e-12, atol=1e-12)
        instance.reset()
    instance.free()


def two_seconds() -> tuple[list[str], np.ndarray, np.ndarray]:
    """The car's states by name, at a start, and 2 s later under 40 N.m and 12 N.m, by SciPy at tight tolerance."""
    functions, names = numeric.compile(MODELS["car_like"]), [s.name for s in MODELS["car_like"].states]
    x, u = np.array([0, 0, 0.3, 0.2, 1.0, 0.4]), functions.inputs(tau_drive=40.0, tau_steer=12.0)
    p = functions.parameters()
    run = solve_ivp(lambda t, x: functions.rhs(t, x, u, p), (0, 2), x, method="DOP853", rtol=1e-13, atol=1e-13)
    return names, x, run.y[:, -1]


def test_dormand_prince_meets_its_tolerance(new: Callable, car: Fmu) -> None:
    """Against SciPy at tight tolerance: the error follows the tolerance, down to rounding."""
    names, x, exact = two_seconds()
    errors = []
    for tolerance in (1e-3, 1e-5, 1e-7, 1e-9, 1e-11):
        instance = new()
        instance.set({car[name]: value for name, value in zip(names, x, strict=True)})
        instance.set(
            {car["tau_drive"]: 40.0, car["tau_steer"]: 12.0, car["solver_step"]: 2.0, car["tolerance"]: tolerance}
        )
        instance.set_enumeration(car["solver"], DORMAND_PRINCE_45)
        instance.start().step(0.0, 2.0)
        errors.append(np.max(np.abs(instance.get(*(car[name] for name in names)) - exact)))
        assert errors[-1] < 100 * tolerance
    assert all(later < earlier / 10 for earlier, later in pairwise(errors))


def test_dormand_prince_has_order_5(new: Callable, car: Fmu) -> None:
    """With a tolerance that never rejects, solver_step is the step: the error falls with its fifth power."""
    names, x, exact = two_seconds()
    errors = []
    for n in (32, 64, 128):
        instance = new()
        instance.set({car[name]: value for name, value in zip(names, x, strict=True)})
        instance.set(
            {car["tau_drive"]: 40.0, car["tau_steer"]: 12.0, car["solver_step"]: 2.0 / n, car["tolerance"]: 0.1}
        )
        instance.set_enumeration(car["solver"], DORMAND_PRINCE_45)
        instance.start().step(0.0, 2.0)
        errors.append(np.linalg.norm(instance.get(*(car[name] for name in names)) - exact))
    np.testing.assert_allclose(-np.diff(np.log2(errors)), 5, atol=0.25)


def test_step_size_underflow_is_an_error(tmp_path: Path) -> None:
    """der(x) = x^2 blows up at 1/x(0) = 1 s: no step gets past it, and the message names the time."""
    x = sympy.Symbol("x")
    path = plants.build(OdeModel("blow_up", "", (State(x, "1", "x", start=1.0),), (x**2,)), out=tmp_path)
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    description = fmpy.read_model_description(path)
    (binary,) = (tmp_path / "binaries").glob("*/*")
    references = {v.name: v.valueReference for v in description.modelVariables}
    references.setdefault("time", len(references))
    fmu = Instance(Library(str(binary), "2.0", description.guid, references["time"]), "co_simulation")
    fmu.set({references["solver_step"]: 1.0})
    fmu.set_enumeration(references["solver"], DORMAND_PRINCE_45)
    with pytest.raises(Refused, match=r"the step size underflows after time (1|0\.9999)"):
        fmu.start().step(0.0, 2.0)
    assert fmu.get(references["time"])[0] == pytest.approx(1.0, abs=1e-3)
    fmu.free()


def test_ramping_inputs(fmus: Callable) -> None:
    """FMI 2.0: with input derivatives, the inputs ramp inside a step; the result is that of the continuous ramp."""
    fmu = fmus("car_like", "2.0")
    functions = numeric.compile(MODELS["car_like"])
    instance = Instance(fmu.library, "co_simulation")
    instance.set({fmu["solver_step"]: 0.005, fmu["tau_drive"]: 3.0})
    instance.set_enumeration(fmu["solver"], RUNGE_KUTTA_4)
    instance.start()
    reference, order = (driver.ctypes.c_uint * 1)(fmu["tau_drive"]), (driver.ctypes.c_int * 1)(1)
    slope = (driver.ctypes.c_double * 1)(50.0)
    instance.call("SetRealInputDerivatives", reference, driver.ctypes.c_size_t(1), order, slope)
    instance.step(0.0, 0.5)

    def rhs(t: float, x: np.ndarray) -> np.ndarray:
        return functions.rhs(t, x, functions.inputs(tau_drive=3.0 + 50.0 * min(t, 0.5)), functions.parameters())

    def exact(t: float) -> np.ndarray:
        return solve_ivp(rhs, (0, t), functions.start(), rtol=1e-12, atol=1e-12, max_step=0.5).y[:, -1]

    np.testing.assert_allclose(instance.get(*range(6)), exact(0.5), atol=1e-9)
    # The ramp ends with the step, where it arrived.
    assert instance.get(fmu["tau_drive"]) == [28.0]
    instance.step(0.5, 0.5)
    np.testing.assert_allclose(instance.get(*range(6)), exact(1.0), atol=1e-8)
    for bad_reference, bad_order, bad_slope in (
        (fmu["x"], 1, 1.0),
        (fmu["tau_drive"], 2, 1.0),
        (fmu["tau_drive"], 1, math.nan),
    ):
        reference[0], order[0], slope[0] = bad_reference, bad_order, bad_slope
        with pytest.raises(Refused):
            instance.call("SetRealInputDerivatives", reference, driver.ctypes.c_size_t(1), order, slope)
    instance.free()
