"""CoFmuPy, by its coordinator and master; the master records all outputs in lists.

It sets all inputs of an FMU at every step, one call each, and gets all outputs, one call each.
"""

import numpy as np
from cofmupy import Coordinator
from serve import OUTPUTS, TORQUES, Floats, Job, Master, serve


class CoFmu:
    def __init__(self, job: Job) -> None:
        self.step = job.step
        self.robots = [f"robot_{i}" for i in range(len(job.start))]
        self.coordinator = Coordinator()
        fmus = [
            {"id": robot, "path": job.fmu, "initialization": {**start, **dict(zip(TORQUES, torque, strict=True))}}
            for robot, start, torque in zip(self.robots, job.start, job.torque, strict=True)
        ]
        self.coordinator.start({"fmus": fmus, "connections": []})
        self.master = self.coordinator.master

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            self.coordinator.do_step(self.step)

    def tick(self, torque: Floats) -> Floats:
        given = {
            robot: {name: [value] for name, value in zip(TORQUES, own, strict=True)}
            for robot, own in zip(self.robots, torque.tolist(), strict=True)
        }
        done = self.master.do_step(self.step, input_dict=given)
        return np.array([[done[robot][name][0] for name in OUTPUTS] for robot in self.robots])

    def outputs(self) -> Floats:
        variable = self.coordinator.get_variable
        return np.array([[variable((robot, name))[0] for name in OUTPUTS] for robot in self.robots])

    def recorded(self, ticks: int) -> Floats:
        results = self.coordinator.get_results()
        rows = [results[robot, name][-ticks:] for robot in self.robots for name in OUTPUTS]
        return np.array(rows).T.reshape(ticks, len(self.robots), len(OUTPUTS))


def start(job: Job) -> Master:
    return CoFmu(job)


if __name__ == "__main__":
    serve(start)
