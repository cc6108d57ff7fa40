"""Directional and adjoint derivatives against differences."""

from collections.abc import Callable
from pathlib import Path

import fmpy
import numpy as np
import pytest
import sympy
from fmpy.fmi3 import FMU3Slave

import plants
from plants.ode import Input, OdeModel, State

from . import driver
from .driver import Instance, Refused
from .fmus import MODELS, Fmu


def central_differences(instance: Instance, unknowns: list[int], known: int, value: float) -> np.ndarray:
    """Differentiate by one known, with central differences extrapolated twice by Richardson's method."""

    def f(changed: float) -> np.ndarray:
        instance.set({known: changed})
        return np.array(instance.get(*unknowns))

    steps = [2e-3, 1e-3, 5e-4]
    slopes = [(f(value + h) - f(value - h)) / (2 * h) for h in steps]
    instance.set({known: value})
    first = [(4 * slopes[i + 1] - slopes[i]) / 3 for i in range(2)]
    return (16 * first[1] - first[0]) / 15


@pytest.mark.parametrize("name", MODELS)
def test_directional_and_adjoint_derivatives(fmus: Callable, fmi: str, name: str) -> None:
    """At random points, in initialization mode, where parameters are knowns too."""
    fmu, model = fmus(name, fmi), MODELS[name]
    rng = np.random.default_rng(12)
    unknowns = [fmu[s.name] for s in model.states if s.output] + [fmu[f"der({s.name})"] for s in model.states]
    unknowns += [fmu[o.name] for o in model.outputs]
    variables = (*model.states, *model.inputs, *model.reals)
    knowns = [fmu[v.name] for v in variables]
    instance = Instance(fmu.library, "co_simulation")
    for k in range(6):
        values = [v.start + rng.uniform(0.1, 0.9) for v in variables]
        instance.set(dict(zip(knowns, values, strict=True)))
        for enumeration in model.enumerations:
            instance.set_enumeration(fmu[enumeration.name], 1 + k % len(enumeration.items))
        instance.initialize(0.4)

        expected = np.column_stack(
            [central_differences(instance, unknowns, *pair) for pair in zip(knowns, values, strict=True)]
        )
        exact = np.column_stack([instance.differentiate(unknowns, [known], [1.0]) for known in knowns])
        # What is zero, or nearly so beside its row, is compared with its row: differences have rounding errors.
        row = np.abs(expected).max(axis=1, keepdims=True)
        assert np.all(np.abs(exact - expected) <= 1e-7 * np.abs(expected) + 1e-10 * row)

        seed = rng.normal(size=len(knowns))
        rounding = 1e-13 * (np.abs(exact) @ np.abs(seed) + 1)
        assert np.all(np.abs(instance.differentiate(unknowns, knowns, seed) - exact @ seed) <= rounding)
        if fmi == "3.0":
            seed = rng.normal(size=len(unknowns))
            rounding = 1e-13 * (np.abs(seed) @ np.abs(exact) + 1)
            assert np.all(
                np.abs(instance.differentiate(unknowns, knowns, seed, adjoint=True) - seed @ exact) <= rounding
            )
        instance.reset()
    instance.free()


def test_derivatives_while_running(new: Callable, car: Fmu) -> None:
    """Time and tunable parameters are knowns; any other variable is refused by value reference."""
    for interface in driver.INTERFACES:
        instance = new(interface).start()
        assert instance.differentiate([car["der(x)"]], [car["v"]], [2.0]) == [2.0]
        assert instance.differentiate([car["x"]], [car["x"], car["y"]], [2.0, 5.0]) == [2.0]
        assert instance.differentiate([car["der(v)"]], [car["time"]], [1.0]) == [0.0]
        instance.set({car["tau_drive"]: 8.0})
        (slope,) = instance.differentiate([car["der(v)"]], [car["m_c"]], [1.0])
        expected = central_differences(instance, [car["der(v)"]], car["m_c"], 30.0)
        np.testing.assert_allclose(slope, expected[0], rtol=1e-7)
        wrong = (("der(v)", "solver_step"), ("der(v)", "der(x)"), ("tau_drive", "x"), ("der(v)", "drive"))
        for unknown, known in wrong:
            with pytest.raises(Refused, match=r"is no (un)?known"):
                instance.differentiate([car[unknown]], [car[known]], [1.0])


def test_a_direction_beside_a_singular_entry_has_its_derivative(tmp_path: Path) -> None:
    """The outlet of an empty tank: its slope has no bound, and the inflow counts all the same."""
    h, u = sympy.symbols("h u", real=True)
    tank = OdeModel(
        name="tank",
        description="Tank with an outlet",
        states=(State(h, "m", "Level"),),
        derivatives=(u - sympy.sqrt(h),),
        inputs=(Input(u, "m/s", "Inflow"),),
    )
    path = plants.build(tank, fmi="3.0", out=tmp_path)
    description = fmpy.read_model_description(path)
    numbers = {variable.name: variable.valueReference for variable in description.modelVariables}
    instance = FMU3Slave(
        guid=description.guid, unzipDirectory=fmpy.extract(path, tmp_path), modelIdentifier="tank", instanceName="tank"
    )
    instance.instantiate()
    instance.enterInitializationMode(startTime=0.0)
    ends = [numbers["der(h)"]], [numbers["u"]]
    assert list(instance.getDirectionalDerivative(*ends, [1.0])) == [1.0]
    assert list(instance.getAdjointDerivative(*ends, [1.0])) == [1.0]
    instance.freeInstance()
