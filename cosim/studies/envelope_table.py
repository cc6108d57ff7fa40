"""The courses of the runs as variables of the table of a study."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from cosim.results.result import Variable
from cosim.studies.bundles import Bundle

MOST_NUMBERS = 20_000_000
"""Upper limit for the numbers of one envelope in the table; one with more is left out."""


def variables(bundles: Iterable[Bundle], runs: Sequence[int]) -> tuple[dict[str, Variable], dict[str, Variable]]:
    """Return the courses of each envelope over the runs of the table, and the labels of their other dimensions.

    That of the first envelope is named ``envelope_1``, over ``run``, ``envelope_1_robot`` and ``envelope_1_time``; of
    paths also over ``envelope_1_axis``. It is NaN where a run has no course. Differences of cases are not there, as
    they follow from the courses.
    """
    groups: dict[int, list[Bundle]] = {}
    for bundle in bundles:
        if bundle.of == "runs":
            groups.setdefault(bundle.place, []).append(bundle)
    data: dict[str, Variable] = {}
    labels: dict[str, Variable] = {}
    for place, group in groups.items():
        name = f"envelope_{place + 1}"
        robots = list(dict.fromkeys(robot for bundle in group for robot in bundle.robots))
        times = np.unique(np.concatenate([bundle.envelope.times for bundle in group]))
        axes = group[0].values.shape[3]
        if len(runs) * len(robots) * len(times) * axes > MOST_NUMBERS:
            continue
        precision = np.result_type(*(bundle.values for bundle in group))
        values = np.full((len(runs), len(robots), len(times), axes), np.nan, precision)
        rows = {run: row for row, run in enumerate(runs)}
        for bundle in group:
            at = np.ix_(
                [rows[run] for run in bundle.runs],
                [robots.index(robot) for robot in bundle.robots],
                np.searchsorted(times, bundle.envelope.times).tolist(),
            )
            values[at] = bundle.values
        envelope = group[0].envelope
        robot, time, axis = f"{name}_robot", f"{name}_time", f"{name}_axis"
        attributes = {"kind": "envelope", "long_name": envelope.text, "units": envelope.unit}
        if envelope.of_paths:
            data[name] = Variable(("run", robot, time, axis), values, attributes)
            labels[axis] = Variable((axis,), np.asarray(["x", "y"]))
        else:
            data[name] = Variable(("run", robot, time), values[..., 0], attributes)
        labels[robot] = Variable((robot,), np.asarray(robots))
        labels[time] = Variable((time,), times, {"units": "s"})
    return data, labels
