"""A loop in C without any master: set, step, get and record.

No master can be faster; this is the cost of the plants themselves.
"""

import ctypes
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from fmpy_methods import make_robots
from serve import OUTPUTS, TORQUES, Floats, Job, Master, references, serve

from plants.factory.compile import find_compiler

SOURCE = r"""
#include <stddef.h>

typedef int Set(void *, const unsigned *, size_t, const double *);
typedef int Step(void *, double, double, int);
typedef int Get(void *, const unsigned *, size_t, double *);

int run(Set *set, Step *step, Get *get, void **robot, long n, const unsigned *in, const unsigned *out,
        const double *torque, double *kept, long first, long ticks, double h)
{
    int status = 0;
    for (long k = first; k < first + ticks; k++)
        for (long i = 0; i < n; i++, kept += 6) {
            status |= set(robot[i], in, 2, torque + 2 * i);
            status |= step(robot[i], (double)k * h, h, 1);
            status |= get(robot[i], out, 6, kept);
        }
    return status;
}
"""


def compiled() -> ctypes.CDLL:
    with tempfile.TemporaryDirectory() as scratch:
        source, library = Path(scratch, "loop.c"), Path(scratch, "loop.so")
        source.write_text(SOURCE)
        command = [*find_compiler().command, "-O2", "-shared", "-fPIC", "-o", str(library), str(source)]
        subprocess.run(command, check=True)
        return ctypes.CDLL(str(library))


class CLoop:
    def __init__(self, job: Job) -> None:
        refs = references(job.fmu)
        self.robots = make_robots(job)
        self.components = (ctypes.c_void_p * len(self.robots))(*(robot.component for robot in self.robots))
        self.set, self.do_step, self.get = (
            ctypes.cast(self.robots[0].dll[name], ctypes.c_void_p)
            for name in ("fmi2SetReal", "fmi2DoStep", "fmi2GetReal")
        )
        self.torques = (ctypes.c_uint * 2)(*(refs[name] for name in TORQUES))
        self.names = (ctypes.c_uint * 6)(*(refs[name] for name in OUTPUTS))
        self.torque = np.array(job.torque, dtype=float)
        self.kept = np.full((job.samples, len(self.robots), len(OUTPUTS)), np.nan)
        self.step = ctypes.c_double(job.step)
        self.now = 0
        self.c = compiled()
        for robot, torque in zip(self.robots, job.torque, strict=True):
            robot.setReal(list(self.torques), torque)

    def run(self, ticks: int) -> None:
        self._advance(self.torque, ticks)

    def tick(self, torque: Floats) -> Floats:
        self._advance(torque, 1)
        return self.kept[0]

    def _advance(self, torque: Floats, ticks: int) -> None:
        n, first, count = (ctypes.c_long(number) for number in (len(self.robots), self.now, ticks))
        assert ticks <= len(self.kept)
        pointers = (ctypes.c_void_p(array.ctypes.data) for array in (torque, self.kept))
        calls = (self.set, self.do_step, self.get, self.components, n, self.torques, self.names)
        status = self.c.run(*calls, *pointers, first, count, self.step)
        if status != 0:
            raise RuntimeError("a call of the FMU did not succeed")
        self.now += ticks

    def outputs(self) -> Floats:
        return np.array([robot.getReal(list(self.names)) for robot in self.robots])

    def recorded(self, ticks: int) -> Floats:
        return self.kept[:ticks]


def start(job: Job) -> Master:
    return CLoop(job)


if __name__ == "__main__":
    serve(start)
