"""Compares whole runs in other masters with ours: ``python -m tests.elsewhere`` from the root.

1. The loop of plants and team FMUs, closed by FMPy, for every scenario, with FMI 2.0 and 3.0.
2. The SSPs of some scenarios in libcosim, ecos and FMPy, against our run with one sample of delay in the actuators;
   and what ``formation import`` makes of them, run again.

The tables show the worst difference of a scenario, and over how many steps. Exit status 1: a difference is beyond its
limit, or a master is not installed (extra ``bench``).
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import xarray as xr

import cosim
from cosim.scenario.reader import read_scenario
from cosim.scenario.scenario import Scenario
from cosim.ssp.imported import import_ssp
from tests.ssp_masters import MASTERS, Exported, apart, written
from tests.team_loop import closed_loop, courses, make_fmus, slaves

SCENARIOS = Path(__file__).parents[1] / "scenarios"
TEAMS = tuple(sorted(path.stem for path in SCENARIOS.glob("*.xml")))
SYSTEMS = ("clmr_line", "tractor_trailer_circle", "mixed_team")
FMI = ("2.0", "3.0")
TEAM_LIMIT, SYSTEM_LIMIT, SAME = 1e-12, 1e-9, 0.0
"""Upper limits for the worst difference of team FMUs, of SSPs, and of a scenario that came back from its SSP."""


def teams_apart(scenario: Scenario, ours: xr.Dataset, fmi: str, folder: Path) -> float:
    """Return the worst difference of a loop that FMPy closes with the team FMUs of a scenario."""
    with ExitStack() as cleanup:
        made = make_fmus(scenario, cleanup, folder, fmi)
        result = closed_loop(made, slaves(made, folder), folder, scenario.ticks)
        return max(apart(theirs, own) for _, theirs, own in courses(result, ours, made.setup))


def back_apart(exported: Exported, folder: Path) -> float:
    """Return the worst difference of all recorded numbers of a scenario and of what comes back from its SSP."""
    back = read_scenario(written(import_ssp(exported.path, folder / f"{exported.scenario.name}.xml")))
    ours, theirs = cosim.run(exported.scenario), cosim.run(back.edited(expectations=False))
    numbers = {str(name) for name, variable in ours.variables.items() if variable.dtype.kind in "fiub"}
    if numbers - {str(name) for name in theirs.variables}:
        return np.inf
    return max(apart(theirs[name].values.astype(float), ours[name].values.astype(float)) for name in numbers)


class Table:
    """A table in Markdown whose rows are printed as they come, and whether all numbers keep their limits."""

    def __init__(self, limits: dict[str, float]) -> None:
        self._limits, self.holds = limits, True
        head = [f"{name}, at most {limit:g}" for name, limit in limits.items()]
        print(f"\n| scenario | steps | {' | '.join(head)} |\n|{'---|' * (len(head) + 2)}", flush=True)

    def row(self, scenario: Scenario, differences: Iterable[float | str]) -> None:
        """Print the differences of a scenario, or the reasons why there are none."""
        cells = []
        for difference, limit in zip(differences, self._limits.values(), strict=True):
            bad = isinstance(difference, str) or not difference <= limit
            self.holds &= not bad
            text = difference if isinstance(difference, str) else f"{difference:.2g}"
            cells.append(f"**{text}**" if bad else text)
        print(f"| `{scenario.name}` | {scenario.ticks} | {' | '.join(cells)} |", flush=True)


def _scenario(name: str, horizon: float | None) -> Scenario:
    read = read_scenario(SCENARIOS / f"{name}.xml")
    return read.edited(horizon=horizon or read.horizon, expectations=False)


def teams(names: Sequence[str], horizon: float | None) -> bool:
    """Compare the loops of plants and team FMUs; return whether the limits hold."""
    table = Table({f"FMI {fmi}": TEAM_LIMIT for fmi in FMI})
    for name in names:
        scenario = _scenario(name, horizon)
        ours = cosim.run(scenario)
        differences = []
        for fmi in FMI:
            with tempfile.TemporaryDirectory(prefix="elsewhere-") as folder:
                differences.append(teams_apart(scenario, ours, fmi, Path(folder)))
        table.row(scenario, differences)
    return table.holds


def systems(names: Sequence[str], horizon: float | None) -> bool:
    """Compare the SSPs in other masters; return whether the limits hold."""
    table = Table({**dict.fromkeys(MASTERS, SYSTEM_LIMIT), "imported again": SAME})
    for name in names:
        with tempfile.TemporaryDirectory(prefix="elsewhere-") as folder:
            exported = Exported(_scenario(name, horizon), Path(folder))
            differences: list[float | str] = []
            for master in MASTERS.values():
                try:
                    differences.append(exported.apart(master(exported)))
                except (ImportError, OSError) as error:
                    differences.append(str(error).splitlines()[0])
            table.row(exported.scenario, [*differences, back_apart(exported, Path(folder))])
    return table.holds


def main() -> int:
    """Compare, and print the tables."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.elsewhere", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scenarios", nargs="*", metavar="SCENARIO", help="all of the project's if left out")
    parser.add_argument("--horizon", type=float, help="end of the runs [s] instead of the scenarios' own")
    options = parser.parse_args()
    if unknown := set(options.scenarios) - set(TEAMS):
        parser.error(f"there is no scenario {', '.join(sorted(unknown))}; there are {', '.join(TEAMS)}")
    os.environ["FORMATION_REQUIRE_MASTERS"] = "1"
    names = options.scenarios or TEAMS
    holds = [teams(names, options.horizon), systems([n for n in SYSTEMS if n in names], options.horizon)]
    return 0 if all(holds) else 1


if __name__ == "__main__":
    sys.exit(main())
