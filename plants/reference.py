"""Reference results of the vehicles, from their constrained dynamics (1), not from the reduction (3).

A vehicle's ``reference.py`` writes its matrices by hand in NumPy, independently of its ``model.py``. Here they are
solved for the accelerations and the Lagrange multipliers together, and integrated with SciPy's DOP853 at a tolerance
of 1e-12; the inputs are held over communication steps.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Reference:
    """A run of a vehicle, and the file that keeps its result.

    Attributes
    ----------
    file
        CSV with the time, the states and the inputs, a row for each communication point.
    states, inputs
        Names, in the order of x and u.
    start
        The states at the start.
    drive
        Returns the inputs of a communication step that begins at a time.
    rhs
        Returns der(x) from x and u.
    step, steps
        Communication step [s], and how many there are.
    """

    file: Path
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    start: tuple[float, ...]
    drive: Callable[[float], Array]
    rhs: Callable[[Array, Array], Array]
    step: float = 0.1
    steps: int = 60

    def simulate(self) -> Array:
        """Return time, states and inputs at each communication point, (steps + 1, 1 + states + inputs)."""
        rows, x = [], np.array(self.start)
        for k in range(self.steps + 1):
            u = self.drive(k * self.step)
            rows.append(np.concatenate([[k * self.step], x, u]))
            # The inputs are bound here: they are constant over the step.
            run = solve_ivp(
                lambda _, x, u=u: self.rhs(x, u), (0.0, self.step), x, method="DOP853", rtol=1e-12, atol=1e-12
            )
            x = run.y[:, -1]
        return np.array(rows)

    def read(self) -> Array:
        """Return the result of `simulate` from when the file was written."""
        return np.loadtxt(self.file, delimiter=",", skiprows=1)

    def write(self) -> None:
        """Simulate, and write the file."""
        header = ",".join(("time", *self.states, *self.inputs))
        np.savetxt(self.file, self.simulate(), delimiter=",", header=header, comments="", fmt="%.12g")


def accelerations(M1: Array, force: Array, A: Array, A_dot: Array, eta_dot: Array) -> Array:
    """Return eta'' of M1 eta'' + A' lambda = force, A eta'' + A_dot eta' = 0, solved with the multipliers lambda."""
    k = len(A)
    matrix = np.block([[M1, A.T], [A, np.zeros((k, k))]])
    eta_ddot: Array = np.linalg.solve(matrix, np.concatenate([force, -A_dot @ eta_dot]))[: len(M1)]
    return eta_ddot
