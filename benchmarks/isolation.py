"""What it costs to keep FMUs out of the process that judges and writes: the same run in several ways, in turns.

    pip install -e controllers -e .
    python benchmarks/isolation.py [--followers N...] [--rounds N] [--ticks N] [--json FILE]

The scenario is scenarios/clmr_line.xml with as many followers, its model as an FMU file. It runs

1. in the harness (isolate="no"),
2. in the process that the harness supervises, as by default: the whole loop is there,
3. with the FMU in a process of its own (isolate="process"): the loop is here, the plants there,
4. likewise in two: the leader's plant is a copy of the file.

The result has to be the same in each way, to the bit. Printed are the time by the clock and the CPU time of all
processes together, each per tick and as a multiple of the run in the harness, and how often a process has waited. A
ratio is that of the fastest rounds, and in brackets the median of the ratios of all rounds: the machine may be busy.
Few ticks are stepped from Python in a process of its own: compiled code takes longer to load than it saves.
"""

import argparse
import gc
import json
import os
import shutil
import statistics
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
from lxml import etree
from teams import STEP, team_scenario

import cosim
import plants
from cosim.master.supervised import whole_run
from cosim.scenario.scenario import Scenario

HARNESS = "in the harness"
WAYS = {HARNESS: "no", "supervised": "", "a process of its own": "process", "two processes": "process"}
"""The ways, each with ``isolate`` of its plants."""
COSTS = ("wall", "CPU", "waits")


def scenarios(followers: int, ticks: int, folder: Path) -> dict[str, Scenario]:
    """Return the scenario for each way."""
    first, second = (folder / f"{name}.fmu" for name in ("vehicle", "leader"))
    for file in (first, second):
        shutil.copyfile(plants.build("car_like"), file)
    found = {}
    for way, isolate in WAYS.items():
        path = team_scenario(followers, ticks, folder)
        tree = etree.parse(str(path))
        (plant,) = tree.findall("{*}plant")
        del plant.attrib["model"]
        plant.set("fmu", str(first))
        if isolate:
            plant.set("isolate", isolate)
        if way == "two processes":
            other = etree.fromstring(etree.tostring(plant))
            other.set("id", "other")
            other.set("fmu", str(second))
            plant.addnext(other)
            tree.find("{*}leader").set("plant", "other")
        tree.write(str(path), xml_declaration=True, encoding="UTF-8")
        found[way] = cosim.read_scenario(path)
    return found


def processes() -> list[int]:
    """Return this process and its children."""
    children = [Path(f"/proc/self/task/{task}/children").read_text().split() for task in os.listdir("/proc/self/task")]
    return [os.getpid(), *(int(child) for own in children for child in own)]


def cpu(process: int) -> float:
    return time.clock_gettime((~process << 3) | 2)


def waits(process: int) -> int:
    """Return how often the main thread of a process has waited for something."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("voluntary"))


def run(scenario: Scenario) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    """Run a scenario; return the costs of its loop, and the result."""
    with whole_run(scenario) as whole:
        gc.collect()
        at_work = processes()
        before = [(cpu(process), waits(process)) for process in at_work]
        begin = time.perf_counter()
        result = whole.run_to_end()
        wall = time.perf_counter() - begin
        spent = [(cpu(process) - at, waits(process) - of) for process, (at, of) in zip(at_work, before, strict=True)]
    costs = (wall, *(sum(own) for own in zip(*spent, strict=True)))
    values = {name: variable.values for name, variable in result.dataset.variables.items()}
    return dict(zip(COSTS, costs, strict=True)), {name: own for name, own in values.items() if own.dtype.kind == "f"}


def measured(followers: int, ticks: int, rounds: int) -> dict[str, dict[str, list[float]]]:
    """Return the costs of each round in each way."""
    costs: dict[str, dict[str, list[float]]] = {way: defaultdict(list) for way in WAYS}
    with tempfile.TemporaryDirectory() as folder:
        ways = scenarios(followers, ticks, Path(folder))
        expected: dict[str, np.ndarray] = {}
        for number in range(rounds + 1):  # the first one loads and is not counted
            for way, scenario in ways.items():
                own, result = run(scenario)
                expected = expected or result
                if different := [name for name in expected if not np.array_equal(expected[name], result[name], True)]:
                    raise SystemExit(f"{way}: other values of {', '.join(different)}")
                for cost, spent in own.items() if number else ():
                    costs[way][cost].append(spent / ticks)
    return costs


def ratios(costs: dict[str, dict[str, list[float]]], way: str, cost: str) -> tuple[float, float]:
    """Return a cost as a multiple of that in the harness: of the fastest rounds, and the median of all."""
    own, base = costs[way][cost], costs[HARNESS][cost]
    return min(own) / min(base), statistics.median(one / other for one, other in zip(own, base, strict=True))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--followers", type=int, nargs="*", default=[4, 100])
    parser.add_argument("--rounds", type=int, default=20)
    parser.add_argument("--ticks", type=int, default=20_000)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all of it there, too")
    options = parser.parse_args()
    told: dict[int, object] = {}
    for followers in options.followers:
        costs = measured(followers, options.ticks, options.rounds)
        print(
            f"{followers} followers, {options.ticks * STEP:g} s, the same bits; minimum (median) of {options.rounds}\n"
        )
        for way, own in costs.items():
            cells = []
            for cost in ("wall", "CPU"):
                fastest, usual = 1e6 * min(own[cost]), 1e6 * statistics.median(own[cost])
                best, middle = ratios(costs, way, cost)
                cells.append(f"{cost} {fastest:6.1f} ({usual:6.1f}) us a tick, x {best:4.2f} ({middle:4.2f})")
            print(f"{way:20}", *cells, f"waits {statistics.median(own['waits']):4.2f}", sep="  ")
        print()
        told[followers] = {way: {cost: own[cost] for cost in COSTS} for way, own in costs.items()}
    if options.json:
        options.json.write_text(json.dumps(told, indent=1) + "\n")


if __name__ == "__main__":
    main()
