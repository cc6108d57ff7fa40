"""The samples of a long result that show all lines of a figure as all samples do."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cosim.results.panels import panels_by_sample
from cosim.results.result import Result, Variable
from cosim.results.thinned import COLUMNS
from cosim.storage import blocks, forget

MOST = 50_000
"""Samples of a result that is drawn as it is."""
_FEWEST = 50
"""Columns of a picture whose extremes are shown of a long result with very many lines."""


def representative(result: Result) -> Result:
    """Return a long result with the samples alone that show all lines as they are; another one as it is.

    Of the samples that share a column of the picture these are, for each line, the lowest, the highest and one that is
    no number; and as many samples, evenly spaced, for the paths.
    """
    samples = result.sizes["time"]
    if samples <= MOST:
        return result
    lines = sum(courses.shape[1] for courses in _courses(result.within(slice(0, 1))))
    columns = min(max(MOST // (2 * max(lines, 1)), _FEWEST), COLUMNS)
    chosen = [np.linspace(0, samples - 1, MOST // 2).round().astype(np.int64)]
    edges = np.linspace(0, samples, columns + 1).astype(np.int64).tolist()
    for start, stop in pairwise(edges):
        part = result.within(slice(start, stop))
        chosen += [start + _extremes(courses) for courses in _courses(part)]
        forget()
    which = np.unique(np.concatenate(chosen))
    data_vars, coords = (
        {name: _taken(one, which) if "time" in one.dims else one for name, one in group.items()}
        for group in (result.data_vars, result.coords)
    )
    return Result(data_vars, coords, result.attrs)


def _courses(result: Result) -> list[NDArray[np.float64]]:
    return [panel.courses for panel in panels_by_sample(result)]


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
