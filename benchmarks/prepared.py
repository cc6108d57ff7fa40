"""Many runs of one prepared scenario: the CPU time of a run, all in, against the loop in C and a run of its own.

    pip install -e controllers -e .
    python benchmarks/prepared.py [--runs N] [--workers N...] [--json FILE]

The scenario is scenarios/clmr_line.xml. Every run has another seed, mass, damping and start of a follower, and is
judged; only what that needs is recorded. Measured is all that a run in a study takes: the changed scenario is read and
set up, plants are reset, noise is drawn, the loop runs, and its figures are computed.

1. A run of the prepared scenario, the same by `cosim.run`, and the loop alone in C (closed_loop.c: plants, law,
   saturation and records of one run; no noise is drawn, nothing is read or judged), in turns in one process.
2. The parts of a prepared run.
3. The peak of memory after a tenth of the runs and after all.
4. Runs a second in so many processes, each with a scenario that it has prepared, by the clock.

CPU times are those of the process.
"""

import argparse
import gc
import json
import multiprocessing
import resource
import statistics
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from loop_in_c import LoopInC, compiled
from teams import SCENARIO

import cosim
from cosim.master import prepared as parts_of_a_run
from cosim.master.simulation import Simulation

PARTS: dict[str, tuple[Any, str]] = {
    "reading the changed scenario": (parts_of_a_run.Variations, "edited"),
    "setting up": (parts_of_a_run, "set_up"),
    "restarting plants, laws, records": (Simulation, "__init__"),
    "loop, noise and result": (Simulation, "run_to_end"),
    "judging": (parts_of_a_run, "judge"),
    "figures": (parts_of_a_run, "follower_figures"),
}
"""The parts of a run, and the functions in which they are done."""
IN_C = 10  # runs in C for each ten of ours


def changes(run: int) -> list[str]:
    """Return the changes of a run: the same whatever ran before."""
    random = np.random.default_rng(run)
    mass, damping, start = random.uniform(20, 40), random.uniform(15, 35), random.uniform(-2, 2)
    return [
        f"simulation/@seed={run}",
        f"plant/parameter[@name='m_c']/@value={mass!r} kg",
        f"plant/parameter[@name='d_x']/@value={damping!r} N.s/m",
        f"follower[1]/pose/@y={start!r} m",
    ]


def cpu(action: Callable[[], object]) -> float:
    gc.collect()
    begin = time.process_time()
    action()
    return time.process_time() - begin


def peak() -> float:
    """Return the peak of this process's memory [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def timed_parts(spent: dict[str, float]) -> None:
    """Let the parts of a run add up their CPU times."""

    def timed(part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **named: Any) -> Any:
            begin = time.process_time()
            try:
                return function(*arguments, **named)
            finally:
                spent[part] += time.process_time() - begin

        return call

    for part, (owner, name) in PARTS.items():
        setattr(owner, name, timed(part, getattr(owner, name)))


def work(share: list[int], ready: Any) -> None:
    """Run a share of the runs, once all workers have prepared the scenario."""
    with cosim.Prepared(cosim.read_scenario(SCENARIO)) as prepared:
        prepared.run()
        ready.wait()
        for run in share:
            prepared.run(changes(run))


def runs_a_second(workers: int, runs: int) -> float:
    context = multiprocessing.get_context("spawn")
    ready = context.Barrier(workers + 1)
    processes = [
        context.Process(target=work, args=(list(range(worker, runs, workers)), ready)) for worker in range(workers)
    ]
    for process in processes:
        process.start()
    ready.wait()
    begin = time.perf_counter()
    for process in processes:
        process.join()
    return runs / (time.perf_counter() - begin)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--workers", type=int, nargs="*", default=[1, 2])
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all of it there, too")
    options = parser.parse_args()
    scenario = cosim.read_scenario(SCENARIO)
    with cosim.Simulation(scenario) as simulation:
        loop = LoopInC(compiled(), simulation)
        simulation.run()
    times: dict[str, list[float]] = defaultdict(list)
    memory = []
    with cosim.Prepared(scenario) as prepared:
        prepared.run()
        for run in range(options.runs):
            times["prepared"].append(cpu(lambda: prepared.run(changes(run))))  # noqa: B023
            if run % IN_C == 0:
                alone = scenario.edited(changes(run))
                times["alone"].append(cpu(lambda: cosim.run(alone)))  # noqa: B023
                times["in C"] += [cpu(loop.run) for _ in range(IN_C)]
            if run in (options.runs // 10, options.runs - 1):
                memory.append(peak())
        spent: dict[str, float] = defaultdict(float)
        timed_parts(spent)
        for run in range(options.runs // 4):
            prepared.run(changes(run))
    table = {name: {"min": 1e3 * min(own), "median": 1e3 * statistics.median(own)} for name, own in times.items()}
    parts = {part: 1e3 * spent[part] / (options.runs // 4) for part in PARTS}
    speed = {workers: runs_a_second(workers, options.runs) for workers in options.workers}

    print(
        f"CPU time of a run of {SCENARIO.name}, {scenario.ticks + 1} ticks, {len(scenario.followers)} followers [ms]\n"
    )
    for name, own in table.items():
        cells = (f"{key} {own[key]:7.2f} ({own[key] / table['in C'][key]:5.2f} x C)" for key in own)
        print(f"{name:10}", *cells)
    print("\nof a prepared run, on average [ms]\n")
    for part, spent_in_it in parts.items():
        print(f"{part:34} {spent_in_it:6.2f}")
    early, late = memory
    print(f"\npeak of memory: {early:.0f} MB after {options.runs // 10} runs, {late:.0f} MB after {options.runs}")
    for workers, rate in speed.items():
        print(f"{workers} processes: {rate:.1f} runs a second, 10,000 in {10_000 / rate:.0f} s")
    if options.json:
        told = {"milliseconds": table, "parts": parts, "memory": memory, "runs a second": speed}
        options.json.write_text(json.dumps(told, indent=1) + "\n")


if __name__ == "__main__":
    main()
