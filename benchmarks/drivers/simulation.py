"""The harness itself: the closed loop of a scenario as ``formation run`` runs it.

With the option `controllers` the time spent in control laws is taken; that costs a little time of its own.
"""

import time
from pathlib import Path
from typing import Any

import formation_controllers as fc
import numpy as np
from serve import Floats, Job, serve

import cosim


class Simulation:
    def __init__(self, job: Job) -> None:
        self.scenario = cosim.read_scenario(Path(job.options["scenario"]))
        if job.options.get("controllers"):
            for source in self.scenario.controllers.values():
                self._time(fc.load(source.name))
        self.simulation = cosim.Simulation(self.scenario)
        self.controllers = 0.0

    def run(self, ticks: int) -> None:
        self.controllers = 0.0
        for _ in range(ticks):
            self.simulation.step()

    def tick(self, torque: Floats) -> Floats:
        raise NotImplementedError("the harness has its own controllers")

    def outputs(self) -> Floats:
        return self.recorded(1)[-1]

    def recorded(self, ticks: int) -> Floats:
        result = self.simulation.result()
        leader = np.concatenate([result["leader_pose"], result["leader_velocity"]], axis=1)
        followers = np.concatenate([result["pose"], result["velocity"]], axis=2)
        return np.concatenate([leader[:, None], followers], axis=1)

    def _time(self, law: Any) -> None:
        step = law.step

        def timed(*arguments: object, **named: object) -> object:
            begin = time.perf_counter()
            torque = step(*arguments, **named)
            self.controllers += time.perf_counter() - begin
            return torque

        law.step = timed


def start(job: Job) -> Simulation:
    return Simulation(job)


if __name__ == "__main__":
    serve(start)
