"""The signals that a figure shows over time, and the samples that show them as all do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from cosim.results.result import Result, Variable
from cosim.results.thinned import COLUMNS
from cosim.storage import blocks, forget

Signals: TypeAlias = Mapping[str, NDArray[np.float64] | None]
"""Signals (T, N) by their labels; None for one that is not recorded."""

MOST = 50_000
"""Samples of a result that is drawn as it is."""
_FEWEST = 50
"""Columns of a picture whose extremes are shown of a long result with very many lines."""


def panels(result: Result) -> tuple[tuple[str, Signals], ...]:
    """Return heading and signals of the panels (c) to (h)."""
    commands = "torque" if "torque" in result else "command"
    return (
        (
            "(c) tracking errors",
            {
                "range error [m]": result["range_error"].values,
                "bearing error [deg]": np.degrees(result["bearing_error"].values),
            },
        ),
        (f"(d) {commands}s as applied", _components(result, commands)),
        (
            "(e) estimation errors of range and bearing",
            {
                "range error [m]": _error_of(result, "range_estimate", result["range"].values),
                "bearing error [deg]": _error_of(result, "bearing_estimate", result["bearing"].values, 180 / np.pi),
            },
        ),
        (
            "(f) estimation errors of the velocities",
            {
                "error of v [m/s]": _error_of(result, "speed_estimate", result["velocity"].values[..., 0]),
                "error of omega [rad/s]": _error_of(
                    result, "steering_rate_estimate", result["velocity"].values[..., 1]
                ),
            },
        ),
        ("(g) Frobenius norm of the weights", _named(result, "weight_norm", "norm of W")),
        ("(h) estimate of the robust gain", _named(result, "gain_estimate", "theta")),
    )


def representative(result: Result) -> Result:
    """Return a long result with the samples alone that show all lines as they are; another one as it is.

    Of the samples that share a column of the picture these are, for each line, the lowest, the highest and one that is
    no number; and as many samples, evenly spaced, for the paths.
    """
    samples = result.sizes["time"]
    if samples <= MOST:
        return result
    drawn = [signal for _, signals in panels(result.within(slice(0, 1))) for signal in signals.values()]
    lines = sum(signal.shape[1] for signal in drawn if signal is not None)
    columns = min(max(MOST // (2 * max(lines, 1)), _FEWEST), COLUMNS)
    chosen = [np.linspace(0, samples - 1, MOST // 2).round().astype(np.int64)]
    edges = np.linspace(0, samples, columns + 1).astype(np.int64).tolist()
    for start, stop in pairwise(edges):
        part = result.within(slice(start, stop))
        for _, signals in panels(part):
            chosen += [start + _extremes(signal) for signal in signals.values() if signal is not None]
        forget()
    which = np.unique(np.concatenate(chosen))
    data_vars, coords = (
        {name: _taken(one, which) if "time" in one.dims else one for name, one in group.items()}
        for group in (result.data_vars, result.coords)
    )
    return Result(data_vars, coords, result.attrs)


def _taken(variable: Variable, which: NDArray[np.int64]) -> Variable:
    axis = variable.dims.index("time")
    values = np.moveaxis(variable.values, axis, 0)
    taken = np.empty((len(which), *values.shape[1:]), values.dtype)
    for block in blocks(len(values), values[:1].size):
        first, last = np.searchsorted(which, (block.start, block.stop))
        taken[first:last] = values[which[first:last]]
    return replace(variable, values=np.moveaxis(taken, 0, axis))


def _extremes(signal: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the samples of signals (T, N) that are lowest, highest, and no number."""
    missing = np.isnan(signal)
    if not missing.any():
        return np.concatenate([signal.argmin(axis=0), signal.argmax(axis=0)])
    lowest, highest = (np.where(missing, out, signal) for out in (np.inf, -np.inf))
    return np.concatenate([lowest.argmin(axis=0), highest.argmax(axis=0), missing.argmax(axis=0)])


def _components(result: Result, name: str) -> Signals:
    """Return the components of a signal, labelled with their units; those of an older result are torques."""
    labels = [str(label) for label in result[f"{name}_component"].values]
    units = f"{name}_component_units"
    shown = [str(unit) for unit in result[units].values] if units in result else ["N.m"] * len(labels)
    values = result[name].values
    return {f"{label} [{unit}]": values[..., at] for at, (label, unit) in enumerate(zip(labels, shown, strict=True))}


def _error_of(
    result: Result, estimate: str, true: NDArray[np.float64], factor: float = 1.0
) -> NDArray[np.float64] | None:
    return (true - result[estimate].values) * factor if estimate in result else None


def _named(result: Result, name: str, label: str) -> Signals:
    """Return a signal, labelled with its unit."""
    if name not in result:
        return {label: None}
    return {f"{label} [{result[name].attrs['units']}]": result[name].values}
