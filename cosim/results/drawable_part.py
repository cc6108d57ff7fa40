"""The drawable part of a result that has diverged: the samples before, at a legible scale."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cosim.results.result import Result, Variable

_LARGEST = 1e12
"""No motion that means anything reaches it; far larger numbers overflow when they are drawn."""
_LATE = 0.9
_GROWTH = 10.0


def drawable(result: Result) -> Result:
    """Return a result that can be drawn; values that are left out are NaN.

    Numbers that are not finite or enormous are left out. If the run ended early, so are numbers more than ten times as
    large as any in its first nine tenths: they would flatten the rest of the curve.
    """
    ended_early = result.attrs["status"] != "completed"
    signals = {
        name: replace(signal, values=_masked(name, signal, ended_early))
        for name, signal in result.data_vars.items()
        if signal.dims[:1] == ("time",)
    }
    return replace(result, data_vars={**result.data_vars, **signals})


def _masked(name: str, signal: Variable, ended_early: bool) -> NDArray[np.float64]:
    values = np.array(signal.values, dtype=float)
    components = values.ndim > 1 + ("robot" in signal.dims)
    if name in ("pose", "leader_pose"):  # a point of a path is drawn or not
        with np.errstate(over="ignore", invalid="ignore"):
            x, y = np.moveaxis(values - values[:1], -1, 0)[:2]
            values[_runs_away(np.hypot(x, y), ended_early)] = np.nan
    for part in np.moveaxis(values, -1, 0) if components else [values]:  # views; components have other units
        part[_runs_away(part, ended_early)] = np.nan
    return values


def _runs_away(values: NDArray[np.float64], ended_early: bool) -> NDArray[np.bool_]:
    """Return which values (T, ...) are not drawn."""
    magnitude = np.abs(values)
    away = ~(magnitude <= _LARGEST)
    if ended_early and len(values):
        early = np.where(away, 0.0, magnitude)[: int(_LATE * (len(values) - 1)) + 1].max()
        away |= magnitude > (_GROWTH * early if early > 0 else _LARGEST)
    return np.asarray(away)
