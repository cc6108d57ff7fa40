"""The long run: ``python -m tests.fuzz --runs 10000 --seed 1`` from the root; exit status 1 if a case fails."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

from tests.fuzz.fuzz import BATCH, CASES, batch, run_limited
from tests.fuzz.seeds import seeds
from tests.stub.stub import make_fmu


def main() -> int:
    """Run cases of all kinds, or of one."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--runs", type=int, default=10_000, help="number of cases of each kind (10000)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the first case; a failure names its own (1)")
    parser.add_argument("--only", choices=list(CASES), help="one kind of case")
    options = parser.parse_args()
    failures = 0
    with tempfile.TemporaryDirectory(prefix="fuzz-") as name:
        folder = Path(name)
        (folder / "seeds").mkdir()
        for number, data in enumerate(seeds(partial(make_fmu, folder))):
            (folder / "seeds" / f"{number}.fmu").write_bytes(data)
        for kind in [options.only] if options.only else CASES:
            started = time.monotonic()
            for first in range(options.seed, options.seed + options.runs, BATCH):
                last = min(first + BATCH, options.seed + options.runs)
                for line in run_limited(kind, range(first, last), folder):
                    failures += 1
                    print(line, flush=True)
            print(f"{options.runs} {kind} in {time.monotonic() - started:.0f} s", flush=True)
    print(f"{failures} failures")
    return min(failures, 1)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--batch"]:
        batch(sys.argv[2], int(sys.argv[3]), int(sys.argv[4]), Path(sys.argv[5]))
    else:
        sys.exit(main())
