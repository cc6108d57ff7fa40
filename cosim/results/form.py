"""The form that the result of a run has, which a file of a stranger may lack."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TypeAlias

import numpy as np

from cosim.errors import InputError
from cosim.results.outlines import FORM as OUTLINES
from cosim.results.provenance import Provenance
from cosim.results.result import Result
from cosim.storage import blocks

Form: TypeAlias = Mapping[str, tuple[tuple[str, ...], bool]]
"""By the name of a variable its dimensions, and whether it holds texts."""

_TEXTS = ("scenario_name", "scenario", "status")
_TIMES = ("step", "horizon")
_OTHER_TEXTS = ("title", "scenario_file", "changes", "versions", "controllers", "plants", "plant_messages", "verdicts")
"""Which a file of an earlier version, or of a run that was not judged, may lack."""
_VARIABLES = ("time", "robot", "pose", "leader_pose")
_GROUPS = ("pose", "velocity", "torque")
_FORM: Form = {
    "time": (("time",), False),
    **{name: ((name,), True) for name in ("robot", "vehicle", *(f"{group}_component" for group in _GROUPS))},
    **{group: (("time", "robot", f"{group}_component"), False) for group in _GROUPS},
    "measured_pose": (("time", "robot", "pose_component"), False),
    **{f"leader_{group}": (("time", f"{group}_component"), False) for group in _GROUPS},
    **dict.fromkeys(("range", "bearing", "range_error", "bearing_error"), (("time", "robot"), False)),
    **dict.fromkeys(("desired_range", "desired_bearing"), (("time", "robot"), False)),
    **{f"{group}_name": (("vehicle", f"{group}_component"), True) for group in _GROUPS},
    **dict.fromkeys(("vehicle_kind", "vehicle_plant"), (("vehicle",), True)),
    **{f"message_{name}": (("message",), False) for name in ("time", "count")},
    **{f"message_{name}": (("message",), True) for name in ("robot", "status", "category", "text")},
    **OUTLINES,
}


def check(result: Result) -> Result:
    """Return a result that has the form of a run's.

    Raises
    ------
    InputError
        It lacks what every result of a run has, a variable has other dimensions, texts in place of numbers or the
        reverse, its times do not increase, or its attributes make no sense.
    """
    for name in (*_TEXTS, *_TIMES, *_VARIABLES):
        if name not in (result if name in _VARIABLES else result.attrs):
            raise InputError(f"this is not the result of a run: {name!r} is missing in it")
    for name in (*_TEXTS, *_OTHER_TEXTS):
        if not isinstance(told := result.attrs.get(name, ""), str):
            raise InputError(f"this is not the result of a run: {name!r} is {told!r}, no text")
    for name in _TIMES:
        told = result.attrs[name]
        if not (isinstance(told, int | float | np.number) and 0.0 < float(told) < math.inf):
            raise InputError(f"this is not the result of a run: its {name} is {told!r}, no time above zero")
    for name, variable in (*result.data_vars.items(), *result.coords.items()):
        dims, text = _FORM.get(name, (variable.dims, False))
        if variable.dims != dims:
            told = f"has the dimensions ({', '.join(variable.dims)}), not ({', '.join(dims)})"
            raise InputError(f"this is not the result of a run: {name!r} {told}")
        known = name in _FORM or variable.dims[:1] == ("time",)
        if known and (variable.values.dtype.kind in "fiu") == text and variable.values.size:
            raise InputError(f"this is not the result of a run: {name!r} holds {'numbers' if text else 'no numbers'}")
    if any(name in result for name in OUTLINES):
        for name in (*OUTLINES, "vehicle", "pose_name"):
            if name not in result:
                raise InputError(f"this is not the result of a run: {name!r} is missing in it")
    if result.sizes.get("outline_axis", 2) != 2:
        raise InputError("this is not the result of a run: 'outline_axis' names no two axes")
    try:
        Provenance.of(result.attrs)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(f"this is not the result of a run: {type(error).__name__}: {error}") from None
    _check_times(result)
    return result


def _check_times(result: Result) -> None:
    time = result["time"].values
    for block in blocks(len(time)):
        some = time[max(block.start - 1, 0) : block.stop]
        if not (np.isfinite(some).all() and (np.diff(some) > 0.0).all()):
            raise InputError("this is not the result of a run: its times do not increase")
