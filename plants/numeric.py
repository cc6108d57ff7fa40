"""A model as NumPy functions, from the same expressions as the C code.

All arrays may have leading batch dimensions, which broadcast: x (..., states), u (..., inputs), p (..., parameters).
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import sympy
from sympy.printing.numpy import NumPyPrinter

from plants import arrays
from plants.errors import ModelError
from plants.jacobian import differentiate
from plants.ode import Enumeration, OdeModel, Term
from plants.printing import OWN_FUNCTIONS, PythonPrinting, python_function, scalar_functions
from plants.runge_kutta import runge_kutta_4

Array = npt.NDArray[np.float64]


class _Printer(PythonPrinting, NumPyPrinter):  # type: ignore[misc]
    """Expressions of NumPy that call functions of our own."""


class Jacobians(NamedTuple):
    """Partial derivatives of f and g: A = df/dx, B = df/du, C = dg/dx, D = dg/du, each (..., rows, columns)."""

    A: Array
    B: Array
    C: Array
    D: Array


Function = Callable[..., Sequence[npt.ArrayLike]]
"""A function of the time and lists of states, inputs and parameters."""

_OF_MATH = {name: np.vectorize(f, otypes=[float]) for name, f in vars(math).items() if callable(f)}
"""Functions of Python's `math`, for those that NumPy lacks, such as erf."""


@dataclass(frozen=True)
class NumericModel:
    """The functions f and g of ``der(x) = f(time, x, u, p), y = g(time, x, u, p)``, and one step of each solver.

    Attributes
    ----------
    model
        The model that the functions were made from; it gives the order of the entries of x, u, p and y.
    """

    model: OdeModel
    _derivatives: Function
    _outputs: Function

    def start(self, **values: npt.ArrayLike) -> Array:
        """Return x with some states set by name, the others at their start values, (..., states)."""
        return _vector("state", {s.name: s.start for s in self.model.states}, values)

    def inputs(self, **values: npt.ArrayLike) -> Array:
        """Return u with some inputs set by name, the others at their start values, (..., inputs)."""
        return _vector("input", {i.name: i.start for i in self.model.inputs}, values)

    def parameters(self, **values: npt.ArrayLike | str) -> Array:
        """Return p with some parameters set by name, the others at their defaults, (..., parameters).

        A variant of an enumeration is given by its name: ``parameters(m_c=20, drive="front_wheel")``. Whether a number
        lies within its parameter's bounds is not asked.

        Raises
        ------
        ModelError
            There is no such parameter or variant, or a value is no number.
        """
        defaults = {p.name: 1.0 if isinstance(p, Enumeration) else p.start for p in self.model.parameters}
        variants = {p.name: p for p in self.model.enumerations}
        numbers = {
            name: _number_of_variant(variants[name], value) if name in variants else value
            for name, value in values.items()
        }
        return _vector("parameter", defaults, numbers)

    def rhs(self, t: npt.ArrayLike, x: npt.ArrayLike, u: npt.ArrayLike, p: npt.ArrayLike) -> Array:
        """Return der(x), (..., states)."""
        return _call(self._derivatives, t, x, u, p)

    def outputs(self, t: npt.ArrayLike, x: npt.ArrayLike, u: npt.ArrayLike, p: npt.ArrayLike) -> Array:
        """Return the computed outputs, (..., outputs); states that are outputs too are not among them."""
        return _call(self._outputs, t, x, u, p)

    def jacobians(self, t: npt.ArrayLike, x: npt.ArrayLike, u: npt.ArrayLike, p: npt.ArrayLike) -> Jacobians:
        """Return the exact partial derivatives of `rhs` and `outputs` with respect to x and u.

        At a kink of a piecewise expression, they belong to the branch in use.
        """
        n, m, k = len(self.model.states), len(self.model.inputs), len(self.model.outputs)
        with np.errstate(divide="ignore", invalid="ignore"):  # NumPy evaluates the branches that are not in use, too
            entries = _call(self._partials, t, x, u, p)
        matrix = entries.reshape(*entries.shape[:-1], n + k, n + m)
        return Jacobians(matrix[..., :n, :n], matrix[..., :n, n:], matrix[..., n:, :n], matrix[..., n:, n:])

    @cached_property
    def _partials(self) -> Function:
        """The entries of the Jacobian of (f, g) with respect to (x, u), row by row."""
        model = self.model
        unknowns = [(s.name, f, s.unit) for s, f in zip(model.states, model.derivatives, strict=True)]
        unknowns += [(output.name, output.expression, output.unit) for output in model.outputs]
        knowns = [variable.name for variable in (*model.states, *model.inputs)]
        jacobian = differentiate(model, unknowns, knowns)
        entries = {(partial.unknown, partial.known): partial.expression for partial in jacobian.partials}
        matrix = [entries.get((name, known), sympy.S.Zero) for name, *_ in unknowns for known in knowns]
        return _function(model, matrix, jacobian.terms)

    def euler(self, t: float, x: npt.ArrayLike, u: npt.ArrayLike, p: npt.ArrayLike, h: float) -> Array:
        """Return the states after one explicit Euler step of length h, inputs held."""
        return np.asarray(x, dtype=float) + h * self.rhs(t, x, u, p)

    def rk4(self, t: float, x: npt.ArrayLike, u: npt.ArrayLike, p: npt.ArrayLike, h: float) -> Array:
        """Return the states after one step of the classical Runge-Kutta method of order 4, inputs held."""
        (result,) = runge_kutta_4(lambda t, x: [self.rhs(t, x[0], u, p)], t, [np.asarray(x, dtype=float)], h)
        return np.asarray(result)


def compile(model: OdeModel) -> NumericModel:
    """Turn a model into NumPy functions.

    Raises
    ------
    ModelError
        Neither NumPy nor Python has a function of the model.
    """
    outputs = [output.expression for output in model.outputs]
    return NumericModel(
        model,
        _function(model, model.derivatives, model.terms_of(model.derivatives)),
        _function(model, outputs, model.terms_of(outputs)),
    )


def _function(model: OdeModel, expressions: Sequence[sympy.Expr], terms: Iterable[Term]) -> Function:
    printer = _Printer({"fully_qualified_modules": False, "user_functions": OWN_FUNCTIONS})
    own = {name: getattr(arrays, name) for name in scalar_functions()}
    return python_function(model, expressions, terms, printer, {**_OF_MATH, **vars(np), **own})


def _call(function: Function, t: npt.ArrayLike, *vectors: npt.ArrayLike) -> Array:
    arrays = [np.asarray(vector, dtype=float) for vector in vectors]
    shape = np.broadcast_shapes(np.shape(t), *(array.shape[:-1] for array in arrays))
    values = function(np.asarray(t, dtype=float), *(list(np.moveaxis(array, -1, 0)) for array in arrays))
    result = np.empty((*shape, len(values)))
    for index, value in enumerate(values):
        result[..., index] = value
    return result


def _number_of_variant(enumeration: Enumeration, value: npt.ArrayLike | str) -> npt.ArrayLike:
    """Return the numbers that stand for variants, which may be given by name."""
    if isinstance(value, str):
        return enumeration.number(value)
    if isinstance(value, bool) or not np.isin(value, np.arange(1, len(enumeration.items) + 1)).all():
        known = ", ".join(f"{number} ({item})" for number, item in enumerate(enumeration.items, 1))
        raise ModelError(f"{enumeration.name} has no variant {value}; it has {known}")
    return value


def _vector(kind: str, defaults: dict[str, float], values: Mapping[str, npt.ArrayLike | str]) -> Array:
    unknown = set(values) - set(defaults)
    if unknown:
        raise ModelError(f"there is no {kind} {min(unknown)!r}; there are {', '.join(defaults)}")
    if texts := [name for name, value in values.items() if np.asarray(value).dtype.kind in "USO"]:
        raise ModelError(f"{kind} {texts[0]!r} is {values[texts[0]]!r}, it must be a number")
    entries = [np.asarray(values.get(name, default), dtype=float) for name, default in defaults.items()]
    return np.stack(np.broadcast_arrays(*entries), axis=-1) if entries else np.empty(0)
