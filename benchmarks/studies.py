"""A study against the same prepared runs without one: CPU time, runs a second, and memory of its processes.

    pip install -e controllers -e .
    python benchmarks/studies.py [--runs N] [--workers N...] [--rounds N] [--json FILE]

The study is Monte Carlo on scenarios/clmr_line.xml: every run has another seed, mass, damping and start of a follower,
and is judged. Each number of workers is `formation study --workers N` from its start to its files, without the figure.
The runs without a study are one process that prepares the scenario and makes all of them, with the margins of the
expectations as a list in the end. Both take turns, and have the same margins, bit for bit.

1. CPU time of all processes from their start to their end, with imports; and how much of a study's does not depend on
   the number of runs, by a study of a tenth of them.
2. Runs a second by the clock, from the first rows to the last ones.
3. The memory of each worker, and of the command, after a tenth of the runs and after all.
"""

import argparse
import csv
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from teams import SCENARIO

import cosim
from cosim.scenario.grammar import NAMESPACE
from cosim.studies.plan import Plan
from cosim.studies.reader import read_study

STUDY = f"""<study xmlns="{NAMESPACE}" name="throughput" of="{{of}}">
  <title>Mass, damping, start and noise</title>
  <vary name="mass" select="plant/parameter[@name='m_c']/@value"><uniform from="20 kg" to="40 kg"/></vary>
  <vary name="damping" select="plant/parameter[@name='d_x']/@value"><uniform from="15 N.s/m" to="35 N.s/m"/></vary>
  <vary name="start" select="follower[1]/pose/@y"><uniform from="-2 m" to="2 m"/></vary>
  <vary name="seed" select="simulation/@seed"><count from="1"/></vary>
  <sample method="random" runs="{{runs}}"/>
</study>
"""
LOOK = 0.1
"""Time [s] between looks at the processes of a study."""


def write_study(folder: Path, runs: int) -> Path:
    path = folder / "throughput.xml"
    path.write_text(STUDY.format(of=SCENARIO.as_posix(), runs=runs), encoding="utf-8")
    return path


def least_margins(verdicts: Sequence[cosim.Verdict]) -> list[float]:
    """Return the least margin over the robots of each expectation, as the table of a study has it."""
    least: dict[object, float] = {}
    for verdict in verdicts:
        margin = -math.inf if math.isnan(verdict.margin) else verdict.margin
        least[verdict.where] = min(least.get(verdict.where, math.inf), margin)
    return list(least.values())


def without_a_study(path: Path) -> None:
    """Make all runs of a study in this process, and print the margins of their expectations."""
    study = read_study(path)
    (scenario,) = study.bases.values()
    margins = []
    with cosim.Prepared(scenario) as prepared:
        for run in Plan(study):
            outcome = prepared.run(run.changes)
            margins.append(None if outcome.failure else least_margins(outcome.verdicts))
    json.dump(margins, sys.stdout)


def cpu_of(process: subprocess.Popen[bytes]) -> float:
    """Wait for a process; return the CPU time [s] of it and all that it has waited for."""
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{process.args} ended with status {process.returncode}")
    return usage.ru_utime + usage.ru_stime


def prepared(path: Path) -> tuple[float, list[Any]]:
    """Return the CPU time [s] of all runs without a study, and their margins."""
    with tempfile.TemporaryFile() as file:
        process = subprocess.Popen([sys.executable, __file__, "--without", str(path)], stdout=file)
        spent = cpu_of(process)
        file.seek(0)
        return spent, json.load(file)


class Watch:
    """How far a study is, and what its processes take, as it is seen from outside.

    Attributes
    ----------
    rows : list of (float, int)
        Times [s] with the number of rows then.
    early, late : dict of float
        Memory [MB] of each process that was there, after a tenth of the runs and at the last look.
    """

    def __init__(self, command: int, rows: Path, runs: int) -> None:
        self._command, self._path, self._runs = command, rows, runs
        self.rows: list[tuple[float, int]] = []
        self.early: dict[int, float] = {}
        self.late: dict[int, float] = {}

    def look(self) -> None:
        done = self._path.read_bytes().count(b"\n") - 1 if self._path.exists() else 0
        if done > 0 and (not self.rows or done > self.rows[-1][1]):
            self.rows.append((time.perf_counter(), done))
        memory = dict(self._memory())
        if 10 * done >= self._runs:
            self.early = {**memory, **self.early}
        if 0 < done < self._runs:
            self.late |= memory

    def _memory(self) -> Iterator[tuple[int, float]]:
        """Yield what the command and its workers have in memory [MB]."""
        workers = Path(f"/proc/{self._command}/task").glob("*/children")
        for process in (self._command, *(int(pid) for path in workers for pid in path.read_text().split())):
            try:
                if process == self._command or b"cosim.studies.worker" in Path(f"/proc/{process}/cmdline").read_bytes():
                    pages = int(Path(f"/proc/{process}/statm").read_text().split()[1])
                    yield process, pages * os.sysconf("SC_PAGE_SIZE") / 2**20
            except (OSError, IndexError):  # it has ended
                continue


def studied(path: Path, runs: int, workers: int, out: Path) -> tuple[float, Watch, list[Any]]:
    """Make a study, or the first of its runs; return its CPU time [s], what was seen, and the margins."""
    command = ["study", str(path), "--workers", str(workers), "--runs", str(runs), "--no-figure", "--out", str(out)]
    process = subprocess.Popen([sys.executable, "-m", "cosim", *command], stdout=subprocess.DEVNULL)
    watch = Watch(process.pid, out / "throughput" / "rows.jsonl", runs)
    while os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None:
        watch.look()
        time.sleep(LOOK)
    spent = cpu_of(process)
    with (out / "throughput" / "runs.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    names = [name for name in rows[0] if name.startswith("margin_")]
    return spent, watch, [None if row["status"] == "broken" else [float(row[name]) for name in names] for row in rows]


def rate_of(watch: Watch) -> float:
    """Return the runs a second between the first rows of workers and the last ones; NaN if all came at once."""
    times = watch.rows[1:] if watch.rows[0][1] == 1 else watch.rows  # the first run is made by the command
    if len(times) < 2:
        return float("nan")
    (begin, first), (end, last) = times[0], times[-1]
    return (last - first) / (end - begin)


@dataclass
class Measured:
    """What was measured of studies with so many workers: CPU times [s], runs a second, memory [MB] of each process."""

    whole: list[float] = field(default_factory=list)
    tenth: list[float] = field(default_factory=list)
    rates: list[float] = field(default_factory=list)
    early: list[float] = field(default_factory=list)
    late: list[float] = field(default_factory=list)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--workers", type=int, nargs="*", default=[1, 2, 4, 8])
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all of it there, too")
    parser.add_argument("--without", type=Path, metavar="STUDY.xml", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.without:
        without_a_study(options.without)
        return
    tenth = options.runs // 10
    prepared_times: list[float] = []
    of_workers = {workers: Measured() for workers in options.workers}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = write_study(folder, options.runs)
        studied(path, 1, 1, folder / "first")  # builds and compiles what this machine has not
        for turn in range(options.rounds):
            for workers, measured in of_workers.items():
                spent, margins = prepared(path)
                prepared_times.append(spent)
                if tenth:
                    spent, _, own = studied(path, tenth, workers, folder / f"tenth {workers} {turn}")
                    measured.tenth.append(spent)
                    assert own == margins[:tenth], "the runs of the study are other ones"
                spent, watch, own = studied(path, options.runs, workers, folder / f"whole {workers} {turn}")
                measured.whole.append(spent)
                assert own == margins, "the runs of the study are other ones"
                measured.rates.append(rate_of(watch))
                there = [process for process in watch.late if process in watch.early]
                measured.early = [watch.early[process] for process in there]
                measured.late = [watch.late[process] for process in there]

    base = min(prepared_times)
    print(f"{options.runs} runs of {SCENARIO.name}, judged; {os.cpu_count()} processors\n")
    print(f"without a study, one process: {base:.1f} s of CPU, {1e3 * base / options.runs:.1f} ms a run, all in")
    for workers, measured in of_workers.items():
        whole = min(measured.whole)
        print(
            f"{workers} workers: {whole:.1f} s of CPU, {whole / base - 1:+.0%}; {min(measured.rates):.1f} runs a second"
        )
        if tenth:
            each = (whole - min(measured.tenth)) / (options.runs - tenth)
            print(f"   {whole - each * options.runs:.1f} s whatever the runs, and {1e3 * each:.1f} ms a run")
        print(f"   memory after a tenth: {_shown(measured.early)}; after all: {_shown(measured.late)}")
    if options.json:
        told = {"prepared": prepared_times, "workers": {key: vars(own) for key, own in of_workers.items()}}
        options.json.write_text(json.dumps(told, indent=1) + "\n")


def _shown(memory: list[float]) -> str:
    command, *workers = memory or [float("nan")]
    return f"command {command:.0f} MB, workers {', '.join(f'{own:.0f}' for own in workers) or 'none'} MB"


if __name__ == "__main__":
    main()
