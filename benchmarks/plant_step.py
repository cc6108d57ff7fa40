"""The cost of a plant: one Euler step of the car-like robot in its FMU, called from C, and building the FMU.

    python benchmarks/plant_step.py [REPETITIONS]

Times depend on the machine, so each is also given relative to a yardstick of the same run.
"""

import ctypes
import itertools
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import fmpy
from fmpy.fmi2 import FMU2Slave
from fmpy.model_description import ModelDescription

import plants
from plants import numeric
from plants.factory.compile import find_compiler

ROUNDS = 15

LOOPS = r"""
typedef int DoStep(void *instance, double time, double step, int no_set_state);

int nothing(void *instance, double time, double step, int no_set_state)
{
    (void)instance; (void)no_set_state;
    return time + step < 0.0;
}

int steps(DoStep *do_step, void *instance, long first, long n, double step)
{
    int status = 0;
    for (long k = first; k < first + n; k++) status |= do_step(instance, (double)k * step, step, 1);
    return status;
}
"""


def per_call(call: Callable[[], object], n: int) -> float:
    """Return the median time of one of the n things that a call does, in seconds."""
    times = []
    for _ in range(ROUNDS):
        begin = time.perf_counter()
        call()
        times.append(time.perf_counter() - begin)
    return statistics.median(times) / n


def loops(folder: Path) -> ctypes.CDLL:
    source, library = folder / "loops.c", folder / "loops.so"
    source.write_text(LOOPS)
    command = [*find_compiler().command, "-O2", "-shared", "-fPIC", "-o", str(library), str(source)]
    subprocess.run(command, check=True)
    return ctypes.CDLL(str(library))


def step_time(folder: Path, description: ModelDescription, c: ctypes.CDLL, solver: int, n: int) -> float:
    """Return the time of a communication step of 20 ms, on a circle."""
    references = {v.name: v.valueReference for v in description.modelVariables}
    fmu = FMU2Slave(guid=description.guid, unzipDirectory=str(folder), modelIdentifier="car_like", instanceName="car")
    fmu.instantiate()
    fmu.setReal([references[name] for name in ("gamma", "tau_drive")], [0.1, 8.0])
    fmu.setInteger([references["solver"]], [solver])
    fmu.setupExperiment()
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    do_step = ctypes.cast(fmu.dll.fmi2DoStep, ctypes.c_void_p)
    rounds = itertools.count()

    def run() -> None:
        if c.steps(do_step, fmu.component, n * next(rounds), n, 0.02) != 0:
            raise RuntimeError("the FMU did not complete a step")

    seconds = per_call(run, n)
    fmu.freeInstance()
    return seconds


def main(n: int) -> None:
    seconds = {}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        for fmi in ("2.0", "3.0"):
            plants.build("car_like", fmi=fmi)
            seconds[f"cold build, FMI {fmi}"] = per_call(
                lambda fmi=fmi: plants.build("car_like", fmi=fmi, cache=False), 1
            )
        seconds["cached build"] = per_call(lambda: plants.build("car_like"), 1)

        fmpy.extract(plants.build("car_like"), folder)
        description = fmpy.read_model_description(folder)
        c = loops(folder)
        c.steps.argtypes = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_long, ctypes.c_long, ctypes.c_double)

        for solver, name in ((1, "euler"), (2, "runge_kutta_4"), (3, "dormand_prince_45")):
            seconds[f"{name} step in the FMU"] = step_time(folder, description, c, solver, n)
        nothing = ctypes.cast(c.nothing, ctypes.c_void_p)
        seconds["empty C function"] = per_call(lambda: c.steps(nothing, None, 0, n, 0.02), n)

    functions = numeric.compile(plants.load("car_like"))
    x, u, p = functions.start() + 0.1, functions.inputs(tau_drive=8.0), functions.parameters()
    few = 2000

    def with_numpy() -> None:
        for _ in range(few):
            functions.euler(0.0, x, u, p, 0.02)

    seconds["Euler step in NumPy"] = per_call(with_numpy, few)

    empty, python = seconds["empty C function"], seconds["Euler step in NumPy"]
    print(f"medians of {ROUNDS} rounds of {n} steps ({few} in NumPy, 1 build)\n")
    print(f"{'':32}{'time':>14}{'empty C calls':>16}{'NumPy steps':>14}")
    for name, value in seconds.items():
        text = f"{value * 1e9:.1f} ns" if value < 1e-5 else f"{value * 1e3:.2f} ms"
        print(f"{name:32}{text:>14}{value / empty:>16.3g}{value / python:>14.3g}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200_000)
