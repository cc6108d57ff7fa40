"""Where the time of one `formation run` goes, from a cold interpreter with warm caches.

    python benchmarks/profile_run.py [SCENARIO.xml] [--runs N]

Every run is a process of its own, with the figure and without in turn, after one of each that is not counted. Its parts
are those of --timing, with what comes before, between and after. Figures are medians, each part's own, so they need not
sum up to the whole. Imports by package come from another run, with -X importtime: a package's own modules alone.
"""

import argparse
import re
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

SCENARIO = Path(__file__).parents[1] / "scenarios" / "clmr_line.xml"
RUN = """
import sys, time
begin = time.perf_counter()
from cosim.cli import entry
imported = time.perf_counter()
try:
    entry()
finally:
    print("clocks", imported - begin, time.perf_counter() - imported, file=sys.stderr)
"""
PACKAGES = 12
WHOLE = "whole process"


def process(*arguments: str) -> tuple[float, subprocess.CompletedProcess[str]]:
    """Run Python and return its duration [s] and its output."""
    begin = time.perf_counter()
    result = subprocess.run([sys.executable, *arguments], capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - begin
    if result.returncode not in (0, 1):  # 1: an expectation does not hold
        raise SystemExit(f"the run has failed:\n{result.stderr}")
    return seconds, result


def parts_of(scenario: Path, folder: str, *, figure: bool) -> dict[str, float]:
    """Return the parts of one run [s]."""
    start, _ = process("-c", "pass")
    more = () if figure else ("--no-figure",)
    whole, result = process("-c", RUN, "run", str(scenario), "--timing", "--out", folder, *more)
    rows = re.findall(r"^ *(\S.*?\S) {2,}([\d.]+) *$", result.stdout.rpartition("seconds")[2], re.MULTILINE)
    timing = {name: float(seconds) for name, seconds in rows}
    total, imports = timing.pop("total"), timing.pop("imports")
    if "first tick" in timing:
        timing["loop"] -= timing["first tick"]
    command_line, inside = (float(clock) for clock in result.stderr.rpartition("clocks")[2].split())
    return {
        "interpreter start": start,
        "imports of the command line": command_line,
        "imports": imports,
        "reading the scenario": inside - total,
        **timing,
        "all else": total - imports - sum(timing.values()),
        "end of the process": whole - start - command_line - inside,
        WHOLE: whole,
    }


def import_times(scenario: Path, folder: str) -> Counter[str]:
    """Return the microseconds that the import of each package's own modules takes in one run."""
    _, result = process("-X", "importtime", "-c", RUN, "run", str(scenario), "--out", folder)
    own: Counter[str] = Counter()
    for microseconds, name in re.findall(r"^import time: +(\d+) \| +\d+ \| +(\S+)$", result.stderr, re.MULTILINE):
        package = name.partition(".")[0]
        own["standard library" if package in sys.stdlib_module_names else package] += int(microseconds)
    return own


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario", nargs="?", type=Path, default=SCENARIO)
    parser.add_argument("--runs", type=int, default=7)
    options = parser.parse_args()
    kinds = {"with the figure": True, "--no-figure": False}
    runs: dict[str, list[dict[str, float]]] = {kind: [] for kind in kinds}
    with tempfile.TemporaryDirectory() as folder:
        for count in range(options.runs + 1):
            for kind, figure in kinds.items():
                parts = parts_of(options.scenario, folder, figure=figure)
                if count > 0:
                    runs[kind].append(parts)
        imports = import_times(options.scenario, folder)

    medians = {
        kind: {part: statistics.median(run[part] for run in own) for part in own[0]} for kind, own in runs.items()
    }
    print(f"{options.scenario.name}, medians of {options.runs} runs [s]\n")
    print(f"{'':30}" + "".join(f"{kind:>24}" for kind in kinds))
    for part in next(iter(medians.values())):
        cells = ""
        for own in medians.values():
            cells += f"{own[part]:>17.3f}{own[part] / own[WHOLE]:>7.1%}" if part in own else f"{'-':>24}"
        print(f"{part:30}{cells}")
    whole = [run[WHOLE] for run in runs["--no-figure"]]
    verdict = "holds" if statistics.median(whole) <= 2.5 else "not held"
    print(f"\n{verdict}: at most 2.5 s with figures off; {min(whole):.2f} to {max(whole):.2f} s")

    total = imports.total()
    print(f"\nimports by package, all of a run with the figure, as -X importtime tells: {total * 1e-6:.3f} s\n")
    for name, microseconds in imports.most_common(PACKAGES):
        print(f"{name:30}{microseconds * 1e-6:>17.3f}{microseconds / total:>7.1%}")


if __name__ == "__main__":
    main()
