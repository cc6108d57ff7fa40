"""Digests of the results of all scenarios, which every machine has to reproduce to the last bit.

    python tests/same_bits.py            compares shortened runs with tests/same_bits.txt, as the tests do
    python tests/same_bits.py --full     compares whole runs with tests/same_bits_full.txt
    python tests/same_bits.py --renew    writes the file anew, after a change that is meant to alter numbers
    python tests/same_bits.py --list     prints what would be written

A line of a file: scenario, variable, the first 16 digits of the SHA-256 of its bytes.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

import cosim

ROOT = Path(__file__).parent.parent
HORIZON = 1.0
"""Of a shortened run [s]; the first second holds the start of every law, plant, sensor, actuator and signal."""


def kept(full: bool) -> Path:
    """Return the file that keeps the digests."""
    return Path(__file__).with_name("same_bits_full.txt" if full else "same_bits.txt")


def digests(scenario: Path, horizon: float | None = HORIZON) -> Iterator[tuple[str, str, str]]:
    """Yield scenario, variable and digest for each numeric variable of a run."""
    read = cosim.read_scenario(scenario)
    result = cosim.run(read if horizon is None else read.edited(horizon=horizon, expectations=False))
    for name, variable in sorted(result.variables.items()):
        values = np.ascontiguousarray(variable.values)
        if values.dtype.kind in "fiub":
            yield scenario.stem, str(name), hashlib.sha256(values.tobytes()).hexdigest()[:16]


def differences(found: Iterable[tuple[str, str, str]], file: Path) -> list[str]:
    """Return the variables of a file that the scenarios found do not have, or with other digests."""
    digest = {(scenario, name): digest for scenario, name, digest in found}
    run = {scenario for scenario, _ in digest}
    kept = map(str.split, file.read_text().splitlines())
    return [
        f"{scenario}: {name}" for scenario, name, d in kept if scenario in run and digest.get((scenario, name)) != d
    ]


def main() -> int:
    """Compare or renew."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--full", action="store_true", help="run the scenarios up to their own horizons")
    parser.add_argument("--renew", action="store_true", help="write the file instead of comparing with it")
    parser.add_argument("--list", action="store_true", help="print the digests instead of comparing them")
    parser.add_argument("--horizon", type=float, default=HORIZON, help=argparse.SUPPRESS)
    parser.add_argument("scenarios", nargs="*", type=Path, help="all of the project's if left out")
    options = parser.parse_args()
    paths = options.scenarios or sorted((ROOT / "scenarios").glob("*.xml"))
    found = [line for path in paths for line in digests(path, None if options.full else options.horizon)]
    text = "".join(f"{' '.join(line)}\n" for line in found)
    if options.renew:
        kept(options.full).write_text(text)
    if options.list:
        print(text, end="")
    if options.renew or options.list:
        return 0
    different = differences(found, kept(options.full))
    print(*different, f"{len(found) - len(different)} of {len(found)} variables are the same", sep="\n")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
