"""The harness itself: the closed loop of a scenario as ``formation run`` runs it, in compiled code."""

from pathlib import Path

import numpy as np
from serve import Floats, Job, serve

import cosim


class Simulation:
    def __init__(self, job: Job) -> None:
        self.simulation = cosim.Simulation(cosim.read_scenario(Path(job.options["scenario"])))

    def run(self, ticks: int) -> None:
        last = self.simulation.tick + ticks
        while self.simulation.tick < last:
            if not self.simulation._ticks.some(last - self.simulation.tick):
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


def start(job: Job) -> Simulation:
    return Simulation(job)


if __name__ == "__main__":
    serve(start)
