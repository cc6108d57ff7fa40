"""How long a scenario of 200 lines takes to read and validate, as a ratio to lxml parsing the same text.

python benchmarks/read_scenario.py
"""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from lxml import etree

from cosim.scenario.reader import read_scenario

SCENARIO = Path(__file__).parents[1] / "scenarios" / "ten_followers.xml"
LINES = 200
REPEATS = 100


def grown() -> str:
    """Return the scenario with events until it has 200 lines."""
    lines = SCENARIO.read_text(encoding="utf-8").splitlines()
    place = next(i for i, line in enumerate(lines) if "<expect>" in line)
    event = ['  <event at="1 s" robots="follower_1">', '    <parameter name="m_c" value="31 kg"/>', "  </event>"]
    while len(lines) < LINES:
        lines[place:place] = event
    return "\n".join(lines)


def best(function: Callable[[], object]) -> float:
    """Return the least time of a call [s]."""
    times = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        function()
        times.append(time.perf_counter() - started)
    return min(times)


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scenario.xml"
        path.write_text(grown(), encoding="utf-8")
        read_scenario(path)  # the schema is compiled once a process
        read, parse = best(lambda: read_scenario(path)), best(lambda: etree.parse(path))
    print(f"lines: at least {LINES}")
    print(
        f"read and validated: {read * 1e3:.2f} ms, {read / parse:.0f} times lxml's parsing alone ({parse * 1e3:.3f} ms)"
    )


if __name__ == "__main__":
    main()
