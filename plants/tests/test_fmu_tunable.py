"""Parameters that can change during a simulation, and parameters that cannot."""

import zipfile
from collections.abc import Callable
from pathlib import Path

import fmpy
import fmpy.validation
import numpy as np
import pytest
import sympy
from lxml import etree

import plants
from plants import numeric
from plants.ode import OdeModel, Output, Parameter, State

from . import driver
from .driver import Instance, Refused
from .fmus import MODELS, VERSIONS, Fmu

EULER, RUNGE_KUTTA_4 = 1, 2
MASSES = {"car_like": "m_c", "tractor_trailer": "m_1", "differential_drive": "m_c"}
STEP, STEPS = 0.02, 25
DRIVE = (8.0, 1.0)


def drive(instance: Instance, n_states: int, steps: range) -> list[list[float]]:
    """Take these communication steps; return the states after each."""
    rows = []
    for k in steps:
        instance.step(k * STEP, STEP)
        rows.append(instance.get(*range(n_states)))
    return rows


def numpy_run(name: str, method: str, factor: float) -> np.ndarray:
    """The states after each of 2 STEPS steps; in the middle, a mass grows by a factor."""
    model, functions = MODELS[name], numeric.compile(MODELS[name])
    u = functions.inputs(**dict(zip((v.name for v in model.inputs), DRIVE, strict=False)))
    (mass,) = (p.start for p in model.reals if p.name == MASSES[name])
    x, rows = functions.start(), []
    for k in range(2 * STEPS):
        p = functions.parameters(**{MASSES[name]: mass if k < STEPS else factor * mass})
        x = getattr(functions, method)(k * STEP, x, u, p, STEP)
        rows.append(x)
    return np.array(rows)


@pytest.mark.parametrize("name", plants.models())
@pytest.mark.parametrize(("solver", "method"), [(EULER, "euler"), (RUNGE_KUTTA_4, "rk4")])
def test_a_mass_that_changes_midway(fmus: Callable, fmi: str, name: str, solver: int, method: str) -> None:
    """The run is NumPy's; after the change it is, bit for bit, a new run from there with the new mass."""
    fmu, n = fmus(name, fmi), len(MODELS[name].states)
    mass, states = fmu[MASSES[name]], range(n)
    derivatives = range(n, 2 * n)

    def made() -> Instance:
        instance = Instance(fmu.library, "co_simulation")
        instance.set({fmu[v.name]: value for v, value in zip(MODELS[name].inputs, DRIVE, strict=False)})
        instance.set_enumeration(fmu["solver"], solver)
        return instance

    one, new_run = made().start(), made()
    rows = drive(one, n, range(STEPS))
    kilograms, slopes = one.get(mass)[0], one.get(*derivatives)
    one.set({mass: 1.5 * kilograms})
    assert one.get(mass) == [1.5 * kilograms]
    assert one.get(*states) == rows[-1], "the states keep their values"
    assert one.get(*derivatives) != slopes, "their derivatives follow at once"

    new_run.set(dict(zip(states, rows[-1], strict=True)) | {mass: 1.5 * kilograms})
    new_run.start(STEPS * STEP)
    assert one.get(*derivatives) == new_run.get(*derivatives)
    rest = range(STEPS, 2 * STEPS)
    rows += drive(one, n, rest)
    assert rows[STEPS:] == drive(new_run, n, rest)
    expected = numpy_run(name, method, 1.5)
    np.testing.assert_allclose(rows, expected, rtol=1e-12, atol=1e-12)
    assert np.abs(expected[-1] - numpy_run(name, method, 1.0)[-1]).max() > 1e-2

    one.reset()
    one.initialize()
    assert one.get(mass) == [kilograms]
    one.free()
    new_run.free()


@pytest.mark.parametrize("interface", ["CoSimulation", "ModelExchange"])
def test_fmpy_changes_a_parameter(fmus: Callable, fmi: str, interface: str) -> None:
    """An importer that knows the standard, given the mass as a signal: all four kinds of FMU follow NumPy."""
    instant = STEPS * STEP
    signals = np.array(
        [(0.0, *DRIVE, 30.0), (instant, *DRIVE, 30.0), (instant, *DRIVE, 45.0)],
        dtype=[(column, float) for column in ("time", "tau_drive", "tau_steer", "m_c")],
    )
    result = fmpy.simulate_fmu(
        str(fmus("car_like", fmi).folder),
        fmi_type=interface,
        solver="Euler",
        step_size=STEP,
        output_interval=STEP,
        stop_time=2 * instant,
        input=signals,
        start_values={f"tau_d_{c}": 0.0 for c in ("x", "y", "psi", "gamma")},
        output=[s.name for s in MODELS["car_like"].states],
    )
    # Model Exchange records an event twice: before and after.
    _, rows = np.unique(np.round(result["time"] / STEP), return_index=True)
    found = np.array(result.tolist())[rows, 1:]
    assert len(found) == 2 * STEPS + 1
    np.testing.assert_allclose(found[1:], numpy_run("car_like", "euler", 1.5), rtol=1e-12, atol=1e-12)


def test_model_exchange_changes_parameters_in_event_mode_only(new: Callable, car: Fmu) -> None:
    instance = new("model_exchange").start()
    instance.set({car["tau_drive"]: 8.0, car["m_c"]: 20.0})
    instance.enter_continuous_time()
    at_20_kg = instance.derivatives(6)
    instance.place(0.3, [0.0] * 6)
    with pytest.raises(Refused, match=r"m_c is set at time 0\.3 s in continuous-time mode: it can") as refusal:
        instance.set({car["m_c"]: 50.0})
    assert refusal.value.status == driver.ERROR
    assert (instance.get(car["m_c"]), instance.derivatives(6)) == ([20.0], at_20_kg)
    instance.set({car["tau_drive"]: 16.0})  # inputs may change
    instance.call("EnterEventMode")
    instance.set({car["m_c"]: 50.0})
    instance.enter_continuous_time()

    fresh = new("model_exchange")
    fresh.set({car["tau_drive"]: 16.0, car["m_c"]: 50.0})
    fresh.start(0.3).enter_continuous_time()
    assert instance.derivatives(6) == fresh.derivatives(6) != at_20_kg


@pytest.mark.parametrize("interface", driver.INTERFACES)
def test_a_saved_state_has_its_parameters(new: Callable, car: Fmu, interface: str) -> None:
    """Restored, or as bytes in another instance, a parameter has the value that it had when the state was saved."""

    def derivatives(instance: Instance) -> list[float]:
        return instance.get(*range(6, 12))

    one, other = new(interface), new(interface)
    one.set({car["gamma"]: 0.2, car["v"]: 1.0})
    one.start()
    one.set({car["m_c"]: 20.0, car["d_psi"]: 3.0})
    state, before = one.save(), derivatives(one)
    one.set({car["m_c"]: 50.0, car["d_psi"]: 0.0})
    changed = one.save()
    after = derivatives(one)
    assert before != after
    one.restore(state)
    assert (one.get(car["m_c"], car["d_psi"]), derivatives(one)) == ([20.0, 3.0], before)
    one.restore(changed)
    assert (one.get(car["m_c"], car["d_psi"]), derivatives(one)) == ([50.0, 0.0], after)
    for saved, values in ((state, [20.0, 3.0]), (changed, [50.0, 0.0])):
        again = other.deserialize(one.serialize(saved))
        other.restore(again)
        assert other.get(car["m_c"], car["d_psi"]) == values
        other.forget(again)
        one.forget(saved)
    # The instance that has just been restored can be changed as any other.
    other.set({car["m_c"]: 60.0})
    assert other.get(car["m_c"]) == [60.0]


@pytest.mark.parametrize("interface", driver.INTERFACES)
def test_what_is_fixed_stays_fixed(new: Callable, car: Fmu, interface: str) -> None:
    instance = new(interface).start()
    for name in ("solver_step", "tolerance", "x"):
        value = instance.get(car[name])
        with pytest.raises(Refused, match=rf"{name} is fixed: set at time 0 s, it can be set before") as refusal:
            instance.set({car[name]: 0.01})
        assert refusal.value.status == driver.ERROR
        assert instance.get(car[name]) == value
    for name in ("drive", "solver", "at_singularity"):
        with pytest.raises(Refused, match=rf"{name} is fixed: set at time 0 s, it can be set before") as refusal:
            instance.set_enumeration(car[name], 2)
        assert refusal.value.status == driver.ERROR


def test_a_value_out_of_bounds_is_refused_with_all_that_came_with_it(new: Callable, car: Fmu) -> None:
    """At once, and the simulation can go on: with the status Discard, as FMI 2.0 has it in section 2.2.3."""
    instance = new().start()
    instance.step(0.0, STEP)
    for name, value, message, status in (
        ("m_c", -45.0, r"parameter m_c is -45 kg at time 0\.02 s: must be at least 1e-06 kg", driver.DISCARD),
        ("gamma_max", 2.0, r"parameter gamma_max is 2 rad at time 0\.02 s: must be at most 1\.57", driver.DISCARD),
        ("m_c", np.nan, r"parameter m_c is set to nan at time 0\.02 s: must be a finite number", driver.ERROR),
        ("solver_step", 0.01, "solver_step is fixed", driver.ERROR),
    ):
        with pytest.raises(Refused, match=message) as refusal:
            instance.set({car["tau_drive"]: 5.0, car["I_c"]: 7.0, car[name]: value})
        assert refusal.value.status == status
        assert instance.get(*(car[n] for n in ("tau_drive", "I_c", "m_c"))) == [0.0, 5.0, 30.0]
    instance.step(STEP, STEP)
    instance.call("Terminate")
    with pytest.raises(Refused, match="must not be called while the instance is terminated"):
        instance.set({car["m_c"]: 45.0})


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_model_says_which_of_its_parameters_are_tunable(fmi: str, tmp_path: Path) -> None:
    """In the description, in the dependencies, on the page, and in the values that the FMU accepts."""
    x, rate, gain, base = sympy.symbols("x rate gain base")
    model = OdeModel(
        name="decay",
        description="Decay",
        states=(State(x, "1", "x", start=2.0),),
        derivatives=(-rate * x,),
        parameters=(
            Parameter(rate, "1/s", "Rate", start=1.0, min=0.0),
            Parameter(gain, "1", "Gain", start=3.0, tunable=False),
            Parameter(base, "1", "Base", start=0.0),
        ),
        outputs=(Output(sympy.Symbol("y"), gain * x + base**2, "1", "Output"),),
    )
    path = plants.build(model, fmi=fmi, out=tmp_path)
    assert fmpy.validation.validate_fmu(str(path)) == []
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    page = " ".join(etree.HTML((tmp_path / "documentation" / "index.html").read_text()).itertext())
    assert "Tunable, that is free to change between two steps of a simulation: rate , base ." in " ".join(page.split())

    description = fmpy.read_model_description(tmp_path)
    variables = {v.name: v for v in description.modelVariables}
    variability = {name: v.variability for name, v in variables.items() if v.causality == "parameter"}
    fixed = dict.fromkeys(("gain", "solver_step", "tolerance", "solver"), "fixed")
    assert variability == {"rate": "tunable", "base": "tunable"} | fixed
    unknowns = {u.variable.name: u for u in (*description.outputs, *description.derivatives)}
    kinds = {
        name: {v.name: kind for v, kind in zip(unknown.dependencies, unknown.dependenciesKind, strict=True)}
        for name, unknown in unknowns.items()
    }
    assert kinds["der(x)"].pop("x") == "tunable"
    assert kinds["y"].pop("x") == "fixed"
    # Parameters are knowns of a running simulation in FMI 3.0 (section 2.4.8), and none in FMI 2.0 (section 2.2.8).
    dependent = {"rate": "dependent"}, {"gain": "dependent", "base": "dependent"}
    assert (kinds["der(x)"], kinds["y"]) == (dependent if fmi == "3.0" else ({}, {}))

    (binary,) = (tmp_path / "binaries").glob("*/*")
    references = {name: v.valueReference for name, v in variables.items()}
    token = description.guid if fmi == "2.0" else description.instantiationToken
    library = driver.Library(str(binary), fmi, token, references.get("time", len(references)))
    instance = Instance(library, "co_simulation").start()
    assert instance.get(references["y"]) == [6.0]
    instance.set({references["base"]: 2.0, references["rate"]: 0.0})
    assert instance.get(references["y"], references["der(x)"]) == [10.0, 0.0]
    with pytest.raises(Refused, match="parameter gain is fixed"):
        instance.set({references["gain"]: 1.0})
    instance.free()
