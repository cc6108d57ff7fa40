"""What checkpoints cost a run: the same run without and with them, in turns.

    pip install -e controllers -e .
    python benchmarks/checkpoints.py [--every TIME] [--rounds N] [--horizon TIME] [SCENARIO...]

Printed for each scenario are the time of the loop by the clock, and the CPU time of its thread and of the whole
process, each with checkpoints as a multiple of that without, and how many were written. A ratio is that of the least
times of all rounds, and in brackets the median of the ratios of the rounds: the machine may be busy. The records must
be the same to the bit. The thread that writes is part of the process, not of the loop; the loop waits for it at its
end. A run that is shorter than a second writes none, and the ratio is that of what watches for them alone: a longer
``--horizon``, or a machine that is slower, shows those that are written. ``--every`` does not: none lies less than a
second after another one.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from cosim.cli.checkpointing import every_of
from cosim.master.checkpoint_folder import ticks_in
from cosim.master.checkpoints import Checkpoints
from cosim.master.interrupt import HeldSignals
from cosim.master.origin import Origin
from cosim.master.setup import set_up
from cosim.master.simulation import Simulation
from cosim.scenario.reader import read_scenario
from cosim.scenario.scenario import Scenario

HERE = Path(__file__).parent
SCENARIOS = ("clmr_line", "ten_followers", "mixed_team")
CLOCKS = {"clock": time.perf_counter, "thread": time.thread_time, "process": time.process_time}


def run(scenario: Scenario, every: int | None) -> tuple[list[float], int, list[bytes]]:
    """Run the loop; return what each clock says, how many checkpoints there are, and the records."""
    with ExitStack() as ending:
        setup = set_up(scenario, ending, {})
        folder = Path(ending.enter_context(tempfile.TemporaryDirectory()))
        checkpoints = None if every is None else Checkpoints(folder, Origin.of(scenario, setup), every)
        simulation = ending.enter_context(Simulation(scenario, setup, checkpoints=checkpoints))
        simulation.step()  # may compile
        began = [clock() for clock in CLOCKS.values()]
        with HeldSignals() as signals:
            simulation.record(signals)
        spent = [clock() - start for clock, start in zip(CLOCKS.values(), began, strict=True)]
        places = simulation._ticks.recorder.numbers(0, scenario.ticks + 1)
        count = sum(tick > 0 for tick in ticks_in(folder))  # besides that of the start
        return spent, count, [np.ascontiguousarray(place).tobytes() for place in places]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenarios", nargs="*", default=SCENARIOS, help="names of scenarios that come with Formation")
    parser.add_argument("--every", default="10s")
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--horizon", default="2000 s")
    options = parser.parse_args()
    for name in options.scenarios:
        scenario = read_scenario(HERE.parent / "scenarios" / f"{name}.xml")
        scenario = scenario.edited(horizon=options.horizon, expectations=False)
        every = every_of(f"every={options.every}", scenario)
        run(scenario, every)
        rounds = []
        for _ in range(options.rounds):
            without, with_them = run(scenario, None), run(scenario, every)
            assert without[2] == with_them[2], "checkpoints have changed the run"
            rounds.append((without[0], with_them[0], with_them[1]))
        told = []
        for place, clock in enumerate(CLOCKS):
            pairs = [(one[place], other[place]) for one, other, _ in rounds]
            least = min(other for _, other in pairs) / min(one for one, _ in pairs)
            told.append(f"{clock} {least:.3f} ({statistics.median(other / one for one, other in pairs):.3f})")
        taken = min(one[0] for one, _, _ in rounds)
        count = statistics.median(written for *_, written in rounds)
        print(
            f"{name}: loop {taken * 1e3:.1f} ms; with {count:g} checkpoints: {', '.join(told)} times that", flush=True
        )


if __name__ == "__main__":
    main()
