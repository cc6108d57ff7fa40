"""The closed loop of scenarios/clmr_line.xml against the same loop in C: CPU time, and its parts.

    pip install -e controllers -e .
    python benchmarks/closed_loop.py [--followers N...] [--rounds N] [--ticks N] [--json FILE]

closed_loop.c is the lower bound: plants, control law, saturation and records in one hand-written file, nothing else. It
is compiled by the C compiler of this machine for any processor, with -O3 -ffp-contract=off, and calls the C library's
sine, exponential function and so on. Where the plants' FMU brings functions of its own, it is compiled with these, too.

1. The loop: `cosim.Simulation.run`, less what the result takes that it returns, against one call in C. Everything that
   a result holds is recorded by both. Not measured is what comes before: reading, FMUs, robots, arrays. The first tick,
   in which the law is started, belongs to the loop. Random numbers are drawn in our loop and handed to the one in C.
2. The plants alone: our fleet, moved by the torques of the run, `cosim.plant.fleet.Fleet.run`, and the same in C.
3. The law alone: a team of 100 by `Controller.step`, in which a call from Python is shared by many, and the same in C.
   The team is made of the first followers of the run, and gets their measured poses, tick by tick.
4. The rest is what our loop takes besides plants and law. In C nothing is left.
5. The result: from records to the variables computed from them, units and provenance; in C, the variables.

Larger teams are copies of the four followers. Before anything is printed, all numbers are compared: every variable of
the result, the states of the plants alone, the commands of the law alone. They are equal to the bit where both call the
same functions, and else, as the loop damps differences, to rounding.

Ours and C take turns in one process. CPU times are those of the process.
"""

import argparse
import gc
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import formation_controllers as fc
import numpy as np
from loop_in_c import DESIRED, STATE, LoopInC, compiled, own_functions
from numpy.typing import NDArray
from teams import team_scenario

import cosim

sys.path.insert(0, str(Path(__file__).parent / "drivers"))
from ours import Ours
from serve import OUTPUTS, Job

RUNS = {1: (5001, 9), 100: (1024, 5), 1000: (512, 3)}
"""Ticks and rounds, from that many followers on. Our loop draws the noise of 256 ticks at once, or of 1,024."""
TEAM = 100  # of the law alone
IN_TURN = 4  # runs in C for each of ours
AGREEMENT = 1e-10  # differences of 4e-15 in every measurement make 7e-12 [N.m] of torques

LOOP, PLANTS, LAW, REST, RESULT = "loop, all recorded", "plants alone", "law alone", "rest of the loop", "result"
WAYS = ("ours", "C")
OWN = "C, own functions"

Times = dict[tuple[str, str], list[float]]  # of each part, by ours and C [s per follower and tick]
Differences = dict[str, dict[str, float]]  # of what is compared, by name


def cpu(action: Callable[[], object]) -> float:
    gc.collect()
    begin = time.process_time()
    action()
    return time.process_time() - begin


def apart(ours: NDArray[Any], c: NDArray[Any], what: str) -> float:
    """Return by how much the numbers differ, at most; end if it is more than rounding."""
    if ours.shape != c.shape:
        raise SystemExit(f"{what} has shape {ours.shape}, and {c.shape} in C")
    if np.array_equal(ours, c):
        return 0.0
    distance = float(np.abs(ours - c).max())
    if not distance <= AGREEMENT:
        raise SystemExit(f"{what} is {distance:.2g} off in C: a comparison would mean nothing")
    return distance


class Plants:
    """Our fleet, moved by given torques (ticks, robots, 2)."""

    def __init__(self, simulation: cosim.Simulation, torques: NDArray[np.float64]) -> None:
        setup = simulation.setup
        robots = (setup.leader, *setup.followers)
        start = [dict(zip(OUTPUTS, robot.pose, strict=False)) for robot in robots]
        ticks = len(torques)
        job = Job(str(setup.leader.fmu.path), start, torques[0].tolist(), simulation.scenario.step, ticks)
        self._fleet = Ours(job)
        self._fleet.given[:] = torques.reshape(ticks, -1)
        self.states = self._fleet.out
        self.run = lambda: self._fleet.run(ticks)

    def close(self) -> None:
        self._fleet.fleet.close()


class LawTeam:
    """The law of a run with a large team of its followers, and what it gets at each tick."""

    def __init__(self, simulation: cosim.Simulation, loop: LoopInC) -> None:
        setup = simulation.setup
        followers = np.arange(TEAM) % min(loop.n, 4)
        self.measured = np.ascontiguousarray(loop.measured[:, followers])
        self.leader = np.ascontiguousarray(loop.states[:, 0])
        self.desired = np.ascontiguousarray(loop.desired[0, followers])
        self.expected = loop.telemetry["torque_command"][:, followers]
        self.commands = {way: np.full((loop.samples, TEAM, 2), np.nan) for way in WAYS}
        (law,) = setup.laws.values()
        self._controller = law.controller_type(
            fc.Team(setup.followers[0].vehicle, TEAM, simulation.scenario.step), setup.gains[0]
        )
        self._desired = fc.Desired(*(np.ascontiguousarray(self.desired[name]) for name in DESIRED.names or ()))
        self._leaders = [fc.Leader(state["pose"].copy(), state["velocity"].copy()) for state in self.leader]

    def start(self) -> None:
        self._controller.start(self.measured[0], self._leaders[0], self._desired)

    def run(self) -> None:
        for pose, leader, commands in zip(self.measured, self._leaders, self.commands["ours"], strict=True):
            commands[:] = self._controller.step(pose, leader, self._desired)


def check_result(result: Any, loop: LoopInC) -> dict[str, float]:
    """Return by how much each variable of a result differs in C."""
    ours = {str(name): variable.values for name, variable in result.data_vars.items()}
    in_c = loop.variables()
    if ours.keys() != in_c.keys():
        raise SystemExit(f"a result holds other variables than are recorded in C: {sorted(ours.keys() ^ in_c.keys())}")
    return {name: apart(ours[name], in_c[name], name) for name in ours}


def measure(followers: int, samples: int, rounds: int, folder: Path) -> tuple[Times, Differences, list[float]]:
    """Return the times of all parts, how far apart all numbers are, and the seconds of our first ticks."""
    scenario = cosim.read_scenario(team_scenario(followers, samples - 1, folder))
    with cosim.Simulation(scenario) as simulation:  # the run that is compared, and a warm-up
        loops = {"C": LoopInC(compiled(), simulation)}
        if functions := own_functions(simulation.setup.leader.fmu.path):
            loops[OWN] = LoopInC(compiled(functions), simulation)
        differences: Differences = {}
        result = simulation.run()
        for way, loop in loops.items():
            loop.run()
            loop.derive()
            differences[way] = check_result(result, loop)
        alike = loops.get(OWN, loops["C"])  # calls the functions that ours calls
        law = LawTeam(simulation, alike)
    torques = np.ascontiguousarray(alike.torques[:-1])
    moved = np.full((samples - 1, 1 + followers), np.nan, STATE)
    times: Times = {}

    def take(part: str, way: str, action: Callable[[], object], count: int = followers * samples) -> float:
        times.setdefault((part, way), []).append(cpu(action) / count)
        return times[part, way][-1]

    c, first = loops["C"], []
    for _ in range(rounds):
        with cosim.Simulation(scenario) as simulation:
            take(LOOP, "ours", simulation.run)
            times[LOOP, "ours"][-1] -= take(RESULT, "ours", simulation.result)
            first.append(simulation.timing.get("first tick", 0.0))
            plants = Plants(simulation, torques)
        take(PLANTS, "ours", plants.run)
        law.start()
        take(LAW, "ours", law.run, law.measured[..., 0].size)
        for _ in range(IN_TURN):
            for way, loop in loops.items():
                take(LOOP, way, loop.run)
            take(RESULT, "C", c.derive)
            take(PLANTS, "C", lambda: c.plants_alone(torques, moved))
            given = (law.desired, law.measured, law.leader, law.commands["C"])
            take(LAW, "C", lambda: c.law_alone(*given), law.measured[..., 0].size)  # noqa: B023
        plants.close()
    expected = alike.states[1:].view(float).reshape(plants.states.shape)
    for way, states in (("ours", plants.states), ("C", moved.view(float).reshape(expected.shape))):
        differences[f"parts alone, {way}"] = {
            PLANTS: apart(states, expected, f"the motion of the {PLANTS}, {way},"),
            LAW: apart(law.commands[way], law.expected, f"the commands of the {LAW}, {way},"),
        }
    return times, differences, first


def summed_up(times: Times) -> dict[str, dict[str, dict[str, float]]]:
    """Return minimum and median of each part in ns, by ours and C, and their ratios."""
    table: dict[str, dict[str, dict[str, float]]] = {part: {} for part in (LOOP, PLANTS, LAW, REST, RESULT)}
    for (part, way), own in times.items():
        table[part][way] = {"min": 1e9 * min(own), "median": 1e9 * statistics.median(own)}
    for own in table.values():
        for way in [way for way in own if way != "ours"]:
            own[f"ours to {way}"] = {name: own["ours"][name] / time for name, time in own[way].items()}
    table[REST]["ours"] = {
        name: time - sum(table[part]["ours"][name] for part in (PLANTS, LAW))
        for name, time in table[LOOP]["ours"].items()
    }
    return table


def print_agreement(differences: Differences) -> None:
    for way, own in differences.items():
        equal = sum(off == 0.0 for off in own.values())
        worst = max(own, key=own.__getitem__)
        told = f", the others to rounding: {worst} to {own[worst]:.1g}" if own[worst] else ""
        print(f"{way}: {equal} of {len(own)} arrays equal to the bit{told}")


def print_table(table: dict[str, dict[str, dict[str, float]]]) -> None:
    columns = list(table[LOOP])
    print("\nCPU time per follower and tick [ns], the leader's included\n")
    print(f"{'':20}" + "".join(f"{column:>26}" for column in columns))
    print(f"{'':20}" + f"{'min':>15}{'median':>11}" * len(columns))
    for part, own in table.items():
        cells = ""
        for column in columns:
            digits = 1 if "to" in column.split() else 0
            low, middle = (f"{own[column][name]:.{digits}f}" if column in own else "" for name in ("min", "median"))
            cells += f"{low:>15}{middle:>11}"
        print(f"{part:20}{cells}".rstrip())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--followers", type=int, nargs="*", default=[4, 100, 1000])
    parser.add_argument("--rounds", type=int, help="how often ours and C take turns")
    parser.add_argument("--ticks", type=int, help="how many a run has")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all of it there, too")
    options = parser.parse_args()
    out = {}
    with tempfile.TemporaryDirectory() as folder:
        measure(4, 10, 1, Path(folder))  # so that Numba has compiled everything
        for followers in options.followers:
            ticks, rounds = RUNS[max(least for least in RUNS if least <= followers)]
            samples = options.ticks or ticks
            times, differences, first = measure(followers, samples, options.rounds or rounds, Path(folder))
            table = summed_up(times)
            print(f"\n{followers} followers, {samples} ticks\n")
            print_agreement(differences)
            print_table(table)
            tick, of_it = 1e-3 * followers * table[LOOP]["ours"]["min"], 1e9 * min(first) / samples / followers
            print(f"a tick of our loop takes {tick:.2f} us; the first tick is {of_it:.0f} ns of {LOOP!r}, by the clock")
            out[followers] = {"ticks": samples, "nanoseconds": table, "apart": differences, "first tick": first}
    if options.json:
        options.json.write_text(json.dumps(out, indent=1) + "\n")


if __name__ == "__main__":
    main()
