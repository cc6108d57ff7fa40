"""A sensitivity as an xarray dataset."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import xarray as xr

from cosim.studies.sensitivity import Sensitivity

_ABOUT = {
    "first": "share of the variance by this value alone",
    "total": "share of the variance by this value and whatever it acts with",
    "second": "share of the variance by two values that act together",
    "mean_absolute": "mean magnitude of the change of the measure over the range of the value",
    "mean": "mean change of the measure over the range of the value",
    "deviation": "standard deviation of the change of the measure over the range of the value",
}


def as_dataset(found: Sequence[Sensitivity]) -> xr.Dataset:
    """Return what was found over ``measured`` and ``varied``, and over ``crossed`` if anything is.

    Each is a variable named ``sensitivity_`` and the figure. Those of pairs are over ``with_varied``, too.
    """
    measures = list(dict.fromkeys(one.measure for one in found))
    cases = list(dict.fromkeys(one.cases for one in found))
    names = list(found[0].names)
    empty = np.full((len(cases), len(measures), len(names)), math.nan)
    figures: dict[str, np.ndarray] = {}
    pairs: dict[str, np.ndarray] = {}
    for one in found:
        place = cases.index(one.cases), measures.index(one.measure)
        for name, own in one.figures.items():
            figures.setdefault(name, empty.copy())[place] = own
        for (value, other), both in one.pairs.items():
            at, to = names.index(value), names.index(other)
            for name, number in zip(("second", "second_plus_minus"), both, strict=True):
                square = pairs.setdefault(name, np.stack([empty] * len(names), axis=-1))[place]
                square[at, to] = square[to, at] = number
    over = ("crossed", "measured", "varied")
    told = xr.Dataset(
        {
            f"sensitivity_{name}": (dimensions, own, {"long_name": _ABOUT[name]} if name in _ABOUT else {})
            for dimensions, group in ((over, figures), ((*over, "with_varied"), pairs))
            for name, own in group.items()
        },
        {"crossed": [", ".join(own) for own in cases], "measured": measures, "varied": names},
    )
    if pairs:
        told = told.assign_coords(with_varied=names)
    return told if cases != [()] else told.isel(crossed=0, drop=True)
