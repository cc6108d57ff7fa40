"""FMPy's own methods in a loop in Python; their results are kept in a list."""

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave
from serve import OUTPUTS, TORQUES, Floats, Job, Master, references, serve


def make_robots(job: Job) -> list[FMU2Slave]:
    """Return the robots of a job, initialised."""
    description = fmpy.read_model_description(job.fmu)
    directory = fmpy.extract(job.fmu)
    refs = references(job.fmu)
    robots = []
    for i, start in enumerate(job.start):
        robot = FMU2Slave(
            guid=description.guid,
            unzipDirectory=directory,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=f"robot_{i}",
        )
        robot.instantiate()
        robot.setReal([refs[name] for name in start], list(start.values()))
        robot.setupExperiment(startTime=0.0)
        robot.enterInitializationMode()
        robot.exitInitializationMode()
        robots.append(robot)
    return robots


class Fmpy:
    def __init__(self, job: Job) -> None:
        refs = references(job.fmu)
        self.torques = [refs[name] for name in TORQUES]
        self.names = [refs[name] for name in OUTPUTS]
        self.robots = make_robots(job)
        self.held = list(zip(self.robots, job.torque, strict=True))
        self.step = job.step
        self.now = 0
        self.kept: list[list[float]] = []

    def run(self, ticks: int) -> None:
        self.kept = []
        for k in range(self.now, self.now + ticks):
            for robot, torque in self.held:
                robot.setReal(self.torques, torque)
                robot.doStep(k * self.step, self.step)
                self.kept.append(robot.getReal(self.names))
        self.now += ticks

    def tick(self, torque: Floats) -> Floats:
        for robot, own in zip(self.robots, torque.tolist(), strict=True):
            robot.setReal(self.torques, own)
            robot.doStep(self.now * self.step, self.step)
        self.now += 1
        return self.outputs()

    def outputs(self) -> Floats:
        return np.array([robot.getReal(self.names) for robot in self.robots])

    def recorded(self, ticks: int) -> Floats:
        return np.array(self.kept).reshape(ticks, len(self.robots), len(OUTPUTS))


def start(job: Job) -> Master:
    return Fmpy(job)


if __name__ == "__main__":
    serve(start)
