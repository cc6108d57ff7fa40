"""The form that the result of a run has, which a file of a stranger may lack."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TypeAlias

import numpy as np

from cosim.clock import ROUNDING, Clock
from cosim.errors import InputError
from cosim.results.outlines import FORM as OUTLINES
from cosim.results.provenance import Provenance
from cosim.results.result import Result, Variable
from cosim.scenario.scenario import LEADER
from cosim.storage import blocks

Form: TypeAlias = Mapping[str, tuple[tuple[str, ...], bool]]
"""By the name of a variable its dimensions, and whether it holds texts."""

_TEXTS = ("scenario_name", "scenario", "status")
_TIMES = ("step", "horizon")
_OTHER_TEXTS = (
    *("title", "scenario_file", "changes", "versions", "controllers", "plants", "plant_messages", "verdicts"),
    *("files", "recording"),
)
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
_LEAST = {"robot": 1, "pose_component": 2, "outline_corner": 1}
"""By the name of a dimension the least entries along it."""


def in_form(result: Result) -> Result:
    """Return a result in the form that a run gives it.

    Whoever has edited it may have added variables, ordered dimensions in another way and left out robots or samples.
    The dimensions are ordered, ``vehicle`` names the leader and the robots, and signals are numbers: an added variable
    that holds none is left out.

    Raises
    ------
    InputError
        It lacks what every result of a run has, a variable has other dimensions, texts in place of numbers or the
        reverse, its times do not increase, its attributes make no sense, or it has a robot twice, or one of no vehicle.
    """
    for name in (*_TEXTS, *_TIMES, *_VARIABLES):
        if name not in (result if name in _VARIABLES else result.attrs):
            raise _strange(f"{name!r} is missing in it")
    for name in (*_TEXTS, *_OTHER_TEXTS):
        if not isinstance(told := result.attrs.get(name, ""), str):
            raise _strange(f"{name!r} is {told!r}, no text")
    for name in _TIMES:
        told = result.attrs[name]
        if not (isinstance(told, int | float | np.number) and 0.0 < float(told) < math.inf):
            raise _strange(f"its {name} is {told!r}, no time above zero")
    signals = {name: _in_form(name, one) for name, one in result.data_vars.items() if name in _FORM or _is_number(one)}
    result = Result(signals, {name: _in_form(name, one) for name, one in result.coords.items()}, result.attrs)
    for dim, least in _LEAST.items():
        if (size := result.sizes.get(dim, least)) < least:
            raise _strange(f"{dim!r} has {size} of at least {least} entries")
    try:
        Provenance.of(result.attrs)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise _strange(f"{type(error).__name__}: {error}") from None
    _check_times(result)
    result = _of_vehicles(result)
    _check_outlines(result)
    return result


def _strange(what: str) -> InputError:
    return InputError(f"this is not the result of a run: {what}")


def _in_form(name: str, variable: Variable) -> Variable:
    first = [dim for dim in ("time", "robot") if dim in variable.dims]
    order = *first, *(dim for dim in variable.dims if dim not in first)
    dims, text = _FORM.get(name, (("vehicle",) if name.startswith("vehicle_") else order, None))  # that of its geometry
    if sorted(variable.dims) != sorted(dims):
        told = f"has the dimensions ({', '.join(variable.dims)}), not ({', '.join(dims)})"
        raise _strange(f"{name!r} {told}")
    if text is not None and _is_number(variable) == text and variable.values.size:
        raise _strange(f"{name!r} holds {'numbers' if text else 'no numbers'}")
    values = variable.values if variable.values.dtype.kind != "b" else variable.values.astype(np.float64)
    return Variable(dims, values.transpose([variable.dims.index(dim) for dim in dims]), variable.attrs)


def _is_number(variable: Variable) -> bool:
    return variable.values.dtype.kind in "fiub"


def _of_vehicles(result: Result) -> Result:
    """Return a result whose vehicles are the leader and the robots, in this order."""
    wanted = (LEADER, *result.robots)
    if len(set(wanted)) < len(wanted):
        raise _strange("it has a robot twice")
    if "vehicle" not in result:  # in files of earlier versions, which have a row for each
        if result.sizes.get("vehicle", len(wanted)) != len(wanted):
            raise _strange("'vehicle' is missing in it")
        return result
    having = [str(name) for name in result["vehicle"].values]
    if missing := [name for name in wanted if name not in having]:
        raise _strange(f"'vehicle' does not name {missing[0]!r}")
    if tuple(having) == wanted:
        return result
    rows = [having.index(name) for name in wanted]
    data_vars, coords = (
        {name: one.taken("vehicle", rows) if "vehicle" in one.dims else one for name, one in group.items()}
        for group in (result.data_vars, result.coords)
    )
    return Result(data_vars, coords, result.attrs)


def _check_outlines(result: Result) -> None:
    if not any(name in result for name in OUTLINES):
        return
    for name in (*OUTLINES, "vehicle", "pose_name"):
        if name not in result:
            raise _strange(f"{name!r} is missing in it")
    if result.sizes["outline_axis"] != 2:
        raise _strange("'outline_axis' names no two axes")
    for names, turned_by in zip(result["pose_name"].values, result["outline_turned_by"].values, strict=True):
        if unknown := sorted(set(" ".join(map(str, turned_by)).split()) - set(map(str, names))):
            raise _strange(f"'pose_name' lacks {unknown[0]!r}, which turns a part")


def has_first_ticks(result: Result) -> bool:
    """Return whether the samples of a result are the first ticks of its run, none of them left out."""
    time = result["time"].values
    clock = Clock(float(result.attrs["step"]), len(time) - 1)
    return all((np.abs(time[block] - clock.times_in(block)) <= ROUNDING).all() for block in blocks(len(time)))


def _check_times(result: Result) -> None:
    time = result["time"].values
    for block in blocks(len(time)):
        some = time[max(block.start - 1, 0) : block.stop]
        if not (np.isfinite(some).all() and (np.diff(some) > 0.0).all()):
            raise _strange("its times do not increase")
