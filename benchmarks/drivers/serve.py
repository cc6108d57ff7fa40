"""The process of one master: it does the jobs of masters.py, a line of JSON at a time, and reports how long they took.

A driver's `start` returns a master for a job. `run` advances all robots by its own loop with held torques,
which are set at every tick, and records; `tick` advances them once with the torques given, for a closed loop in Python.
"""

import gc
import json
import os
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import fmpy
import numpy as np
from numpy.typing import NDArray

OUTPUTS = ("x", "y", "psi", "gamma", "v", "omega")
TORQUES = ("tau_drive", "tau_steer")

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Job:
    """The job of a master.

    Attributes
    ----------
    fmu : str
        The plant, the same for all robots.
    start : list of dict
        Start values of each robot.
    torque : list of list
        Torques that `run` holds, of each robot.
    step : float
        Communication step [s].
    samples : int
        The most ticks of one `run`.
    options : dict
        Options of the driver.
    """

    fmu: str
    start: list[dict[str, float]]
    torque: list[list[float]]
    step: float
    samples: int
    options: dict[str, Any] = field(default_factory=dict)


class Master(Protocol):
    """All robots of a job under one master."""

    def run(self, ticks: int) -> None:
        """Advance by its own loop; `recorded` returns the records of this call."""

    def tick(self, torque: Floats) -> Floats:
        """Hold the torques (robots, 2), advance by one step and return the outputs (robots, 6)."""

    def outputs(self) -> Floats:
        """Return the outputs (robots, 6) as they are."""

    def recorded(self, ticks: int) -> Floats | None:
        """Return the records (ticks, robots, 6) of the last call of `run`, if it records."""


def references(fmu: str) -> dict[str, int]:
    """Return the value references of an FMU by name."""
    return {v.name: v.valueReference for v in fmpy.read_model_description(fmu, validate=False).modelVariables}


def serve(start: Callable[[Job], Master]) -> None:
    """Answer requests until there are no more."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # output of a master is no answer
    served: dict[str, Any] = {}
    for line in sys.stdin:
        try:
            answer = _answer(json.loads(line), served, start)
        except Exception as error:
            traceback.print_exc()
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), file=answers, flush=True)
    os._exit(0)  # not all masters end well


def _answer(request: dict[str, Any], served: dict[str, Any], start: Callable[[Job], Master]) -> dict[str, Any]:
    what = request.pop("what")
    if what == "start":
        served["master"], seconds = _timed(lambda: start(Job(**request["job"])))
        if loop := request.get("loop"):
            from closed_loop import ClosedLoop

            served["loop"] = ClosedLoop(served["master"], loop)
        return {"seconds": seconds}
    runner = served.get("loop") or served["master"]
    if what == "run":
        _, seconds = _timed(lambda: runner.run(request["ticks"]))
        return {"seconds": seconds}
    assert what == "record"
    recorded = runner.recorded(request["ticks"])
    arrays = {"outputs": served["master"].outputs()} | ({} if recorded is None else {"recorded": recorded})
    np.savez(request["path"], **arrays)
    return {}


def _timed(call: Callable[[], Any]) -> tuple[Any, float]:
    gc.collect()
    begin = time.perf_counter()
    result = call()
    return result, time.perf_counter() - begin
