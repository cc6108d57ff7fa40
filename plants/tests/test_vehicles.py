"""Tests for all vehicles: equations, references, FMU, NumPy and SciPy agree; effects are off until asked for."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import fmpy
import fmpy.validation
import numpy as np
import pytest
import sympy
from scipy.integrate import solve_ivp

import plants
from plants import numeric
from plants.car_like import model as car
from plants.car_like.reference import REFERENCE as CAR_REFERENCE
from plants.differential_drive import model as differential
from plants.differential_drive.reference import REFERENCE as DIFFERENTIAL_REFERENCE
from plants.effects import Effect, friction
from plants.nonholonomic import NonholonomicSystem
from plants.ode import OdeModel
from plants.tractor_trailer import model as tractor
from plants.tractor_trailer.reference import REFERENCE as TRACTOR_REFERENCE
from plants.trigonometry import shorten


def effects_of(vehicle: ModuleType) -> tuple[Effect, ...]:
    return (*vehicle.FRICTION, *([vehicle.STOP] if hasattr(vehicle, "STOP") else []))


VEHICLES = {"car_like": car, "tractor_trailer": tractor, "differential_drive": differential}
REFERENCES = {
    "car_like": CAR_REFERENCE,
    "tractor_trailer": TRACTOR_REFERENCE,
    "differential_drive": DIFFERENTIAL_REFERENCE,
}
LARGEST = {"car_like": "gamma_max", "tractor_trailer": "hitch_max"}
"""Vehicles with an angle that a stop can hold, and the parameter that says where."""
EFFECTS = {
    name: [parameter.name for effect in effects_of(vehicle) for parameter in effect.parameters]
    for name, vehicle in VEHICLES.items()
}
NUMPY = {name: numeric.compile(vehicle.model()) for name, vehicle in VEHICLES.items()}
STRONG = {"F_c_v": 8.0, "F_v_v": 3.0, "v_s": 0.05, "F_c_omega": 4.0, "F_v_omega": 2.0, "omega_s": 0.1}
STIFF = {"k_stop": 2e3}


def angle_of(vehicle: ModuleType, x: np.ndarray) -> Any:
    """The steering or hitch angle."""
    return x[..., 3] - x[..., 2] if vehicle is tractor else x[..., 3]


def is_zero(system: NonholonomicSystem, matrix: sympy.Matrix) -> bool:
    """Whether a matrix in the coordinates or in the relative angles vanishes identically."""
    for angle in system.angles:
        (last,) = sympy.solve(angle.expression - angle.symbol, system.eta[-1])
        matrix = matrix.subs(system.eta[-1], last)
    return all(shorten(entry) == 0 for entry in matrix)


def draw(rng: np.random.Generator, model: OdeModel, effects: bool) -> tuple[np.ndarray, np.ndarray, dict[str, float]]:
    """Random states, inputs and parameters; friction and stop are drawn too, or left off."""
    pose = {3: [50, 50, 10], 4: [50, 50, 10, 1.4]}[len(model.states) - 2]
    largest = np.array([*pose, 3, 3])
    x = rng.uniform(-largest, largest)
    if model.name == "tractor_trailer":
        x[3] += x[2]
    u = rng.uniform(-200, 200, len(model.inputs))
    p = {}
    for parameter in model.reals:
        if parameter.name not in EFFECTS[model.name]:
            p[parameter.name] = parameter.start * rng.uniform(0.5, 2.0)
        elif effects:
            p[parameter.name] = rng.uniform(0.1, 1.0) * (1e3 if parameter.name == "k_stop" else 1.0)
    p |= {e.name: int(rng.integers(len(e.items))) + 1 for e in model.enumerations}
    return x, u, p


class Plant:
    """One instance of an FMU, by names."""

    def __init__(self, path: Path, folder: Path) -> None:
        fmpy.extract(path, folder)
        self.description = fmpy.read_model_description(folder)
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.fmu = fmpy.instantiate_fmu(folder, self.description, "CoSimulation")

    def start(self, **values: float) -> None:
        for name, value in values.items():
            write = self.fmu.setInteger if isinstance(value, int) else self.fmu.setReal
            write([self.references[name]], [value])
        self.fmu.setupExperiment()
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def get(self, *names: str) -> list[float]:
        values: list[float] = self.fmu.getReal([self.references[name] for name in names])
        return values


@pytest.fixture(scope="module", params=list(VEHICLES))
def plant(
    request: pytest.FixtureRequest, own_caches: None, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Plant]:
    plant = Plant(plants.build(request.param), tmp_path_factory.mktemp(request.param))
    yield plant
    plant.fmu.freeInstance()


def test_fmu_is_valid(plant: Plant) -> None:
    assert fmpy.validation.validate_fmu(str(plants.build(plant.description.modelName))) == []


@pytest.mark.parametrize("effects", [False, True])
@pytest.mark.parametrize(("solver", "method"), [(1, "euler"), (2, "rk4")])
def test_fmu_steps_like_numpy(plant: Plant, solver: int, method: str, effects: bool) -> None:
    """Derivatives, outputs and one step, to 1e-12 at random states, inputs and parameters."""
    functions = NUMPY[plant.description.modelName]
    model, rng = functions.model, np.random.default_rng([solver, effects])
    states, inputs = [s.name for s in model.states], [i.name for i in model.inputs]
    computed = [o.name for o in model.outputs]
    for _ in range(100):
        x, u, values = draw(rng, model, effects)
        h, p = rng.uniform(1e-3, 0.02), functions.parameters(**values)
        plant.fmu.reset()
        plant.start(
            **dict(zip(states, map(float, x), strict=True)),
            **dict(zip(inputs, map(float, u), strict=True)),
            **values,
            solver=solver,
            solver_step=h,
        )
        assert_close(plant.get(*(f"der({name})" for name in states)), functions.rhs(0.0, x, u, p))
        assert_close(plant.get(*computed), functions.outputs(0.0, x, u, p))
        plant.fmu.doStep(0.0, h)
        assert_close(plant.get(*states), getattr(functions, method)(0.0, x, u, p, h))


def assert_close(actual: Any, expected: np.ndarray) -> None:
    assert np.all(np.abs(actual - expected) <= 1e-12 * np.maximum(1.0, np.abs(expected)))


def test_directional_derivatives_equal_the_jacobians_of_numpy(plant: Plant) -> None:
    """Derivatives in C against NumPy, with friction and stop at work."""
    functions, rng = NUMPY[plant.description.modelName], np.random.default_rng(6)
    model = functions.model
    states, inputs = [s.name for s in model.states], [i.name for i in model.inputs]
    unknowns = [plant.references[n] for n in (*(f"der({name})" for name in states), *(o.name for o in model.outputs))]
    for _ in range(50):
        x, u, values = draw(rng, model, effects=True)
        plant.fmu.reset()
        named = dict(zip([*states, *inputs], map(float, [*x, *u]), strict=True))
        plant.start(**named, **values)
        A, B, C, D = functions.jacobians(0.0, x, u, functions.parameters(**values))
        jacobian = np.block([[A, B], [C, D]])
        for column, known in enumerate((*states, *inputs)):
            derivative = plant.fmu.getDirectionalDerivative(unknowns, [plant.references[known]], [1.0])
            assert_close(derivative, jacobian[:, column])


def test_fmu_gives_the_reference_result(plant: Plant) -> None:
    reference = REFERENCES[plant.description.modelName]
    plant.fmu.reset()
    plant.start(**dict(zip(reference.states, reference.start, strict=True)), solver=2, solver_step=0.001)
    inputs = 1 + len(reference.states)
    for row in reference.read():
        np.testing.assert_allclose(plant.get(*reference.states), row[1:inputs], rtol=0, atol=1e-9)
        plant.fmu.setReal([plant.references[name] for name in reference.inputs], list(row[inputs:]))
        plant.fmu.doStep(row[0], reference.step)


@pytest.mark.parametrize("name", VEHICLES)
def test_reference_file_is_what_its_script_makes(name: str) -> None:
    reference, model = REFERENCES[name], NUMPY[name].model
    assert reference.states == tuple(state.name for state in model.states)
    assert reference.inputs == tuple(variable.name for variable in model.inputs)
    np.testing.assert_allclose(reference.read(), reference.simulate(), rtol=1e-10, atol=1e-10)


# ---- equations ----


@pytest.mark.parametrize("vehicle", VEHICLES.values(), ids=VEHICLES)
def test_motion_basis_keeps_the_constraints(vehicle: ModuleType) -> None:
    assert is_zero(vehicle.SYSTEM, vehicle.A * vehicle.S)
    assert vehicle.A.rank() == len(vehicle.COORDINATES) - len(vehicle.VELOCITIES)


@pytest.mark.parametrize("vehicle", VEHICLES.values(), ids=VEHICLES)
def test_energy_balance(vehicle: ModuleType) -> None:
    """d/dt(v' M2 v / 2) = v' (B2 tau - D2 v - S' tau_d): M2_dot/2 - C2 does no work for any v."""
    system = vehicle.SYSTEM
    M2 = system.M2.subs({angle.symbol: angle.expression for angle in system.angles})
    M2_dot = sum((M2.diff(q) * rate for q, rate in zip(system.eta, system.eta_dot, strict=True)), 0 * M2)
    work = M2_dot / 2 - system.C2
    assert M2.is_symmetric()
    assert is_zero(system, system.v.T * work * system.v)
    if vehicle is differential:  # there C2 is skew: the others' is not the one that is
        assert is_zero(system, work + work.T)


@pytest.mark.parametrize("vehicle", VEHICLES.values(), ids=VEHICLES)
def test_damping_and_disturbance_take_energy(vehicle: ModuleType) -> None:
    system = vehicle.SYSTEM
    damped = sum(entry * rate**2 for entry, rate in zip(vehicle.D1.diagonal(), system.eta_dot, strict=True))
    assert is_zero(system, system.v.T * system.D2 * system.v - sympy.Matrix([damped]))
    disturbances = sympy.Matrix([disturbance.symbol for disturbance in system.disturbances])
    assert is_zero(system, system.v.T * system.tau_d2 - system.eta_dot.T * disturbances)


# ---- steps ----


@pytest.mark.parametrize(("method", "order", "steps"), [("euler", 1, (200, 400, 800)), ("rk4", 4, (40, 80, 160))])
@pytest.mark.parametrize("name", VEHICLES)
def test_numpy_converges_to_scipy(name: str, method: str, order: int, steps: tuple[int, ...]) -> None:
    functions, reference = NUMPY[name], REFERENCES[name]
    u, p, horizon = reference.drive(0.7), functions.parameters(), 1.0
    start = np.array(reference.start)
    exact = solve_ivp(
        lambda t, x: functions.rhs(t, x, u, p), (0.0, horizon), start, method="DOP853", rtol=1e-13, atol=1e-13
    ).y[:, -1]
    errors = []
    for n in steps:
        x = start
        for k in range(n):
            x = getattr(functions, method)(k * horizon / n, x, u, p, horizon / n)
        errors.append(np.linalg.norm(x - exact))
    np.testing.assert_allclose(-np.diff(np.log2(errors)), order, atol=0.15)


@pytest.mark.parametrize("name", LARGEST)
def test_angle_is_limited_to_90_degrees(name: str) -> None:
    (limit,) = NUMPY[name].model.limits
    assert (limit.min, limit.max, limit.unit) == (-np.pi / 2, np.pi / 2, "rad")
    states = [state.symbol for state in NUMPY[name].model.states]
    x = np.arange(1.0, 7.0)
    assert sympy.lambdify(states, limit.expression)(*x) == angle_of(VEHICLES[name], x)


# ---- friction and stops ----


@pytest.mark.parametrize("name", VEHICLES)
def test_effects_that_are_off_change_no_bit(name: str) -> None:
    """Against the same vehicle without them, beyond the angle of the stop too: the very same floating-point numbers."""
    functions = NUMPY[name]
    plain = numeric.compile(replace(VEHICLES[name].SYSTEM, F2=None).ode())
    assert not set(EFFECTS[name]) & {parameter.name for parameter in plain.model.parameters}
    rng = np.random.default_rng(3)
    for _ in range(500):
        x, u, p = draw(rng, functions.model, effects=False)
        x[3] *= rng.choice([0.0, 0.3, 1.0, 1.1])
        x[-2:] *= rng.choice([0.0, -0.0, 1.0], 2)
        u *= rng.choice([0.0, -0.0, 1.0], len(u))
        with_off = functions.rhs(0.0, x, u, functions.parameters(**p))
        assert with_off.tobytes() == plain.rhs(0.0, x, u, plain.parameters(**p)).tobytes()


@pytest.mark.parametrize("vehicle", VEHICLES.values(), ids=VEHICLES)
def test_fmu_with_effects_off_changes_no_bit(vehicle: ModuleType, tmp_path: Path) -> None:
    """The compiled code too: a run that steers past the angle of the stop."""
    results = []
    for name, system in (("with_off", vehicle.SYSTEM), ("without", replace(vehicle.SYSTEM, F2=None))):
        path = plants.build(replace(system, name=name).ode(), out=tmp_path)
        start = {
            "v": 0.5,
            "omega": 2.0,
            system.coordinates[-1].name: 0.9,
            system.inputs[0].name: 2.0,
            system.inputs[1].name: -1.0,
            "tau_d_y": 3.0,
        }
        damping = {p.name: 1.0 for p in system.parameters if p.name.startswith("d_")}
        output = [state.name for state in system.ode().states]
        run = fmpy.simulate_fmu(
            str(path), stop_time=2.0, output_interval=0.02, start_values=start | damping, output=output
        )
        results.append(run.tobytes())
        if system.name in LARGEST:
            angles = angle_of(vehicle, np.array([run[name] for name in output]).T)
            assert np.abs(angles).max() > np.radians(60)
    assert results[0] == results[1]


@pytest.mark.parametrize("name", VEHICLES)
def test_friction_is_what_the_readme_says(name: str) -> None:
    functions, rng = NUMPY[name], np.random.default_rng(4)
    M2 = sympy.lambdify([s.symbol for s in functions.model.states], numbers(name, VEHICLES[name].SYSTEM.M2))
    off, on = functions.parameters(), functions.parameters(**STRONG)
    for _ in range(50):
        x, u, _ = draw(rng, functions.model, effects=False)
        resistance = -M2(*x) @ (functions.rhs(0.0, x, u, on) - functions.rhs(0.0, x, u, off))[-2:]
        v, omega = x[-2:]
        expected = [8 * np.tanh(v / 0.05) + 3 * v, 4 * np.tanh(omega / 0.1) + 2 * omega]
        np.testing.assert_allclose(resistance, expected, rtol=1e-9, atol=1e-9)


def numbers(name: str, matrix: sympy.Matrix) -> sympy.Matrix:
    """A reduced matrix with the default parameters, in the states."""
    system = VEHICLES[name].SYSTEM
    for term in reversed((*system.angles, *system.terms)):
        matrix = matrix.subs(term.symbol, term.expression)
    return matrix.subs({p.symbol: p.start for p in system.parameters if hasattr(p, "start")})


@pytest.mark.parametrize("name", LARGEST)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_stop_holds_the_angle(name: str, side: float) -> None:
    """Pushed against the stop at speed, the angle comes to rest just beyond it, on either side."""
    functions, stiffness, limit = NUMPY[name], 5e3, 0.8
    p = functions.parameters(**{"k_stop": stiffness, LARGEST[name]: limit})
    push = 60.0
    u = functions.inputs(**({"tau_steer": side * push} if name == "car_like" else {"tau_d_theta_0": -side * push}))
    x = np.zeros(6)
    largest = 0.0
    for k in range(5000):
        x = functions.rk4(k * 1e-3, x, u, p, 1e-3)
        largest = max(largest, abs(angle_of(VEHICLES[name], x)))
    # What the spring does not balance, the damping of the motion does.
    assert limit < side * angle_of(VEHICLES[name], x) < limit + 1.01 * push / stiffness
    assert largest < limit + 5 * push / stiffness


@pytest.mark.parametrize("name", VEHICLES)
def test_effects_take_energy(name: str) -> None:
    """The power of friction is never positive, nor the power of the stop without the work stored in its spring."""
    functions, rng = NUMPY[name], np.random.default_rng(5)
    states = [s.symbol for s in functions.model.states]
    M2 = sympy.lambdify(states, numbers(name, VEHICLES[name].SYSTEM.M2))
    stop = STIFF | {LARGEST[name]: 0.5} if name in LARGEST else {}
    off, on = functions.parameters(), functions.parameters(**STRONG, **stop)
    pushed = 0
    for _ in range(300):
        x, u, _ = draw(rng, functions.model, effects=False)
        force = M2(*x) @ (functions.rhs(0.0, x, u, on) - functions.rhs(0.0, x, u, off))[-2:]
        stored = 0.0
        if stop:
            angle, rate = (angle_of(VEHICLES[name], q) for q in (x, functions.rhs(0.0, x, u, on)))
            beyond = np.sign(angle) * max(abs(angle) - 0.5, 0.0)
            stored = STIFF["k_stop"] * beyond * rate
            pushed += beyond != 0
        assert force @ x[-2:] + stored <= 1e-6
    assert pushed > 100 or not stop


def test_friction_needs_a_velocity() -> None:
    with pytest.raises(plants.ModelError, match="friction on 'v': its unit is 'km/h', it must be one of m/s, rad/s"):
        friction(replace(car.VELOCITIES[0], unit="km/h"))
