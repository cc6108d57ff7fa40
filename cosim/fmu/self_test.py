"""FMUs that test themselves: their reference experiments are replayed, each in a process of its own, and compared.

The draft standard defines experiments, but not how close an importer must come. Here a variable may differ by
the experiment's tolerance, or `TOLERANCE` if it states none, times the variable's largest magnitude in the references.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim import process_tree
from cosim.errors import printable
from cosim.fmu.binaries import check_binary
from cosim.fmu.interfaces import choose_interface, interfaces
from cosim.fmu.package import Package
from cosim.fmu.reference_experiments import Experiment
from cosim.fmu.reference_series import Series
from cosim.fmu.replay import FAILURE, REQUEST, RESULT, Request
from cosim.plant.interpreter import environment, kill, wait
from cosim.plant.spec import CO_SIMULATION, FLOAT_TYPES
from plants import scratch

TOLERANCE = 1e-4
"""Relative tolerance of an experiment that states none."""
ROUNDING = 1e-12
"""Absolute tolerance that is added, for a variable whose references are all zero."""
TIME_LIMIT = 60.0
"""Default time limit of an experiment [s]."""
_MAX_TEXT = 2000


@dataclass(frozen=True)
class Agreement:
    """How far a variable is from its references.

    Attributes
    ----------
    variable
        Its name; an array's elements count together.
    largest, time
        The largest difference, and where it is [s]. It is infinite where the FMU gave no number.
    allowed
        The largest difference that counts as agreement.
    """

    variable: str
    largest: float
    time: float
    allowed: float

    @property
    def holds(self) -> bool:
        """Whether the difference is allowed."""
        return self.largest <= self.allowed


@dataclass(frozen=True)
class Replay:
    """Outcome of an experiment: how its variables agree, or why it failed."""

    experiment: Experiment
    agreements: tuple[Agreement, ...]
    failure: str = ""

    @property
    def holds(self) -> bool:
        """Whether it ran, and all variables agree."""
        return not self.failure and all(agreement.holds for agreement in self.agreements)


def replay(package: Package, experiment: Experiment, time_limit: float = TIME_LIMIT) -> Replay:
    """Replay an experiment of an FMU in a process of its own, and compare.

    Raises
    ------
    InputError
        The FMU cannot be run on this machine.
    """
    interface = choose_interface(package, "", None)
    check_binary(package, interfaces(package.description)[interface].modelIdentifier, None)
    with scratch.folder(Path(tempfile.gettempdir()), "formation-replay-") as folder:
        (folder / REQUEST).write_text(_request(package, experiment, interface), "utf-8")
        failure = _in_a_process(folder, time_limit)
        if not failure and (folder / FAILURE).is_file():
            with (folder / FAILURE).open("rb") as file:
                failure = printable(file.read(_MAX_TEXT).decode("utf-8", "replace")).strip() or "it failed"
        if failure:
            return Replay(experiment, (), failure)
        rows = _rows(folder / RESULT, experiment.references)
    if rows is None:
        return Replay(experiment, (), "its process has ended without a result")
    return Replay(experiment, tuple(_agreements(package, experiment, rows)))


def _request(package: Package, experiment: Experiment, interface: str) -> str:
    stimuli = experiment.stimuli
    request: Request = {
        "directory": str(package.directory),
        "interface": "CoSimulation" if interface == CO_SIMULATION else "ModelExchange",
        "start": experiment.start,
        "stop": experiment.stop,
        "step": experiment.step,
        "tolerance": experiment.tolerance,
        "values": dict(experiment.values),
        "stimuli": None if stimuli is None else {"columns": list(stimuli.columns), "rows": _table(stimuli).tolist()},
        "outputs": {
            name: column.shape[1]
            for name, column in (experiment.references.columns if experiment.references else {}).items()
        },
    }
    return json.dumps(request)


def _table(series: Series) -> NDArray[np.float64]:
    return np.column_stack([series.time, *series.columns.values()])


# The process ------------------------------------------------------------------------------------------------


def _in_a_process(folder: Path, time_limit: float) -> str:
    """Run `cosim.fmu.replay`, and return why it failed; empty if it did not."""
    mark = process_tree.new_mark()
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "cosim.fmu.replay", str(folder)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,  # output of the FMU
        stderr=subprocess.DEVNULL,
        env=environment(mark),
        start_new_session=os.name == "posix",
    )
    try:
        status = wait(process, mark, time_limit)
    except subprocess.TimeoutExpired:
        return f"it did not end within {time_limit:g} s; its process was ended"
    finally:
        kill(process, mark)
    if status < 0:
        name = signal.Signals(-status).name if -status in set(signal.Signals) else f"signal {-status}"
        return f"its process crashed ({name})"
    return "" if status == 0 else f"its process exited with status {status}"


def _rows(file: Path, references: Series | None) -> NDArray[np.float64] | None:
    """Return time and variables row by row; None if they are not there."""
    width = 1 + sum(column.shape[1] for column in references.columns.values()) if references is not None else 1
    try:
        numbers = np.fromfile(file)
    except OSError:
        return None
    return numbers.reshape(-1, width) if numbers.size and numbers.size % width == 0 else None


# Comparing --------------------------------------------------------------------------------------------------


def _agreements(package: Package, experiment: Experiment, rows: NDArray[np.float64]) -> Iterator[Agreement]:
    if experiment.references is None:
        return
    types = {variable.name: variable.type for variable in package.description.modelVariables}
    tolerance = TOLERANCE if experiment.tolerance is None else experiment.tolerance
    wanted, place = experiment.references.time, 1
    for name, column in experiment.references.columns.items():
        given = rows[:, place : place + column.shape[1]]
        place += column.shape[1]
        differences = np.abs(_nearest(rows[:, 0], given, wanted, column, smooth=types[name] in FLOAT_TYPES)).max(axis=1)
        differences[np.isnan(differences)] = np.inf
        worst = int(differences.argmax())
        allowed = tolerance * float(np.abs(column).max()) + ROUNDING
        yield Agreement(name, float(differences[worst]), float(wanted[worst]), allowed)


def _nearest(
    time: NDArray[np.float64],
    given: NDArray[np.float64],
    wanted: NDArray[np.float64],
    references: NDArray[np.float64],
    *,
    smooth: bool,
) -> NDArray[np.float64]:
    """Return how far a variable is from its references at their times; not a number where it has no value.

    At a jump, where a time has several values, the nearest one counts. Between two points in time a number of type
    float is interpolated, any other keeps its value.
    """
    same = 1e-9 * max(1.0, float(np.abs(wanted).max()))
    first, last = np.searchsorted(time, wanted - same), np.searchsorted(time, wanted + same, side="right")
    differences = np.full(references.shape, np.nan)
    for k, (a, b) in enumerate(zip(first, last, strict=True)):
        if a < b:
            differences[k] = np.abs(given[a:b] - references[k]).min(axis=0)
        elif 0 < a < len(time):
            share = (wanted[k] - time[a - 1]) / (time[a] - time[a - 1]) if smooth else 0.0
            differences[k] = given[a - 1] + share * (given[a] - given[a - 1]) - references[k]
    return differences
