"""Runs cases: each is a seed, which makes its input; limits of time and memory hold for each."""

from __future__ import annotations

import random
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

from cosim.errors import FormationError, InputError
from cosim.fmu.vehicle import open_fmu
from cosim.master.setup import set_up
from cosim.scenario.reader import read_scenario
from tests.fuzz import mutations
from tests.fuzz.calls import calls_case, warm
from tests.fuzz.files import files_case
from tests.fuzz.files import warm as warm_files
from tests.fuzz.hosts import hosts_case
from tests.fuzz.interrupts import interrupts_case

ROOT = Path(__file__).parents[2]
SECONDS = 2.0
"""CPU time of a case."""
BYTES = 1024**3
"""Memory that a batch may take beyond what its libraries take."""
BATCH = 500


def scenario_case(seed: int, folder: Path, _: tuple[bytes, ...]) -> None:
    """Read a mutated scenario, and set it up now and then; raise whatever is no proper refusal."""
    rng = random.Random(seed)
    files = sorted((ROOT / "scenarios").glob("*.xml"))
    text = rng.choice(files).read_text(encoding="utf-8")
    (folder / "base.xml").write_text(rng.choice(files[:3]).read_text(encoding="utf-8"), encoding="utf-8")
    path = folder / "case.xml"
    path.write_bytes(mutations.scenario(text, rng))
    changes = [mutations.setting(rng)] if rng.random() < 0.2 else []

    def read() -> None:
        scenario = read_scenario(path, changes)
        if seed % 10 == 0:
            with ExitStack() as cleanup:
                set_up(scenario, cleanup, {})

    _refused(read)


def fmu_case(seed: int, folder: Path, fmus: tuple[bytes, ...]) -> None:
    """Open a mutated FMU as a vehicle, without loading it; raise whatever is no proper refusal."""
    rng = random.Random(seed)
    path = folder / "case.fmu"
    path.write_bytes(mutations.archive(rng.choice(fmus), rng))
    _refused(lambda: open_fmu(path).close())


CASES: dict[str, Callable[[int, Path, tuple[bytes, ...]], None]] = {
    "scenarios": scenario_case,
    "fmus": fmu_case,
    "hosts": lambda *case: _refused(lambda: hosts_case(*case)),
    "files": files_case,
    "calls": calls_case,
    "interrupts": interrupts_case,
}


WARMED = {"calls": warm, "interrupts": warm, "files": warm_files}
"""What is loaded and made before the first case, so that none pays for it."""


def run(kind: str, seeds: range, folder: Path, fmus: tuple[bytes, ...]) -> Iterator[str]:
    """Run cases in this process; return a line for each that fails.

    A case that takes long is run again: the first one of its kind may have compiled functions for all that follow.
    """
    for seed in seeds:
        for again in (False, True):
            started = time.process_time()
            try:
                CASES[kind](seed, folder, fmus)
            except Exception as error:
                yield f"{kind} {seed}: {type(error).__name__}: {str(error)[:300]}"
                break
            if (took := time.process_time() - started) <= SECONDS:
                break
            if again:
                yield f"{kind} {seed}: takes {took:.1f} s"


def run_limited(kind: str, seeds: range, folder: Path) -> Iterator[str]:
    """Run cases in a process of their own, which limits of the system end, again from the case after a failure."""
    first = seeds.start
    while first < seeds.stop:
        command = [sys.executable, "-m", "tests.fuzz", "--batch", kind, str(first), str(seeds.stop), str(folder)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, errors="replace", check=False)
        *lines, last = done.stdout.splitlines() or [""]
        yield from (line for line in lines if not line.startswith("case "))
        if last == "done":
            return
        reached = next((int(line.split()[1]) for line in reversed([*lines, last]) if line.startswith("case ")), first)
        yield f"{kind} {reached}: ends the process with status {done.returncode}: {done.stderr[-300:]}"
        first = reached + 1


def batch(kind: str, first: int, last: int, folder: Path) -> None:
    """Run cases under limits of CPU time and memory, and print each before it runs, and what fails."""
    fmus = tuple(path.read_bytes() for path in sorted(folder.glob("seeds/*.fmu")))
    if kind in WARMED:
        WARMED[kind](folder)
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + BYTES, size + BYTES))
    for seed in range(first, last):
        print(f"case {seed}", flush=True)
        used = resource.getrusage(resource.RUSAGE_SELF)
        soft = int(used.ru_utime + used.ru_stime + 5 * SECONDS)
        resource.setrlimit(resource.RLIMIT_CPU, (soft, resource.RLIM_INFINITY))
        for line in run(kind, range(seed, seed + 1), folder, fmus):
            print(line, flush=True)
    print("done", flush=True)


def _refused(read: Callable[[], None]) -> None:
    """Demand that something works, or is refused in one sentence of sensible length."""
    try:
        read()
    except InputError as error:
        said = error.message
        if "\n" in said or len(said) > 12_000 or not said.strip():
            raise AssertionError(f"no sentence: {said[:300]!r}") from None
        if "Traceback" in said:
            raise AssertionError(f"a traceback in {said[:300]!r}") from None
    except FormationError as error:
        raise AssertionError(f"no refusal: {error}") from None
