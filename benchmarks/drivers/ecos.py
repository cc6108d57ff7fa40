"""ecos, by its Python interface ecospy.

`run` is one call of step(n), the loop of ecos in C++. Torques are set at every step because each is connected with
itself. ecos fetches the outputs at every step, since they have been asked for once; it records by the option `csv`
alone, into a text file, which is all that it offers.
"""

import contextlib
import ctypes
import sys
import tempfile
from pathlib import Path

import numpy as np
from serve import OUTPUTS, TORQUES, Floats, Job, Master, serve

with contextlib.suppress(OSError):  # TBB from the package tbb; else the system's
    ctypes.CDLL(str(Path(sys.prefix, "lib", "libtbb.so.12")), ctypes.RTLD_GLOBAL)
from ecospy import EcosLib, EcosSimulation, EcosSimulationStructure


class Ecos:
    def __init__(self, job: Job) -> None:
        EcosLib.set_log_level("off")
        structure = EcosSimulationStructure()
        parameters: dict[str, float] = {}
        self.robots = [f"robot_{i}" for i in range(len(job.start))]
        self.names = [[f"{robot}::{name}" for name in OUTPUTS] for robot in self.robots]
        self.torques = [[f"{robot}::{name}" for name in TORQUES] for robot in self.robots]
        for robot, start, torques, torque in zip(self.robots, job.start, self.torques, job.torque, strict=True):
            structure.add_model(robot, job.fmu)
            parameters |= {f"{robot}::{name}": float(value) for name, value in start.items()}
            parameters |= dict(zip(torques, map(float, torque), strict=True))
            if not job.options.get("closed_loop"):
                for name in torques:
                    structure.make_real_connection(name, name)
        structure.add_parameter_set("start", parameters)
        self.simulation = EcosSimulation(structure=structure, step_size=job.step)
        self.file = Path(tempfile.mkdtemp(), "ecos.csv") if job.options.get("csv") else None
        if self.file:
            self.simulation.add_csv_writer(str(self.file), identifiers=[f"*::{name}" for name in OUTPUTS])
        if not self.simulation.init(parameter_set="start"):
            raise RuntimeError(EcosLib.get_last_error())
        self.outputs()

    def run(self, ticks: int) -> None:
        self.simulation.step(ticks)

    def tick(self, torque: Floats) -> Floats:
        for names, own in zip(self.torques, torque.tolist(), strict=True):
            for name, value in zip(names, own, strict=True):
                self.simulation.set_real(name, value)
        self.simulation.step()
        return self.outputs()

    def outputs(self) -> Floats:
        return np.array([[self.simulation.get_real(name) for name in names] for names in self.names])

    def recorded(self, ticks: int) -> Floats | None:
        if self.file is None:
            return None
        self.simulation.terminate()  # writes the rest
        header, *lines = self.file.read_text().splitlines()
        columns = [column.partition("[")[0] for column in header.split(", ")]
        order = [columns.index(name) for names in self.names for name in names]
        rows = np.array([line.split(", ") for line in lines[-ticks:]], dtype=float)
        return rows[:, order].reshape(ticks, len(self.robots), len(OUTPUTS))


def start(job: Job) -> Master:
    return Ecos(job)


if __name__ == "__main__":
    serve(start)
