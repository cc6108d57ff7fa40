"""An FMU driven by its roles through FMPy's own methods, one call after the other: slow, plain, without the harness."""

import ctypes
from pathlib import Path
from typing import Any, Self

import fmpy
import numpy as np

from .vehicles import UNITS, Variable, to_variables

STEP = 0.02


class Robot:
    """One instance of a vehicle; values are by role, in the kind's units.

    `method` is for Model Exchange, whose FMUs bring none: "euler" or "runge_kutta_4", a step a communication step.
    """

    def __init__(
        self, fmu: Path, folder: Path, interface: str, roles: dict[str, Variable], method: str | None = None
    ) -> None:
        self.roles, self.method = roles, method
        description = fmpy.read_model_description(str(fmu), validate=False)
        self.is_2 = description.fmiVersion == "2.0"
        self.variables = {variable.name: variable for variable in description.modelVariables}
        self.model = fmpy.simulation.instantiate_fmu(fmpy.extract(str(fmu), str(folder)), description, interface)
        self.exchange = interface == "ModelExchange"
        self.states = description.numberOfContinuousStates

    def set(self, values: dict[str, float], *, start: bool = False) -> None:
        for name, elements in to_variables(self.roles, values, start=start).items():
            self.set_variable(name, *elements)

    def set_variable(self, name: str, *values: float) -> None:
        setter = self.model.setReal if self.is_2 else self.model.setFloat64
        setter([self.variables[name].valueReference], values)

    def get(self, *roles: str) -> list[float]:
        getter = self.model.getReal if self.is_2 else self.model.getFloat64
        values = []
        for role in roles:
            variable = self.variables[self.roles[role].name]
            size = (int(np.prod([int(d.start) for d in variable.dimensions])),) if variable.dimensions else ()
            element = getter([variable.valueReference], *size)[self.roles[role].element or 0]
            values.append(self.roles[role].from_fmu(role, element))
        return values

    def start(self, **values: float) -> Self:
        """Set start values by role, and initialise."""
        self.set(values, start=True)
        if self.is_2:
            self.model.setupExperiment(startTime=0.0)
            self.model.enterInitializationMode()
        else:
            self.model.enterInitializationMode(startTime=0.0)
        self.model.exitInitializationMode()
        if self.exchange:
            assert not any((self.model.newDiscreteStates if self.is_2 else self.model.updateDiscreteStates)()[:2])
            self.model.enterContinuousTimeMode()
        return self

    def step(self, time: float) -> None:
        if not self.exchange:
            self.model.doStep(time, STEP)
            return
        x = np.empty(self.states)
        self.model.getContinuousStates(pointer(x), len(x))
        k1 = self.slope(time, x)
        if self.method == "euler":
            x += STEP * k1
        else:
            k2 = self.slope(time + STEP / 2, x + STEP / 2 * k1)
            k3 = self.slope(time + STEP / 2, x + STEP / 2 * k2)
            k4 = self.slope(time + STEP, x + STEP * k3)
            x += STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        self.place(time + STEP, x)
        assert self.model.completedIntegratorStep() == (False, False)

    def place(self, time: float, x: np.ndarray) -> None:
        self.model.setTime(time)
        self.model.setContinuousStates(pointer(x), len(x))

    def slope(self, time: float, x: np.ndarray) -> np.ndarray:
        self.place(time, x)
        slope = np.empty_like(x)
        (self.model.getDerivatives if self.is_2 else self.model.getContinuousStateDerivatives)(
            pointer(slope), len(slope)
        )
        return slope

    def drive(self, torques: np.ndarray) -> np.ndarray:
        """Apply torques (n, 2) and return what the outputs offered are after each step, the start included."""
        outputs = [role for role in ("x", "y", "psi", "gamma", "v", "omega") if role in self.roles]
        trajectory = [self.get(*outputs)]
        for k, (drive, steer) in enumerate(torques.tolist()):
            self.set({"tau_drive": drive, "tau_steer": steer})
            self.step(k * STEP)
            trajectory.append(self.get(*outputs))
        return np.array(trajectory)

    def close(self) -> None:
        self.model.terminate()
        self.model.freeInstance()


def pointer(array: np.ndarray) -> Any:
    return array.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


OURS = {role: Variable(role, unit) for role, unit in UNITS.items()}
