"""Formation's harness: scenarios in, co-simulated formations of robots out.

>>> import cosim
>>> result = cosim.run("scenarios/clmr_line.xml")            # an xarray.Dataset

or step by step:

>>> with cosim.Simulation(cosim.read_scenario("scenarios/clmr_line.xml")) as simulation:
...     while not simulation.finished:
...         simulation.step()
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from cosim.errors import FormationError, InputError, OutputError, RunInterrupted, SimulationError
from cosim.scenario import Scenario, read_scenario

if TYPE_CHECKING:
    import xarray as xr

    from cosim.simulation import Simulation

__all__ = [
    "FormationError",
    "InputError",
    "OutputError",
    "RunInterrupted",
    "Scenario",
    "Simulation",
    "SimulationError",
    "read_scenario",
    "run",
]


def run(scenario: str | Path | Scenario, replacements: Iterable[str] = ()) -> xr.Dataset:
    """Run a scenario to its horizon and return the result.

    Parameters
    ----------
    scenario
        A scenario, or the path of its file.
    replacements
        ``XPATH=VALUE`` each, for a file; see `read_scenario`.

    Raises
    ------
    InputError
        The scenario is wrong or does not fit what is installed.
    SimulationError
        A plant or controller failed, or the motion diverged; its ``result`` holds everything up to then.
    RunInterrupted
        The user pressed Ctrl-C; likewise.
    """
    from cosim.simulation import Simulation

    if not isinstance(scenario, Scenario):
        scenario = read_scenario(scenario, replacements)
    with Simulation(scenario) as simulation:
        return simulation.run()


def __getattr__(
    name: str,
) -> object:  # the master's libraries take a second to import; a scenario needs none of them
    if name == "Simulation":
        from cosim.simulation import Simulation

        return Simulation
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
