"""Which samples of a line are drawn: of those that fall on one column of a picture, the lowest and the highest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

COLUMNS = 500
"""Columns of a picture that a line can be told apart in; a panel is a little narrower."""


def thinned(values: NDArray[np.float64]) -> NDArray[np.int_]:
    """Return the samples of a line (T,) that show the same picture as all of them, in their order.

    Of the samples that share a column it is the lowest, the highest and, so that gaps stay gaps, one that is no number.
    A line of a few samples a column is returned whole.
    """
    samples = len(values)
    width = samples // COLUMNS
    if width < 4:  # the extremes and a gap would be nearly all
        return np.arange(samples)
    whole = samples - samples % width
    columns = values[:whole].reshape(-1, width)
    missing = np.isnan(columns)
    first = np.arange(0, whole, width)
    chosen = (
        first + np.where(missing, np.inf, columns).argmin(axis=1),
        first + np.where(missing, -np.inf, columns).argmax(axis=1),
        (first + missing.argmax(axis=1))[missing.any(axis=1)],
        np.arange(whole, samples),
        [0, samples - 1],
    )
    return np.unique(np.concatenate(chosen))
