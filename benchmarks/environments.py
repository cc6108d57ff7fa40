"""What it costs to run a controller in an environment of its own: the same run with its law here and there, in turns.

    pip install -e controllers -e .
    python benchmarks/environments.py [--rounds N] [--horizon SECONDS] [--environment DIR]

The scenario is scenarios/clmr_line.xml. The environment is by default the one in which this program runs, so the law
and its libraries are the same, and the results have to be, to the bit. Three ways:

1. here, called by compiled code,
2. in a host, by one exchange through shared memory a tick,
3. a law in plain Python here, which makes each tick one of Python: what a host does not do.

Printed are the time by the clock of the loop, and the CPU time of all processes together, per tick: the least of all
rounds, as a multiple of the first way, and in brackets the median of the ratios of all rounds.
"""

import argparse
import gc
import resource
import statistics
import sys
import time
from collections import defaultdict
from pathlib import Path

import numpy as np

import cosim
from cosim.control.team_elsewhere import TeamElsewhere
from cosim.scenario.scenario import Scenario

LINE = Path(__file__).parents[1] / "scenarios" / "clmr_line.xml"
HERE, THERE, BY_TICKS = "here", "in a host", "here, tick by tick"


class EveryTick:
    """An observer that lets each tick be one of Python."""

    every_tick = True

    def started(self, watched: object) -> None:
        """Watch."""

    def ticked(self, tick: int) -> None:
        """Do nothing."""

    def ended(self, failure: object) -> None:
        """Watch no more."""


def hosted(scenario: Scenario, environment: Path) -> Scenario:
    """Return the scenario with its controllers in an environment."""
    from cosim.scenario.edits import set_environment

    laws = {one.name: (one.package, "0.1.0") for one in scenario.controllers.values()}
    for name in scenario.controllers:
        scenario = scenario.edited([set_environment(name, environment, laws)])
    return scenario


def cpu(process: int) -> float:
    """Return the CPU time [s] of a process."""
    return time.clock_gettime((~process << 3) | 2)


def run(scenario: Scenario, by_ticks: bool = False) -> tuple[float, float, np.ndarray]:
    """Return the time by the clock, the CPU time and the poses of a run; its first tick is not counted."""
    with cosim.Simulation(scenario, observers=[EveryTick()] if by_ticks else ()) as simulation:
        simulation.step()
        simulation.step()
        processes = {team.host.process.number for team in simulation._teams if isinstance(team, TeamElsewhere)}
        gc.collect()
        used = sum(map(cpu, processes)) + resource.getrusage(resource.RUSAGE_SELF).ru_utime
        used += resource.getrusage(resource.RUSAGE_SELF).ru_stime
        begin = time.perf_counter()
        simulation.run_to_end()
        taken = time.perf_counter() - begin
        now = resource.getrusage(resource.RUSAGE_SELF)
        used = sum(map(cpu, processes)) + now.ru_utime + now.ru_stime - used
        return taken, used, simulation.result()["pose"].values


def main() -> None:
    """Run all ways in turns, and print what they cost."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--horizon", type=float, default=100.0)
    parser.add_argument("--environment", type=Path, default=Path(sys.prefix))
    options = parser.parse_args()
    scenario = cosim.read_scenario(LINE).edited(horizon=options.horizon, expectations=False)
    ways = {HERE: scenario, THERE: hosted(scenario, options.environment), BY_TICKS: scenario}
    costs: dict[str, list[tuple[float, float]]] = defaultdict(list)
    expected = None
    for number in range(options.rounds + 1):
        for way, its in ways.items():
            *cost, poses = run(its, way == BY_TICKS)
            expected = poses if expected is None else expected
            if not np.array_equal(poses, expected):
                raise SystemExit(f"{way}: other numbers")
            if number:  # the first round compiles
                costs[way].append((cost[0] / scenario.ticks, cost[1] / scenario.ticks))
    for place, what in enumerate(("wall", "CPU")):
        base = [cost[place] for cost in costs[HERE]]
        for way, own in costs.items():
            here = [cost[place] for cost in own]
            ratio, median = min(here) / min(base), statistics.median(np.divide(here, base))
            more = 1e6 * (min(here) - min(base))
            print(f"{what:5} {way:20} {1e6 * min(here):8.2f} us a tick  x {ratio:.2f} ({median:.2f})  {more:+.2f} us")


if __name__ == "__main__":
    main()
