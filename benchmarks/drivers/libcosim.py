"""libcosim, by its Python interface libcosimpy.

`run` is one call of step(n), the loop of libcosim in C++. An override manipulator sets the torques at every step, a
time-series observer records the outputs in memory. In a closed loop an observer of last values returns the outputs,
in one call a robot.
"""

import numpy as np
from libcosimpy.CosimEnums import CosimVariableType
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave
from serve import OUTPUTS, TORQUES, Floats, Job, Master, references, serve


class Libcosim:
    def __init__(self, job: Job) -> None:
        log_output_level(CosimLogLevel.FATAL)
        refs = references(job.fmu)
        self.names = [refs[name] for name in OUTPUTS]
        self.torques = [refs[name] for name in TORQUES]
        self.closed_loop = job.options.get("closed_loop", False)
        self.execution = CosimExecution.from_step_size(round(job.step * 1e9))
        self.slaves = [CosimLocalSlave(job.fmu, f"robot_{i}") for i in range(len(job.start))]
        self.robots = [self.execution.add_local_slave(slave) for slave in self.slaves]
        self.torque = CosimManipulator.create_override()
        self.last = CosimObserver.create_last_value()
        self.series = CosimObserver.create_time_series(10**9)
        done = [self.execution.add_manipulator(self.torque)]
        done.append(self.execution.add_observer(self.last if self.closed_loop else self.series))
        for robot, start, torque in zip(self.robots, job.start, job.torque, strict=True):
            done += [self.execution.real_initial_value(robot, refs[name], value) for name, value in start.items()]
            if not self.closed_loop:
                done += [self.series.start_time_series(robot, ref, CosimVariableType.REAL) for ref in self.names]
                done.append(self.torque.slave_real_values(robot, self.torques, torque))
        if not all(done):
            raise RuntimeError("libcosim has refused something")
        self.now = 0
        self.start = np.array([[start.get(name, 0.0) for name in OUTPUTS] for start in job.start])

    def run(self, ticks: int) -> None:
        if not self.execution.step(ticks):
            raise RuntimeError("libcosim has failed")
        self.now += ticks

    def tick(self, torque: Floats) -> Floats:
        for robot, own in zip(self.robots, torque.tolist(), strict=True):
            self.torque.slave_real_values(robot, self.torques, own)
        self.run(1)
        return self.outputs()

    def outputs(self) -> Floats:
        if self.now == 0:  # libcosim initialises the FMUs at the first step
            return self.start
        if not self.closed_loop:
            return self.recorded(1)[0]
        return np.array([self.last.last_real_values(robot, self.names) for robot in self.robots])

    def recorded(self, ticks: int) -> Floats:
        first = self.now - ticks + 1
        rows = [
            self.series.time_series_real_samples(robot, ref, first, ticks)[2]
            for robot in self.robots
            for ref in self.names
        ]
        return np.array(rows).T.reshape(ticks, len(self.robots), len(OUTPUTS))


def start(job: Job) -> Master:
    return Libcosim(job)


if __name__ == "__main__":
    serve(start)
