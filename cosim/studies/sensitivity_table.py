"""A sensitivity as variables of the table of a study."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.results.result import Variable
from cosim.studies.sensitivity import Sensitivity

_ABOUT = {
    "first": "share of the variance by this value alone",
    "total": "share of the variance by this value and whatever it acts with",
    "second": "share of the variance by two values that act together",
    "mean_absolute": "mean magnitude of the change of the measure over the range of the value",
    "mean": "mean change of the measure over the range of the value",
    "deviation": "standard deviation of the change of the measure over the range of the value",
}


def variables(found: Sequence[Sensitivity]) -> tuple[dict[str, Variable], dict[str, Variable]]:
    """Return what was found over ``measured`` and ``varied``, and over ``crossed`` if anything is; and the labels.

    Each is a variable named ``sensitivity_`` and the figure. Those of pairs are over ``with_varied``, too.
    """
    measures = list(dict.fromkeys(one.measure for one in found))
    cases = list(dict.fromkeys(one.cases for one in found))
    names = list(found[0].names)
    empty = np.full((len(cases), len(measures), len(names)), math.nan)
    figures: dict[str, NDArray[np.float64]] = {}
    pairs: dict[str, NDArray[np.float64]] = {}
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
    data = {
        f"sensitivity_{name}": Variable(dimensions, own, {"long_name": _ABOUT[name]} if name in _ABOUT else {})
        for dimensions, group in ((over, figures), ((*over, "with_varied"), pairs))
        for name, own in group.items()
    }
    labels = {"crossed": [", ".join(own) for own in cases], "measured": measures, "varied": names}
    labels |= {"with_varied": names} if pairs else {}
    if cases == [()]:
        data = {name: variable.at("crossed", 0) for name, variable in data.items()}
        del labels["crossed"]
    return data, {name: Variable((name,), np.asarray(own)) for name, own in labels.items()}
