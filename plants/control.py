"""A model as a system of python-control: for simulation, operating points, linear analysis and control design.

Needs python-control: ``pip install "formation-cosim[control]"``. A system has the
outputs of the FMU, by the same names: the states that are outputs, then the computed ones.
"""

from collections.abc import Callable, Mapping
from functools import lru_cache
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

import plants
from plants import numeric
from plants.errors import ModelError, PlantError
from plants.numeric import Array
from plants.ode import OdeModel

if TYPE_CHECKING:
    from control import NonlinearIOSystem, StateSpace


def nonlinear_io_system(
    model: str | OdeModel, *, parameters: Mapping[str, float | str] | None = None, name: str | None = None
) -> "NonlinearIOSystem":
    """Make a python-control system of a model.

    Parameters
    ----------
    model
        Name of a built-in model, or a model.
    parameters
        Values by name, a variant of an enumeration by its name; the others have their defaults. They become the
        system's ``params``, which python-control's functions can change: ``params={"m_c": 20}``.
    name
        Name of the system, by default that of the model.

    Returns
    -------
    control.NonlinearIOSystem
        Its states, inputs and outputs have the names of the model's.

    Raises
    ------
    UnknownModel
        There is no built-in model of this name.
    ModelError
        There is no such parameter, or no such variant.
    PlantError
        python-control is not installed.
    """
    control, model = _control(), _loaded(model)
    functions = numeric.compile(model)
    shown = [index for index, state in enumerate(model.states) if state.output]

    @lru_cache(maxsize=16)
    def vector(items: tuple[tuple[str, float | str], ...]) -> Array:
        return functions.parameters(**dict(items))

    def update(t: float, x: Array, u: Array, params: Mapping[str, float | str]) -> Array:
        return functions.rhs(t, x, u, vector(tuple(params.items())))

    def output(t: float, x: Array, u: Array, params: Mapping[str, float | str]) -> Array:
        return np.concatenate([x[shown], functions.outputs(t, x, u, vector(tuple(params.items())))])

    params = dict(parameters or {})
    functions.parameters(**params)  # refuses wrong ones now
    return control.NonlinearIOSystem(update, output, params=params, name=name or model.name, **_names(model))


def linearise(
    model: str | OdeModel,
    x: npt.ArrayLike | Mapping[str, float] | None = None,
    u: npt.ArrayLike | Mapping[str, float] | None = None,
    parameters: Mapping[str, float | str] | None = None,
    *,
    t: float = 0.0,
    name: str | None = None,
) -> "StateSpace":
    """Linearise a model at a point, by its exact Jacobians.

    Parameters
    ----------
    model
        Name of a built-in model, or a model.
    x, u
        The states (states,) and the inputs (inputs,), or some of them by name, the others at their start values.
    parameters
        Values by name; the others have their defaults.
    t
        The time [s].
    name
        Name of the system, by default that of the model.

    Returns
    -------
    control.StateSpace
        A, B, C and D for deviations from the point; the names of states, inputs and outputs are the model's.

    Raises
    ------
    UnknownModel
        There is no built-in model of this name.
    ModelError
        There is no such state, input, parameter or variant, or x or u has another shape.
    PlantError
        python-control is not installed.
    """
    control, model = _control(), _loaded(model)
    functions = numeric.compile(model)
    states = _point(functions.start(), functions.start, x, "x")
    inputs = _point(functions.inputs(), functions.inputs, u, "u")
    A, B, C, D = functions.jacobians(t, states, inputs, functions.parameters(**(parameters or {})))
    shown = np.eye(len(A))[[state.output for state in model.states]]
    C, D = np.vstack([shown, C]), np.vstack([np.zeros((len(shown), B.shape[1])), D])
    return control.StateSpace(A, B, C, D, name=name or model.name, remove_useless_states=False, **_names(model))


def _control() -> ModuleType:
    try:
        import control
    except ImportError as error:
        message = "python-control is not installed: install it with 'pip install \"formation-cosim[control]\"'"
        raise PlantError(message) from error
    module: ModuleType = control
    return module


def _loaded(model: str | OdeModel) -> OdeModel:
    return plants.load(model) if isinstance(model, str) else model


def _point(
    default: Array, by_name: Callable[..., Array], values: npt.ArrayLike | Mapping[str, float] | None, letter: str
) -> Array:
    if values is None or isinstance(values, Mapping):
        return by_name(**(values or {}))
    point = np.asarray(values, dtype=float)
    if point.shape != default.shape:
        raise ModelError(f"{letter} has the shape {point.shape}, it must be {default.shape}")
    return point


def _names(model: OdeModel) -> dict[str, list[str]]:
    outputs = [state.name for state in model.states if state.output] + [output.name for output in model.outputs]
    return {
        "states": [state.name for state in model.states],
        "inputs": [variable.name for variable in model.inputs],
        "outputs": outputs,
    }
