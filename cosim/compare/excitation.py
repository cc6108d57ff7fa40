"""The commands of a comparison: given by the user, or steps and sines that move a vehicle well."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError, Location, nearest
from cosim.scenario.csv_table import read_table
from cosim.signals.interpolation import interpolated
from cosim.vehicle.kind import Excitation, Kind
from plants import arrays


def given(
    kind: Kind, torque: str | Path | NDArray[np.float64], step: float, ticks: int
) -> tuple[NDArray[np.float64], str]:
    """Return commands (ticks, commands) in their roles' units from a table or an array, and where they come from.

    A command without a column is zero, and the last row of a table holds until the end; the text says both.

    Raises
    ------
    InputError
        They have another shape or are not finite; the table has no column for them, lacks one and has a column that is
        no command, does not begin by 0 s, or ends before.
    """
    if not isinstance(torque, (str, Path)):
        values = np.array(torque, dtype=np.float64)
        shape = (ticks, len(kind.command))
        if values.shape != shape or not np.isfinite(values).all():
            raise InputError(f"the {kind.command_word}s are an array {values.shape}; expected {shape} finite numbers")
        return values, "an array"
    where = Location(f"--torque {torque}")
    table = read_table(Path(torque), where)
    names = [role.name for role in kind.command]
    if not any(name in table.columns for name in names):
        raise InputError(f"the table {torque} has none of the columns {' and '.join(names)}", where)
    is_whole = all(name in table.columns for name in names)
    for name in () if is_whole else table.columns:  # of a command that is missing, perhaps the name with an error
        if name not in ("time", *names):
            raise InputError(
                f"the column {name!r} is no command of a {kind.name} vehicle: {nearest(name, names)} (the table is "
                f"named in {where})",
                Location(str(torque), 1),
            )
    first, last = float(table.time[0]), float(table.time[-1])
    if not first <= 0.0 <= last:
        gap = f"begins at {first:.12g} s, after" if first > 0 else f"ends at {last:.12g} s, before"
        raise InputError(f"the table {torque} {gap} the drive begins, at 0 s: give it rows from 0 s on", where)
    times = step * np.arange(ticks, dtype=np.float64)
    values = np.zeros((ticks, len(names)))
    for column, role in enumerate(kind.command):
        if role.name in table.columns:
            values[:, column] = interpolated(times, table.time, table.column(role.name, role.unit, where))
    told = [f"without {name}, which is 0" for name in names if name not in table.columns]
    if last < times[-1] - 1e-6 * step:
        told.append(f"its last row, at {last:.12g} s, holds until the end")
    return values, f"the table {torque}" + (f" ({'; '.join(told)})" if told else "")


_FREQUENCIES = ((0.10, 0.23, 0.61), (0.13, 0.37, 0.89))
"""Of the sines in drive and steering [Hz]."""
_PERIODS = (7.0, 5.0)
"""Of the steps in drive and steering [s]."""
_SPEED, _BEND = 1.0, math.radians(25)
"""Aims of the commands: the largest speed [m/s], and the largest change of the turned angle [rad]."""
_FAR = 0.1
"""Part of an aim below which it is missed by far."""
_ATTEMPTS = 6

Run = Callable[[NDArray[np.float64]], NDArray[np.float64] | None]


def excitation(kind: Kind, run: Run, step: float, ticks: int, seed: int) -> tuple[NDArray[np.float64], str]:
    """Return steps and sines (ticks, commands) that move a plant but keep it far from singular, with a description.

    Parameters
    ----------
    kind
        The kind of vehicle.
    run
        Drives the plant with commands and returns its states (ticks + 1, entries); None if it failed.
    step, ticks
        The communication step [s], and how many.
    seed
        Of the phases of the sines.
    """
    shape = _shape(step * np.arange(ticks, dtype=np.float64), seed)
    own = kind.excitation
    if own is None:
        raise InputError(f"the kind {kind.name} states no commands for a comparison: give them with --torque TABLE.csv")
    scale = np.array(own.size)
    for _ in range(_ATTEMPTS):
        torques = own.commands(shape * scale)
        states = run(torques)
        if states is None:
            scale = scale / 4
            continue
        speed, bent = _motion(own, states, step)
        wanted = np.array([_change(_SPEED, speed), _change(_BEND, bent)])
        if (np.abs(arrays.log(wanted)) < arrays.log(1.5)).all():
            break
        scale = np.array([float(f"{value:.2g}") for value in scale * wanted])
    units = (kind.command[0].unit, kind.command[-1].unit)
    said = " and ".join(f"{value:.2g} {unit}" for value, unit in zip(scale, units, strict=True))
    return own.commands(shape * scale), f"steps and sines of {said} (seed {seed})"


def missed(kind: Kind, states: NDArray[np.float64], step: float) -> str:
    """Return a sentence if steps and sines moved a plant with these states far less than they should; else nothing."""
    if kind.excitation is None:
        return ""
    speed, bent = _motion(kind.excitation, states, step)
    if speed > _FAR * _SPEED and bent > _FAR * _BEND:
        return ""
    return (
        f"the {kind.command_word}s move A at {speed:.2g} m/s at most and turn it by {math.degrees(bent):.2g} deg, far "
        f"less than the {_SPEED:g} m/s and {math.degrees(_BEND):.3g} deg that a comparison should have: give others "
        "with --torque TABLE.csv"
    )


def _motion(own: Excitation, states: NDArray[np.float64], step: float) -> tuple[float, float]:
    """Return the largest speed [m/s], and the largest change of the turned angle [rad]."""
    turned = own.turned(states)
    return float(np.abs(np.diff(states[:, :2], axis=0)).max() / step), float(np.abs(turned - turned[0]).max())


def _shape(times: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    """Return steps and sines (T, 2) in drive and steering, the first around 0.5, the second around zero."""
    phases = np.random.default_rng(seed).uniform(0.0, 2 * math.pi, (2, len(_FREQUENCIES[0])))
    columns = []
    for frequencies, own, period in zip(_FREQUENCIES, phases, _PERIODS, strict=True):
        sines = arrays.sin(2 * math.pi * np.outer(times, frequencies) + own).mean(axis=1)
        # From the middle of a step, so that its sum is around zero.
        steps = np.where(np.remainder(times / period + 0.25, 1.0) < 0.5, 1.0, -1.0)
        columns.append((sines + steps) / 2)
    columns[0] = (columns[0] + 1) / 2
    return np.column_stack(columns)


def _change(wanted: float, found: float) -> float:
    """Return the factor for a torque in the next attempt; 1 for a torque without an effect."""
    return min(max(wanted / found, 0.1), 10.0) if found > 1e-9 else 1.0
